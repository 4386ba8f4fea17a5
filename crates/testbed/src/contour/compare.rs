//! Comparison of a contour with the true outline, without alignment.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use trace::Outline;
use whisker::frames::{Point, World};

use super::{Contour, Vertex, touched_stretch};
use crate::statistics::{NORMAL_95, mean, quantile};

/// Maximum distance between the points at which both outlines are compared.
const STEP_M: f64 = 1e-4;

/// Deviation of a contour from the true outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Mean distance of the contour's points from the true outline.
    pub mean_m: f64,
    /// 95th percentile of those distances.
    pub p95_m: f64,
    /// Hausdorff distance: maximum over the contour's points of the distance from the true outline, and over the
    /// touched part of the true outline of the distance from the contour. `None` if the touched part is unknown.
    pub hausdorff_m: Option<f64>,
    /// Mean distance of the places that were touched from the contour. `None` if they are unknown.
    pub touched_mean_m: Option<f64>,
    /// Fraction of the contour's points whose 95 % region, the ellipse of 1.96 standard deviations, intersects the true
    /// outline. `None` if the contour states no covariance.
    pub band_coverage: Option<f64>,
}

impl Comparison {
    /// Compares a contour with the true outline, of which `touched` is the touched part.
    pub fn new(contour: &Contour, outline: &Outline, touched: &Touched) -> Self {
        let points = sampled(contour);
        let distances_m: Vec<f64> = points.iter().map(|point| outline.distance_m(point.at)).collect();
        let covered: Option<Vec<f64>> = points.iter().map(|point| Some(f64::from(point.holds(outline)?))).collect();
        let worst_m = |distances_m: &[f64]| distances_m.iter().copied().reduce(f64::max);
        let line: Vec<_> = contour.vertices.iter().map(|vertex| vertex.at.vector()).collect();
        let missed_m: Vec<f64> = touched.stretch.iter().map(|at| distance(&line, *at)).collect();
        Self {
            mean_m: mean(distances_m.iter().copied()).unwrap_or_default(),
            p95_m: quantile(&distances_m, 0.95).unwrap_or_default(),
            hausdorff_m: worst_m(&missed_m).zip(worst_m(&distances_m)).map(|(missed_m, off_m)| missed_m.max(off_m)),
            touched_mean_m: mean(touched.places.iter().map(|at| distance(&line, *at))),
            band_coverage: covered.and_then(mean),
        }
    }
}

/// Touched part of a true outline; empty if unknown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Touched {
    /// The outline from the first to the last touched place, as points.
    stretch: Vec<Vector2<f64>>,
    /// Places that were touched, at most one for each interval of [`STEP_M`] in each coordinate.
    places: Vec<Vector2<f64>>,
}

impl Touched {
    /// Part of an outline between the touched positions.
    pub fn new(outline: &Outline, touched: impl IntoIterator<Item = Point<World>>) -> Self {
        let plain = |point: Point<World>| (point.x(), point.y());
        let line: Vec<(f64, f64)> = outline.vertices().iter().copied().map(plain).collect();
        let touched: Vec<Point<World>> = touched.into_iter().collect();
        let stretch = along(&touched_stretch(&line, touched.iter().copied().map(plain))).collect();
        let interval = |place_m: f64| (place_m / STEP_M).floor() as i64;
        let by_interval: BTreeMap<_, _> =
            touched.iter().map(|at| ((interval(at.x()), interval(at.y())), at.vector())).collect();
        Self { stretch, places: by_interval.into_values().collect() }
    }
}

impl Vertex {
    /// Whether the true outline intersects the 95 % region of this vertex, the ellipse of 1.96 standard deviations. For
    /// a straight outline the probability is 95 % for any orientation of the ellipse, since the extent of the ellipse
    /// across the outline equals the normal band. At a corner both directions count, and the probability is between 95
    /// % and the 85 % of a point. `None` without a covariance.
    fn holds(&self, outline: &Outline) -> Option<bool> {
        let whitening = self.covariance_m2?.cholesky()?.l().try_inverse()?;
        let line: Vec<_> = outline.vertices().iter().map(|at| whitening * (at.vector() - self.at.vector())).collect();
        Some(distance(&line, Vector2::zeros()) <= NORMAL_95)
    }
}

/// Distance from a point to a polyline.
fn distance(line: &[Vector2<f64>], point: Vector2<f64>) -> f64 {
    let vertices = line.iter().map(|vertex| (vertex - point).norm_squared());
    let edges = line.windows(2).map(|edge| {
        let way = edge[1] - edge[0];
        let part = ((point - edge[0]).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (edge[0] + way * part - point).norm_squared()
    });
    vertices.chain(edges).fold(f64::INFINITY, f64::min).sqrt()
}

/// Vertices of the contour with interpolated points between them; covariances are interpolated linearly.
fn sampled(contour: &Contour) -> Vec<Vertex> {
    let between = contour.vertices.windows(2).flat_map(|edge| {
        let (from, to) = (edge[0], edge[1]);
        parts(from.at.distance(&to.at)).map(move |part| Vertex {
            at: from.at.shifted((to.at.vector() - from.at.vector()) * part),
            normal_rad: from.normal_rad,
            covariance_m2: from.covariance_m2.zip(to.covariance_m2).map(|(from, to)| from + (to - from) * part),
            touched: from.touched && to.touched,
        })
    });
    between.chain(contour.vertices.last().copied()).collect()
}

/// Points along a polyline.
fn along(line: &[(f64, f64)]) -> impl Iterator<Item = Vector2<f64>> {
    let at = |&(x, y): &(f64, f64)| Vector2::new(x, y);
    let between = line.windows(2).flat_map(move |edge| {
        let (from, to) = (at(&edge[0]), at(&edge[1]));
        parts((to - from).norm()).map(move |part| from + (to - from) * part)
    });
    between.chain(line.last().map(at))
}

/// Sample positions on an edge as fractions of its length, in `[0, 1)`.
fn parts(length_m: f64) -> impl Iterator<Item = f64> {
    let count = (length_m / STEP_M).ceil().max(1.0);
    (0..count as usize).map(move |i| i as f64 / count)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::Matrix2;

    use super::*;

    fn contour(points: &[(f64, f64)], sd_m: Option<f64>) -> Contour {
        let covariance_m2 = sd_m.map(|sd_m| Matrix2::identity() * (sd_m * sd_m));
        let vertex =
            |&(x, y): &(f64, f64)| Vertex { at: Point::new(x, y), normal_rad: 0.0, covariance_m2, touched: true };
        Contour { vertices: points.iter().map(vertex).collect() }
    }

    fn square() -> Outline {
        let corners = [(0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.0, 0.01), (0.0, 0.0)];
        Outline::new(corners.iter().map(|&(x, y)| Point::new(x, y)).collect()).expect("closed")
    }

    #[test]
    fn val_distances_of_a_line_parallel_to_a_face() {
        let touched = Touched::new(&square(), [Point::new(0.002, 0.0), Point::new(0.008, 0.0)]);
        // Half a millimetre below the face, and one millimetre shorter than the touched part at one end.
        let beside = contour(&[(0.002, -5e-4), (0.007, -5e-4)], Some(3e-4));
        let found = Comparison::new(&beside, &square(), &touched);
        assert!((found.mean_m - 5e-4).abs() < 1e-12 && (found.p95_m - 5e-4).abs() < 1e-12);
        assert!((found.hausdorff_m.expect("touched") - 1e-3f64.hypot(5e-4)).abs() < 1e-12);
        // The second of the two places lies beside the end of the line.
        assert!((found.touched_mean_m.expect("touched") - 0.5 * (5e-4 + 1e-3f64.hypot(5e-4))).abs() < 1e-12);
        assert_eq!(found.band_coverage, Some(1.0));
        let narrow = contour(&[(0.002, -5e-4), (0.007, -5e-4)], Some(2e-4));
        assert_eq!(Comparison::new(&narrow, &square(), &touched).band_coverage, Some(0.0));
    }

    /// Outside of both faces of a corner: coverage depends on the extent of the ellipse in all directions.
    #[test]
    fn val_coverage_at_a_corner_depends_on_all_directions() {
        let off = Point::new(-3e-4, -3e-4);
        let beside = |along_m: f64| {
            let (n, t) = (Vector2::new(1.0, -1.0).normalize(), Vector2::new(1.0, 1.0).normalize());
            let covariance = n * n.transpose() * 1e-10 + t * t.transpose() * along_m.powi(2);
            Vertex { at: off, normal_rad: -PI / 4.0, covariance_m2: Some(covariance), touched: true }.holds(&square())
        };
        let reach_m = 3e-4 * 2f64.sqrt() / NORMAL_95;
        assert_eq!((beside(0.99 * reach_m), beside(1.01 * reach_m)), (Some(false), Some(true)));
    }

    #[test]
    fn verif_unknown_quantities_are_none() {
        let found = Comparison::new(&contour(&[(0.005, 1e-4)], None), &square(), &Touched::default());
        assert!((found.mean_m - 1e-4).abs() < 1e-12);
        assert_eq!((found.hausdorff_m, found.band_coverage), (None, None));
    }
}
