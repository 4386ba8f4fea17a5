//! Prior of outlines.

use filters::least_squares::Quadratic;
use serde::{Deserialize, Serialize};

use super::curve::{ANCHOR, Curve, SCALE_M};
use crate::settings::{SettingsError, within};

/// The radius is likely to be constant from cell to cell, with occasional jumps.
///
/// A change `x` of its logarithm costs `c d ln(1 + |x| / d)`: nearly `c |x|` if it is small, which draws a round object
/// to one radius, and little more for a large jump than for a smaller one, which leaves corners and sides as sharp as
/// the readings require. `|x|` is rounded off near zero.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Prior {
    /// Prior mean of the radius, with the wire's.
    pub radius_m: f64,
    /// Prior standard deviation of its logarithm.
    pub log_radius_sd: f64,
    /// Cost `c` per unit of a small change.
    pub change_cost: f64,
    /// Change below which the cost is quadratic.
    pub change_least: f64,
    /// Change `d` above which the cost is logarithmic.
    pub change_large: f64,
    /// Standard deviation of the curve's position in each direction.
    pub place_sd_m: f64,
    /// Standard deviation of the curve's tangent angle.
    pub tangent_sd_rad: f64,
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            radius_m: 1e-3,
            log_radius_sd: 5.0,
            change_cost: 10.0,
            change_least: 1e-3,
            change_large: 0.3,
            place_sd_m: 2e-2,
            tangent_sd_rad: 1.0,
        }
    }
}

impl Prior {
    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("prior.radius_m", self.radius_m, 1e-6..=10.0)?;
        within("prior.log_radius_sd", self.log_radius_sd, 1e-3..=100.0)?;
        within("prior.change_cost", self.change_cost, 1e-3..=1e3)?;
        within("prior.change_least", self.change_least, 1e-6..=10.0)?;
        within("prior.change_large", self.change_large, 1e-6..=1e6)?;
        within("prior.place_sd_m", self.place_sd_m, 1e-6..=1.0)?;
        within("prior.tangent_sd_rad", self.tangent_sd_rad, 1e-6..=10.0)
    }

    /// Total variation, a convex cost: a search that begins with it does not end in a local minimum of the prior's own,
    /// non-convex cost with a misplaced jump.
    pub(super) fn rough(&self) -> Self {
        Self { change_cost: 1.0, change_least: 3e-3, change_large: 1e6, ..*self }
    }

    /// A prior under which the curve is nearly a circle.
    pub(super) fn smooth(&self) -> Self {
        Self { change_cost: 30.0, change_large: 1e6, ..*self }
    }

    /// A prior whose curvature at the most probable curve gives the covariance. The original prior would give a
    /// negligible variance to every cell without a jump.
    pub(super) fn for_covariance(&self) -> Self {
        Self { change_least: 3e-2, ..self.rough() }
    }

    /// Size of a change, rounded off near zero.
    fn rounded(&self, change: f64) -> f64 {
        (change * change + self.change_least * self.change_least).sqrt()
    }

    fn middle(&self) -> f64 {
        (self.radius_m / SCALE_M).ln()
    }

    /// Cost of a curve. All cells together count as one observation of the radius.
    pub(super) fn cost(&self, curve: &Curve) -> f64 {
        let logs = curve.logs();
        let levels: f64 = logs.iter().map(|u| 0.5 * ((u - self.middle()) / self.log_radius_sd).powi(2)).sum();
        let jump = |pair: &[f64]| (self.rounded(pair[1] - pair[0]) / self.change_large).ln_1p();
        levels / logs.len() as f64 + self.change_cost * self.change_large * logs.windows(2).map(jump).sum::<f64>()
    }

    /// Adds gradient and curvature of the cost, the latter those of the majorising quadratic. The position has no
    /// gradient: along the curve it is free, and across it the readings determine it.
    pub(super) fn add_to(&self, curve: &Curve, quadratic: &mut Quadratic) {
        let Quadratic { gradient, curvature, .. } = quadratic;
        for (i, sd) in [self.place_sd_m, self.place_sd_m, self.tangent_sd_rad].into_iter().enumerate() {
            curvature[(i, i)] += sd.powi(-2);
        }
        let logs = curve.logs();
        let level = self.log_radius_sd.powi(-2) / logs.len() as f64;
        for (i, u) in logs.iter().enumerate() {
            gradient[ANCHOR + i] += level * (u - self.middle());
            curvature[(ANCHOR + i, ANCHOR + i)] += level;
        }
        for (i, pair) in logs.windows(2).enumerate() {
            let change = pair[1] - pair[0];
            let size = self.rounded(change);
            let weight = self.change_cost / (size * (1.0 + size / self.change_large));
            let (one, other) = (ANCHOR + i, ANCHOR + i + 1);
            gradient[one] -= weight * change;
            gradient[other] += weight * change;
            curvature[(one, one)] += weight;
            curvature[(other, other)] += weight;
            curvature[(other, one)] -= weight;
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector, Vector2};

    use super::*;

    #[test]
    fn verif_gradient_is_that_of_the_cost() {
        let mut curve = Curve::new(1.0, Vector2::zeros(), 0.0, 5e-3);
        curve.extend(-1e-3, 1e-3);
        let size = curve.size();
        let waves: Vec<f64> = (0..size).map(|i| if i < ANCHOR { 0.0 } else { (2.0 * i as f64).sin() }).collect();
        let curve = curve.moved(&waves);
        let prior = Prior::default();
        let mut quadratic =
            Quadratic { cost: 0.0, gradient: DVector::zeros(size), curvature: DMatrix::zeros(size, size) };
        prior.add_to(&curve, &mut quadratic);
        for i in 0..size {
            let cost = |by: f64| {
                let mut step = vec![0.0; size];
                step[i] = by;
                prior.cost(&curve.moved(&step))
            };
            let expected = (cost(1e-6) - cost(-1e-6)) / 2e-6;
            assert!((quadratic.gradient[i] - expected).abs() < 1e-6, "{i}: {} {expected}", quadratic.gradient[i]);
        }
        assert!(quadratic.curvature.cholesky().is_some());
    }
}
