//! Taylor series in the arc length, and the wire as stretches of constant pre-curvature.
//!
//! An equilibrium is integrated by series of high order, whose coefficients follow from recurrences (Jorba and Zou, "A
//! software package for the numerical integration of ODEs by means of high-order Taylor methods", Experimental
//! Mathematics 14, 2005). One step covers a third of a radian or more to machine precision, without tabulated
//! coefficients or trial steps.

use crate::Whisker;

/// Order of the series. The work per step grows with its square, the step with `eps^(-1/order)`: near 18 is cheapest.
pub(crate) const ORDER: usize = 20;

/// Coefficients of a series, from order 0.
pub(crate) type Series = [f64; ORDER + 1];

/// Value of a series at the distance `step_m` from its centre.
pub(crate) fn horner(series: &Series, step_m: f64) -> f64 {
    series.iter().rev().fold(0.0, |sum, term| sum * step_m + term)
}

/// Term of order `k` of the product of two series.
pub(crate) fn product(a: &Series, b: &Series, k: usize) -> f64 {
    a[..=k].iter().zip(b[..=k].iter().rev()).map(|(a, b)| a * b).sum()
}

/// Stretch of the wire with one pre-curvature and one rate of taper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stretch {
    pub(crate) start_m: f64,
    pub(crate) curvature_per_m: f64,
    /// Diameter at `start_m`.
    pub(crate) diameter_m: f64,
    /// Change of the diameter per length.
    pub(crate) taper: f64,
}

impl Stretch {
    /// Stretches of a whisker, from the root. The last continues the wire beyond its tip, which iterations may pass.
    pub(crate) fn of(whisker: &Whisker) -> Vec<Self> {
        let taper = (whisker.tip_diameter_m - whisker.root_diameter_m) / whisker.length_m;
        let mut stretches: Vec<Self> = Vec::with_capacity(whisker.curvature.len() + 1);
        let mut start_m = 0.0;
        for piece in &whisker.curvature {
            let curvature_per_m = piece.curvature_per_m;
            stretches.push(Self { start_m, curvature_per_m, diameter_m: whisker.diameter_m(start_m), taper });
            start_m += piece.length_m;
        }
        let curvature_per_m = stretches[stretches.len() - 1].curvature_per_m;
        let (start_m, diameter_m) = (whisker.length_m, whisker.tip_diameter_m);
        stretches.push(Self { start_m, curvature_per_m, diameter_m, taper: 0.0 });
        stretches
    }

    /// Series of `1 / EI = C d^-4` in the distance from the arc length `s_m`, with `C = 64 / (pi E)`, and its number of terms.
    pub(crate) fn compliance(&self, coefficient: f64, s_m: f64) -> (Series, usize) {
        let diameter_m = self.diameter_m + self.taper * (s_m - self.start_m);
        let mut series = [0.0; ORDER + 1];
        series[0] = coefficient / diameter_m.powi(4);
        if self.taper == 0.0 {
            return (series, 1);
        }
        // d f' = -4 d' f for f = d^-4.
        for k in 0..ORDER {
            series[k + 1] = -series[k] * self.taper / diameter_m * (k as f64 + 4.0) / (k as f64 + 1.0);
        }
        (series, ORDER + 1)
    }
}
