//! Fitted coefficients as a calibration file stores them, and the regressions they restore.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::LabelledPress;
use super::cross_validation::CrossValidation;
use super::regression::{LiveFit, Regressor};

/// A regression fitted to all presses, and without each group of them.
#[derive(Debug)]
pub(super) struct Fitted {
    pub(super) all: Box<dyn Regressor>,
    pub(super) held_out: Vec<Box<dyn Regressor>>,
}

/// Coefficients of [`Fitted`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Coefficients {
    /// Names, in the order of the values below.
    names: Vec<String>,
    /// Fit to all presses.
    all: Vec<f64>,
    /// Fit without each group of presses, in the order of the groups.
    held_out: Vec<Vec<f64>>,
}

impl Fitted {
    /// Errors on the presses, each by the regression without its group.
    pub(super) fn validation(&self, presses: &[LabelledPress], groups: &[usize]) -> CrossValidation {
        let estimate = |(press, &group): (&LabelledPress, &usize)| self.held_out[group].distance_m(&press.features);
        let estimated_m: Vec<f64> = presses.iter().zip(groups).map(estimate).collect();
        CrossValidation::of(presses, &estimated_m)
    }
}

impl Coefficients {
    /// `None` if a coefficient is not finite, so that no file can hold it.
    pub(super) fn of(fitted: &Fitted, live: &LiveFit) -> Option<Self> {
        let coefficients = Self {
            names: live.coefficients.iter().map(|&name| name.into()).collect(),
            all: fitted.all.coefficients(),
            held_out: fitted.held_out.iter().map(|regressor| regressor.coefficients()).collect(),
        };
        let is_finite = |values: &Vec<f64>| values.iter().all(|value| value.is_finite());
        let all_finite = is_finite(&coefficients.all) && coefficients.held_out.iter().all(is_finite);
        all_finite.then_some(coefficients)
    }

    /// The regressions of these coefficients, for presses in so many groups.
    ///
    /// # Errors
    /// [`files::Error::Value`] names the key of a wrong name, count or coefficient.
    pub(super) fn restore(&self, path: &Path, live: &LiveFit, groups: usize) -> Result<Fitted, files::Error> {
        if self.names != live.coefficients {
            let [found, expected] = [self.names.join(", "), live.coefficients.join(", ")];
            return Err(files::Error::value(path, "coefficients.names", found, expected));
        }
        if self.held_out.len() != groups {
            let found = format!("{} rows", self.held_out.len());
            let expected = format!("{groups}, one for each group of presses held out");
            return Err(files::Error::value(path, "coefficients.held_out", found, expected));
        }
        let row = |key: String, values: &[f64]| {
            if values.len() != live.coefficients.len() {
                let expected = format!("{}, as many as names", live.coefficients.len());
                return Err(files::Error::value(path, key, format!("{} numbers", values.len()), expected));
            }
            let finite =
                |(i, value): (usize, &f64)| if value.is_finite() { Ok(()) } else { Err((i, "a finite number")) };
            let checked = values.iter().enumerate().try_for_each(finite);
            checked.and_then(|()| (live.restore)(values)).map_err(|(i, expected)| {
                let key = format!("{key}.{i} ({})", live.coefficients[i]);
                files::Error::value(path, key, values[i], expected)
            })
        };
        let held_out = self.held_out.iter().enumerate();
        Ok(Fitted {
            all: row("coefficients.all".into(), &self.all)?,
            held_out: held_out
                .map(|(i, values)| row(format!("coefficients.held_out.{i}"), values))
                .collect::<Result<_, _>>()?,
        })
    }
}
