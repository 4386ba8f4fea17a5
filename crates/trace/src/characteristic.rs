//! Characteristic curve of a sensor: counts as a function of the moment at the whisker's root.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Polynomial from moment to counts relative to rest, `c1 M + c2 M^2 + ...`. Higher powers describe the nonlinearity of
/// a magnet that rotates above its sensor. It is strictly monotone over its range and therefore invertible.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Characteristic {
    /// `c1, c2, ...`, in counts per (N m)^k.
    pub coefficients: Vec<f64>,
    /// Smallest and largest moment of the calibration. The range contains 0, the moment at rest.
    pub range_n_m: [f64; 2],
}

impl Characteristic {
    /// Characteristic with these coefficients. `None` if the polynomial is not strictly monotone over the range.
    pub fn new(coefficients: Vec<f64>, range_n_m: [f64; 2]) -> Option<Self> {
        let own = Self { coefficients, range_n_m };
        own.is_valid().then_some(own)
    }

    /// Least-squares fit of a polynomial of this degree to pairs of moment (N m) and counts. `None` if the pairs do not
    /// determine it or if it is not strictly monotone over their range.
    pub fn fit(degree: usize, pairs: &[(f64, f64)]) -> Option<Self> {
        let moments = || pairs.iter().map(|pair| pair.0);
        let range_n_m = [moments().fold(0.0, f64::min), moments().fold(0.0, f64::max)];
        Self::new(through_zero(degree, pairs)?, range_n_m)
    }

    /// Whether the polynomial is strictly monotone over its range.
    pub fn is_valid(&self) -> bool {
        const CHECKED: u32 = 100;
        let [least, largest] = self.range_n_m;
        let Some(&first) = self.coefficients.first() else { return false };
        let rises = |i| {
            let moment_n_m = least + (largest - least) * f64::from(i) / f64::from(CHECKED);
            first.signum() * self.slope(moment_n_m) > 0.0
        };
        first != 0.0 && least <= 0.0 && largest >= 0.0 && (0..=CHECKED).all(rises)
    }

    /// Counts relative to rest.
    pub fn counts(&self, moment_n_m: f64) -> f64 {
        polynomial(&self.coefficients, moment_n_m)
    }

    /// Derivative of the counts with respect to the moment.
    pub fn slope(&self, moment_n_m: f64) -> f64 {
        let powers = (1..=self.coefficients.len()).rev().zip(self.coefficients.iter().rev());
        powers.fold(0.0, |sum, (power, c)| power as f64 * c + moment_n_m * sum)
    }

    /// Moment for counts relative to rest. Outside the calibrated range the characteristic is extrapolated linearly.
    pub fn moment_n_m(&self, counts: f64) -> f64 {
        let [least, largest] = self.range_n_m;
        let end_n_m = if counts / self.coefficients[0] < 0.0 { least } else { largest };
        if end_n_m == 0.0 {
            return counts / self.coefficients[0];
        }
        let most = self.counts(end_n_m);
        let share = counts / most;
        if share >= 1.0 {
            return end_n_m + (counts - most) / self.slope(end_n_m);
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.counts(middle * end_n_m) / most < share { low = middle } else { high = middle }
        }
        0.5 * (low + high) * end_n_m
    }
}

/// Polynomial without constant term, `c1 x + c2 x^2 + ...`.
pub(crate) fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    x * coefficients.iter().rev().fold(0.0, |sum, c| c + x * sum)
}

/// Least-squares coefficients `c1, c2, ...` of the polynomial without constant term, of this degree, for pairs of
/// moment (N m) and counts. `None` if the pairs do not determine them.
pub fn through_zero(degree: usize, pairs: &[(f64, f64)]) -> Option<Vec<f64>> {
    // Scaling by the largest moment keeps the normal matrix well conditioned.
    let unit_n_m = pairs.iter().map(|pair| pair.0.abs()).fold(0.0, f64::max);
    let powers = DMatrix::from_fn(pairs.len(), degree, |row, i| (pairs[row].0 / unit_n_m).powi(i as i32 + 1));
    let counts = DVector::from_iterator(pairs.len(), pairs.iter().map(|pair| pair.1));
    let scaled = powers.tr_mul(&powers).cholesky()?.solve(&powers.tr_mul(&counts));
    Some(scaled.iter().enumerate().map(|(i, c)| c / unit_n_m.powi(i as i32 + 1)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_inverse_and_linear_extrapolation() {
        let bent = Characteristic::new(vec![2.0, 1.0, 0.5], [0.0, 3.0]).unwrap();
        for moment_n_m in [0.0, 0.3, 1.7, 3.0] {
            assert!((bent.moment_n_m(bent.counts(moment_n_m)) - moment_n_m).abs() < 1e-12);
        }
        assert_eq!(bent.moment_n_m(-4.0), -2.0);
        assert!(bent.moment_n_m(40.0) > 3.0);
        assert_eq!(Characteristic::new(vec![2.0, -1.0, 0.0], [0.0, 3.0]), None);
    }

    #[test]
    fn verif_inverse_on_both_sides_of_rest() {
        let falling = Characteristic::new(vec![-3.0, 0.4, 0.1], [-2.0, 1.0]).unwrap();
        for moment_n_m in [-2.0, -1.1, 0.2, 1.0] {
            assert!((falling.moment_n_m(falling.counts(moment_n_m)) - moment_n_m).abs() < 1e-12);
        }
        // The slope at the end is -3 - 1.6 + 1.2.
        let past_end = falling.moment_n_m(falling.counts(-2.0) + 3.4);
        assert!((past_end + 3.0).abs() < 1e-12, "{past_end}");
    }

    #[test]
    fn verif_fit_recovers_the_polynomial_of_its_samples() {
        let exact = Characteristic::new(vec![-2e7, 1e9, 1e15], [-6e-5, 4e-5]).unwrap();
        let moments = (-60..=40).map(|i| 1e-6 * f64::from(i));
        let pairs: Vec<(f64, f64)> = moments.map(|m| (m, exact.counts(m))).collect();
        let fitted = Characteristic::fit(3, &pairs).unwrap();
        assert_eq!(fitted.range_n_m.map(|end_n_m| (1e7 * end_n_m).round()), [-600.0, 400.0]);
        for (found, expected) in fitted.coefficients.iter().zip(&exact.coefficients) {
            assert!((found / expected - 1.0).abs() < 1e-6, "{found} for {expected}");
        }
    }

    #[test]
    fn robust_degenerate_samples_have_no_fit() {
        assert_eq!(Characteristic::fit(3, &[]), None);
        assert_eq!(Characteristic::fit(3, &[(0.0, 0.0); 9]), None);
        assert_eq!(Characteristic::fit(1, &[(1.0, 0.0), (-1.0, 0.0)]), None);
    }
}
