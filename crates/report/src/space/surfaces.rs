//! Estimated surfaces of the touched solids, coloured by their distance from the true solid.

use anyhow::Result;
use nalgebra::Vector3;
use testbed::results::RECOMMENDED;
use testbed::space::run::SweptSolid;
use testbed::space::solid::Solid;
use testbed::space::surface::{SurfaceMesh, Vertex};

use super::Data;
use super::scores::MOST_ROWS;
use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::color::{Rgb, viridis};
use crate::style::{HAIRLINE_PX, INK, MUTED, plain};

/// Distances at the ends of the colour scale, which is logarithmic.
const SCALE_M: [f64; 2] = [1e-6, 1e-3];

/// Panels in a row, their height, and the distance of two rows.
const COLUMNS: usize = 3;
const PANEL_PX: f64 = 240.0;
const GAP_PX: f64 = 64.0;

/// Width of the view beside the surface, and its least width.
const MARGIN_MM: f64 = 1.0;
const LEAST_VIEW_MM: f64 = 8.0;

/// Pieces of the colour bar.
const BAR_STEPS: usize = 64;

/// Place of a distance from the true solid on the colour scale, from 0 to 1.
pub(super) fn share(distance_m: f64) -> f64 {
    let [least_m, most_m] = SCALE_M;
    (distance_m.clamp(least_m, most_m) / least_m).ln() / (most_m / least_m).ln()
}

/// Mean distance of the corners of each triangle from a solid (m).
pub(super) fn distances_m<'a>(mesh: &'a SurfaceMesh, solid: &'a Solid) -> impl Iterator<Item = f64> + use<'a> {
    let away_m: Vec<f64> = mesh.vertices.iter().map(|vertex| solid.distance_m(vertex.on.at.vector())).collect();
    mesh.triangles.iter().map(move |corners| corners.iter().map(|corner| away_m[*corner as usize]).sum::<f64>() / 3.0)
}

/// The surface of one solid in a parallel projection. Coordinates are in millimetres, across and upwards, from its middle.
struct View {
    title: String,
    /// Triangles with their colours, the farthest first.
    triangles: Vec<([(f64, f64); 3], Rgb)>,
    /// Curves of the true solid.
    curves: Vec<Vec<(f64, f64)>>,
}

/// Lays the figure out. `None` also if there are many groups.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let estimators = data.estimators();
    let shown = estimators.iter().find(|name| **name == RECOMMENDED).or(estimators.first());
    let Some(estimator) = shown.filter(|_| data.groups().len() <= MOST_ROWS) else { return Ok(None) };
    let mut views = Vec::new();
    let solids = data.run.solids();
    for group in data.groups() {
        views.extend(view(data, &solids, group, estimator)?);
    }
    if views.is_empty() {
        return Ok(None);
    }
    let note = format!("Estimator: {estimator}.");
    let rows = views.len().div_ceil(COLUMNS);
    let height_px = 36.0 + 52.0 + rows as f64 * PANEL_PX + (rows - 1) as f64 * GAP_PX;
    let paint = move |canvas: &Canvas| {
        let plot = Rect::inside(canvas, [64.0, 36.0, 130.0, 52.0]);
        for (row, frame) in views.chunks(COLUMNS).zip(plot.rows(&equal(rows), GAP_PX)) {
            for (view, frame) in row.iter().zip(frame.columns(&equal(COLUMNS), 66.0)) {
                view.paint(canvas, frame)?;
            }
        }
        let bar = Rect { left: plot.right + 96.0, right: plot.right + 112.0, bottom: plot.top + PANEL_PX, ..plot };
        paint_bar(canvas, bar)
    };
    Ok(Some(Picture::new(1200, height_px as u32, paint).noted(note)))
}

/// The largest surface of the solids of a group. `None` if no solid is known or none has a surface.
fn view(data: &Data, solids: &[SweptSolid<'_>], group: &str, estimator: &str) -> Result<Option<View>> {
    let mut largest: Option<(f64, SurfaceMesh, Solid)> = None;
    for swept in solids {
        let is_of_group = swept.trials.iter().any(|trial| trial.group == group);
        let Some(solid) = Solid::of_scene(swept.solid).filter(|_| is_of_group) else { continue };
        for mesh in objects(&data.surface(swept, estimator)?) {
            let area_m2 = mesh.area_m2();
            if area_m2 > largest.as_ref().map_or(0.0, |(largest_m2, ..)| *largest_m2) {
                largest = Some((area_m2, mesh, solid.clone()));
            }
        }
    }
    Ok(largest.map(|(_, mesh, solid)| View::new(plain(group), &mesh, &solid)))
}

/// The surface of each object alone. The whiskers touch a solid at several places, which a map tells apart as objects.
fn objects(mesh: &SurfaceMesh) -> Vec<SurfaceMesh> {
    let mut before = 0;
    let of_object = |vertices: &[Vertex]| {
        let range = before..before + vertices.len() as u32;
        before = range.end;
        let is_part = |[first, ..]: &&[u32; 3]| range.contains(first);
        let own = |corners: &[u32; 3]| corners.map(|corner| corner - range.start);
        SurfaceMesh { vertices: vertices.into(), triangles: mesh.triangles.iter().filter(is_part).map(own).collect() }
    };
    mesh.vertices.chunk_by(|a, b| a.object == b.object).map(of_object).collect()
}

impl View {
    /// The surface seen along its mean normal.
    fn new(title: String, mesh: &SurfaceMesh, solid: &Solid) -> Self {
        let mean = |of: fn(&Vertex) -> Vector3<f64>| {
            mesh.vertices.iter().map(of).sum::<Vector3<f64>>() / mesh.vertices.len() as f64
        };
        let middle = mean(|vertex| vertex.on.at.vector());
        let towards = mean(|vertex| vertex.on.normal).try_normalize(0.1).unwrap_or_else(Vector3::x);
        let pole = if towards.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
        let right = pole.cross(&towards).normalize();
        let up = towards.cross(&right);
        let flat = |at: Vector3<f64>| (1e3 * right.dot(&(at - middle)), 1e3 * up.dot(&(at - middle)));
        let depth = |corners: &[u32; 3]| {
            corners.iter().map(|corner| towards.dot(&mesh.vertices[*corner as usize].on.at.vector())).sum::<f64>()
        };
        let mut by_depth: Vec<(&[u32; 3], f64)> = mesh.triangles.iter().zip(distances_m(mesh, solid)).collect();
        by_depth.sort_by(|a, b| depth(a.0).total_cmp(&depth(b.0)));
        let triangle = |(corners, distance_m): (&[u32; 3], f64)| {
            (corners.map(|corner| flat(mesh.vertices[corner as usize].on.at.vector())), viridis(share(distance_m)))
        };
        Self {
            title,
            triangles: by_depth.into_iter().map(triangle).collect(),
            curves: solid.curves_m().into_iter().map(|curve| curve.into_iter().map(flat).collect()).collect(),
        }
    }

    fn paint(&self, canvas: &Canvas, frame: Rect) -> Result<()> {
        let range = |of: fn(&(f64, f64)) -> f64| {
            let values = self.triangles.iter().flat_map(|(places, _)| places.iter().map(of));
            let (low, high) = extent(values).unwrap_or((0.0, 0.0));
            let half = (0.5 * (high - low) + MARGIN_MM).max(0.5 * LEAST_VIEW_MM);
            let middle = 0.5 * (low + high);
            [middle - half, middle + half]
        };
        let ([left, right], [low, high]) = (range(|place| place.0), range(|place| place.1));
        let panel = Panel::with_equal_scales(canvas, frame, &self.title, ("mm", "mm"), [left, right, low, high])?;
        for curve in &self.curves {
            panel.line(curve.iter().copied(), MUTED.mix(0.6), HAIRLINE_PX)?;
        }
        self.triangles.iter().try_for_each(|(places, colour)| {
            panel.area(*places, *colour)?;
            // The outline in the same colour covers the seam beside the next triangle.
            panel.line(places.iter().chain(&places[..1]).copied(), *colour, 0.5 * HAIRLINE_PX)
        })
    }
}

/// The colour scale.
fn paint_bar(canvas: &Canvas, frame: Rect) -> Result<()> {
    let [least_mm, most_mm] = SCALE_M.map(|distance_m| 1e3 * distance_m);
    let at = |step: usize| least_mm * (most_mm / least_mm).powf(step as f64 / BAR_STEPS as f64);
    let axis = Axis::logarithmic_between("distance from the true solid (mm)", least_mm, most_mm);
    let panel = Panel::new(canvas, frame, "", Axis::linear("", 0.0, 1.0).bare(), axis)?;
    for step in 0..BAR_STEPS {
        let corners = [(0.0, at(step)), (1.0, at(step)), (1.0, most_mm), (0.0, most_mm)];
        panel.area(corners, viridis((step as f64 + 0.5) / BAR_STEPS as f64))?;
    }
    panel.line([(0.0, least_mm), (1.0, least_mm), (1.0, most_mm), (0.0, most_mm), (0.0, least_mm)], INK, HAIRLINE_PX)
}

#[cfg(test)]
mod tests {
    use testbed::space::surface::Vertex;
    use whisker::space::frames::Point;
    use whisker::space::surface::ProjectedPoint;

    use super::*;

    #[test]
    fn verif_the_surface_of_each_object_is_alone() {
        let vertex = |x_m: f64, object: usize| Vertex {
            on: ProjectedPoint { at: Point::new(x_m, 0.0, 0.0), normal: Vector3::y(), sd_m: 1e-5 },
            object,
        };
        let vertices =
            [(0.0, 0), (1.0, 0), (2.0, 0), (3.0, 1), (4.0, 1), (5.0, 1)].map(|(x_m, object)| vertex(x_m, object));
        let mesh = SurfaceMesh { vertices: vertices.into(), triangles: vec![[0, 1, 2], [3, 5, 4]] };
        let alone = objects(&mesh);
        assert_eq!(
            alone.iter().map(|mesh| mesh.triangles.clone()).collect::<Vec<_>>(),
            [vec![[0, 1, 2]], vec![[0, 2, 1]]]
        );
        assert_eq!(alone[1].vertices, vertices[3..]);
    }

    #[test]
    fn verif_the_colour_scale_is_logarithmic_and_ends_at_its_limits() {
        assert_eq!([0.0, 1e-6, 1e-3, 1.0].map(share), [0.0, 0.0, 1.0, 1.0]);
        assert!((share(10e-6) - 1.0 / 3.0).abs() < 1e-12);
    }
}
