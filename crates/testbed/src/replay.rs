//! Replay: a recording through an estimator, in order of time, without looking ahead.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant as Clock;

use anyhow::{Context, bail};
use serde_json::Value;
use trace::{CalibrationFile, Recording, SensorFile, Sidecar};
use whisker::estimators::{
    BaseNoise, Estimate, Estimator, EstimatorRow, Knowledge, Method, OutlinePoint, Runner, Sample,
};
use whisker::events::{ContactDetector, Signals, TouchConfig};
use whisker::frames::Pose;
use whisker::sensor::{CalibratedFace, Face};

use crate::seeds::derived_seed;

/// The samples that a robot would have had: base motion from the recorded poses, readings from the front end.
pub fn samples(recording: &Recording, readings_n_m: &[f64]) -> Vec<Sample> {
    with_readings(&motions(recording), readings_n_m)
}

/// The same as long as nothing was read: without readings.
pub fn motions(recording: &Recording) -> Vec<Sample> {
    let mut steps = Steps::default();
    recording.instants.iter().map(|now| steps.sample(now, 0.0)).collect()
}

/// Motions, each with its reading.
pub fn with_readings(motions: &[Sample], readings_n_m: &[f64]) -> Vec<Sample> {
    motions.iter().zip(readings_n_m).map(|(motion, &reading_n_m)| Sample { reading_n_m, ..*motion }).collect()
}

/// Turns instants into samples, one by one in the order of time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steps {
    last: Option<trace::Instant>,
}

impl Steps {
    /// The sample of the next instant, which reads so much.
    pub fn sample(&mut self, now: &trace::Instant, reading_n_m: f64) -> Sample {
        let (motion, dt_s) = match self.last.replace(*now) {
            Some(before) => (before.base.then(&now.base.inverse()), now.t_s - before.t_s),
            None => (Pose::new(0.0, 0.0, 0.0), 0.0),
        };
        Sample { motion, dt_s, reading_n_m }
    }
}

/// Standard deviation of all measurement noise of a trace: what is added, what its sensor has where it has one, and what a recording has of itself.
pub fn noise_sd_n_m(added_sd_n_m: f64, sensor: Option<&SensorFile>, sidecar: &Sidecar) -> f64 {
    added_sd_n_m.hypot(sensor.map_or(0.0, |sensor| sensor.noise_sd_n_m)).hypot(sidecar.own_noise_sd_n_m())
}

/// Calibrated faces as a sensor reads them, with what it may be off by throughout.
pub fn read_by(sensor: Option<&SensorFile>, faces: &[Arc<CalibratedFace>]) -> Vec<Arc<CalibratedFace>> {
    match sensor {
        Some(sensor) => faces.iter().map(|face| Arc::new(face.read_by(sensor.offset_sd_n_m, sensor.gain_sd))).collect(),
        None => faces.to_vec(),
    }
}

/// What a robot with the whisker of a trace, and an exact base, knows before it touches anything.
pub fn knowledge(sidecar: &Sidecar, faces: &[Arc<CalibratedFace>], noise_sd_n_m: f64) -> Arc<Knowledge> {
    Arc::new(Knowledge {
        whisker: sidecar.whisker.clone(),
        rest: sidecar.whisker.rest_shape(),
        faces: faces.to_vec(),
        noise_sd_n_m,
        base_noise: BaseNoise::default(),
        rate_hz: sidecar.rate_hz,
        contact_prior: None,
    })
}

/// The method of a registered estimator.
///
/// # Errors
/// If its settings are wrong.
pub fn method(row: &EstimatorRow, config: &Value, knowledge: &Arc<Knowledge>) -> anyhow::Result<Box<dyn Method>> {
    (row.build)(config, knowledge).with_context(|| format!("settings of `{}`", row.name))
}

/// A registered estimator, with the randomness that belongs to this trace and seed.
///
/// # Errors
/// If its settings are wrong.
pub fn runner(
    row: &EstimatorRow,
    config: &Value,
    knowledge: &Arc<Knowledge>,
    trace_name: &str,
    seed: u64,
) -> anyhow::Result<Runner> {
    let method = method(row, config, knowledge)?;
    let own_seed = derived_seed(seed, &[row.name, trace_name]);
    Ok(Runner::new(method, knowledge.clone(), own_seed))
}

/// The same with a detection of contacts of its own, for samples that come one by one.
///
/// # Errors
/// If its settings are wrong.
pub fn estimator(
    row: &EstimatorRow,
    config: &Value,
    touch: TouchConfig,
    knowledge: &Arc<Knowledge>,
    trace_name: &str,
    seed: u64,
) -> anyhow::Result<Estimator> {
    Ok(Estimator::new(runner(row, config, knowledge, trace_name, seed)?, touch))
}

/// Checks that a calibration is that of a trace's whisker and knows the face that the trace touches with.
///
/// # Errors
/// If it is not, or does not; `path` is the calibration's.
pub fn check_calibration(path: &Path, calibration: &CalibrationFile, sidecar: &Sidecar) -> anyhow::Result<()> {
    if calibration.whisker != sidecar.whisker {
        bail!("{}: calibrates a whisker with other parameters than that of {}", path.display(), sidecar.name);
    }
    if !calibration.faces.iter().any(|face| face.face == sidecar.face) {
        bail!("{}: has no face {}, which {} touches with", path.display(), sidecar.face.name(), sidecar.name);
    }
    Ok(())
}

/// What the detection of contacts sees and concludes at each sample.
pub fn signals(touch: TouchConfig, knowledge: &Knowledge, samples: &[Sample]) -> Vec<Signals> {
    let mut detector = ContactDetector::new(touch, &knowledge.sensing());
    samples.iter().map(|sample| detector.judge(sample.reading_n_m, sample.dt_s)).collect()
}

/// The side on which the object lies, at each sample at which the detection of contacts takes the whisker to touch.
pub fn touched(touch: TouchConfig, knowledge: &Knowledge, samples: &[Sample]) -> Vec<Option<Face>> {
    let mut detector = ContactDetector::new(touch, &knowledge.sensing());
    samples.iter().map(|sample| detector.step(sample.reading_n_m, sample.dt_s)).collect()
}

/// Estimates of a replay, and how long it took.
#[derive(Clone, Debug)]
pub struct Replay {
    /// One entry a sample; none while the estimator saw no contact.
    pub estimates: Vec<Option<Estimate>>,
    /// The outline that the estimator has at the end, where it carries one.
    pub outline: Option<Vec<OutlinePoint>>,
    /// Wall-clock time of all steps.
    pub elapsed_ns: u128,
    /// Why the estimator fell silent before the end, where it failed.
    pub failure: Option<String>,
}

impl Replay {
    /// That of an estimator which never said anything, for this reason.
    pub fn silent(samples: usize, reason: String) -> Self {
        Self { estimates: vec![None; samples], outline: None, elapsed_ns: 0, failure: Some(reason) }
    }
}

/// Runs an estimator over samples whose contacts are known.
pub fn replay(runner: &mut Runner, samples: &[Sample], touched: &[Option<Face>]) -> Replay {
    let start = Clock::now();
    let estimates = runner.run(samples, touched);
    let outline = runner.outline();
    Replay { estimates, outline, elapsed_ns: start.elapsed().as_nanos(), failure: None }
}
