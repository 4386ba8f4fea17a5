//! Merging of surface points into one outline with an uncertainty band.
//!
//! **Order.** Neither position nor orientation alone orders points along an outline: a corner has many orientations at
//! one position, a flat face one orientation at many positions. A convex outline offset outwards along its normals by
//! [`REACH_M`] is a smooth curve around the centre of its points, on which both are arc lengths. Sorted by the polar
//! angle about that centre, the offset points are in order, through corners, over flat faces and for a single pin.
//!
//! **Merging.** Points in the same cell of length [`CELL_M`] of the offset outline are merged. Their errors are
//! strongly correlated: a filter's error persists over time and recurs in the next stroke. The correlation is unknown,
//! so information is averaged rather than added (covariance intersection, Julier and Uhlmann 1997): with weights `w` of
//! sum one, `P^-1 = sum w C^-1` and `x = P sum w C^-1 p`, which is consistent for any correlation, and never more
//! certain than the most certain point. The weight of a point is its information across the outline, `1 / (n' C n)`.
//!
//! **Band.** Each cell keeps its full covariance: an error along the outline has no effect on a straight part, but at a
//! corner all directions count. The scatter of a cell's points measures the uncorrelated part of their errors: for any
//! correlation, the mean square error of the points is that of their mean plus their scatter about it, so that `E (x -
//! truth)^2 = C - scatter` across the outline. The ratio of scatter to stated variance is averaged over the whole
//! outline. The band of a cell is never narrower than the scatter of its own points.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use filters::product;
use nalgebra::{Matrix2, Vector2};
use whisker::frames::Point;

use super::{Contour, MOST_SD_M, SurfacePoint, Vertex, direction};
use crate::statistics::{NORMAL_95, mean};

/// Outward offset used for ordering: length that counts as much as a rotation by one radian.
const REACH_M: f64 = 1e-2;

/// Length of a cell on the offset outline.
const CELL_M: f64 = 1e-3;

/// Lower bound of the common fraction of the points' variance within a cell.
const LEAST_KEPT: f64 = 0.1;

/// Upper bound of the path along the tangents between two cells relative to the chord; sqrt(2) is a right angle.
const LONGEST_DETOUR: f64 = std::f64::consts::SQRT_2;

/// Largest distance of the merged position of a cell from the nearest of its points.
const FAR_M: f64 = 1e-3;

/// Length of the steps that bridge untouched parts between two cells.
const BRIDGE_STEP_M: f64 = 1e-3;

/// Outline through surface points of a convex object. `None` if no point is usable.
pub(super) fn merged<'a>(points: impl IntoIterator<Item = &'a SurfacePoint>) -> Option<Contour> {
    let points: Vec<Placed> = points.into_iter().filter_map(Placed::new).collect();
    let cells = cells(&points);
    let merged: Vec<Merged> = cells.iter().filter_map(|cell| Merged::new(cell)).collect();
    let kept = 1.0 - mean(merged.iter().map(|merged| merged.scatter)).unwrap_or_default();
    let vertices: Vec<Vertex> = merged.iter().map(|merged| merged.vertex(kept.max(LEAST_KEPT))).collect();
    (!vertices.is_empty()).then(|| Contour { vertices: bridged(&vertices) })
}

/// Surface point with its information.
struct Placed {
    at: Vector2<f64>,
    normal: Vector2<f64>,
    /// Inverse covariance; the identity if no covariance is stated.
    information: Matrix2<f64>,
    /// Information across the outline.
    weight: f64,
    is_stated: bool,
}

impl Placed {
    fn new(point: &SurfacePoint) -> Option<Self> {
        let normal = point.normal;
        let (information, variance_m2) = match point.covariance_m2 {
            Some(covariance) => (covariance.try_inverse()?, normal.dot(&product(&covariance, &normal))),
            None => (Matrix2::identity(), 1.0),
        };
        let is_stated = point.covariance_m2.is_some();
        (variance_m2 > 0.0 && point.is_sure(MOST_SD_M)).then_some(Self {
            at: point.at,
            normal,
            information,
            weight: 1.0 / variance_m2,
            is_stated,
        })
    }

    /// Position offset outwards.
    fn pushed(&self) -> Vector2<f64> {
        self.at + self.normal * REACH_M
    }
}

/// Points of each cell, counter-clockwise around the object.
fn cells(points: &[Placed]) -> Vec<Vec<&Placed>> {
    let middle = points.iter().map(|point| point.at).sum::<Vector2<f64>>() / points.len().max(1) as f64;
    let seen_at = |point: &Placed| {
        let seen = point.pushed() - middle;
        seen.y.atan2(seen.x)
    };
    let mut placed: Vec<(f64, &Placed)> = points.iter().map(|point| (seen_at(point), point)).collect();
    placed.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    // The sequence starts after the widest gap; the gap before the first point wraps around to the last.
    let around = placed.first().zip(placed.last()).map(|(first, last)| (first.0 - last.0).rem_euclid(2.0 * PI));
    let gaps = around.into_iter().chain(placed.windows(2).map(|pair| pair[1].0 - pair[0].0));
    let widest = gaps.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(place, _)| place);
    placed.rotate_left(widest);
    let mut way_m = 0.0;
    let mut last: Option<(Vector2<f64>, Vector2<f64>)> = None;
    let mut cells: BTreeMap<i64, Vec<&Placed>> = BTreeMap::new();
    for (_, point) in placed {
        let (pushed, normal) = (point.pushed(), point.normal);
        if let Some((before, normal_before)) = last {
            // Increment along the tangent only: errors across the outline do not count, and errors along it cancel.
            let outward = normal + normal_before;
            let along = Vector2::new(-outward.y, outward.x).try_normalize(f64::MIN_POSITIVE).unwrap_or_default();
            way_m += along.dot(&(pushed - before));
        }
        last = Some((pushed, normal));
        cells.entry((way_m / CELL_M).floor() as i64).or_default().push(point);
    }
    cells.into_values().collect()
}

/// Merged points of one cell.
struct Merged {
    at: Vector2<f64>,
    normal: Vector2<f64>,
    /// Covariance of a single point, if stated.
    covariance_m2: Option<Matrix2<f64>>,
    /// Mean squared distance of the points from the merged position across the outline, relative to their stated
    /// variance.
    scatter: f64,
}

impl Merged {
    /// Merges the points of a cell. `None` if the points are inconsistent.
    fn new(points: &[&Placed]) -> Option<Self> {
        let total: f64 = points.iter().map(|point| point.weight).sum();
        let share = |point: &Placed| point.weight / total;
        let normal = points.iter().map(|point| point.normal * share(point)).sum::<Vector2<f64>>();
        let normal = normal.try_normalize(f64::MIN_POSITIVE)?;
        let information: Matrix2<f64> = points.iter().map(|point| point.information * share(point)).sum();
        let covariance = information.try_inverse()?;
        let weighted: Vector2<f64> =
            points.iter().map(|point| product(&point.information, &point.at) * share(point)).sum();
        let at = covariance * weighted;
        let scatter_m2: f64 =
            points.iter().map(|point| share(point) * point.normal.dot(&(point.at - at)).powi(2)).sum();
        let stated_m2: f64 = points.iter().map(|point| share(point) / point.weight).sum();
        let covariance_m2 = points.iter().all(|point| point.is_stated).then_some(covariance);
        // Points with far too small covariances along nearly the same line have an ill-conditioned intersection.
        let is_near = points.iter().any(|point| (point.at - at).norm() <= FAR_M);
        is_near.then_some(Self { at, normal, covariance_m2, scatter: scatter_m2 / stated_m2 })
    }

    /// Vertex with a band; `kept` is the fraction of the points' variance across the outline that is common to all of
    /// them.
    fn vertex(&self, kept: f64) -> Vertex {
        let across = self.normal * self.normal.transpose();
        let narrowed = Matrix2::identity() + across * (kept.max(self.scatter).sqrt() - 1.0);
        let covariance_m2 = self.covariance_m2.map(|covariance| narrowed * covariance * narrowed);
        let normal_rad = self.normal.y.atan2(self.normal.x);
        Vertex { at: Point::from_vector(self.at), normal_rad, covariance_m2, touched: true }
    }
}

/// Interpolates between distant vertices. A convex outline tangent at both ends lies between the chord and the
/// intersection of the tangents. The interpolation is the parabola with these tangents, halfway between, and the 95 %
/// band covers the whole region.
fn bridged(vertices: &[Vertex]) -> Vec<Vertex> {
    let mut bridged: Vec<Vertex> = vertices.first().copied().into_iter().collect();
    for pair in vertices.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let (a, b) = (from.at.vector(), to.at.vector());
        let steps = ((b - a).norm() / BRIDGE_STEP_M).floor() as usize;
        let crossing = crossing(&from, &to).unwrap_or(0.5 * (a + b));
        let height_m = (crossing - a).perp(&(b - a)).abs() / (b - a).norm().max(f64::MIN_POSITIVE);
        let turn_rad = (to.normal_rad - from.normal_rad + PI).rem_euclid(2.0 * PI) - PI;
        for step in 1..steps {
            let part = step as f64 / steps as f64;
            let (before, after) = ((1.0 - part) * (1.0 - part), part * part);
            let at = a * before + crossing * (2.0 * part * (1.0 - part)) + b * after;
            let unknown_m = 2.0 * height_m * part * (1.0 - part) / NORMAL_95;
            let normal_rad = from.normal_rad + part * turn_rad;
            let unknown = direction(normal_rad) * unknown_m;
            let stated = from.covariance_m2.zip(to.covariance_m2);
            let covariance_m2 = stated.map(|(a, b)| a + (b - a) * part + unknown * unknown.transpose());
            bridged.push(Vertex { at: Point::from_vector(at), normal_rad, covariance_m2, touched: false });
        }
        bridged.push(to);
    }
    bridged
}

/// Intersection of the tangents at two vertices. `None` unless it is ahead of the first and behind the second vertex
/// and the path over it is at most [`LONGEST_DETOUR`] times the chord; otherwise the vertices are inconsistent.
fn crossing(from: &Vertex, to: &Vertex) -> Option<Vector2<f64>> {
    let (ahead, behind) = (direction(from.normal_rad + 0.5 * PI), direction(to.normal_rad - 0.5 * PI));
    let chord = to.at.vector() - from.at.vector();
    let ways = Matrix2::from_columns(&[ahead, -behind]).try_inverse()? * chord;
    let is_bridge = ways.x > 0.0 && ways.y > 0.0 && ways.sum() <= LONGEST_DETOUR * chord.norm();
    is_bridge.then(|| from.at.vector() + ahead * ways.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SD_M: f64 = 1e-4;

    fn surface_point(at: Vector2<f64>, normal: Vector2<f64>, covariance_m2: Matrix2<f64>) -> SurfacePoint {
        SurfacePoint {
            row: 0,
            touch: 0,
            since_touch_s: 0.0,
            at,
            normal,
            covariance_m2: Some(covariance_m2),
            is_second: false,
            is_doubtful: false,
        }
    }

    /// Point whose error is mainly along the outline, as is typical of whiskers.
    fn point(x_m: f64, y_m: f64, normal_deg: f64) -> SurfacePoint {
        let normal_rad = normal_deg.to_radians();
        let (n, t) = (direction(normal_rad), direction(normal_rad + 0.5 * PI));
        let covariance = n * n.transpose() * SD_M.powi(2) + t * t.transpose() * (10.0 * SD_M).powi(2);
        surface_point(Vector2::new(x_m, y_m), n, covariance)
    }

    fn circle(radius_m: f64, from_deg: f64, to_deg: f64, count: usize) -> Vec<SurfacePoint> {
        let at = |i: usize| from_deg + (to_deg - from_deg) * i as f64 / (count - 1) as f64;
        let on = |deg: f64| point(radius_m * deg.to_radians().cos(), radius_m * deg.to_radians().sin(), deg);
        (0..count).map(|i| on(at(i))).collect()
    }

    #[test]
    fn verif_strokes_over_an_arc_are_merged_in_order() {
        let mut points = circle(0.015, 200.0, 260.0, 300);
        points.extend(circle(0.015, 260.0, 200.0, 250));
        let contour = merged(&points).expect("an outline");
        let angles: Vec<f64> = contour.vertices.iter().map(|v| v.at.y().atan2(v.at.x()).to_degrees() + 360.0).collect();
        assert!(angles.windows(2).all(|pair| pair[0] < pair[1]), "{angles:?}");
        assert!(angles[0] < 203.0 && angles[angles.len() - 1] > 257.0);
        assert!(contour.vertices.iter().all(|v| (v.at.vector().norm() - 0.015).abs() < 0.02 * SD_M));
    }

    #[test]
    fn verif_correlated_points_do_not_reduce_the_covariance() {
        let sd = |count| {
            merged(&vec![point(0.0, 0.0, 90.0); count]).expect("an outline").vertices[0].sd_m().expect("stated")
        };
        assert!((sd(1) - SD_M).abs() < 1e-12 && (sd(1000) - SD_M).abs() < 1e-12);
    }

    #[test]
    fn verif_scatter_widens_the_band() {
        let points = [point(0.0, 3e-4, 90.0), point(0.0, -3e-4, 90.0)];
        let sd_m = merged(&points).expect("an outline").vertices[0].sd_m().expect("stated");
        assert!((sd_m - 3e-4).abs() < 1e-12);
    }

    #[test]
    fn verif_corners_and_flat_faces_are_ordered() {
        // Along the lower face, around the corner at the origin, along the right face.
        let flat = (0..20).map(|i| point(-0.02 + 1e-3 * f64::from(i), 0.0, -90.0));
        let corner = (0..20).map(|i| point(0.0, 0.0, -90.0 + 4.5 * f64::from(i)));
        let side = (0..20).map(|i| point(0.0, 1e-3 * f64::from(i), 0.0));
        let mut points: Vec<SurfacePoint> = side.chain(flat).chain(corner).collect();
        points.rotate_left(17);
        let contour = merged(&points).expect("an outline");
        let way = |v: &Vertex| v.at.x() + v.at.y();
        assert!(contour.vertices.windows(2).all(|pair| way(&pair[0]) <= way(&pair[1]) + 1e-9));
        assert!(contour.vertices.iter().all(|v| v.at.x().abs().min(v.at.y().abs()) < 1e-5));
    }

    #[test]
    fn verif_bands_of_bridges_are_narrow_on_flat_faces_and_wide_on_arcs() {
        let corners: Vec<SurfacePoint> = (0..10)
            .flat_map(|i| [point(-5e-3, 0.0, -100.0 + f64::from(i)), point(5e-3, 0.0, -90.0 + f64::from(i))])
            .collect();
        let flat = merged(&corners).expect("an outline");
        let middle = flat.vertices.iter().min_by(|a, b| a.at.x().abs().total_cmp(&b.at.x().abs())).expect("a vertex");
        assert!(middle.at.y().abs() < 2e-4 && middle.sd_m().expect("stated") < 4.0 * SD_M, "{middle:?}");

        let mut arcs = circle(0.05, 200.0, 220.0, 100);
        arcs.extend(circle(0.05, 250.0, 270.0, 100));
        let contour = merged(&arcs).expect("an outline");
        let bridge: Vec<&Vertex> = contour
            .vertices
            .iter()
            .filter(|v| (222.0..248.0).contains(&(v.at.y().atan2(v.at.x()).to_degrees() + 360.0)))
            .collect();
        assert!(bridge.len() > 10);
        for vertex in bridge {
            let off_m = (vertex.at.vector().norm() - 0.05).abs();
            assert!(off_m < NORMAL_95 * vertex.sd_m().expect("stated"), "{off_m}");
        }
    }

    #[test]
    fn robust_inconsistent_points_are_dropped() {
        let needle = |x_m: f64, tilt_rad: f64| {
            let (n, t) = (direction(tilt_rad), direction(tilt_rad + 0.5 * PI));
            let covariance = n * n.transpose() * 1e-18 + t * t.transpose() * 1e-7;
            surface_point(Vector2::new(x_m, 0.0), Vector2::x(), covariance)
        };
        assert_eq!(merged(&[needle(0.0, 0.0), needle(2e-4, 1e-5)]), None);
    }

    #[test]
    fn robust_uncertain_points_are_dropped() {
        let vague = SurfacePoint { covariance_m2: Some(Matrix2::identity() * 1e-4), ..point(0.0, 0.0, 0.0) };
        assert_eq!(merged(&[vague]), None);
        assert_eq!(merged(&[]), None);
    }
}
