//! Interface of a regression, and the transformed features that several of them share.

use std::fmt::Debug;

use crate::calibration::{Error, Features, LabelledPress};

/// A fitted regression. It extrapolates; a [`Calibration`](crate::calibration::Calibration) evaluates it only near the
/// features it was fitted to.
pub trait Regressor: Debug + Send + Sync {
    /// Radial distance of the contact from the whisker's root (m); not a number if a feature is missing that the regression uses.
    fn distance_m(&self, features: &Features) -> f64;

    /// Fitted coefficients, in the order of [`LiveFit::coefficients`].
    fn coefficients(&self) -> Vec<f64>;
}

/// A fitted regression that uses the true distance as a feature.
pub trait LeakingRegressor: Debug + Send + Sync {
    /// Radial distance (m) computed from the features *and the true distance* of a press.
    fn distance_m(&self, press: &LabelledPress) -> f64;
}

/// Fits a regression to labelled presses.
pub type Fitter<R> = fn(&[LabelledPress]) -> Result<Box<R>, Error>;

/// Restores a fitted regression from its coefficients, which are finite and as many as their names. The error is the
/// index of a coefficient out of range, and the range.
pub type Restorer = fn(&[f64]) -> Result<Box<dyn Regressor>, (usize, &'static str)>;

/// Fit of a regression that needs only features available at run time.
#[derive(Clone, Copy, Debug)]
pub struct LiveFit {
    /// Names of its coefficients, in the order in which a calibration file stores them; a suffix is the unit.
    pub coefficients: &'static [&'static str],
    /// Quantities by which it estimates. Their ranges over the presses are the calibrated domain.
    pub quantities: &'static [Quantity],
    /// Fit to labelled presses.
    pub fit: Fitter<dyn Regressor>,
    /// Inverse of [`Regressor::coefficients`]: the restored regression gives the same distances, bit for bit.
    pub restore: Restorer,
}

/// Features that a regression is fitted to.
#[derive(Clone, Copy, Debug)]
pub enum Fit {
    /// Features that are available at run time.
    Live(LiveFit),
    /// The true distance too, as was published: it can be cross-validated, not used.
    Leaking(Fitter<dyn LeakingRegressor>),
}

/// Affine map of the fitted values to -1 .. 1, which keeps the powers of a polynomial well conditioned.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub(super) middle: f64,
    pub(super) half: f64,
}

impl Scale {
    /// Range of [`Scale::half`] in a file.
    pub(super) const HALF: &str = "a number above zero";

    /// `None` if all values are equal.
    pub(super) fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        (high > low).then_some(Self { middle: 0.5 * (low + high), half: 0.5 * (high - low) })
    }

    pub(super) fn scaled(&self, value: f64) -> f64 {
        (value - self.middle) / self.half
    }
}

/// Quantity of a press by which a regression estimates, such as the natural logarithm of a slope in counts/s; not a number if the
/// feature is missing.
pub type Quantity = fn(&Features) -> f64;

/// Checks that every press has the slope before the low-pass.
pub(super) fn with_ramps(regression: &'static str, presses: &[LabelledPress]) -> Result<(), Error> {
    match presses.iter().position(|press| press.features.ramp_counts_per_s.is_none()) {
        Some(i) => Err(Error::Feature { regression, feature: "ramp_counts_per_s", press: i + 1 }),
        None => Ok(()),
    }
}

/// Natural logarithm of the slope before the low-pass in counts/s; not a number if the push was too short, and so is
/// the distance then.
pub(super) fn log_ramp(features: &Features) -> f64 {
    features.ramp_counts_per_s.map_or(f64::NAN, f64::ln)
}

/// Natural logarithm of the slope in counts/s.
pub(super) fn log_slope(features: &Features) -> f64 {
    features.slope_counts_per_s.ln()
}
