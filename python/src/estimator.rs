//! The class `Estimator`.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ::trace::Instant;
use ::whisker::estimators::{self, BaseNoise, EstimatorRow, Knowledge, Runner, Sample};
use ::whisker::events::TouchConfig;
use ::whisker::frames::Pose;
use anyhow::Context;
use pyo3::prelude::*;
use serde_json::Value;
use testbed::replay::{self, Steps, method};

use crate::arrays::{Numbers, numbers, same_length, times};
use crate::calibration::Calibration;
use crate::convert::{
    Motion, Placed, base_noise as base_noise_of, check_finite, check_not_negative, check_rate,
    contact_prior as prior_of, from_json, poses, settings_over, to_json,
};
use crate::error::raised;
use crate::estimate::Estimate;
use crate::interrupt;
use crate::outline::Outline;
use crate::replay::Replay;
use crate::sampling::Sampling;

/// Registered estimator with its contact detector.
///
/// `name` is one of `estimators()`, `noise_sd_n_m` the standard deviation of the sensor's measurement noise (N m), `rate_hz`
/// the sampling rate, `settings` a dictionary over the estimator's defaults and `touch` one over those of a contact detector
/// (`{"detector": name, ...}`). `base_noise` (3, 3) is the covariance of the base's measured pose (x, y, yaw) in Base.
/// `contact_prior` is the prior of the first contact in Base: x (m), y (m) and standard deviation (m). `seed` is that of
/// random numbers.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Estimator {
    setup: Setup,
    running: Mutex<Running>,
}

/// Inputs from which an estimator is constructed.
struct Setup {
    row: &'static EstimatorRow,
    config: Value,
    touch: TouchConfig,
    knowledge: Arc<Knowledge>,
    seed: u64,
}

struct Running {
    estimator: estimators::Estimator,
    sampling: Sampling,
    steps: Steps,
}

impl From<estimators::Estimator> for Running {
    fn from(estimator: estimators::Estimator) -> Self {
        Self { estimator, sampling: Sampling::default(), steps: Steps::default() }
    }
}

impl Setup {
    fn start(&self) -> PyResult<estimators::Estimator> {
        let method = method(self.row, &self.config, &self.knowledge).map_err(raised)?;
        Ok(estimators::Estimator::new(Runner::new(method, self.knowledge.clone(), self.seed), self.touch))
    }
}

/// Registry row and settings of an estimator.
pub(crate) fn registered(name: &str, settings: Option<&Bound<'_, PyAny>>) -> PyResult<(&'static EstimatorRow, Value)> {
    let row = replay::registered(name).map_err(raised)?;
    Ok((row, settings_over(name, (row.defaults)(), settings)?))
}

/// Settings of the contact detection.
pub(crate) fn detection(touch: Option<&Bound<'_, PyAny>>) -> PyResult<TouchConfig> {
    let Some(touch) = touch else { return Ok(TouchConfig::default()) };
    let config: TouchConfig = serde_json::from_value(to_json("touch", touch)?).context("touch").map_err(raised)?;
    config.validate().context("touch").map_err(raised)?;
    Ok(config)
}

impl Estimator {
    fn running(&self) -> MutexGuard<'_, Running> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn estimate(&self, estimate: Option<estimators::Estimate>, reading_n_m: f64) -> Option<Estimate> {
        estimate.map(|estimate| Estimate::new(estimate, reading_n_m, &self.setup.knowledge))
    }
}

#[pymethods]
impl Estimator {
    #[new]
    #[pyo3(signature = (
        name, calibration, noise_sd_n_m, rate_hz, settings=None, *, touch=None, base_noise=None, contact_prior=None, seed=1
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        name: &str,
        calibration: &Calibration,
        noise_sd_n_m: f64,
        rate_hz: f64,
        settings: Option<&Bound<'_, PyAny>>,
        touch: Option<&Bound<'_, PyAny>>,
        base_noise: Option<Numbers<'_>>,
        contact_prior: Option<[f64; 3]>,
        seed: u64,
    ) -> PyResult<Self> {
        check_not_negative("noise_sd_n_m", noise_sd_n_m)?;
        check_rate(rate_hz)?;
        let (row, config) = registered(name, settings)?;
        let base_noise: BaseNoise = base_noise_of(base_noise.as_ref())?;
        let knowledge = Arc::new(Knowledge {
            whisker: calibration.file.whisker.clone(),
            rest: calibration.file.whisker.rest_shape(),
            faces: calibration.calibrated(row.sensor_model)?,
            noise_sd_n_m,
            base_noise,
            rate_hz,
            contact_prior: prior_of(contact_prior)?,
        });
        let setup = Setup { row, config, touch: detection(touch)?, knowledge, seed };
        let running = Mutex::new(setup.start()?.into());
        Ok(Self { setup, running })
    }

    /// Name in the registry.
    #[getter]
    fn name(&self) -> &'static str {
        self.setup.row.name
    }

    /// Settings of the estimator, with its defaults.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.setup.config)
    }

    /// Takes one sample: the motion of the base since the last one, the time since then (s) and the reading (N m).
    ///
    /// `motion` is the pose (x in m, y in m, yaw in rad) of the base's frame at the last sample in its present frame; a tuple is
    /// the fastest. `dt_s` is positive, or 0 at the first sample. Returns `None` while the whisker is free, at a reading beyond
    /// `Calibration.gate_n_m`, and where the method has no estimate. Raises `ValueError` for numbers that are not finite.
    fn step(&self, motion: Motion, dt_s: f64, reading_n_m: f64) -> PyResult<Option<Estimate>> {
        check_finite("reading_n_m", reading_n_m)?;
        let mut running = self.running();
        running.sampling.step(dt_s)?;
        let estimate = running.estimator.step(&Sample { motion: motion.0, dt_s, reading_n_m });
        Ok(self.estimate(estimate, reading_n_m))
    }

    /// Takes one sample given by the time (s), the pose of the base in World (x in m, y in m, yaw in rad) and the reading (N m).
    ///
    /// The times must ascend; the yaw may be wrapped. An estimator takes its samples either by `step` or by `update`.
    fn update(&self, t_s: f64, base: Placed, reading_n_m: f64) -> PyResult<Option<Estimate>> {
        check_finite("reading_n_m", reading_n_m)?;
        let mut running = self.running();
        running.sampling.update(t_s)?;
        let sample = running.steps.sample(&instant(t_s, base.0, reading_n_m), reading_n_m);
        let estimate = running.estimator.step(&sample);
        Ok(self.estimate(estimate, reading_n_m))
    }

    /// Replays a recording from its beginning, independently of `step`: times (n) in s, poses of the base in World (n, 3) in m
    /// and rad, and readings (n) in N m. A method that smooths revises its estimates when a contact ends.
    fn replay(
        &self,
        py: Python<'_>,
        t_s: Numbers<'_>,
        base: Numbers<'_>,
        readings_n_m: Numbers<'_>,
    ) -> PyResult<Replay> {
        let times_s = times("t_s", &t_s)?;
        let (poses, readings_n_m) = (poses(&base)?, numbers("readings_n_m", &readings_n_m)?);
        same_length("base", poses.len(), "t_s", times_s.len())?;
        same_length("readings_n_m", readings_n_m.len(), "t_s", times_s.len())?;
        let places = times_s.iter().zip(&poses).zip(&readings_n_m);
        let instants: Vec<Instant> =
            places.map(|((&t_s, &base), &reading_n_m)| instant(t_s, base, reading_n_m)).collect();
        let mut estimator = self.setup.start()?;
        let mut steps = Steps::default();
        let mut estimates = Vec::with_capacity(instants.len());
        interrupt::each(py, instants.len(), |row| {
            estimator.push(&steps.sample(&instants[row], readings_n_m[row]), &mut estimates);
            Ok(())
        })?;
        py.detach(|| estimator.end(&mut estimates));
        Ok(Replay::new(self.setup.knowledge.clone(), instants, None, readings_n_m, estimates, estimator.outline()))
    }

    /// Outline of the object that is touched, or was touched last, in Start. `None` for methods that estimate contacts only.
    fn outline(&self) -> Option<Outline> {
        self.running().estimator.outline().map(|outline| Outline::carried(&outline.points))
    }

    /// Whether a contact is being tracked.
    #[getter]
    fn touching(&self) -> bool {
        self.running().estimator.is_following()
    }

    /// Resets the estimator: discards all samples.
    fn reset(&self) -> PyResult<()> {
        *self.running() = self.setup.start()?.into();
        Ok(())
    }

    fn __repr__(&self) -> String {
        format!("<Estimator {} of {}>", self.setup.row.name, self.setup.knowledge.whisker.name)
    }
}

fn instant(t_s: f64, [x_m, y_m, yaw_rad]: [f64; 3], moment_z_n_m: f64) -> Instant {
    Instant { t_s, base: Pose::new(x_m, y_m, yaw_rad), twist: None, moment_z_n_m, rotation_z_rad: None }
}
