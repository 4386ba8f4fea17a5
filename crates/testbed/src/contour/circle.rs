//! Circle fitted to the touched part of a contour.
//!
//! Geometric fit: minimises the weighted squared distances from the circle (Gauss-Newton). Errors of nearby vertices
//! are correlated, and a smooth error resembles a different radius. The covariance is modelled as `sd_i sd_j
//! exp(-distance / CORRELATION_M)` with the distance along the contour, and the interval of the radius follows by
//! generalised least squares. If the residuals exceed the stated uncertainty, the interval is scaled by the Birge ratio
//! (Birge 1932).

use filters::least_squares::{Method, Moves, Outcome, Problem, Quadratic, Settings, minimise};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2, Matrix3, Vector2, Vector3};
use trace::Outline;
use whisker::frames::{Point, World};

use super::{Contour, Vertex};
use crate::statistics::{NORMAL_95, rms};

/// Correlation length of a contour's errors, equal to that of a sensor model's error (`error_length_m` of the filters).
const CORRELATION_M: f64 = 1e-2;

/// Minimum number of vertices and minimum arc that determine a circle.
const LEAST_VERTICES: usize = 5;
const LEAST_ARC_RAD: f64 = 0.1;

/// Minimum ratio of the residuals of two straight lines to those of a circle for a contour to be classified as round.
const LEAST_ROUND: f64 = 4.0;

/// Gauss-Newton method, until the circle moves by less than 1e-12 m.
const SETTINGS: Settings =
    Settings { method: Method::GaussNewton, iterations: 100, absolute: 0.0, relative: 0.0, step: 1e-12 };

/// Largest deviation of a round outline from its circle, relative to the radius.
const MOST_OUT_OF_ROUND: f64 = 2e-3;

/// Circle with the uncertainty of its radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre.
    pub center: Point<World>,
    /// Radius.
    pub radius_m: f64,
    /// Lower end of the 95 % interval of the radius, computed as an interval of the curvature, whose error is nearly
    /// Gaussian.
    pub low_m: f64,
    /// Upper end of the interval. `None` if the interval includes a straight line.
    pub high_m: Option<f64>,
    /// RMS distance of the contour's touched vertices from the circle.
    pub residual_rms_m: f64,
}

impl Circle {
    /// Circle fitted to a contour. `None` if the contour is too short or states no uncertainty.
    pub fn through(contour: &Contour) -> Option<Self> {
        let vertices: Vec<&Vertex> = contour.vertices.iter().filter(|vertex| vertex.touched).collect();
        if vertices.len() < LEAST_VERTICES {
            return None;
        }
        let points: Vec<Vector2<f64>> = vertices.iter().map(|vertex| vertex.at.vector()).collect();
        let sds_m: Vec<f64> = vertices.iter().map(|vertex| vertex.sd_m()).collect::<Option<_>>()?;
        let ways_m: Vec<f64> = std::iter::once(0.0)
            .chain(points.windows(2).scan(0.0, |way_m, pair| {
                *way_m += (pair[1] - pair[0]).norm();
                Some(*way_m)
            }))
            .collect();
        let covariance = DMatrix::from_fn(points.len(), points.len(), |i, j| {
            sds_m[i] * sds_m[j] * (-(ways_m[i] - ways_m[j]).abs() / CORRELATION_M).exp()
        });
        let distances = Distances { points: &points, whitening: covariance.cholesky()? };
        let solution = minimise(&distances, algebraic(&points)?, &SETTINGS)?;
        if solution.outcome == Outcome::NoDescent {
            return None;
        }
        let circle = solution.state;
        let residuals = off(&points, &circle);
        let way_m = ways_m[ways_m.len() - 1];
        let radius_m = circle.z;
        if !(radius_m > 0.0 && way_m / radius_m >= LEAST_ARC_RAD) {
            return None;
        }
        let freedom = (points.len() - 3) as f64;
        let birge = (residuals.dot(&distances.whitening.solve(&residuals)) / freedom).max(1.0);
        let radius_sd_m = (birge * inverse(&solution.approximation)?[(2, 2)]).sqrt();
        let curvature = |sds: f64| (1.0 + sds * radius_sd_m / radius_m) / radius_m;
        Some(Self {
            center: Point::new(circle.x, circle.y),
            radius_m,
            low_m: 1.0 / curvature(NORMAL_95),
            high_m: Some(curvature(-NORMAL_95)).filter(|per_m| *per_m > 0.0).map(f64::recip),
            residual_rms_m: rms(residuals.as_slice())?,
        })
    }

    /// Circle fitted to a contour that is classified as round: its touched vertices are several times nearer to a
    /// circle than to any two straight lines, and the interval of the radius excludes a straight line. `None`
    /// otherwise.
    pub fn round(contour: &Contour) -> Option<Self> {
        let circle = Self::through(contour)?;
        let touched = contour.vertices.iter().filter(|vertex| vertex.touched);
        let points: Vec<Vector2<f64>> = touched.map(|vertex| vertex.at.vector()).collect();
        let is_round = LEAST_ROUND * circle.residual_rms_m < two_lines_rms_m(&points);
        (is_round && circle.high_m.is_some()).then_some(circle)
    }
}

/// Circle of a true outline. `None` if the outline is not round.
pub fn true_circle(outline: &Outline) -> Option<Circle> {
    let vertices = outline.vertices();
    // Equal covariances make the fit unweighted.
    let vertex = |at: &Point<World>| Vertex {
        at: *at,
        normal_rad: 0.0,
        covariance_m2: Some(Matrix2::identity() * 1e-12),
        touched: true,
    };
    let circle = Circle::through(&Contour { vertices: vertices[1..].iter().map(vertex).collect() })?;
    let off_m = |at: &Point<World>| (at.distance(&circle.center) - circle.radius_m).abs();
    vertices.iter().all(|at| off_m(at) <= MOST_OUT_OF_ROUND * circle.radius_m).then_some(circle)
}

/// RMS distance of points from the two straight lines that fit them best, one for the points before a split and one for
/// those after it.
fn two_lines_rms_m(points: &[Vector2<f64>]) -> f64 {
    let squares_m2 = |points: &[Vector2<f64>]| {
        let mean = points.iter().sum::<Vector2<f64>>() / points.len().max(1) as f64;
        let spread: Matrix2<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
        spread.symmetric_eigenvalues().min().max(0.0)
    };
    let split = |at: usize| squares_m2(&points[..at]) + squares_m2(&points[at..]);
    let least_m2 = (0..points.len()).map(split).fold(f64::INFINITY, f64::min);
    (least_m2 / points.len() as f64).sqrt()
}

/// Distances of points from the circle `(x, y, radius)`, with their covariance.
struct Distances<'a> {
    points: &'a [Vector2<f64>],
    /// Cholesky factor of the covariance.
    whitening: Cholesky<f64, Dyn>,
}

impl Moves for Distances<'_> {
    type State = Vector3<f64>;

    fn moved(&self, circle: &Vector3<f64>, step: &DVector<f64>) -> Option<Vector3<f64>> {
        Some(circle + Vector3::from_column_slice(step.as_slice()))
    }

    /// Step by the closed form of the inverse. The damping is zero.
    fn step(&self, approximation: &Quadratic, _: f64) -> Option<DVector<f64>> {
        let gradient = Vector3::from_column_slice(approximation.gradient.as_slice());
        let step = -(inverse(approximation)? * gradient);
        Some(DVector::from_column_slice(step.as_slice()))
    }
}

impl Problem for Distances<'_> {
    fn approximate(&self, circle: &Vector3<f64>) -> Option<Quadratic> {
        let (residuals, jacobian) = (off(self.points, circle), jacobian(self.points, circle));
        let weighted = self.whitening.solve(&jacobian);
        Some(Quadratic {
            cost: self.cost(circle, circle)?,
            gradient: weighted.transpose() * residuals,
            curvature: jacobian.transpose() * &weighted,
        })
    }

    fn cost(&self, circle: &Vector3<f64>, _: &Vector3<f64>) -> Option<f64> {
        let residuals = off(self.points, circle);
        Some(0.5 * residuals.dot(&self.whitening.solve(&residuals)))
    }
}

/// Covariance of the circle at a minimum. `None` if the curvature is singular.
fn inverse(approximation: &Quadratic) -> Option<Matrix3<f64>> {
    Matrix3::from_column_slice(approximation.curvature.as_slice()).try_inverse()
}

/// Signed distances from the circle `(x, y, radius)`, positive outside.
fn off(points: &[Vector2<f64>], circle: &Vector3<f64>) -> DVector<f64> {
    DVector::from_iterator(points.len(), points.iter().map(|point| (point - circle.xy()).norm() - circle.z))
}

fn jacobian(points: &[Vector2<f64>], circle: &Vector3<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(points.len(), 3, |row, column| {
        let outward = (points[row] - circle.xy()).normalize();
        if column < 2 { -outward[column] } else { -1.0 }
    })
}

/// Initial value: algebraic fit of `|p|^2 = 2 c p + e` about the mean of the points (Kasa 1976).
fn algebraic(points: &[Vector2<f64>]) -> Option<Vector3<f64>> {
    let mean = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for point in points {
        let row = (point - mean).push(0.5) * 2.0;
        normal += row * row.transpose();
        right += row * (point - mean).norm_squared();
    }
    let solved = normal.try_inverse()? * right;
    let radius_m = (solved.z + solved.xy().norm_squared()).sqrt();
    Some((solved.xy() + mean).push(radius_m))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    use super::*;

    const SD_M: f64 = 5e-5;

    /// Arc with exponentially correlated errors.
    fn arc(radius_m: f64, turn_rad: f64, sd_m: f64, seed: u64) -> Contour {
        let mut rng = Pcg64::seed_from_u64(seed);
        let step_m = 1e-3;
        let kept = (-step_m / CORRELATION_M).exp();
        let mut error: f64 = rng.sample(StandardNormal);
        let count = (turn_rad * radius_m / step_m) as usize;
        let vertices = (0..count).map(|i| {
            let (sin, cos) = (3.0 + i as f64 * step_m / radius_m).sin_cos();
            let off_m = radius_m + sd_m * error;
            error = kept * error + (1.0 - kept * kept).sqrt() * rng.sample::<f64, _>(StandardNormal);
            Vertex {
                at: Point::new(0.1 + off_m * cos, -0.2 + off_m * sin),
                normal_rad: 0.0,
                covariance_m2: Some(Matrix2::identity() * SD_M.powi(2)),
                touched: true,
            }
        });
        Contour { vertices: vertices.collect() }
    }

    #[test]
    fn verif_recovers_the_circle_of_an_exact_arc() {
        let circle = Circle::through(&arc(0.05, 0.4, 0.0, 1)).expect("a circle");
        assert!((circle.radius_m - 0.05).abs() < 1e-9 && circle.residual_rms_m < 1e-9);
        assert!(circle.center.distance(&Point::new(0.1, -0.2)) < 1e-9);
    }

    #[test]
    fn val_the_interval_has_its_nominal_coverage() {
        let holds = |seed| {
            let circle = Circle::through(&arc(0.05, 0.4, SD_M, seed)).expect("a circle");
            circle.low_m <= 0.05 && circle.high_m.is_none_or(|high_m| high_m >= 0.05)
        };
        let share = (0..400).filter(|&seed| holds(seed)).count() as f64 / 400.0;
        assert!((0.91..=0.99).contains(&share), "{share}");
    }

    #[test]
    fn verif_an_arc_is_round_and_a_corner_is_not() {
        assert!(Circle::round(&arc(0.05, 0.9, SD_M, 1)).is_some());
        let sides = (-20..=20).map(|i: i32| Point::new(1e-3 * f64::from(i.max(0)), 1e-3 * f64::from(i.min(0))));
        let covariance_m2 = Some(Matrix2::identity() * SD_M.powi(2));
        let vertex = |at| Vertex { at, normal_rad: 0.0, covariance_m2, touched: true };
        let corner = Contour { vertices: sides.map(vertex).collect() };
        assert!(Circle::through(&corner).is_some());
        assert_eq!(Circle::round(&corner), None);
    }

    #[test]
    fn robust_a_straight_line_or_a_point_has_no_circle() {
        let at = |i: i32| Point::new(1e-3 * f64::from(i), 0.0);
        let vertex = |i: i32| Vertex {
            at: at(i),
            normal_rad: 0.0,
            covariance_m2: Some(Matrix2::identity() * SD_M.powi(2)),
            touched: true,
        };
        assert_eq!(Circle::through(&Contour { vertices: (0..20).map(vertex).collect() }), None);
        assert_eq!(Circle::through(&Contour { vertices: vec![vertex(0); 20] }), None);
    }
}
