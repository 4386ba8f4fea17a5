//! Uncertainty of a surface between and beyond its touched points.
//!
//! The points of a stroke determine the curvature along the stroke, not across it: a plane and a thin rod give the same points.
//! Beyond the convex hull of the points, projected along the normal, the surface may end at an edge, and so the distance from the
//! hull is added to the standard deviation in quadrature. The places of the points across the normal are themselves uncertain, as
//! those of contacts along a whisker are: on a thin object, a contact that is displaced by its standard deviation lies beside the
//! object. The hull is therefore that of displaced points, and its distance the root mean square over the displacement, which is
//! common to all points of the hull.
//!
//! Within the hull, the normal may turn steadily or at an edge. If it turns by the angle `t` between the points around, a smooth
//! and an edged surface differ by at most `d t` at a distance `d` from the nearest point; the standard deviation includes
//! `d t / sqrt(12)`, that of a uniform distribution.
//!
//! Points that are farther away, or less certain, may enlarge the hull or make it less certain. Of the hulls of the points up to a
//! distance and a standard deviation, the one that gives the smallest value counts.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::{CELL_M, OrientedPoint};
use crate::frames::World;
use crate::space::frames::{Point, across};

/// Smallest standard deviation up to which points count as equally certain (m).
const LEAST_SD_M: f64 = 10e-6;

/// A point around a place, in the plane across the normal there.
struct PointAround {
    away_m: f64,
    offset_m: Vector2<f64>,
    /// Square root of the covariance in the plane.
    root_m: Matrix2<f64>,
    /// Square root of the trace of this covariance.
    sd_across_m: f64,
    normal: Vector3<f64>,
}

impl PointAround {
    /// The point in the coordinates of `axes` about `at`. `None` if its distance is `reach_m` or more.
    fn new(point: &OrientedPoint, at: Point<World>, axes: &[Vector3<f64>; 2], reach_m: f64) -> Option<Self> {
        let offset = point.at.vector() - at.vector();
        let away_m = offset.norm();
        (away_m < reach_m).then(|| {
            let root_m = root(axes.map(|one| axes.map(|other| one.dot(&(point.covariance_m2 * other)))).into());
            let offset_m = axes.map(|axis| axis.dot(&offset)).into();
            Self { away_m, offset_m, root_m, sd_across_m: root_m.norm(), normal: point.normal }
        })
    }
}

/// Standard deviation (m) of the surface at a place with this normal, for what the points leave undetermined: those within
/// `reach_m` that do not face the other way. Infinite without any, or without a normal.
pub(super) fn undetermined_sd_m(
    points: &[OrientedPoint],
    reach_m: f64,
    at: Point<World>,
    normal: &Vector3<f64>,
) -> f64 {
    let Some(normal) = normal.try_normalize(0.0) else { return f64::INFINITY };
    let axes = across(&normal);
    let facing = points.iter().filter(|point| point.normal.dot(&normal) > 0.0);
    let mut around: Vec<PointAround> = facing.filter_map(|point| PointAround::new(point, at, &axes, reach_m)).collect();
    around.sort_by(|a, b| a.away_m.total_cmp(&b.away_m));
    let sds_m = || around.iter().map(|point| point.sd_across_m);
    let (least_m, most_m) = (sds_m().fold(f64::INFINITY, f64::min), sds_m().fold(0.0, f64::max));
    let levels_m = std::iter::successors(Some(least_m.max(LEAST_SD_M)), |sd_across_m| {
        (*sd_across_m < most_m).then_some(2.0 * sd_across_m)
    });
    let certain_up_to = |sd_across_m: f64| -> Vec<&PointAround> {
        around.iter().filter(|point| point.sd_across_m <= sd_across_m).collect()
    };
    let mut levels: Vec<Vec<&PointAround>> = levels_m.map(certain_up_to).collect();
    // Each level contains the one before: levels with equal numbers of points are the same.
    levels.dedup_by_key(|points| points.len());
    levels.iter().map(|points| least_sd_m(points)).fold(f64::INFINITY, f64::min)
}

/// The smallest standard deviation of the hulls of the points up to a distance. The points are in the order of their distance.
fn least_sd_m(points: &[&PointAround]) -> f64 {
    let Some(nearest) = points.first() else { return f64::INFINITY };
    let (mut reach_m, mut least_m) = (2.0 * nearest.away_m.max(CELL_M), f64::INFINITY);
    loop {
        let within = &points[..points.partition_point(|point| point.away_m <= reach_m)];
        let cosines = within.iter().map(|point| point.normal.dot(&nearest.normal));
        let turn_rad = cosines.fold(1.0, f64::min).max(-1.0).acos();
        let least_certain = within.iter().max_by(|a, b| a.sd_across_m.total_cmp(&b.sd_across_m)).unwrap_or(nearest);
        let hull = convex_hull(within.iter().map(|point| point.offset_m));
        let of_edge_m = nearest.away_m * turn_rad / 12_f64.sqrt();
        least_m = from_hull_m(&hull, &least_certain.root_m).hypot(of_edge_m).min(least_m);
        if within.len() == points.len() {
            return least_m;
        }
        while reach_m < points[within.len()].away_m {
            reach_m *= 2.0;
        }
    }
}

/// Root mean square distance from a convex polygon of the origin, displaced by an error with a normal distribution and this square
/// root of its covariance: by cubature of the third degree.
fn from_hull_m(hull: &[Vector2<f64>], root_m: &Matrix2<f64>) -> f64 {
    let displaced = root_m * 2_f64.sqrt();
    let squares =
        displaced.column_iter().flat_map(|error| [1.0, -1.0].map(|sign| distance(hull, &(sign * error)).powi(2)));
    (squares.sum::<f64>() / 4.0).sqrt()
}

/// Distance of a point from a convex polygon, whose corners are given counter-clockwise; infinite without corners.
fn distance(hull: &[Vector2<f64>], from: &Vector2<f64>) -> f64 {
    let sides = || hull.iter().zip(hull.iter().cycle().skip(1)).map(|(a, b)| (b - a, from - a));
    if hull.len() > 2 && sides().all(|(side, offset)| side.perp(&offset) >= 0.0) {
        return 0.0;
    }
    let from_side = |(side, offset): (Vector2<f64>, Vector2<f64>)| {
        let share = (offset.dot(&side) / side.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (offset - side * share).norm()
    };
    sides().map(from_side).fold(f64::INFINITY, f64::min)
}

/// Corners of the convex hull of points, counter-clockwise: A. M. Andrew's monotone chain (Information Processing Letters 9, 1979).
fn convex_hull(points: impl Iterator<Item = Vector2<f64>>) -> Vec<Vector2<f64>> {
    let mut sorted: Vec<Vector2<f64>> = points.collect();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull = chain(sorted.iter());
    hull.extend(chain(sorted.iter().rev()));
    hull
}

/// The corners of a hull on one side of its first and last point, without the last one.
fn chain<'a>(points: impl Iterator<Item = &'a Vector2<f64>>) -> Vec<Vector2<f64>> {
    let mut corners: Vec<Vector2<f64>> = Vec::new();
    for point in points {
        while let [.., a, b] = corners[..]
            && (b - a).perp(&(point - a)) <= 0.0
        {
            corners.pop();
        }
        corners.push(*point);
    }
    corners.pop();
    corners
}

/// The symmetric square root of a covariance, also of one without full rank.
fn root(covariance: Matrix2<f64>) -> Matrix2<f64> {
    let parts = covariance.symmetric_eigen();
    let roots = parts.eigenvalues.map(|variance| variance.max(0.0).sqrt());
    parts.eigenvectors * Matrix2::from_diagonal(&roots) * parts.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    fn from_hull(points: &[[f64; 2]], root: Matrix2<f64>) -> f64 {
        from_hull_m(&convex_hull(points.iter().copied().map(Vector2::from)), &root)
    }

    #[test]
    fn verif_the_distance_from_a_hull_is_that_from_its_nearest_edge() {
        let exact = Matrix2::zeros();
        let square = [[1.0, -1.0], [3.0, 1.0], [3.0, -1.0], [2.0, 0.0], [1.0, 1.0], [1.0, 0.0]];
        assert_eq!(from_hull(&square, exact), 1.0);
        assert_eq!(from_hull(&square.map(|[x, y]| [x - 2.0, y - 0.5]), exact), 0.0);
        assert_eq!(from_hull(&[[3.0, 4.0]], exact), 5.0);
        assert_eq!(from_hull(&[[3.0, 4.0], [3.0, 4.0]], exact), 5.0);
        assert_eq!(from_hull(&[[-1.0, 2.0], [1.0, 2.0]], exact), 2.0);
        assert_eq!(from_hull(&[], exact), f64::INFINITY);
    }

    #[test]
    fn verif_the_hull_of_points_has_the_corners_in_order() {
        let points = [[0.0, 0.0], [2.0, 1.0], [1.0, 1.0], [0.0, 2.0], [2.0, 0.0], [1.0, 0.0]].map(Vector2::from);
        let corners = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 2.0]].map(Vector2::from);
        assert_eq!(convex_hull(points.into_iter()), corners);
    }

    #[test]
    fn verif_errors_across_a_hull_count_and_those_within_it_do_not() {
        let segment = [[-1.0, 0.0], [1.0, 0.0]];
        let [along, across] = [Vector2::new(0.1, 0.0), Vector2::new(0.0, 0.1)].map(|sd| Matrix2::from_diagonal(&sd));
        assert_eq!(from_hull(&segment, along), 0.0);
        assert!((from_hull(&segment, across) - 0.1).abs() < 1e-12);
        assert!((from_hull(&[[0.0, 0.0]], along + across) - 0.1 * 2_f64.sqrt()).abs() < 1e-12, "a single point");
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        assert_eq!(from_hull(&square, along + across), 0.0);
        assert!((from_hull(&[[0.0, 1.0]], across) - 1.0_f64.hypot(0.1)).abs() < 1e-12, "beyond it, in quadrature");
    }

    #[test]
    fn verif_a_root_of_a_covariance_gives_it_back() {
        let of = |covariance: Matrix2<f64>| {
            let found = root(covariance);
            assert!((found * found.transpose() - covariance).norm() < 1e-12, "{covariance}");
        };
        of(Matrix2::new(4.0, 1.0, 1.0, 2.0));
        of(Matrix2::new(0.0, 0.0, 0.0, 2.0));
        of(Matrix2::new(1.0, -2.0, -2.0, 4.0));
        of(Matrix2::zeros());
        of(Matrix2::new(1e-30, 3e-18, 3e-18, 1e-8));
        assert!((root(Matrix2::new(1e-30, 3e-18, 3e-18, 1e-8)).norm() - 1e-4).abs() < 1e-9);
    }

    #[test]
    fn verif_uncertain_points_around_certain_ones_do_not_count() {
        let point = |x_m: f64, sd_m: f64| OrientedPoint {
            at: Point::new(x_m, 0.0, 0.0),
            normal: Vector3::z(),
            covariance_m2: Matrix3::from_diagonal(&Vector3::new(sd_m, 0.0, 0.0).map(|sd_m| sd_m * sd_m)),
            normal_sd_rad: 5e-3,
            touch: 0,
        };
        let sd_m = |points: &[OrientedPoint], x_m: f64| {
            undetermined_sd_m(points, 0.02, Point::new(x_m, 0.0, 0.0), &Vector3::z())
        };
        // The first estimates of a touch with a thin object, and a later one.
        let early: Vec<OrientedPoint> = [-1e-3, -5e-4, 5e-4, 1e-3].map(|x_m| point(x_m, 1e-3)).into();
        let all: Vec<OrientedPoint> = early.iter().copied().chain([point(0.0, 5e-5)]).collect();
        assert!((sd_m(&all, 0.0) - 5e-5).abs() < 1e-9, "{}", sd_m(&all, 0.0));
        assert!(sd_m(&early, 0.0) > 2e-4, "within the hull of the others: {}", sd_m(&early, 0.0));
    }
}
