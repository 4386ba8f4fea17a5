//! The classes `SpatialEstimator` and `SpatialEstimate`.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ::trace::{SpatialInstant, SpatialPose};
use ::whisker::events::TouchConfig;
use ::whisker::space::estimators::{self, Knowledge, SPATIAL_ESTIMATORS, Sample, SpatialEstimatorRow};
use anyhow::Context;
use nalgebra::{SMatrix, SVector, Vector2};
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};
use testbed::space::replay::{SpatialSteps, read_by, registered};

use super::calibration::SpatialCalibration;
use super::pose::{motion, placed};
use super::replay::SpatialReplay;
use crate::arrays::{Numbers, rows, same_length, times};
use crate::convert::{check_not_negative, check_rate, from_json, settings_over};
use crate::error::{raised, refused};
use crate::interrupt;
use crate::sampling::Sampling;

/// Registered estimators in space: `name`, `about`, `class` and default `settings`.
#[pyfunction]
pub(crate) fn spatial_estimators(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = SPATIAL_ESTIMATORS
        .iter()
        .map(|row| json!({"name": row.name, "about": row.about, "class": row.class(), "settings": row.defaults()}));
    from_json(py, &rows.collect::<Vec<Value>>())
}

/// Registered estimator in space with its contact detector.
///
/// `name` is one of `spatial_estimators()`, `noise_sd_n_m` the standard deviation of the measurement noise of each bending moment
/// (N m), `rate_hz` the sampling rate, and `settings` a dictionary over the estimator's defaults. With a calibration through a
/// front end, readings are those of its sensor, as in `SpatialTrial.readings_n_m`, and `noise_sd_n_m` includes the sensor's noise.
/// Methods of the class `hindsight` revise their estimates in `replay` only.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialEstimator {
    row: &'static SpatialEstimatorRow,
    config: Value,
    knowledge: Arc<Knowledge>,
    running: Mutex<Running>,
}

struct Running {
    estimator: estimators::Estimator,
    sampling: Sampling,
    steps: SpatialSteps,
}

impl From<estimators::Estimator> for Running {
    fn from(estimator: estimators::Estimator) -> Self {
        Self { estimator, sampling: Sampling::default(), steps: SpatialSteps::default() }
    }
}

/// A registered estimator with its settings, before its first sample.
pub(super) fn start(
    row: &SpatialEstimatorRow,
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> PyResult<estimators::Estimator> {
    let built = row.build(config, TouchConfig::default(), knowledge);
    built.with_context(|| format!("settings of `{}`", row.name)).map_err(raised)
}

/// Estimates of all samples of a recording.
pub(super) fn replayed(
    py: Python<'_>,
    estimator: &mut estimators::Estimator,
    samples: &[Sample],
) -> PyResult<Vec<Option<estimators::Estimate>>> {
    let mut estimates = Vec::with_capacity(samples.len());
    interrupt::each(py, samples.len(), |row| {
        estimator.push(&samples[row], &mut estimates);
        Ok(())
    })?;
    estimator.end(&mut estimates);
    Ok(estimates)
}

impl SpatialEstimator {
    fn running(&self) -> MutexGuard<'_, Running> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Both moments, if they are finite.
fn finite(reading_n_m: [f64; 2]) -> PyResult<Vector2<f64>> {
    if !reading_n_m.iter().all(|moment_n_m| moment_n_m.is_finite()) {
        return Err(refused("reading_n_m", format!("{reading_n_m:?}"), "finite numbers"));
    }
    Ok(Vector2::from(reading_n_m))
}

#[pymethods]
impl SpatialEstimator {
    #[new]
    #[pyo3(signature = (name, calibration, noise_sd_n_m, rate_hz, settings=None))]
    fn new(
        name: &str,
        calibration: &SpatialCalibration,
        noise_sd_n_m: f64,
        rate_hz: f64,
        settings: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        check_not_negative("noise_sd_n_m", noise_sd_n_m)?;
        check_rate(rate_hz)?;
        let row = registered(name).map_err(raised)?;
        let config = settings_over(name, row.defaults(), settings)?;
        let calibrated = read_by(&calibration.calibrated, calibration.file.front_end_sensor());
        let knowledge = Arc::new(Knowledge { calibrated, noise_sd_n_m, rate_hz });
        let running = Mutex::new(start(row, &config, &knowledge)?.into());
        Ok(Self { row, config, knowledge, running })
    }

    /// Name in the registry.
    #[getter]
    fn name(&self) -> &'static str {
        self.row.name
    }

    /// Settings of the estimator, with its defaults.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.config)
    }

    /// Takes one sample: the motion of the base since the last one, the time since then (s) and the bending moments about y and z
    /// of Base (N m).
    ///
    /// `motion` is the pose of the base's frame at the last sample in its present frame: x, y, z (m) and a unit quaternion w, x,
    /// y, z. `dt_s` is positive, or 0 at the first sample. Returns `None` while the whisker is free or the method has no estimate.
    fn step(&self, motion: [f64; 7], dt_s: f64, reading_n_m: [f64; 2]) -> PyResult<Option<SpatialEstimate>> {
        let (motion, reading_n_m) = (self::motion(motion)?, finite(reading_n_m)?);
        let mut running = self.running();
        running.sampling.step(dt_s)?;
        let estimate = running.estimator.step(&Sample { motion, dt_s, reading_n_m });
        Ok(estimate.map(|estimate| SpatialEstimate::new(estimate, &self.knowledge)))
    }

    /// Takes one sample given by the time (s), the pose of the base in World (x, y, z in m and a unit quaternion w, x, y, z) and
    /// the bending moments about y and z of Base (N m).
    ///
    /// The times must ascend. An estimator takes its samples either by `step` or by `update`.
    fn update(&self, t_s: f64, base: [f64; 7], reading_n_m: [f64; 2]) -> PyResult<Option<SpatialEstimate>> {
        let (base, reading_n_m) = (placed("base", base)?, finite(reading_n_m)?);
        let mut running = self.running();
        running.sampling.update(t_s)?;
        let sample = running.steps.sample(t_s, &base, reading_n_m);
        let estimate = running.estimator.step(&sample);
        Ok(estimate.map(|estimate| SpatialEstimate::new(estimate, &self.knowledge)))
    }

    /// Replays a recording from its beginning, independently of `step`: times (n) in s, poses of the base in World (n, 7), each x,
    /// y, z (m) and a unit quaternion w, x, y, z, and bending moments about y and z of Base (n, 2) in N m.
    fn replay(
        &self,
        py: Python<'_>,
        t_s: Numbers<'_>,
        base: Numbers<'_>,
        readings_n_m: Numbers<'_>,
    ) -> PyResult<SpatialReplay> {
        let times_s = times("t_s", &t_s)?;
        let (bases, readings) = (rows::<7>("base", &base)?, rows::<2>("readings_n_m", &readings_n_m)?);
        same_length("base", bases.len(), "t_s", times_s.len())?;
        same_length("readings_n_m", readings.len(), "t_s", times_s.len())?;
        let bases = bases.iter().enumerate().map(|(row, &base)| placed(format_args!("base[{row}]"), base));
        let bases: Vec<SpatialPose> = bases.collect::<PyResult<_>>()?;
        let readings_n_m: Vec<Vector2<f64>> = readings.into_iter().map(Vector2::from).collect();
        let mut steps = SpatialSteps::default();
        let known = times_s.iter().zip(&bases).zip(&readings_n_m);
        let samples: Vec<Sample> = known.map(|((t_s, base), reading)| steps.sample(*t_s, base, *reading)).collect();
        let mut estimator = start(self.row, &self.config, &self.knowledge)?;
        let estimates = replayed(py, &mut estimator, &samples)?;
        let instants = times_s.into_iter().zip(bases).zip(&readings_n_m);
        let instants = instants.map(|((t_s, base), reading_n_m)| SpatialInstant::measured(t_s, base, *reading_n_m));
        Ok(SpatialReplay::new(self.knowledge.clone(), instants.collect(), None, readings_n_m, estimates))
    }

    /// Resets the estimator: discards all samples.
    fn reset(&self) -> PyResult<()> {
        let fresh = start(self.row, &self.config, &self.knowledge)?;
        *self.running() = fresh.into();
        Ok(())
    }

    fn __repr__(&self) -> String {
        format!("<SpatialEstimator {} of {}>", self.row.name, self.knowledge.calibrated.whisker.whisker.name)
    }
}

/// Estimate of the contact in space at one instant, in Base.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialEstimate {
    pub(super) estimate: estimators::Estimate,
    knowledge: Arc<Knowledge>,
}

impl SpatialEstimate {
    pub(super) fn new(estimate: estimators::Estimate, knowledge: &Arc<Knowledge>) -> Self {
        Self { estimate, knowledge: knowledge.clone() }
    }
}

#[pymethods]
impl SpatialEstimate {
    /// Contact (3) on the centre line, in Base (m).
    #[getter]
    fn contact<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, &self.estimate.contact.vector())
    }

    /// Posterior covariance of the contact (3, 3), in Base (m2).
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        square(py, &self.estimate.covariance_m2)
    }

    /// Point (3) of the object's surface, in Base (m): the contact shifted by the wire's radius towards the object.
    #[getter]
    fn surface<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let surface = self.knowledge.calibrated.surface(self.estimate.contact, self.estimate.normal);
        array(py, &surface.vector())
    }

    /// Unit normal (3) of the touched surface out of the object, in Base.
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, &self.estimate.normal)
    }

    /// Posterior covariance of the normal (3, 3), in Base (rad2), singular along the normal itself.
    #[getter]
    fn normal_covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        square(py, &self.estimate.normal_covariance)
    }

    /// Unit direction (3) of the edge or rod in Base, of either sign. `None` if the method does not estimate it.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.estimate.direction.map(|direction| array(py, &direction.along))
    }

    /// Standard deviation of the angle of `direction` in the tangent plane of the contact (rad).
    #[getter]
    fn direction_sd_rad(&self) -> Option<f64> {
        self.estimate.direction.map(|direction| direction.sd_rad)
    }

    /// Radius of a sphere, or of a rod across its axis (m). `None` if the method does not estimate it.
    #[getter]
    fn radius_m(&self) -> Option<f64> {
        self.estimate.radius.map(|radius| radius.radius_m)
    }

    /// Standard deviation of `radius_m` (m).
    #[getter]
    fn radius_sd_m(&self) -> Option<f64> {
        self.estimate.radius.map(|radius| radius.sd_m)
    }

    /// Whether the contact lies in the calibrated domain of the sensor model.
    #[getter]
    fn calibrated(&self) -> bool {
        self.estimate.calibrated
    }

    /// Whether the readings contradict the models of the method, so that the covariance may be too small. `None` if the method does
    /// not judge them.
    #[getter]
    fn model_doubtful(&self) -> Option<bool> {
        self.estimate.model_doubtful
    }

    /// Probabilities of the competing models by name, in descending order. `None` for methods with one model only.
    #[getter]
    fn models<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(shares) = self.estimate.models else { return Ok(None) };
        let models = PyDict::new(py);
        shares.iter().try_for_each(|(name, share)| models.set_item(name, share))?;
        Ok(Some(models))
    }

    /// Innovation (2) of the last update (N m): bending moments minus predicted ones, about the axes of the readings. `None` where
    /// there is none, as at the touch.
    #[getter]
    fn innovation_n_m<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.estimate.innovation.map(|innovation| array(py, &innovation.residual))
    }

    /// Covariance of the innovation (2, 2), in N2 m2.
    #[getter]
    fn innovation_covariance_n2_m2<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        self.estimate.innovation.map(|innovation| square(py, &innovation.covariance))
    }

    fn __repr__(&self) -> String {
        let at = 1e3 * self.estimate.contact.vector();
        let sd_mm = 1e3 * self.estimate.covariance_m2.trace().sqrt();
        format!("<SpatialEstimate: contact ({:.3}, {:.3}, {:.3}) mm, sd {sd_mm:.3} mm>", at.x, at.y, at.z)
    }
}

fn array<'py, const N: usize>(py: Python<'py>, vector: &SVector<f64, N>) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, vector.as_slice())
}

fn square<'py, const N: usize>(py: Python<'py>, matrix: &SMatrix<f64, N, N>) -> Bound<'py, PyArray2<f64>> {
    numpy::ndarray::Array2::from_shape_fn((N, N), |place| matrix[place]).to_pyarray(py)
}
