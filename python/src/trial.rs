//! The class `Trial`: a trace with measurement noise, its replays and their scores.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use ::trace::{Miscalibration, SensorFile};
use ::whisker::estimators::{BaseNoise, CarriedOutline, Knowledge, Sample};
use ::whisker::sensor::Face;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::json;
use testbed::bound::{Deviations, TraceBound};
use testbed::contact_events::Events;
use testbed::front_end::{FRONT_ENDS, FrontEnd, FrontEndConfig, Mounting, Reading};
use testbed::metrics::{self, GroundTruth, METRICS, Scored, Scores};
use testbed::replay::{
    check_calibration, detect_contact, knowledge, noise_sd_n_m as total_noise, read_by, runner, samples,
};

use crate::arrays::{Numbers, column, structured, texts};
use crate::calibration::Calibration;
use crate::convert::{base_noise as base_noise_of, to_json};
use crate::error::{of_argument, raised, refused};
use crate::estimate::returned;
use crate::estimator::{detection, registered};
use crate::interrupt;
use crate::outline::Outline;
use crate::replay::Replay;
use crate::trace::Trace;

/// Largest difference of the yaw of a pose, from its angle in numbers and back, by rounding.
const YAW_ROUNDING_RAD: f64 = 1e-12;

/// A trace with measurement noise, as `whisker replay` and `whisker evaluate` give it to an estimator, and with the truth that
/// estimates are scored against.
///
/// `noise` is the standard deviation of the measurement noise to add, as a fraction of the trace's largest reading; by default
/// 0.01, and 0 for a recording of a real sensor or a front end with its own noise. `noise_sd_n_m` states it in N m instead.
/// `seed` is that of the noise, of the front end and of the estimators. `touch` are the settings of the contact detector.
/// `front_end` is the sensor between moment and reading, see `front_ends()`, with the settings `front_end_settings`; the
/// calibration must be one through the same front end.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Trial {
    pub(crate) trace: Py<Trace>,
    calibration: Py<Calibration>,
    seed: u64,
    /// Sensor of the front end. `None` if readings are the moments themselves.
    sensor: Option<SensorFile>,
    /// Prior information with the sensor model that the calibration chose.
    knowledge: Arc<Knowledge>,
    readings_n_m: Vec<f64>,
    samples: Vec<Sample>,
    touched: Vec<Option<Face>>,
    events: Option<Events>,
    bound: OnceLock<Option<TraceBound>>,
    ground_truth: GroundTruth,
}

impl Trial {
    /// The trial as metrics see it.
    pub(crate) fn scored<'a>(&'a self, replay: &'a Replay) -> metrics::Trial<'a> {
        let trace = self.trace.get();
        metrics::Trial {
            trace: &trace.trace,
            outline: trace.outline.as_ref(),
            knowledge: &replay.knowledge,
            readings_n_m: &self.readings_n_m,
            events: self.events.as_ref(),
            bound: self.bound(),
            ground_truth: &self.ground_truth,
        }
    }

    fn bound(&self) -> Option<&TraceBound> {
        let compute = || {
            let trace = &self.trace.get().trace;
            let face = self.knowledge.face(trace.sidecar.face)?;
            let (noise_sd_n_m, base_noise) = (self.knowledge.noise_sd_n_m, BaseNoise::default());
            let exact = Miscalibration::default();
            let largest_n_m = face.largest_reading_n_m;
            let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m };
            let bound = TraceBound::new(trace, face, noise_sd_n_m, &base_noise)?;
            Some(bound.with_deviations(trace, face, noise_sd_n_m, &base_noise, &deviations))
        };
        self.bound.get_or_init(compute).as_ref()
    }

    /// Prior information with the sensor model of this label.
    fn knowledge(&self, label: Option<&str>) -> PyResult<Arc<Knowledge>> {
        if label.is_none() {
            return Ok(self.knowledge.clone());
        }
        let faces = read_by(self.sensor.as_ref(), &self.calibration.get().calibrated(label)?);
        Ok(Arc::new(Knowledge { faces, ..Knowledge::clone(&self.knowledge) }))
    }

    /// Checks that a replay is one of this trial: that it has the times, poses and readings of its rows.
    pub(crate) fn check(&self, replay: &Replay) -> PyResult<()> {
        let instants = &self.trace.get().trace.recording.instants;
        let (found, expected) = (replay.instants.len(), instants.len());
        if found != expected {
            return Err(refused("replay", format!("{found} rows"), &format!("{expected}, as many as the trace has")));
        }
        let rows = replay.instants.iter().zip(&replay.readings_n_m).zip(instants.iter().zip(&self.readings_n_m));
        for (row, ((found, found_n_m), (expected, expected_n_m))) in rows.enumerate() {
            let turned_rad = found.base.then(&expected.base.inverse()).yaw_rad().abs();
            let (at, of_trial) = (found.base.origin(), expected.base.origin());
            let quantities = [
                ("time", found.t_s, expected.t_s, found.t_s == expected.t_s),
                ("base x", at.x(), of_trial.x(), at.x() == of_trial.x()),
                ("base y", at.y(), of_trial.y(), at.y() == of_trial.y()),
                ("base yaw", found.base.yaw_rad(), expected.base.yaw_rad(), turned_rad <= YAW_ROUNDING_RAD),
                ("reading", *found_n_m, *expected_n_m, found_n_m == expected_n_m),
            ];
            if let Some((what, found, expected, _)) = quantities.into_iter().find(|(.., is_same)| !is_same) {
                let name = &self.trace.get().trace.sidecar.name;
                let expected = format!("{expected}, that of the trial of {name}");
                return Err(refused(&format!("replay: row {row}: {what}"), found, &expected));
            }
        }
        Ok(())
    }

    /// Replay of this trace with the truth beside the estimates.
    fn replayed(
        &self,
        knowledge: Arc<Knowledge>,
        estimates: Vec<Option<::whisker::estimators::Estimate>>,
        outline: Option<CarriedOutline>,
    ) -> Replay {
        let trace = &self.trace.get().trace;
        let (instants, truths) = (trace.recording.instants.clone(), trace.truth.instants.clone());
        Replay::new(knowledge, instants, Some(truths), self.readings_n_m.clone(), estimates, outline)
    }
}

#[pymethods]
impl Trial {
    #[new]
    #[pyo3(signature = (trace, calibration, noise=None, seed=1, *, noise_sd_n_m=None, touch=None, front_end=None, front_end_settings=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python class")]
    fn new(
        py: Python<'_>,
        trace: Py<Trace>,
        calibration: Py<Calibration>,
        noise: Option<f64>,
        seed: u64,
        noise_sd_n_m: Option<f64>,
        touch: Option<&Bound<'_, PyAny>>,
        front_end: Option<String>,
        front_end_settings: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let touch = detection(touch)?;
        for (what, number) in [("noise", noise), ("noise_sd_n_m", noise_sd_n_m)] {
            if let Some(number) = number.filter(|number| !(number.is_finite() && *number >= 0.0)) {
                return Err(refused(what, number, "a number of 0 or more"));
            }
        }
        if noise.is_some() && noise_sd_n_m.is_some() {
            return Err(refused("noise and noise_sd_n_m", "both", "one of them"));
        }
        let read = trace.get();
        let (sidecar, recording) = (&read.trace.sidecar, &read.trace.recording);
        let calibrated = calibration.get();
        check_calibration(&calibrated.path, &calibrated.file, sidecar).map_err(raised)?;
        let front_end = FrontEnd::new(&front_end_of(front_end, front_end_settings)?).map_err(raised)?;
        front_end.check_trace(sidecar).map_err(raised)?;
        let folder = read.folder.as_deref();
        let mounting = folder.map_or_else(|| Ok(Mounting::alone(sidecar)), |folder| Mounting::of(folder, sidecar));
        let mounting = mounting.map_err(raised)?;
        let sensor = front_end.sensor(&calibrated.path, &calibrated.file, &mounting).map_err(raised)?;
        let gate = calibrated.file.gate();
        let moments = recording.instants.iter().map(|now| now.moment_z_n_m);
        let largest_n_m = moments.filter(|moment| gate.admits(*moment)).map(f64::abs).fold(0.0, f64::max);
        let fraction = noise.unwrap_or_else(|| front_end.row.default_noise(sidecar));
        let added_sd_n_m = noise_sd_n_m.unwrap_or(fraction * largest_n_m);
        let path = &calibrated.path;
        let reading = Reading { front_end: &front_end, path, calibration: &calibrated.file, added_sd_n_m, seed };
        let beside = folder.unwrap_or(Path::new(""));
        let readings_n_m = py.detach(|| reading.of(&read.trace, &mounting, beside)).map_err(raised)?;
        let faces = read_by(sensor, &calibrated.calibrated(None)?);
        let knowledge = knowledge(sidecar, &faces, total_noise(added_sd_n_m, sensor, sidecar));
        let sensor = sensor.cloned();
        let (samples, touched, ground_truth) = py.detach(|| {
            let mut samples = samples(recording, &readings_n_m);
            let touched = detect_contact(touch, &knowledge, &mut samples);
            (samples, touched, GroundTruth::new(&read.trace, read.outline.as_ref(), &knowledge.rest))
        });
        let events = Events::of(&read.trace, &touched);
        let bound = OnceLock::new();
        Ok(Self {
            trace,
            calibration,
            seed,
            sensor,
            knowledge,
            readings_n_m,
            samples,
            touched,
            events,
            bound,
            ground_truth,
        })
    }

    /// The trace.
    #[getter]
    fn trace(&self, py: Python<'_>) -> Py<Trace> {
        self.trace.clone_ref(py)
    }

    /// The calibration.
    #[getter]
    fn calibration(&self, py: Python<'_>) -> Py<Calibration> {
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

    /// Standard deviation of all measurement noise (N m).
    #[getter]
    fn noise_sd_n_m(&self) -> f64 {
        self.knowledge.noise_sd_n_m
    }

    /// Readings with measurement noise (n), in N m.
    #[getter]
    fn readings_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.readings_n_m)
    }

    /// Motions of the base since the last sample (n, 3): x (m), y (m) and yaw (rad) of its earlier frame in its later one.
    #[getter]
    fn motions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let motions = self.samples.iter().map(|sample| sample.motion);
        let numbers = motions.flat_map(|motion| [motion.origin().x(), motion.origin().y(), motion.yaw_rad()]).collect();
        Array2::from_shape_vec((self.samples.len(), 3), numbers).expect("three numbers a row").into_pyarray(py)
    }

    /// Times since the last sample (n), in s; 0 for the first.
    #[getter]
    fn dt_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.samples.iter().map(|sample| Some(sample.dt_s)))
    }

    /// Side on which the contact detector detects an object (n): `left`, `right`, or empty while the whisker is free.
    #[getter]
    fn touched<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        texts(py, self.touched.iter().map(|face| face.map_or("", Face::name)))
    }

    /// Replays the trial through a registered estimator: the same bits as `whisker replay` with this noise and seed.
    #[pyo3(signature = (estimator, settings=None))]
    fn replay(&self, py: Python<'_>, estimator: &str, settings: Option<&Bound<'_, PyAny>>) -> PyResult<Replay> {
        let (row, config) = registered(estimator, settings)?;
        let knowledge = self.knowledge(row.sensor_model)?;
        let name = &self.trace.get().trace.sidecar.name;
        let mut runner = runner(row, &config, &knowledge, name, self.seed).map_err(raised)?;
        let mut estimates = Vec::with_capacity(self.samples.len());
        interrupt::each(py, self.samples.len(), |i| {
            runner.push(&self.samples[i], self.touched[i], &mut estimates);
            Ok(())
        })?;
        py.detach(|| runner.end(&mut estimates));
        Ok(self.replayed(knowledge, estimates, runner.outline()))
    }

    /// Replays the trial through an estimator written in Python: any object with a method `step(motion, dt_s, reading_n_m)` like
    /// that of `Estimator`, which returns `None`, an `Estimate`, or an object with the attributes `contact` (2) and, optionally,
    /// `covariance_m2` (2, 2), `innovation_n_m` and `innovation_variance_n2_m2`, in Base.
    fn run(&self, py: Python<'_>, estimator: &Bound<'_, PyAny>) -> PyResult<Replay> {
        let step = estimator.getattr("step")?;
        let mut estimates = Vec::with_capacity(self.samples.len());
        for (row, sample) in self.samples.iter().enumerate() {
            py.check_signals()?;
            let motion = (sample.motion.origin().x(), sample.motion.origin().y(), sample.motion.yaw_rad());
            let answer = step.call1((motion, sample.dt_s, sample.reading_n_m))?;
            let face = self.touched[row].unwrap_or_else(|| Face::of_reading(sample.reading_n_m));
            let estimate = returned(&answer, face, &self.knowledge)
                .map_err(|error| of_argument(py, &format!("estimate of row {row}"), error))?;
            estimates.push(estimate);
        }
        Ok(self.replayed(self.knowledge.clone(), estimates, None))
    }

    /// Scores of a replay against the truth: the metrics of `whisker evaluate` by name, see `metrics()`. NaN where a metric is
    /// undefined.
    fn score<'py>(&self, py: Python<'py>, replay: &Replay) -> PyResult<Bound<'py, PyDict>> {
        self.check(replay)?;
        let scores = py.detach(|| {
            let trial = self.scored(replay);
            let points = trial.surface_points(&replay.replay);
            let contour = trial.contour(&replay.replay, &points, 0);
            Ok::<_, metrics::Unscored>(Scores::of(&Scored::new(&trial, &replay.replay, &points, contour.as_ref())?))
        });
        let name = &self.trace.get().trace.sidecar.name;
        let scores = scores.map_err(|reason| raised(anyhow::anyhow!("{name}: {reason}")))?;
        let by_name = PyDict::new(py);
        for metric in METRICS {
            by_name.set_item(metric.name, scores.get(metric).unwrap_or(f64::NAN))?;
        }
        Ok(by_name)
    }

    /// Distances of the estimated from the true contacts (n), in m. NaN without an estimate or a single true contact.
    fn errors_m<'py>(&self, py: Python<'py>, replay: &Replay) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check(replay)?;
        let trace = &self.trace.get().trace;
        let rows = trace.recording.instants.iter().zip(&trace.truth.instants).zip(&replay.replay.estimates);
        let errors = rows.map(|((known, truth), estimate)| {
            let truth = truth.contact.filter(|_| truth.split != Some(true))?;
            Some(estimate.as_ref()?.contact.distance(&known.base.inverse().apply(truth)))
        });
        Ok(column(py, errors))
    }

    /// Posterior Cramér–Rao bound along the trial, see `cramer_rao_bound`.
    #[getter(bound)]
    fn bound_rows<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.detach(|| self.bound());
        bound_table(py, &self.trace.get().trace, self.bound())
    }

    /// Estimated outline of the object in World: that which the estimator carries, or that through the surface points of all
    /// contacts. `None` if no point is certain enough.
    fn outline(&self, replay: &Replay) -> PyResult<Option<Outline>> {
        self.check(replay)?;
        let trial = self.scored(replay);
        let points = trial.surface_points(&replay.replay);
        Ok(trial.contour(&replay.replay, &points, 0).map(Outline::of_contour))
    }

    fn __len__(&self) -> usize {
        self.samples.len()
    }

    fn __repr__(&self) -> String {
        let name = &self.trace.get().trace.sidecar.name;
        format!("<Trial of {name}: noise {:.3e} N m, seed {}>", self.noise_sd_n_m(), self.seed)
    }
}

/// Posterior Cramér–Rao bound along a trace: lower bound of the root mean square contact error of any estimator with the same
/// readings.
///
/// `noise_sd_n_m` is the standard deviation of the measurement noise (N m), `base_noise` (3, 3) the covariance of the base's
/// measured pose. Returns a structured array (n), NaN while the whisker is free: `t_s`, `since_touch_s`, `bound_m`, the bound
/// `window_m` from the readings of the last half second alone and the `condition` number of their information.
#[pyfunction]
#[pyo3(signature = (trace, calibration, noise_sd_n_m, base_noise=None))]
pub(crate) fn cramer_rao_bound<'py>(
    py: Python<'py>,
    trace: &Trace,
    calibration: &Calibration,
    noise_sd_n_m: f64,
    base_noise: Option<Numbers<'py>>,
) -> PyResult<Bound<'py, PyAny>> {
    let base_noise = base_noise_of(base_noise.as_ref())?;
    if !(noise_sd_n_m.is_finite() && (noise_sd_n_m > 0.0 || (noise_sd_n_m == 0.0 && !base_noise.is_none()))) {
        return Err(refused("noise_sd_n_m", noise_sd_n_m, "a positive number: without noise the bound is 0"));
    }
    check_calibration(Path::new(&calibration.path), &calibration.file, &trace.trace.sidecar).map_err(raised)?;
    let face = calibration.face(trace.trace.sidecar.face.name(), None)?;
    let bound = py.detach(|| TraceBound::new(&trace.trace, &face, noise_sd_n_m, &base_noise));
    bound_table(py, &trace.trace, bound.as_ref())
}

fn bound_table<'py>(
    py: Python<'py>,
    trace: &::trace::Trace,
    bound: Option<&TraceBound>,
) -> PyResult<Bound<'py, PyAny>> {
    let instants = &trace.recording.instants;
    let rows: Vec<_> = (0..instants.len()).map(|row| bound?.at(row)).collect();
    let numbers = |number: fn(&testbed::bound::BoundAt) -> Option<f64>| {
        column(py, rows.iter().map(|row| row.as_ref().and_then(number))).into_any()
    };
    let columns = [
        ("t_s", column(py, instants.iter().map(|now| Some(now.t_s))).into_any()),
        ("since_touch_s", numbers(|at| Some(at.since_touch_s))),
        ("bound_m", numbers(|at| Some(at.sd_m))),
        ("window_m", numbers(|at| at.window.map(|window| window.sd_m))),
        ("condition", numbers(|at| at.window.map(|window| window.condition))),
    ];
    structured(py, rows.len(), &columns)
}

/// Choice of the front end of this name and these settings.
pub(crate) fn front_end_of(name: Option<String>, settings: Option<&Bound<'_, PyAny>>) -> PyResult<FrontEndConfig> {
    let config = settings.map_or_else(|| Ok(json!({})), |settings| to_json("front_end_settings", settings))?;
    let name = name.unwrap_or_else(|| FRONT_ENDS[0].name.into());
    Ok(FrontEndConfig { name, config })
}
