//! A circle through the touched part of a contour.
//!
//! Geometric: the weighted squares of the distances from the circle are least (Gauss-Newton). The errors of a contour are alike at nearby vertices, and so
//! smooth an error looks like another radius: their covariance is `sd_i sd_j exp(-way / CORRELATION_M)`, and the interval follows
//! from it (generalised least squares). Where the contour is farther from any circle than that allows, the interval is as much wider (Birge 1932).

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};
use trace::Outline;
use whisker::frames::{Point, World};

use super::{Contour, Vertex};
use crate::statistics::{NORMAL_95, rms};

/// Way along the outline over which its errors become others: that of a sensor model's error (`error_length_m` of the filters).
const CORRELATION_M: f64 = 1e-2;

/// Fewest vertices, and shortest way relative to the radius, that tell of a circle.
const LEAST_VERTICES: usize = 5;
const LEAST_ARC_RAD: f64 = 0.1;

/// What is round lies so many times nearer to a circle than to any two straight lines.
const LEAST_ROUND: f64 = 4.0;

/// Largest distance of a round outline from its circle, relative to the radius.
const MOST_OUT_OF_ROUND: f64 = 2e-3;

/// A circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its middle.
    pub center: Point<World>,
    /// Its radius.
    pub radius_m: f64,
    /// The interval that holds the radius with 95 %: of the curvature, which errors change evenly; no upper end where a straight line is within it.
    pub low_m: f64,
    /// Upper end.
    pub high_m: Option<f64>,
    /// Root mean square distance of the contour's touched vertices from it.
    pub residual_rms_m: f64,
}

impl Circle {
    /// The circle of which a contour is an arc; nothing where it is too short to tell or states no uncertainty.
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
        let whitening = covariance.cholesky()?;
        let mut circle = algebraic(&points)?;
        let mut normal = Matrix3::zeros();
        for _ in 0..100 {
            let (residuals, jacobian) = (off(&points, &circle), jacobian(&points, &circle));
            let weighed = whitening.solve(&jacobian);
            normal = Matrix3::from_iterator((jacobian.transpose() * &weighed).iter().copied());
            let step: Vector3<f64> =
                normal.try_inverse()? * Vector3::from_iterator((weighed.transpose() * residuals).iter().copied());
            circle -= step;
            if step.norm() < 1e-12 {
                break;
            }
        }
        let residuals = off(&points, &circle);
        let way_m = ways_m[ways_m.len() - 1];
        let radius_m = circle.z;
        if !(radius_m > 0.0 && way_m / radius_m >= LEAST_ARC_RAD) {
            return None;
        }
        let freedom = (points.len() - 3) as f64;
        let birge = (residuals.dot(&whitening.solve(&residuals)) / freedom).max(1.0);
        let radius_sd_m = (birge * normal.try_inverse()?[(2, 2)]).sqrt();
        let curvature = |sds: f64| (1.0 + sds * radius_sd_m / radius_m) / radius_m;
        Some(Self {
            center: Point::new(circle.x, circle.y),
            radius_m,
            low_m: 1.0 / curvature(NORMAL_95),
            high_m: Some(curvature(-NORMAL_95)).filter(|per_m| *per_m > 0.0).map(f64::recip),
            residual_rms_m: rms(residuals.as_slice())?,
        })
    }

    /// The same where the contour itself says that it is round: what was touched of it lies several times nearer to a circle than to any two straight lines, and
    /// to none so wide that a straight line is within the interval of its radius.
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
    // Equal covariances weight all vertices equally.
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

/// Root mean square distance of points from the two straight lines that fit them best, one up to some point and one from the next.
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

/// Distances outside of the circle `(x, y, radius)`.
fn off(points: &[Vector2<f64>], circle: &Vector3<f64>) -> DVector<f64> {
    DVector::from_iterator(points.len(), points.iter().map(|point| (point - circle.xy()).norm() - circle.z))
}

fn jacobian(points: &[Vector2<f64>], circle: &Vector3<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(points.len(), 3, |row, column| {
        let outward = (points[row] - circle.xy()).normalize();
        if column < 2 { -outward[column] } else { -1.0 }
    })
}

/// Where to begin: the circle whose equation the points meet best, `|p|^2 = 2 c p + e` (Kasa 1976), about their mean.
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

    /// An arc with correlated errors.
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
    fn verif_an_exact_arc_gives_its_circle() {
        let circle = Circle::through(&arc(0.05, 0.4, 0.0, 1)).expect("a circle");
        assert!((circle.radius_m - 0.05).abs() < 1e-9 && circle.residual_rms_m < 1e-9);
        assert!(circle.center.distance(&Point::new(0.1, -0.2)) < 1e-9);
    }

    #[test]
    fn val_the_interval_holds_the_radius_as_often_as_it_says() {
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
    fn robust_a_flat_or_a_point_is_no_circle() {
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
