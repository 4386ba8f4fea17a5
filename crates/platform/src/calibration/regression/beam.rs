//! Physics: a conical beam on a gel hinge.
//!
//! An edge at distance `d` displaces the shaft by `p`. Its force `F` turns the hinge of stiffness `k` by `F d / k` and bends the shaft by `F c` at the
//! edge, where for a cone with its virtual tip at `t` and the stiffness `E I` at its root `c = d^3 / (3 E I (1 - d / t))` (Castigliano: the integral over
//! `s` of `(d - s)^2 / (E I (1 - s / t)^4)`). So the hinge turns by `p / (d + l d^2 / (1 - d / t))` with `l = k / (3 E I)`, and at a constant speed of
//! the edge the slope is that with a gain `g` instead of `p`. `g`, `l` and `t` are fitted to the distances by Levenberg-Marquardt.
//!
//! Not modelled: the finite angle of the twist, the non-linear field of the magnet, the low-pass.

use nalgebra::{DMatrix, DVector, Vector3};

use super::regressor::{LiveFit, Regressor, log_slope};
use crate::calibration::{Error, Features, LabelledPress};

const NAME: &str = "beam";

/// Upper end of the search for a distance, as a share of the virtual tip's distance.
const OUTERMOST: f64 = 0.999;

const ROUNDS: usize = 100;

pub(super) const LIVE: LiveFit =
    LiveFit { coefficients: &["log_gain_counts_m_per_s", "bend_per_m", "tip_m"], fit, restore };

#[derive(Clone, Copy, Debug)]
struct Beam {
    log_gain: f64,
    bend_per_m: f64,
    tip_m: f64,
}

impl Beam {
    /// Beam of the unconstrained parameters `ln g`, `ln (l r)` and `ln (t / r - 1)`, with the reach `r` (m): any value of them is physical.
    fn new(parameters: &Vector3<f64>, reach_m: f64) -> Self {
        Self {
            log_gain: parameters[0],
            bend_per_m: parameters[1].exp() / reach_m,
            tip_m: reach_m * (1.0 + parameters[2].exp()),
        }
    }

    fn log_slope(&self, distance_m: f64) -> f64 {
        let bend = self.bend_per_m * distance_m * distance_m / (1.0 - distance_m / self.tip_m);
        self.log_gain - (distance_m + bend).ln()
    }
}

impl Regressor for Beam {
    fn distance_m(&self, features: &Features) -> f64 {
        let wanted = log_slope(features);
        // The slope decreases with the distance: bisection.
        let (mut low, mut high) = (0.0, OUTERMOST * self.tip_m);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.log_slope(middle) > wanted { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    fn coefficients(&self) -> Vec<f64> {
        vec![self.log_gain, self.bend_per_m, self.tip_m]
    }
}

fn restore(coefficients: &[f64]) -> Result<Box<dyn Regressor>, (usize, &'static str)> {
    let [log_gain, bend_per_m, tip_m] = coefficients.try_into().expect("as many as names");
    // Zero and very large values are limits that a fit may reach.
    if bend_per_m < 0.0 {
        return Err((1, "a number not below zero"));
    }
    if tip_m <= 0.0 {
        return Err((2, "a distance above zero"));
    }
    Ok(Box::new(Beam { log_gain, bend_per_m, tip_m }))
}

fn fit(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    let reach_m = presses.iter().map(|press| press.distance_m).fold(0.0, f64::max);
    let nearest_m = presses.iter().map(|press| press.distance_m).fold(f64::INFINITY, f64::min);
    let differ =
        presses.iter().any(|press| press.features.slope_counts_per_s != presses[0].features.slope_counts_per_s);
    if !differ || nearest_m >= reach_m {
        return Err(Error::Undetermined(NAME));
    }
    let residuals = |parameters: &Vector3<f64>| {
        let beam = Beam::new(parameters, reach_m);
        let of_press = |press: &LabelledPress| (beam.distance_m(&press.features) - press.distance_m) / reach_m;
        DVector::from_iterator(presses.len(), presses.iter().map(of_press))
    };
    let gain = |bend: f64, taper: f64| {
        // Mean gain over the presses for these starting values of bend and taper.
        let beam = Beam::new(&Vector3::new(0.0, bend, taper), reach_m);
        let gains = presses.iter().map(|press| log_slope(&press.features) - beam.log_slope(press.distance_m));
        gains.sum::<f64>() / presses.len() as f64
    };
    let starts = [-2.0, 0.0, 2.0].into_iter().flat_map(|bend| [-2.0, 0.0].map(|taper| (bend, taper)));
    let fits = starts.map(|(bend, taper)| levenberg_marquardt(Vector3::new(gain(bend, taper), bend, taper), residuals));
    let best = fits.min_by(|(_, a), (_, b)| a.total_cmp(b)).filter(|(_, squares)| squares.is_finite());
    let (parameters, _) = best.ok_or(Error::Undetermined(NAME))?;
    Ok(Box::new(Beam::new(&parameters, reach_m)))
}

/// Parameters near `start` with the least sum of squares, and that sum.
fn levenberg_marquardt(start: Vector3<f64>, residuals: impl Fn(&Vector3<f64>) -> DVector<f64>) -> (Vector3<f64>, f64) {
    const STEP: f64 = 1e-5;
    let (mut parameters, mut damping) = (start, 1e-3);
    let mut current = residuals(&parameters);
    for _ in 0..ROUNDS {
        let jacobian = DMatrix::from_columns(&[0, 1, 2].map(|i| {
            let step = Vector3::ith(i, STEP);
            (residuals(&(parameters + step)) - residuals(&(parameters - step))) / (2.0 * STEP)
        }));
        let normal = jacobian.transpose() * &jacobian;
        let damped = &normal + DMatrix::from_diagonal(&normal.diagonal().add_scalar(1e-12)) * damping;
        let Some(step) = damped.cholesky().map(|cholesky| cholesky.solve(&(jacobian.transpose() * &current))) else {
            break;
        };
        let next = parameters - Vector3::new(step[0], step[1], step[2]);
        let tried = residuals(&next);
        if tried.norm_squared() < current.norm_squared() {
            let gained = 1.0 - tried.norm_squared() / current.norm_squared();
            (parameters, current, damping) = (next, tried, damping / 10.0);
            if gained < 1e-10 {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    (parameters, current.norm_squared())
}
