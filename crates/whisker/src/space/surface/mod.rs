//! Estimate of a surface from oriented points: a Gaussian process implicit surface.
//!
//! The surface is the zero level of a function `f` of space, positive outside of the object (Williams and Fitzgibbon, "Gaussian
//! process implicit surfaces", 2007). A touched point gives `f = 0` at its place, and its unit normal the gradient of `f` there
//! (Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, section 9.4). The prior of `f` has mean zero and the
//! Matérn covariance with smoothness 5/2 of the distance `r`,
//!
//! ```text
//! k = s^2 (1 + a + a^2 / 3) exp(-a)    a = sqrt(5) r / l
//! ```
//!
//! with `s = l / sqrt(5)`, so that the mean square of the gradient is 1, as for a distance. The standard deviation of a curvature
//! is then `sqrt(5) / l`. The length scale `l` is given, or the one with the largest evidence.
//!
//! Estimates of one touch are estimates of the same unknowns from more and more readings: the error of an estimate is that of a
//! later one plus an independent part. The errors of two points of a touch therefore have the smaller of both variances as their
//! covariance, as those of a Kalman filter without process noise. A tenth of the variance of each point is added as independent
//! error. Errors of different touches count as independent.
//!
//! The standard deviation also includes what the points leave undetermined: beyond their convex hull, which is as uncertain as the
//! places of the points, the distance from it; within the hull, an edge at which the normal may turn.
//!
//! [`ImplicitSurface::add`] takes points one by one, each in a time proportional to the square of the number of points used, with a
//! given length scale. [`ImplicitSurface::fit`] takes all points at once and also chooses the length scale. Unless points are left
//! out, both give the same surface for the same length scale.

mod extent;

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

use self::extent::undetermined_sd_m;
use super::frames::Point;
use crate::frames::World;

/// Unknowns of a point: the function and its gradient.
const OF_POINT: usize = 4;

/// Length scales from which that of the largest evidence is usually chosen (m), for radii of curvature from about 2 mm to 70 mm.
pub const LENGTHS_M: [f64; 6] = [5e-3, 10e-3, 20e-3, 40e-3, 80e-3, 160e-3];

/// Largest number of points of a surface from all points at once, and the edge of the cells of which each touch gives one (m),
/// doubled until there are not more points, but not more often than seven times.
const MOST_POINTS: usize = 120;
const CELL_M: f64 = 1e-3;
const MOST_DOUBLED: u32 = 7;

/// Ratio of standard deviations up to which a point is nearly as certain as another.
const NEARLY_AS_CERTAIN: f64 = 1.5;

/// Independent variance of each point, relative to that which it has in common with the others of its touch.
const INDEPENDENT: f64 = 0.1;

/// Smallest standard deviation of the independent part of a place (m), and of a normal (rad).
const LEAST_SD_M: f64 = 1e-6;
const LEAST_SD_RAD: f64 = 1e-3;

/// Most iterations of a projection onto the surface, and the step at which it ends (m).
const MOST_STEPS: usize = 20;
const LEAST_STEP_M: f64 = 1e-9;

/// A point of a touched surface with its normal, in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedPoint {
    /// Point of the surface, not of the centre line of the whisker.
    pub at: Point<World>,
    /// Unit normal out of the object.
    pub normal: Vector3<f64>,
    /// Covariance of the place (m2).
    pub covariance_m2: Matrix3<f64>,
    /// Standard deviation of the normal about either axis across it (rad).
    pub normal_sd_rad: f64,
    /// Number of the touch, whose estimates have errors in common.
    pub touch: usize,
}

impl OrientedPoint {
    /// Standard deviation of the place along the normal (m).
    pub fn sd_m(&self) -> f64 {
        self.normal.dot(&(self.covariance_m2 * self.normal)).max(0.0).sqrt()
    }

    /// Square root of the trace of the covariance of the place (m).
    fn spread_m(&self) -> f64 {
        self.covariance_m2.trace().sqrt()
    }
}

/// The function at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Value (m): zero on the surface and positive outside; near the points the distance from the surface.
    pub value_m: f64,
    /// Its gradient, out of the object.
    pub gradient: Vector3<f64>,
    /// Standard deviation of the value (m), infinite farther than the length scale from all points.
    pub sd_m: f64,
}

/// A point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectedPoint {
    /// The point.
    pub at: Point<World>,
    /// Unit normal out of the object.
    pub normal: Vector3<f64>,
    /// Standard deviation of the surface along the normal (m).
    pub sd_m: f64,
}

/// Prior covariance of the function and its gradient.
#[derive(Clone, Copy, Debug)]
struct Kernel {
    length_m: f64,
}

impl Kernel {
    /// Covariance of the function and its gradient at one point (rows) with those at another (columns), 4x4, by the vector from
    /// the other to the one.
    fn at(&self, apart: &Vector3<f64>) -> Matrix4<f64> {
        let [of_values, slope, decay] = self.parts(apart);
        let bend = 5.0 * decay / (3.0 * self.length_m * self.length_m);
        let of_gradients = Matrix3::identity() * slope - apart * apart.transpose() * bend;
        let mut covariance = Matrix4::zeros();
        covariance[(0, 0)] = of_values;
        covariance.fixed_view_mut::<1, 3>(0, 1).copy_from(&(apart.transpose() * slope));
        covariance.fixed_view_mut::<3, 1>(1, 0).copy_from(&(-apart * slope));
        covariance.fixed_view_mut::<3, 3>(1, 1).copy_from(&of_gradients);
        covariance
    }

    /// The first row of [`Self::at`]: the covariance of the function with function and gradient.
    fn of_value(&self, apart: &Vector3<f64>) -> Vector4<f64> {
        let [of_values, slope, _] = self.parts(apart);
        Vector4::new(of_values, slope * apart.x, slope * apart.y, slope * apart.z)
    }

    /// Covariance of the function at both points, that of the function and a gradient over the distance, and the exponential.
    fn parts(&self, apart: &Vector3<f64>) -> [f64; 3] {
        let a = 5_f64.sqrt() * apart.norm() / self.length_m;
        let decay = (-a).exp();
        [self.variance_m2() * (1.0 + a + a * a / 3.0) * decay, (1.0 + a) * decay / 3.0, decay]
    }

    /// Prior variance of the function.
    fn variance_m2(&self) -> f64 {
        self.length_m * self.length_m / 5.0
    }
}

/// Covariance of the errors of two points: that of the place and that of each coordinate of the normal; with the independent part
/// if `is_same`.
fn errors(one: &OrientedPoint, other: &OrientedPoint, is_same: bool) -> [f64; 2] {
    let common = |one: f64, other: f64| one.min(other).powi(2);
    let mut covariance = if one.touch == other.touch {
        [common(one.sd_m(), other.sd_m()), common(one.normal_sd_rad, other.normal_sd_rad)]
    } else {
        [0.0; 2]
    };
    if is_same {
        for (of_kind, least) in covariance.iter_mut().zip([LEAST_SD_M, LEAST_SD_RAD]) {
            *of_kind += INDEPENDENT * *of_kind + least * least;
        }
    }
    covariance
}

/// The surface of an object, from oriented points.
#[derive(Clone, Debug)]
pub struct ImplicitSurface {
    kernel: Kernel,
    points: Vec<OrientedPoint>,
    /// Cholesky factor of the covariance of the observations: the rows of the lower triangle, one after the other.
    factor: Vec<f64>,
    /// The observations, multiplied by the inverse of the factor.
    whitened: Vec<f64>,
    /// The observations, multiplied by the inverse of their covariance.
    weights: Vec<f64>,
}

impl ImplicitSurface {
    /// A surface without points, whose radii of curvature are about half of the length scale.
    pub fn new(length_m: f64) -> Self {
        let kernel = Kernel { length_m };
        Self { kernel, points: Vec::new(), factor: Vec::new(), whitened: Vec::new(), weights: Vec::new() }
    }

    /// The surface of many points, with the length scale of the largest evidence. Of more than 120 points, the one of each touch in
    /// each cell of 1 mm with the smallest covariance (trace) is used; the cells are doubled up to seven times, and after that the
    /// 120 points with the most certain normals are used. `None` without length scales.
    pub fn fit(points: &[OrientedPoint], lengths_m: &[f64]) -> Option<Self> {
        let points = thinned(points);
        let of_length = |length_m: &f64| {
            let mut surface = Self::new(*length_m);
            points.iter().for_each(|point| surface.extend(point));
            surface.weigh();
            surface
        };
        lengths_m.iter().map(of_length).max_by(|a, b| a.log_evidence().total_cmp(&b.log_evidence()))
    }

    /// Adds a point, unless another one of its touch is less than 1 mm away and nearly as certain, along the normal and in all.
    /// Returns whether it is used. The length of the path over the object therefore limits the number of points used.
    pub fn add(&mut self, point: &OrientedPoint) -> bool {
        let is_redundant_beside = |other: &OrientedPoint| {
            other.touch == point.touch
                && other.at.distance(&point.at) < CELL_M
                && other.sd_m() <= NEARLY_AS_CERTAIN * point.sd_m()
                && other.spread_m() <= NEARLY_AS_CERTAIN * point.spread_m()
        };
        let is_used = !self.points.iter().any(is_redundant_beside);
        if is_used {
            self.extend(point);
            self.weigh();
        }
        is_used
    }

    /// The points that are used.
    pub fn points(&self) -> &[OrientedPoint] {
        &self.points
    }

    /// Length scale of the covariance (m).
    pub fn length_m(&self) -> f64 {
        self.kernel.length_m
    }

    /// Logarithm of the evidence of the points for the length scale.
    pub fn log_evidence(&self) -> f64 {
        let rows = self.whitened.len();
        let log_pivots: f64 = (0..rows).map(|row| self.factor[start(row) + row].ln()).sum();
        let squares: f64 = self.whitened.iter().map(|one| one * one).sum();
        -0.5 * (squares + rows as f64 * TAU.ln()) - log_pivots
    }

    /// The function at a point.
    pub fn level(&self, at: Point<World>) -> Level {
        let (value_m, gradient) = self.mean(&at.vector());
        let of_point = |point: &OrientedPoint| -> [f64; OF_POINT] {
            self.kernel.of_value(&(at.vector() - point.at.vector())).into()
        };
        let mut covariance: Vec<f64> = self.points.iter().flat_map(of_point).collect();
        self.whiten(&mut covariance);
        let explained: f64 = covariance.iter().map(|one| one * one).sum();
        let known_m2 = (self.kernel.variance_m2() - explained).max(0.0);
        // With a slope of zero, the infinite standard deviation would become undefined.
        let slope = gradient.norm().max(f64::MIN_POSITIVE);
        let sd_m = known_m2.sqrt().hypot(slope * undetermined_sd_m(&self.points, self.kernel.length_m, at, &gradient));
        Level { value_m, gradient, sd_m }
    }

    /// The value of the function at a point (m), without its uncertainty.
    pub fn value_m(&self, at: Point<World>) -> f64 {
        let weighted = self.points.iter().zip(self.weights.chunks_exact(OF_POINT)).map(|(point, weights)| {
            self.kernel.of_value(&(at.vector() - point.at.vector())).dot(&Vector4::from_column_slice(weights))
        });
        weighted.sum()
    }

    /// Projects a point onto the surface along the gradient, by Newton's method. `None` if it does not converge within 20 steps, or
    /// a step exceeds the length scale.
    pub fn project(&self, at: Point<World>) -> Option<ProjectedPoint> {
        let mut at = at.vector();
        for _ in 0..MOST_STEPS {
            let (value_m, gradient) = self.mean(&at);
            let step_m = gradient * (value_m / gradient.norm_squared());
            // Without a gradient the step is not finite.
            if !step_m.norm().is_finite() || step_m.norm() > self.kernel.length_m {
                return None;
            }
            at -= step_m;
            if step_m.norm() < LEAST_STEP_M {
                let at = Point::from_vector(at);
                let Level { gradient, sd_m, .. } = self.level(at);
                let size = gradient.norm();
                return Some(ProjectedPoint { at, normal: gradient / size, sd_m: sd_m / size });
            }
        }
        None
    }

    /// Expected value of the function (m) and of its gradient.
    fn mean(&self, at: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let mut sum = Vector4::zeros();
        for (point, weights) in self.points.iter().zip(self.weights.chunks_exact(OF_POINT)) {
            sum += self.kernel.at(&(at - point.at.vector())) * Vector4::from_column_slice(weights);
        }
        (sum[0], sum.fixed_rows::<3>(1).into())
    }

    /// Extends the factor and the whitened observations by a point.
    fn extend(&mut self, point: &OrientedPoint) {
        self.points.push(*point);
        let before = self.points.len() - 1;
        let blocks: Vec<Matrix4<f64>> = self
            .points
            .iter()
            .enumerate()
            .map(|(index, other)| {
                let [of_place, of_normal] = errors(point, other, index == before);
                let noise = Vector4::new(of_place, of_normal, of_normal, of_normal);
                self.kernel.at(&(point.at.vector() - other.at.vector())) + Matrix4::from_diagonal(&noise)
            })
            .collect();
        let observed = [0.0, point.normal.x, point.normal.y, point.normal.z];
        for (row, observed) in observed.into_iter().enumerate() {
            let mut new: Vec<f64> =
                blocks.iter().flat_map(|block| -> [f64; OF_POINT] { block.row(row).clone_owned().into() }).collect();
            new.truncate(OF_POINT * before + row + 1);
            let variance = new.pop().expect("a row has its diagonal");
            self.whiten(&mut new);
            let pivot = (variance - new.iter().map(|one| one * one).sum::<f64>()).sqrt();
            let known: f64 = new.iter().zip(&self.whitened).map(|(one, other)| one * other).sum();
            self.factor.extend(new);
            self.factor.push(pivot);
            self.whitened.push((observed - known) / pivot);
        }
    }

    /// Solves the factor for a column.
    fn whiten(&self, column: &mut [f64]) {
        for row in 0..column.len() {
            let of_row = &self.factor[start(row)..=start(row) + row];
            let known: f64 = of_row[..row].iter().zip(&*column).map(|(one, other)| one * other).sum();
            column[row] = (column[row] - known) / of_row[row];
        }
    }

    /// Computes the weights from the whitened observations.
    fn weigh(&mut self) {
        self.weights.clone_from(&self.whitened);
        for row in (0..self.weights.len()).rev() {
            let of_row = &self.factor[start(row)..=start(row) + row];
            let weight = self.weights[row] / of_row[row];
            self.weights[row] = weight;
            for (other, element) in self.weights[..row].iter_mut().zip(of_row) {
                *other -= element * weight;
            }
        }
    }
}

/// The most certain point of each touch in each cell, if there are many.
fn thinned(points: &[OrientedPoint]) -> Vec<OrientedPoint> {
    let mut kept = points.to_vec();
    for doubled in 0..=MOST_DOUBLED {
        if kept.len() <= MOST_POINTS {
            break;
        }
        let edge_m = CELL_M * f64::from(1 << doubled);
        let mut cells: BTreeMap<(usize, [i64; 3]), OrientedPoint> = BTreeMap::new();
        for point in points {
            let cell: [i64; 3] = point.at.vector().map(|m| (m / edge_m).floor() as i64).into();
            let kept = cells.entry((point.touch, cell)).or_insert(*point);
            if point.spread_m() < kept.spread_m() {
                *kept = *point;
            }
        }
        kept = cells.into_values().collect();
    }
    // Of many touches, the most certain points. Errors of normals are the larger ones.
    kept.sort_by(|a, b| a.normal_sd_rad.total_cmp(&b.normal_sd_rad));
    kept.truncate(MOST_POINTS);
    kept
}

/// Index of the first element of a row of the factor.
fn start(row: usize) -> usize {
    row * (row + 1) / 2
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const RADIUS_M: f64 = 0.015;

    /// Covariance of a place that is uncertain along a direction only.
    fn along(direction: Vector3<f64>, sd_m: f64) -> Matrix3<f64> {
        direction * direction.transpose() * sd_m * sd_m
    }

    /// Points on a sphere about the origin, on a spiral over a cap of a third of its surface.
    fn on_sphere(count: usize, sd_m: f64) -> Vec<OrientedPoint> {
        let point = |i: usize| {
            let (polar, azimuth) =
                (1.2 * ((i as f64 + 0.5) / count as f64).sqrt(), PI * (3.0 - 5_f64.sqrt()) * i as f64);
            let normal = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
            let at = Point::from_vector(RADIUS_M * normal);
            OrientedPoint { at, normal, covariance_m2: along(normal, sd_m), normal_sd_rad: 0.01, touch: 0 }
        };
        (0..count).map(point).collect()
    }

    #[test]
    fn verif_covariances_are_the_derivatives_of_the_kernel() {
        let kernel = Kernel { length_m: 0.03 };
        let (apart, step_m) = (Vector3::new(0.004, -0.007, 0.002), 1e-6);
        let (found, value) = (kernel.at(&apart), |apart: Vector3<f64>| kernel.at(&apart)[(0, 0)]);
        for axis in 0..3 {
            let step = Vector3::ith(axis, step_m);
            let slope = (value(apart + step) - value(apart - step)) / (2.0 * step_m);
            assert!((found[(axis + 1, 0)] - slope).abs() < 1e-9 && (found[(0, axis + 1)] + slope).abs() < 1e-9);
            // A derivative by the other point is minus that by the difference.
            let of_gradients = (kernel.at(&(apart + step)) - kernel.at(&(apart - step))).column(0) / (-2.0 * step_m);
            for other in 0..3 {
                assert!((found[(other + 1, axis + 1)] - of_gradients[other + 1]).abs() < 1e-6, "{axis} {other}");
            }
        }
        let at_rest = kernel.at(&Vector3::zeros());
        assert!((at_rest.fixed_view::<3, 3>(1, 1).trace() - 1.0).abs() < 1e-12, "mean square of the gradient");
    }

    #[test]
    fn verif_a_sphere_is_found_between_its_points() {
        let surface = ImplicitSurface::fit(&on_sphere(60, 2e-6), &[0.01, 0.02, 0.04, 0.08]).unwrap();
        for (polar, azimuth) in [(0.0, 0.0), (0.3, 1.0), (0.7, -2.0), (1.0, 2.5)] {
            let (polar, azimuth): (f64, f64) = (polar, azimuth);
            let normal = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
            let found = surface.project(Point::from_vector(1.05 * RADIUS_M * normal)).unwrap();
            let error_m = found.at.vector().norm() - RADIUS_M;
            assert!(error_m.abs() < 20e-6 && error_m.abs() < 3.0 * found.sd_m, "{error_m} {}", found.sd_m);
            assert!(found.normal.angle(&normal) < 0.02, "{}", found.normal.angle(&normal));
            let level = surface.level(found.at);
            assert!(level.value_m.abs() < 1e-12 && level.sd_m > 0.0);
        }
        let outside = surface.value_m(Point::from_vector(Vector3::z() * (RADIUS_M + 0.001)));
        assert!((outside - 0.001).abs() < 1e-4, "near a point the value is the distance: {outside}");
    }

    #[test]
    fn verif_errors_of_a_touch_are_common_and_those_of_different_touches_average_out() {
        const SD_M: f64 = 100e-6;
        let points = on_sphere(40, SD_M);
        let top = |points: &[OrientedPoint]| {
            let surface = ImplicitSurface::fit(points, &[0.04]).unwrap();
            surface.project(points[0].at).unwrap()
        };
        let one = top(&points);
        assert!(
            (0.8..1.2).contains(&(one.sd_m / SD_M)),
            "forty points of a touch are no better than one: {}",
            one.sd_m
        );
        let again = points.iter().map(|point| OrientedPoint { touch: 1, ..*point });
        let both: Vec<OrientedPoint> = points.iter().copied().chain(again).collect();
        let ratio = one.sd_m / top(&both).sd_m;
        assert!((ratio - 2_f64.sqrt()).abs() < 0.1, "two touches are better than one: {ratio}");
        // A less certain touch counts less: 100 um outwards with twice the standard deviation.
        let shifted = |point: &OrientedPoint| OrientedPoint {
            at: point.at.shifted(100e-6 * point.normal),
            covariance_m2: along(point.normal, 2.0 * SD_M),
            touch: 1,
            ..*point
        };
        let mixed: Vec<OrientedPoint> = points.iter().copied().chain(points.iter().map(shifted)).collect();
        let height_m = top(&mixed).at.vector().norm() - RADIUS_M;
        assert!((height_m - 20e-6).abs() < 5e-6, "weights are inverse to the variances: {height_m}");
    }

    #[test]
    fn verif_beyond_the_points_the_surface_is_uncertain_by_the_distance_from_them() {
        // A stroke along x over a plane, or over a thin rod.
        let point = |i: i32| OrientedPoint {
            at: Point::new(1e-3 * f64::from(i), 0.0, 0.0),
            normal: Vector3::z(),
            covariance_m2: along(Vector3::z(), 5e-6),
            normal_sd_rad: 5e-3,
            touch: 0,
        };
        let stroke: Vec<OrientedPoint> = (0..=20).map(point).collect();
        let surface = ImplicitSurface::fit(&stroke, &LENGTHS_M).unwrap();
        let sd_m = |x_m: f64, y_m: f64| surface.project(Point::new(x_m, y_m, 1e-4)).unwrap().sd_m;
        assert!(sd_m(0.0105, 0.0) < 10e-6, "{}", sd_m(0.0105, 0.0));
        for (x_m, y_m, away_m) in [(0.0105, 1e-3, 1e-3), (0.01, -2e-3, 2e-3), (0.023, 0.0, 3e-3), (-3e-3, 4e-3, 5e-3)] {
            assert!((sd_m(x_m, y_m) / away_m - 1.0).abs() < 0.1, "{x_m} {y_m}: {}", sd_m(x_m, y_m));
        }
        // A second stroke encloses the surface between both.
        let beside = |point: &OrientedPoint| OrientedPoint { at: point.at.shifted(Vector3::y() * 3e-3), ..*point };
        let both: Vec<OrientedPoint> = stroke.iter().copied().chain(stroke.iter().map(beside)).collect();
        let between =
            ImplicitSurface::fit(&both, &LENGTHS_M).unwrap().project(Point::new(0.0105, 1.5e-3, 1e-4)).unwrap();
        assert!(between.sd_m < 20e-6, "{}", between.sd_m);
        // Where the normals of both strokes differ, there may be an edge between them.
        let around = |stroke: &OrientedPoint| OrientedPoint {
            at: stroke.at.shifted(Vector3::new(0.0, 5e-3, -2e-3)),
            normal: Vector3::new(0.0, 0.7, 0.7).normalize(),
            ..*stroke
        };
        let both: Vec<OrientedPoint> = stroke.iter().copied().chain(stroke.iter().map(around)).collect();
        let between = ImplicitSurface::fit(&both, &LENGTHS_M).unwrap().project(Point::new(0.0105, 2e-3, 1e-4)).unwrap();
        assert!((0.3e-3..0.8e-3).contains(&between.sd_m), "{}", between.sd_m);
    }

    #[test]
    fn verif_points_added_one_by_one_give_the_same_surface_as_all_at_once() {
        let points = on_sphere(25, 10e-6);
        let mut online = ImplicitSurface::new(0.04);
        let away = Point::from_vector(Vector3::new(0.002, 0.003, 0.016));
        let mut sd_m = f64::INFINITY;
        for point in &points {
            assert!(online.add(point));
            let now = online.level(away).sd_m;
            assert!(now <= sd_m + 1e-12, "a point adds information");
            sd_m = now;
        }
        let batch = ImplicitSurface::fit(&points, &[0.04]).unwrap();
        let (one, other) = (online.level(away), batch.level(away));
        assert!((one.value_m - other.value_m).abs() < 1e-12 && (one.sd_m - other.sd_m).abs() < 1e-12);
        assert_eq!((online.points().len(), online.length_m()), (25, 0.04));
        let again = OrientedPoint { at: points[3].at.shifted(Vector3::x() * 5e-4), ..points[3] };
        assert!(
            !online.add(&again) && online.add(&OrientedPoint { covariance_m2: along(again.normal, 2e-6), ..again })
        );
    }

    #[test]
    fn verif_the_evidence_selects_a_longer_length_scale_for_a_larger_object() {
        let length_m = |scale: f64| {
            let points: Vec<OrientedPoint> = on_sphere(50, 5e-6)
                .into_iter()
                .map(|point| OrientedPoint { at: Point::from_vector(scale * point.at.vector()), ..point })
                .collect();
            ImplicitSurface::fit(&points, &LENGTHS_M).unwrap().length_m()
        };
        assert!(length_m(0.3) < length_m(2.0), "{} {}", length_m(0.3), length_m(2.0));
    }

    #[test]
    fn robust_of_many_touches_the_most_certain_points_are_used() {
        let of_touch = |touch: usize| {
            let normal_sd_rad = 1e-3 * (1.0 + touch as f64);
            on_sphere(40, 1e-6).into_iter().map(move |point| OrientedPoint { touch, normal_sd_rad, ..point })
        };
        let points: Vec<OrientedPoint> = (0..500).flat_map(of_touch).collect();
        let kept = thinned(&points);
        assert_eq!(kept.len(), MOST_POINTS);
        assert!(kept.iter().all(|point| point.normal_sd_rad < 0.2));
        assert_eq!(thinned(&points[..10]).len(), 10);
    }

    #[test]
    fn robust_without_points_there_is_no_surface() {
        let surface = ImplicitSurface::new(0.04);
        assert_eq!(surface.level(Point::from_vector(Vector3::zeros())).sd_m, f64::INFINITY);
        assert!(surface.project(Point::from_vector(Vector3::zeros())).is_none());
        assert!(ImplicitSurface::fit(&[], &[]).is_none());
    }
}
