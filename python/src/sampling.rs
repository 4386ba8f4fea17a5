//! Whether a running estimator takes its samples by `step` or by `update`.

use pyo3::prelude::*;

use crate::error::refused;

/// Samples that an estimator has taken since its start: none, by `step`, or by `update` with the last time (s).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) enum Sampling {
    #[default]
    Unused,
    Steps,
    Updates(f64),
}

impl Sampling {
    /// Takes the time since the last sample of `step` (s).
    ///
    /// # Errors
    /// `ValueError` if the time is negative, zero after the first sample or not finite, or if the samples are those of `update`.
    pub(crate) fn step(&mut self, dt_s: f64) -> PyResult<()> {
        if matches!(self, Self::Updates(_)) {
            return Err(refused("step", "samples given by `update` before", "`update`, or `reset` before `step`"));
        }
        let is_first = matches!(self, Self::Unused);
        if !dt_s.is_finite() || dt_s < 0.0 || (dt_s == 0.0 && !is_first) {
            let expected = if is_first { "a finite number of 0 or more" } else { "a positive number" };
            return Err(refused("dt_s", dt_s, expected));
        }
        *self = Self::Steps;
        Ok(())
    }

    /// Takes the time of a sample of `update` (s).
    ///
    /// # Errors
    /// `ValueError` if the time is not after the last one or not finite, or if the samples are those of `step`.
    pub(crate) fn update(&mut self, t_s: f64) -> PyResult<()> {
        let expected = match *self {
            Self::Steps => {
                return Err(refused("update", "samples given by `step` before", "`step`, or `reset` before `update`"));
            }
            Self::Updates(last_s) if t_s <= last_s => format!("more than the last, {last_s}"),
            _ if !t_s.is_finite() => "a finite number".into(),
            _ => {
                *self = Self::Updates(t_s);
                return Ok(());
            }
        };
        Err(refused("t_s", t_s, &expected))
    }
}
