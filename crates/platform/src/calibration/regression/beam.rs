//! Physical model: a conical beam on a gel hinge.
//!
//! An edge at distance `d` displaces the shaft by `p`. Its force `F` turns the hinge of stiffness `k` by `F d / k` and
//! bends the shaft by `F c` at the edge, where for a cone with its virtual tip at `t` and the stiffness `E I` at its
//! root `c = d^3 / (3 E I (1 - d / t))` (Castigliano: the integral over `s` of `(d - s)^2 / (E I (1 - s / t)^4)`). The
//! hinge therefore turns by `p / (d + l d^2 / (1 - d / t))` with `l = k / (3 E I)`, and at a constant speed of the edge
//! the slope is that with a gain `g` instead of `p`. `g`, `l` and `t` are fitted to the distances by
//! Levenberg-Marquardt.
//!
//! The low-pass decreases the slope of a push that is shorter than its rise time, the more the shorter it is. [`RAMP`]
//! is fitted to the slope before the low-pass instead, so that the depth of a push does not matter.
//!
//! Not modelled: the finite angle of the twist, the non-linear field of the magnet, a speed of the edge that depends on the depth.

use filters::least_squares::{Damping, Evaluated, Method, Residuals, Settings, central_jacobian, minimise};
use nalgebra::{DMatrix, DVector, dvector};

use super::regressor::{LiveFit, Quantity, Regressor, log_ramp, log_slope, with_ramps};
use crate::calibration::{Error, Features, LabelledPress};

/// Upper end of the search for a distance, as a share of the virtual tip's distance.
const OUTERMOST: f64 = 0.999;

/// Levenberg-Marquardt method, until the sum of squares decreases by less than 1e-10 of itself.
const SETTINGS: Settings = Settings {
    method: Method::LevenbergMarquardt(Damping { first: 1e-3, highest: 1e12, ..Damping::MARQUARDT }),
    iterations: 100,
    absolute: 0.0,
    relative: 1e-10,
    step: 0.0,
};

const COEFFICIENTS: &[&str] = &["log_gain_counts_m_per_s", "bend_per_m", "tip_m"];

pub(super) const LIVE: LiveFit = LiveFit {
    coefficients: COEFFICIENTS,
    quantities: &[log_slope],
    fit: |presses| fit("beam", presses, log_slope),
    restore: |coefficients| restore(coefficients, log_slope),
};

pub(super) const RAMP: LiveFit = LiveFit {
    coefficients: COEFFICIENTS,
    quantities: &[log_ramp],
    fit: |presses| {
        with_ramps("beam-ramp", presses)?;
        fit("beam-ramp", presses, log_ramp)
    },
    restore: |coefficients| restore(coefficients, log_ramp),
};

#[derive(Clone, Copy, Debug)]
struct Beam {
    measured: Quantity,
    log_gain: f64,
    bend_per_m: f64,
    tip_m: f64,
}

impl Beam {
    /// Beam of the unconstrained parameters `ln g`, `ln (l r)` and `ln (t / r - 1)`, with the reach `r` (m): any value
    /// of them is physical.
    fn new(parameters: &DVector<f64>, reach_m: f64, measured: Quantity) -> Self {
        Self {
            measured,
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
        let wanted = (self.measured)(features);
        if wanted.is_nan() {
            return f64::NAN;
        }
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

fn restore(coefficients: &[f64], measured: Quantity) -> Result<Box<dyn Regressor>, (usize, &'static str)> {
    let [log_gain, bend_per_m, tip_m] = coefficients.try_into().expect("as many as names");
    // Zero and very large values are limits that a fit may reach.
    if bend_per_m < 0.0 {
        return Err((1, "a number not below zero"));
    }
    if tip_m <= 0.0 {
        return Err((2, "a distance above zero"));
    }
    Ok(Box::new(Beam { measured, log_gain, bend_per_m, tip_m }))
}

fn fit(name: &'static str, presses: &[LabelledPress], measured: Quantity) -> Result<Box<dyn Regressor>, Error> {
    let reach_m = presses.iter().map(|press| press.distance_m).fold(0.0, f64::max);
    let nearest_m = presses.iter().map(|press| press.distance_m).fold(f64::INFINITY, f64::min);
    let differ = presses.iter().any(|press| measured(&press.features) != measured(&presses[0].features));
    if !differ || nearest_m >= reach_m {
        return Err(Error::Undetermined(name));
    }
    let distances = Distances { presses, reach_m, measured };
    let gain = |bend: f64, taper: f64| {
        // Mean gain over the presses for these starting values of bend and taper.
        let beam = Beam::new(&dvector![0.0, bend, taper], reach_m, measured);
        let gains = presses.iter().map(|press| measured(&press.features) - beam.log_slope(press.distance_m));
        gains.sum::<f64>() / presses.len() as f64
    };
    let starts = [-2.0, 0.0, 2.0].into_iter().flat_map(|bend| [-2.0, 0.0].map(|taper| (bend, taper)));
    let fits = starts.filter_map(|(bend, taper)| {
        let start = Evaluated::new(&distances, dvector![gain(bend, taper), bend, taper])?;
        minimise(&distances, start, &SETTINGS).map(|solution| solution.state)
    });
    let best = fits.min_by(|a, b| a.cost().total_cmp(&b.cost())).ok_or(Error::Undetermined(name))?;
    Ok(Box::new(Beam::new(&best.x, reach_m, measured)))
}

/// Residuals of the distances, relative to the reach, by the parameters of [`Beam::new`].
struct Distances<'a> {
    presses: &'a [LabelledPress],
    reach_m: f64,
    measured: Quantity,
}

impl Residuals for Distances<'_> {
    fn residuals(&self, parameters: &DVector<f64>) -> Option<DVector<f64>> {
        let beam = Beam::new(parameters, self.reach_m, self.measured);
        let of_press = |press: &LabelledPress| (beam.distance_m(&press.features) - press.distance_m) / self.reach_m;
        Some(DVector::from_iterator(self.presses.len(), self.presses.iter().map(of_press)))
    }

    fn jacobian(&self, at: &Evaluated) -> Option<DMatrix<f64>> {
        central_jacobian(self, at, 1e-5)
    }
}
