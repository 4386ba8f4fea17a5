//! The class `SpatialTrial`: a trace in space with measurement noise, its replays and their scores.

use std::sync::{Arc, OnceLock};

use ::trace::SpatialPose;
use ::whisker::events::TouchConfig;
use ::whisker::space::estimators::{Estimate, Knowledge, Sample, TouchDetector};
use ::whisker::space::frames::Point;
use nalgebra::{Rotation3, UnitQuaternion, Vector2};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};
use testbed::front_end::SpatialFrontEnd;
use testbed::space::bound::SpatialBoundAt;
use testbed::space::replay::{check_calibration, knowledge, registered, samples};
use testbed::space::trial::SpatialTrial as Reference;
use testbed::space::{largest_reading_n_m, to_base};

use super::calibration::SpatialCalibration;
use super::estimator::{replayed, start};
use super::replay::SpatialReplay;
use super::returned::returned;
use super::trace::SpatialTrace;
use crate::arrays::{column, flags, structured, vectors};
use crate::convert::{check_not_negative, settings_over};
use crate::error::{of_argument, raised, refused};
use crate::trial::front_end_of;

/// A trace in space with measurement noise, as `whisker replay` and `whisker evaluate` give it to an estimator, and with the truth
/// that estimates are scored against.
///
/// `noise` is the standard deviation of the noise of each bending moment, as a fraction of the trace's largest bending moment (for
/// that of its group, as of `whisker evaluate`, use `evaluate` or `noise_sd_n_m`), by default 0.01, and 0 for a front end with its
/// own noise and for a recording of a real sensor; `noise_sd_n_m` states it in N m instead. `seed` is that of the noise and of the
/// front end. `front_end` is the sensor between moment and reading, see `spatial_front_ends()`, with the settings
/// `front_end_settings`. The calibration must be one of the trace's whisker through the same front end. `ValueError` names a wrong
/// argument.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialTrial {
    trace: Py<SpatialTrace>,
    calibration: Py<SpatialCalibration>,
    seed: u64,
    knowledge: Arc<Knowledge>,
    readings_n_m: Vec<Vector2<f64>>,
    samples: Vec<Sample>,
    /// The trial as scores see it, with its bound.
    reference: OnceLock<Reference>,
}

impl SpatialTrial {
    fn reference(&self) -> &Reference {
        self.reference.get_or_init(|| Reference::new(self.trace.get().trace.clone(), self.knowledge.clone()))
    }

    /// Checks that a replay is one of this trial: that it has the times, poses and readings of its rows.
    fn check(&self, replay: &SpatialReplay) -> PyResult<()> {
        let trace = &self.trace.get().trace;
        let instants = &trace.recording.instants;
        let (found, expected) = (replay.instants.len(), instants.len());
        if found != expected {
            return Err(refused("replay", format!("{found} rows"), &format!("{expected}, as many as the trace has")));
        }
        let rows = replay.instants.iter().zip(&replay.readings_n_m).zip(instants.iter().zip(&self.readings_n_m));
        for (row, ((found, found_n_m), (expected, expected_n_m))) in rows.enumerate() {
            let (what, found, expected) = if found.t_s != expected.t_s {
                ("time", found.t_s.to_string(), expected.t_s.to_string())
            } else if found.base != expected.base {
                ("base", pose(&found.base), pose(&expected.base))
            } else if found_n_m != expected_n_m {
                ("reading", format!("{:?}", found_n_m.as_slice()), format!("{:?}", expected_n_m.as_slice()))
            } else {
                continue;
            };
            let expected = format!("{expected}, that of the trial of {}", trace.sidecar.name);
            return Err(refused(&format!("replay: row {row}: {what}"), found, &expected));
        }
        Ok(())
    }

    /// Replay of this trace with the truth beside the estimates.
    fn replay_of(&self, estimates: Vec<Option<Estimate>>) -> SpatialReplay {
        let trace = &self.trace.get().trace;
        let (instants, truths) = (trace.recording.instants.clone(), trace.truth.instants.clone());
        SpatialReplay::new(self.knowledge.clone(), instants, Some(truths), self.readings_n_m.clone(), estimates)
    }
}

fn pose(base: &SpatialPose) -> String {
    format!("{:?} with the quaternion {:?}", base.position.as_slice(), numbers_of(&base.rotation))
}

/// Numbers w, x, y, z of a quaternion.
fn numbers_of(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k]
}

/// Motion as numbers: x, y, z (m) and a unit quaternion w, x, y, z with a scalar part of at least 0.
fn motion(sample: &Sample) -> [f64; 7] {
    let rotation = Rotation3::from_matrix_unchecked(sample.motion.rotation());
    let [w, x, y, z] = numbers_of(&UnitQuaternion::from_rotation_matrix(&rotation));
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    let moved_m = sample.motion.origin().vector();
    [moved_m.x, moved_m.y, moved_m.z, sign * w, sign * x, sign * y, sign * z]
}

#[pymethods]
impl SpatialTrial {
    #[new]
    #[pyo3(signature = (trace, calibration, noise=None, seed=1, *, noise_sd_n_m=None, front_end=None, front_end_settings=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python class")]
    fn new(
        py: Python<'_>,
        trace: Py<SpatialTrace>,
        calibration: Py<SpatialCalibration>,
        noise: Option<f64>,
        seed: u64,
        noise_sd_n_m: Option<f64>,
        front_end: Option<String>,
        front_end_settings: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        for (what, number) in [("noise", noise), ("noise_sd_n_m", noise_sd_n_m)] {
            number.map_or(Ok(()), |number| check_not_negative(what, number))?;
        }
        if noise.is_some() && noise_sd_n_m.is_some() {
            return Err(refused("noise and noise_sd_n_m", "both", "one of them"));
        }
        let (read, of_whisker) = (&trace.get().trace, calibration.get());
        check_calibration(&of_whisker.path, &of_whisker.file, &read.sidecar).map_err(raised)?;
        let front_end = SpatialFrontEnd::new(&front_end_of(front_end, front_end_settings)?).map_err(raised)?;
        let sensor = front_end.sensor(&of_whisker.path, &of_whisker.file).map_err(raised)?;
        front_end.check_trace(&read.sidecar).map_err(raised)?;
        let fraction = noise.unwrap_or_else(|| front_end.default_noise(&read.sidecar));
        let added_sd_n_m = noise_sd_n_m.unwrap_or_else(|| fraction * largest_reading_n_m([&**read]));
        let all_sd_n_m = added_sd_n_m.hypot(read.sidecar.own_noise_sd_n_m());
        let knowledge = knowledge(&of_whisker.calibrated, all_sd_n_m, sensor, read.sidecar.rate_hz);
        let read_trace = || front_end.bending_n_m(read, added_sd_n_m, seed, sensor);
        let readings_n_m = py.detach(read_trace).map_err(raised)?;
        let samples = samples(read, &readings_n_m);
        Ok(Self { trace, calibration, seed, knowledge, readings_n_m, samples, reference: OnceLock::new() })
    }

    /// The trace.
    #[getter]
    fn trace(&self, py: Python<'_>) -> Py<SpatialTrace> {
        self.trace.clone_ref(py)
    }

    /// The calibration.
    #[getter]
    fn calibration(&self, py: Python<'_>) -> Py<SpatialCalibration> {
        self.calibration.clone_ref(py)
    }

    /// Seed of the measurement noise.
    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    /// Sampling rate (Hz).
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.knowledge.rate_hz
    }

    /// Standard deviation of all measurement noise of each bending moment (N m).
    #[getter]
    fn noise_sd_n_m(&self) -> f64 {
        self.knowledge.noise_sd_n_m
    }

    /// Bending moments (n, 2) about y and z with measurement noise, in N m. Their axes are those of Base, or of the front end.
    #[getter]
    fn readings_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.readings_n_m.iter().map(|reading_n_m| Some(*reading_n_m)))
    }

    /// Motions of the base since the last sample (n, 7): x, y, z (m) and unit quaternion w, x, y, z of its earlier frame in its
    /// later one.
    #[getter]
    fn motions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let numbers = self.samples.iter().flat_map(motion).collect();
        Array2::from_shape_vec((self.samples.len(), 7), numbers).expect("seven numbers a row").into_pyarray(py)
    }

    /// Times since the last sample (n), in s; 0 for the first.
    #[getter]
    fn dt_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.samples.iter().map(|sample| Some(sample.dt_s)))
    }

    /// Whether the contact detector detects an object in either moment (n). A reading that no contact explains leaves it as it was.
    #[getter]
    fn touched<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let mut detector = TouchDetector::new(TouchConfig::default(), &self.knowledge);
        let mut touched = false;
        let detected = self.samples.iter().map(|sample| {
            touched = detector.step(sample).map_or(touched, |(_, touches)| touches);
            touched
        });
        flags(py, detected)
    }

    /// Instants at which `score` expects an estimate once its time has begun (n): the true contact lies in the calibrated domain,
    /// not at the tip and not at several places.
    #[getter]
    fn expected<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let expected = py.detach(|| self.reference().expected().to_vec());
        flags(py, expected)
    }

    /// Replays the trial through a registered estimator in space: the same bits as `whisker replay` with this noise and seed.
    /// `settings` is a dictionary over the estimator's defaults.
    #[pyo3(signature = (estimator, settings=None))]
    fn replay(&self, py: Python<'_>, estimator: &str, settings: Option<&Bound<'_, PyAny>>) -> PyResult<SpatialReplay> {
        let row = registered(estimator).map_err(raised)?;
        let config = settings_over(estimator, row.defaults(), settings)?;
        let mut estimator = start(row, &config, &self.knowledge)?;
        Ok(self.replay_of(replayed(py, &mut estimator, &self.samples)?))
    }

    /// Replays the trial through an estimator written in Python: any object with a method `step(motion, dt_s, reading_n_m)` like
    /// that of `SpatialEstimator`, which returns `None`, a `SpatialEstimate`, or an object with the attributes `contact` (3) and
    /// `covariance_m2` (3, 3) in Base.
    ///
    /// Optional attributes are `normal` (3), by default that of the whisker's mechanics at the contact; `direction` (3) with
    /// `direction_sd_rad`; `radius_m` with `radius_sd_m`; and `model_doubtful`. `ValueError` names the row and the attribute of a
    /// wrong answer; an exception of the estimator is raised unchanged.
    fn run(&self, py: Python<'_>, estimator: &Bound<'_, PyAny>) -> PyResult<SpatialReplay> {
        let step = estimator.getattr("step")?;
        let mut estimates = Vec::with_capacity(self.samples.len());
        for (row, sample) in self.samples.iter().enumerate() {
            py.check_signals()?;
            let [x, y, z, qw, qx, qy, qz] = motion(sample);
            let reading_n_m = (sample.reading_n_m.x, sample.reading_n_m.y);
            let answer = step.call1(((x, y, z, qw, qx, qy, qz), sample.dt_s, reading_n_m))?;
            let estimate = returned(&answer, &self.knowledge)
                .map_err(|error| of_argument(py, &format!("estimate of row {row}"), error))?;
            estimates.push(estimate);
        }
        Ok(self.replay_of(estimates))
    }

    /// Scores of a replay against the truth from one second after each touch: the columns of `space_trials.csv` by name, from
    /// `answered` on (`datasets/FORMAT.md`). NaN where a score is undefined.
    fn score<'py>(&self, py: Python<'py>, replay: &SpatialReplay) -> PyResult<Bound<'py, PyDict>> {
        self.check(replay)?;
        let scores = py.detach(|| self.reference().score("", self.seed, &replay.estimates)).map_err(raised)?;
        let by_name = PyDict::new(py);
        let Value::Object(columns) = json!(scores) else { return Ok(by_name) };
        // The columns before these identify the replay.
        for (name, score) in columns.iter().skip_while(|(name, _)| *name != "answered") {
            by_name.set_item(name, score.as_f64().unwrap_or(f64::NAN))?;
        }
        Ok(by_name)
    }

    /// Distances of the estimated from the true contacts (n), in m. NaN without an estimate or a single true contact.
    fn errors_m<'py>(&self, py: Python<'py>, replay: &SpatialReplay) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check(replay)?;
        let trace = &self.trace.get().trace;
        let rows = trace.recording.instants.iter().zip(&trace.truth.instants).zip(&replay.estimates);
        let errors = rows.map(|((known, truth), estimate)| {
            let contact_m = truth.contact_m().filter(|_| truth.contact.is_none_or(|contact| !contact.split))?;
            let true_contact = to_base(&known.base).apply(Point::from_vector(contact_m));
            Some((estimate.as_ref()?.contact.vector() - true_contact.vector()).norm())
        });
        Ok(column(py, errors))
    }

    /// Posterior Cramér–Rao bound along the trial, see `spatial_cramer_rao_bound`. NaN without noise.
    #[getter]
    fn bound<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.detach(|| self.reference());
        bound_table(py, self.reference())
    }

    fn __len__(&self) -> usize {
        self.samples.len()
    }

    fn __repr__(&self) -> String {
        let name = &self.trace.get().trace.sidecar.name;
        format!("<SpatialTrial of {name}: noise {:.3e} N m, seed {}>", self.noise_sd_n_m(), self.seed)
    }
}

/// Posterior Cramér–Rao bound along a trace in space: lower bounds of the root mean square errors of any estimator with the same
/// readings.
///
/// `noise_sd_n_m` is the standard deviation of the measurement noise of each bending moment (N m); with a calibration through a
/// front end, it includes the noise of the sensor, as `SpatialTrial.bound` does. Returns a structured array (n), NaN while the
/// whisker is free: `t_s`; `since_touch_s`; `bound_m`, that of the contact if its sliding is known; and the bounds with an unknown
/// object, NaN if it is no rod, cylinder, edge or sphere: `object_bound_m` of the contact, `direction_bound_rad` of the direction
/// of a rod or edge (both angles together) and `radius_bound_m` of the radius.
#[pyfunction]
pub(crate) fn spatial_cramer_rao_bound<'py>(
    py: Python<'py>,
    trace: &SpatialTrace,
    calibration: &SpatialCalibration,
    noise_sd_n_m: f64,
) -> PyResult<Bound<'py, PyAny>> {
    if !(noise_sd_n_m.is_finite() && noise_sd_n_m > 0.0) {
        return Err(refused("noise_sd_n_m", noise_sd_n_m, "a positive number: without noise the bound is 0"));
    }
    check_calibration(&calibration.path, &calibration.file, &trace.trace.sidecar).map_err(raised)?;
    let knowledge = knowledge(&calibration.calibrated, noise_sd_n_m, None, trace.trace.sidecar.rate_hz);
    let compute = || Reference::new(trace.trace.clone(), knowledge);
    let reference = py.detach(compute);
    bound_table(py, &reference)
}

fn bound_table<'py>(py: Python<'py>, trial: &Reference) -> PyResult<Bound<'py, PyAny>> {
    let is_noisy = trial.knowledge.noise_sd_n_m > 0.0;
    let radius_m = trial.object().map(testbed::space::object::TrueObject::radius_m);
    let numbers = |number: &dyn Fn(&SpatialBoundAt) -> Option<f64>| {
        column(py, trial.bound().iter().map(|at| at.as_ref().and_then(number))).into_any()
    };
    let bounds = |variance: &dyn Fn(&SpatialBoundAt) -> Option<f64>| {
        numbers(&|at: &SpatialBoundAt| variance(at).filter(|_| is_noisy).map(f64::sqrt))
    };
    let instants = &trial.trace.recording.instants;
    let columns = [
        ("t_s", column(py, instants.iter().map(|now| Some(now.t_s))).into_any()),
        ("since_touch_s", numbers(&|at| Some(at.since_touch_s))),
        ("bound_m", bounds(&|at| Some(at.covariance_m2.trace()))),
        ("object_bound_m", bounds(&|at| Some(at.object?.covariance_m2.trace()))),
        ("direction_bound_rad", bounds(&|at| at.object?.direction_rad2)),
        ("radius_bound_m", bounds(&|at| Some(at.object?.log_radius2 * radius_m?.powi(2)))),
    ];
    structured(py, instants.len(), &columns)
}
