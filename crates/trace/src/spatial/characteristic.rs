//! Response of a three-axis sensor's counts to the bending about two axes, and its inverse.

use nalgebra::{DMatrix, Matrix3x2, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Degree of the polynomials, that of the planar characteristic.
const DEGREE: i32 = 5;

/// Smallest ratio of singular values with which the calibration determines the coefficients.
const LEAST_DETERMINED: f64 = 1e-8;

/// Largest bending, relative to the largest calibrated one, up to which the inverse is sought.
const MOST_BENT: f64 = 1.5;

/// Smallest sensitivity of the counts to the bending within the calibration, in any direction, relative to that at
/// rest.
const LEAST_SENSITIVE: f64 = 0.1;

const ITERATIONS: usize = 30;
const TOLERANCE: f64 = 1e-12;

/// Counts of each axis as a polynomial of the two bending moments, without constant term.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialCharacteristic {
    /// Largest calibrated bending moment (N m), by which both arguments are divided.
    pub scale_n_m: f64,
    /// Coefficients (counts) of each axis, of `y`, `z`, `y^2`, `y z`, `z^2`, `y^3`, and so on.
    pub coefficients: [Vec<f64>; 3],
}

impl SpatialCharacteristic {
    /// Least-squares fit to pairs of bending moments (N m) and counts. `None` if they do not determine it, or if the
    /// counts do not determine the bending.
    pub fn fit(pairs: &[([f64; 2], Vector3<f64>)]) -> Option<Self> {
        let largest = |bending: &[f64; 2]| bending[0].hypot(bending[1]);
        let scale_n_m = pairs.iter().map(|(bending, _)| largest(bending)).fold(0.0, f64::max);
        let scaled: Vec<Vector2<f64>> = pairs.iter().map(|(bending, _)| Vector2::from(*bending) / scale_n_m).collect();
        let count = exponents().count();
        if !(scale_n_m > 0.0 && scale_n_m.is_finite()) || pairs.len() < count {
            return None;
        }
        let terms: Vec<Vec<f64>> =
            scaled.iter().map(|at| exponents().map(|powers| term(at, powers)).collect()).collect();
        let terms = DMatrix::from_fn(pairs.len(), count, |row, column| terms[row][column]);
        let counts = DMatrix::from_fn(pairs.len(), 3, |row, axis| pairs[row].1[axis]);
        let (normal, right) = (terms.tr_mul(&terms), terms.tr_mul(&counts));
        let spread = normal.clone().symmetric_eigenvalues();
        if spread.min() < LEAST_DETERMINED.powi(2) * spread.max() {
            return None;
        }
        let solved = normal.cholesky()?.solve(&right);
        let coefficients = std::array::from_fn(|axis| solved.column(axis).iter().copied().collect());
        let fitted = Self { scale_n_m, coefficients };
        let sensitivity = |at: &Vector2<f64>| fitted.jacobian(at).svd(false, false).singular_values[1];
        let least = LEAST_SENSITIVE * sensitivity(&Vector2::zeros());
        (least > 0.0 && scaled.iter().all(|at| sensitivity(at) > least)).then_some(fitted)
    }

    /// Number of coefficients of each axis.
    pub(super) fn terms() -> usize {
        exponents().count()
    }

    /// Whether scale and coefficients describe a response.
    pub(super) fn is_valid(&self) -> bool {
        let is_complete = |axis: &Vec<f64>| axis.len() == Self::terms() && axis.iter().all(|number| number.is_finite());
        self.scale_n_m.is_finite() && self.scale_n_m > 0.0 && self.coefficients.iter().all(is_complete)
    }

    /// Counts for bending moments (N m) about y and z.
    pub fn counts(&self, bending_n_m: [f64; 2]) -> Vector3<f64> {
        self.at(&(Vector2::from(bending_n_m) / self.scale_n_m))
    }

    /// Bending moments about y and z (N m) whose counts are nearest, by the Gauss-Newton method. They are limited to 1.5
    /// times the largest calibrated one along each axis.
    pub fn bending_n_m(&self, counts: Vector3<f64>) -> [f64; 2] {
        let mut at = Vector2::zeros();
        for _ in 0..ITERATIONS {
            let jacobian = self.jacobian(&at);
            let normal = jacobian.tr_mul(&jacobian);
            let Some(inverse) = normal.try_inverse() else { break };
            let before = at;
            at += inverse * jacobian.tr_mul(&(counts - self.at(&at)));
            at = at.map(|value| value.clamp(-MOST_BENT, MOST_BENT));
            if (at - before).norm() < TOLERANCE {
                break;
            }
        }
        (self.scale_n_m * at).into()
    }

    fn at(&self, at: &Vector2<f64>) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| {
            exponents().zip(&self.coefficients[axis]).map(|(powers, coefficient)| coefficient * term(at, powers)).sum()
        })
    }

    /// Derivatives of the counts by the scaled moments.
    fn jacobian(&self, at: &Vector2<f64>) -> Matrix3x2<f64> {
        Matrix3x2::from_fn(|axis, by| {
            let derivative = |[y, z]: [i32; 2]| match by {
                0 => f64::from(y) * term(at, [(y - 1).max(0), z]),
                _ => f64::from(z) * term(at, [y, (z - 1).max(0)]),
            };
            exponents().zip(&self.coefficients[axis]).map(|(powers, factor)| factor * derivative(powers)).sum()
        })
    }
}

/// Powers of y and z in the terms, in their order.
fn exponents() -> impl Iterator<Item = [i32; 2]> {
    (1..=DEGREE).flat_map(|degree| (0..=degree).map(move |of_z| [degree - of_z, of_z]))
}

fn term(at: &Vector2<f64>, [y, z]: [i32; 2]) -> f64 {
    at.x.powi(y) * at.y.powi(z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth response of three axes over a disc of moments.
    fn pairs() -> Vec<([f64; 2], Vector3<f64>)> {
        let mut found = Vec::new();
        for (i, j) in (0..15).flat_map(|i| (0..15).map(move |j| (i, j))) {
            let (y, z) = (f64::from(i - 7) / 7.0, f64::from(j - 7) / 7.0);
            let counts =
                Vector3::new(-90.0 * (y * y + z * z), 700.0 * (0.4 * z).sin(), -650.0 * (0.4 * y).sin() + 20.0 * z);
            found.push(([3e-5 * y, 3e-5 * z], counts));
        }
        found
    }

    #[test]
    fn verif_the_inverse_returns_the_bending() {
        let characteristic = SpatialCharacteristic::fit(&pairs()).unwrap();
        for (bending_n_m, counts) in pairs() {
            let expected = characteristic.counts(bending_n_m);
            assert!((expected - counts).norm() < 0.05, "{expected} for {counts}");
            let [y, z] = characteristic.bending_n_m(expected);
            assert!((y - bending_n_m[0]).abs() < 1e-15 && (z - bending_n_m[1]).abs() < 1e-15);
        }
    }

    #[test]
    fn robust_an_undetermined_response_is_refused() {
        let one_direction: Vec<_> = pairs().into_iter().filter(|(bending, _)| bending[0] == 0.0).collect();
        assert!(SpatialCharacteristic::fit(&one_direction).is_none());
        let saturated: Vec<_> = pairs()
            .into_iter()
            .map(|(bending, counts)| (bending, counts.map(|value| value.clamp(-100.0, 100.0))))
            .collect();
        assert!(SpatialCharacteristic::fit(&saturated).is_none());
        assert!(SpatialCharacteristic::fit(&[]).is_none());
    }
}
