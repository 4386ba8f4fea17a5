//! Fitted physical parameters, in the plane and in space: method of the fit, and checks of what is configured and stored.

use filters::least_squares::{Damping, Method, Outcome, Settings};
use nalgebra::SVector;

use super::ModelError;

/// Levenberg-Marquardt method, until the negative logarithm of the posterior density decreases by less than 0.005: a
/// tenth of a standard deviation.
pub(crate) const SETTINGS: Settings = Settings {
    method: Method::LevenbergMarquardt(Damping { restart: 1e-3, highest: 1e5, ..Damping::MARQUARDT }),
    iterations: 60,
    absolute: 5e-3,
    relative: 0.0,
    step: 0.0,
};

/// Share of its prior standard deviation to which the data must reduce that of a parameter that counts as informed by
/// them.
pub(crate) const INFORMED_SHARE: f64 = 0.5;

pub(crate) fn no_solution() -> ModelError {
    ModelError::Data("the whisker's parameters have no equilibrium over the calibrated domain".into())
}

/// Checks that a fit with [`SETTINGS`] has settled.
pub(crate) fn check_settled(outcome: Outcome) -> Result<(), ModelError> {
    if outcome == Outcome::IterationLimit {
        let steps = SETTINGS.iterations;
        return Err(ModelError::Data(format!("the whisker's parameters do not settle in {steps} steps")));
    }
    Ok(())
}

/// Checks configured standard deviations, each with its key.
pub(crate) fn check_sds<'a>(sds: impl IntoIterator<Item = (&'a str, f64)>) -> Result<(), ModelError> {
    match sds.into_iter().find(|(_, sd)| !(sd.is_finite() && *sd >= 0.0)) {
        Some((key, found)) => Err(ModelError::Data(format!("`{key}`: found {found}, expected a number of 0 or more"))),
        None => Ok(()),
    }
}

/// Values changed by a step, which is one of the logarithm for the leading `positive` ones.
pub(crate) fn moved<const COUNT: usize>(
    values: &SVector<f64, COUNT>,
    positive: usize,
    step: &SVector<f64, COUNT>,
) -> SVector<f64, COUNT> {
    SVector::from_fn(|i, _| if i < positive { values[i] * step[i].exp() } else { values[i] + step[i] })
}

/// Values of stored parameters, which must have these names in this order, the leading `positive` ones positive.
pub(crate) fn read<'a, const COUNT: usize>(
    names: &[&str; COUNT],
    positive: usize,
    stored: impl Iterator<Item = (&'a str, f64)> + Clone,
) -> Result<SVector<f64, COUNT>, ModelError> {
    if stored.clone().map(|(name, _)| name).ne(names.iter().copied()) {
        return Err(ModelError::Data(format!("expected the parameters {}, in this order", names.join(", "))));
    }
    let wrong = |(i, (_, value)): &(usize, (&str, f64))| !value.is_finite() || *i < positive && *value <= 0.0;
    if let Some((i, (name, value))) = stored.clone().enumerate().find(wrong) {
        let expected = if i < positive { "a positive number" } else { "a finite number" };
        return Err(ModelError::Data(format!("`{name}`: found {value}, expected {expected}")));
    }
    Ok(SVector::from_iterator(stored.map(|(_, value)| value)))
}
