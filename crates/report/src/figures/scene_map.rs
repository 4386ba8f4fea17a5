//! Map of a recording of several whiskers in plan view.

use anyhow::Result;
use testbed::results::{GridRow, MapObjectRow, MapPointRow, MapVertexRow, RunRecording, VertexRow};

use crate::axes::{Panel, Rect, extent};
use crate::canvas::{Align, Canvas, Lettering, Picture};
use crate::color::{Rgb, Rgba};
use crate::contour_panel::{Points, band};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, DARK, FRAME, GREEN, INK, LegendEntry, Look, OBJECT, SKY, SMALL, STATED, legend, plain};

/// Radius of a contact point.
const DOT_PX: f64 = 3.0;
/// Colours of free and occupied cells.
const FREE: Rgba = SKY.mix(0.22);
const OCCUPIED: Rgba = DARK.mix(0.45);
/// Contact points that belong to no outline.
const LEFT_OUT: Rgb = STATED;
/// Outlines found.
const FOUND: Rgb = GREEN;
const BAND_OPACITY: f64 = 0.35;
/// Margin around the objects.
const MARGIN_MM: f64 = 40.0;
/// Height of a line of text.
const LINE_PX: f64 = 15.0;
/// Largest distance of neighbouring cells, in cells.
const NEIGHBOUR: f64 = 1.5;

/// Content of the picture, in millimetres.
struct Scene {
    title: String,
    /// Runs of like cells: from, to, y, and whether they are free.
    cells: Vec<(f64, f64, f64, bool)>,
    cell_mm: f64,
    truths: Vec<Points>,
    /// The contact points of each array that outlines are made of.
    arrays: Vec<(String, Points)>,
    /// The other contact points.
    left_out: Points,
    /// Outline and band of each object found.
    found: Vec<(Points, Points)>,
    /// Annotations: position and lines of text.
    words: Vec<((f64, f64), Vec<String>)>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let Some(estimator) = data.filters().next() else { return Ok(None) };
    let recordings = &data.run.recordings;
    let Some(recording) = recordings.iter().find(|recording| recording.encoders.are_perfect()) else { return Ok(None) };
    let Some(scene) = scene(data, recording, estimator)? else { return Ok(None) };
    let paint = move |canvas: &Canvas| {
        let left_out = scene.left_out_name();
        let names: Vec<String> = scene.arrays.iter().map(|(name, _)| format!("contact points, array {name}")).collect();
        let mut entries: Vec<LegendEntry> =
            names.iter().enumerate().map(|(place, name)| LegendEntry::line(name, color(place), 2.0 * DOT_PX)).collect();
        if !scene.left_out.is_empty() {
            entries.push(LegendEntry::line(&left_out, LEFT_OUT, 2.0 * DOT_PX));
        }
        entries.push(LegendEntry::line("estimated outline", FOUND, CURVE_PX));
        entries.push(LegendEntry::bands("95 % band", vec![FOUND.mix(BAND_OPACITY)]));
        entries.push(LegendEntry::line("true outline", FRAME, 1.5));
        entries.push(LegendEntry::bands("free", vec![FREE]));
        entries.push(LegendEntry::bands("occupied", vec![OCCUPIED]));
        let below = legend(canvas, (56.0, 18.0), &entries)?;
        scene.paint(canvas, Rect::inside(canvas, [60.0, below + 40.0, 14.0, 48.0]))
    };
    Ok(Some(Picture::new(1200, 1000, paint)))
}

/// The colour of an array, distinct from those of the grid.
fn color(place: usize) -> Rgb {
    Look::of([0, 4, 3, 1][place % 4]).color
}

fn scene(data: &RunData, recording: &RunRecording, estimator: &str) -> Result<Option<Scene>> {
    let name = &recording.name;
    let Some(points) = data.map_table::<MapPointRow>(name, estimator, "points")? else { return Ok(None) };
    let vertices = data.map_table::<MapVertexRow>(name, estimator, "outlines")?.unwrap_or_default();
    let grid = data.map_table::<GridRow>(name, estimator, "grid")?.unwrap_or_default();
    let objects = data.map_objects()?;
    let is_shown = |row: &&MapObjectRow| {
        row.recording == *name
            && row.estimator == estimator
            && row.noise == data.noise()
            && Some(&row.seed) == data.run.seeds.first()
    };
    let mut truths = Vec::new();
    let mut words = Vec::new();
    for object in &recording.objects {
        let Some(outline) = data.outline(&format!("{name}.{object}"))? else { continue };
        let outline: Points = outline.iter().map(|(x_m, y_m)| (1e3 * x_m, 1e3 * y_m)).collect();
        let is_it = |row: &&MapObjectRow| is_shown(row) && row.matched.as_ref() == Some(object);
        let (left, right) = extent(outline.iter().map(|at| at.0)).unwrap_or_default();
        let (low, high) = extent(outline.iter().map(|at| at.1)).unwrap_or_default();
        let found = objects.iter().filter(is_it).flat_map(in_words);
        let lines = std::iter::once(plain(object)).chain(found).collect();
        words.push(((0.5 * (left + right), 0.5 * (low + high)), lines));
        truths.push(outline);
    }
    let mut arrays: Vec<(String, Points)> = Vec::new();
    let mut left_out = Points::new();
    for row in &points {
        let at = (1e3 * row.x_m, 1e3 * row.y_m);
        if row.object.is_none() {
            left_out.push(at);
            continue;
        }
        match arrays.iter_mut().find(|(array, _)| *array == row.array) {
            Some((_, points)) => points.push(at),
            None => arrays.push((row.array.clone(), vec![at])),
        }
    }
    let found = vertices.chunk_by(|a, b| a.object == b.object).map(|rows| {
        let line = rows.iter().map(|row| (1e3 * row.x_m, 1e3 * row.y_m)).collect();
        let rows: Vec<VertexRow> = rows.iter().map(MapVertexRow::vertex).collect();
        (line, band(&rows).unwrap_or_default())
    });
    Ok(Some(Scene {
        title: format!("{}, {estimator}", plain(name)),
        cells: runs(&grid, recording.map.cell_m),
        cell_mm: 1e3 * recording.map.cell_m,
        truths,
        arrays,
        left_out,
        found: found.collect(),
        words,
    }))
}

/// Annotation of an object that was found.
fn in_words(row: &MapObjectRow) -> Vec<String> {
    let mm = |value_m: f64| format!("{:.2} mm", 1e3 * value_m);
    let mut words = Vec::new();
    words.extend(row.outline_mean_m.map(|mean_m| format!("outline error {}", mm(mean_m))));
    words.extend(row.radius_m.map(|radius_m| format!("radius {}", mm(radius_m))));
    words.extend(row.center_error_m.map(|error_m| format!("centre error {}", mm(error_m))));
    words
}

/// Neighbouring cells along x that are alike, as one.
fn runs(grid: &[GridRow], cell_m: f64) -> Vec<(f64, f64, f64, bool)> {
    let is_free = |row: &GridRow| row.occupied < 0.5;
    let mut cells: Vec<&GridRow> = grid.iter().filter(|row| row.occupied != 0.5).collect();
    cells.sort_by(|a, b| a.y_m.total_cmp(&b.y_m).then(a.x_m.total_cmp(&b.x_m)));
    let are_alike =
        |a: &&GridRow, b: &&GridRow| a.y_m == b.y_m && b.x_m - a.x_m < NEIGHBOUR * cell_m && is_free(a) == is_free(b);
    cells
        .chunk_by(are_alike)
        .map(|run| (1e3 * run[0].x_m, 1e3 * run[run.len() - 1].x_m, 1e3 * run[0].y_m, is_free(run[0])))
        .collect()
}

impl Scene {
    /// Legend of the points that belong to no outline, with their number.
    fn left_out_name(&self) -> String {
        let used: usize = self.arrays.iter().map(|(_, points)| points.len()).sum();
        let left_out = self.left_out.len();
        format!("contact points left out of the outlines, {left_out} of {}", used + left_out)
    }

    fn paint(&self, canvas: &Canvas, frame: Rect) -> Result<()> {
        let used = self.arrays.iter().map(|(_, points)| points);
        let places = self.truths.iter().chain(used).chain([&self.left_out]);
        let all: Points = places.flatten().copied().collect();
        let (left, right) = extent(all.iter().map(|at| at.0)).unwrap_or((-1.0, 1.0));
        let (low, high) = extent(all.iter().map(|at| at.1)).unwrap_or((-1.0, 1.0));
        let bounds = [left - MARGIN_MM, right + MARGIN_MM, low - MARGIN_MM, high + MARGIN_MM];
        let panel = Panel::with_equal_scales(canvas, frame, &self.title, ("x (mm)", "y (mm)"), bounds)?;
        for truth in &self.truths {
            panel.area(truth.iter().copied(), OBJECT)?;
        }
        let half = 0.5 * self.cell_mm;
        for &(from, to, y, is_free) in &self.cells {
            let color = if is_free { FREE } else { OCCUPIED };
            let (from, to) = (from - half, to + half);
            panel.area([(from, y - half), (to, y - half), (to, y + half), (from, y + half)], color)?;
        }
        for truth in &self.truths {
            panel.line(truth.iter().copied(), FRAME, 1.5)?;
        }
        panel.discs(self.left_out.iter().copied(), DOT_PX, LEFT_OUT)?;
        for (place, (_, points)) in self.arrays.iter().enumerate() {
            panel.discs(points.iter().copied(), DOT_PX, color(place))?;
        }
        for (line, band) in &self.found {
            panel.area(band.iter().copied(), FOUND.mix(BAND_OPACITY))?;
            panel.line(line.iter().copied(), Rgb::WHITE, 2.0 * CURVE_PX)?;
            panel.line(line.iter().copied(), FOUND, CURVE_PX)?;
        }
        for (at, lines) in &self.words {
            let (x, y) = panel.at(*at);
            let top = y - 0.5 * LINE_PX * (lines.len() - 1) as f64;
            for (index, line) in lines.iter().enumerate() {
                let lettering = if index == 0 { Lettering { color: INK, bold: true, ..SMALL } } else { SMALL };
                canvas.text(line, (x, top + LINE_PX * index as f64), lettering.aligned(Align::Center))?;
            }
        }
        Ok(())
    }
}
