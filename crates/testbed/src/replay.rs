//! Causal replay of a recording through an estimator.
//!
//! A replay converts a recording into the [`Sample`]s of a robot (base motion and reading), builds the prior information
//! ([`knowledge`]) from a calibration, runs the contact detector ([`detect_contact`]) and passes the samples to an
//! estimator in order of time ([`replay`]). Evaluation, the command `whisker replay` and the report all use these
//! functions, so that an estimator has the same input everywhere.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant as Clock;

use anyhow::{Context, bail};
use serde_json::Value;
use trace::{CalibrationFile, Recording, SensorFile, Sidecar};
use whisker::estimators::{
    self, BaseNoise, CarriedOutline, ESTIMATORS, Estimate, Estimator, EstimatorRow, Knowledge, Method, Runner, Sample,
};
use whisker::events::{ContactDetector, Signals, TouchConfig};
use whisker::frames::Pose;
use whisker::sensor::{CalibratedFace, Face};
use whisker::space::estimators::spatial_estimator;

use crate::seeds::derived_seed;
use crate::settings::SettingsOf;

/// Samples of a robot: base motions from the recorded poses and readings from the front end.
pub fn samples(recording: &Recording, readings_n_m: &[f64]) -> Vec<Sample> {
    with_readings(&motions(recording), readings_n_m)
}

/// Samples with base motions only; the readings are zero.
pub fn motions(recording: &Recording) -> Vec<Sample> {
    let mut steps = Steps::default();
    recording.instants.iter().map(|now| steps.sample(now, 0.0)).collect()
}

/// Combines motions with readings.
pub fn with_readings(motions: &[Sample], readings_n_m: &[f64]) -> Vec<Sample> {
    motions.iter().zip(readings_n_m).map(|(motion, &reading_n_m)| Sample { reading_n_m, ..*motion }).collect()
}

/// Converts instants to samples one by one, in order of time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steps {
    last: Option<trace::Instant>,
}

impl Steps {
    /// Sample of the next instant with this reading.
    pub fn sample(&mut self, now: &trace::Instant, reading_n_m: f64) -> Sample {
        let (motion, dt_s) = match self.last.replace(*now) {
            Some(before) => (before.base.then(&now.base.inverse()), now.t_s - before.t_s),
            None => (Pose::new(0.0, 0.0, 0.0), 0.0),
        };
        Sample { motion, dt_s, reading_n_m }
    }
}

/// Standard deviation of the total measurement noise of a trace: added noise, noise of the front end's sensor, and
/// noise of a recorded sensor.
pub fn noise_sd_n_m(added_sd_n_m: f64, sensor: Option<&SensorFile>, sidecar: &Sidecar) -> f64 {
    added_sd_n_m.hypot(sensor.map_or(0.0, |sensor| sensor.noise_sd_n_m)).hypot(sidecar.own_noise_sd_n_m())
}

/// Calibrated faces with the offset and gain uncertainty of a sensor.
pub fn read_by(sensor: Option<&SensorFile>, faces: &[Arc<CalibratedFace>]) -> Vec<Arc<CalibratedFace>> {
    match sensor {
        Some(sensor) => faces.iter().map(|face| Arc::new(face.read_by(sensor.offset_sd_n_m, sensor.gain_sd))).collect(),
        None => faces.to_vec(),
    }
}

/// Prior information of an estimator for the whisker of a trace, with exact base poses.
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

/// The row of this name in the registry of planar estimators.
///
/// # Errors
/// If there is none.
pub fn registered(name: &str) -> anyhow::Result<&'static EstimatorRow> {
    estimators::estimator(name).with_context(|| {
        let known: Vec<_> = ESTIMATORS.iter().map(|row| row.name).collect();
        let hint = if spatial_estimator(name).is_some() { " (it is one for traces in space)" } else { "" };
        format!("unknown estimator `{name}`{hint}, expected one of: {}", known.join(", "))
    })
}

/// Builds the method of a registered estimator.
///
/// # Errors
/// If its settings are invalid.
pub fn method(row: &EstimatorRow, config: &Value, knowledge: &Arc<Knowledge>) -> anyhow::Result<Box<dyn Method>> {
    (row.build)(config, knowledge).with_context(|| SettingsOf(row.name.into()))
}

/// Builds the runner of a registered estimator, with a random seed derived from the trace and the seed.
///
/// # Errors
/// If its settings are invalid.
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

/// Builds an estimator with its own contact detector, for streaming samples.
///
/// # Errors
/// If its settings are invalid.
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

/// Checks that a calibration belongs to a trace's whisker and contains the face that the trace touches with.
///
/// # Errors
/// If the whisker differs or the face is missing. `path` is the path of the calibration.
pub fn check_calibration(path: &Path, calibration: &CalibrationFile, sidecar: &Sidecar) -> anyhow::Result<()> {
    if let Some(difference) = calibration.whisker.difference(&sidecar.whisker) {
        bail!("{}: whisker.{difference}, as in {}; fit a calibration to this whisker", path.display(), sidecar.name);
    }
    if !calibration.faces.iter().any(|face| face.face == sidecar.face) {
        bail!(
            "{}: faces: found no face `{}`, with which {} touches",
            path.display(),
            sidecar.face.name(),
            sidecar.name
        );
    }
    Ok(())
}

/// Signals of the contact detector at each sample.
pub fn signals(touch: TouchConfig, knowledge: &Knowledge, samples: &[Sample]) -> Vec<Signals> {
    let mut detector = ContactDetector::new(touch, &knowledge.sensing());
    samples.iter().map(|sample| detector.judge(sample.reading_n_m, sample.dt_s)).collect()
}

/// Detects contact at each sample, and subtracts the rest reading from all samples in place. Returns the face in contact at each
/// sample, `None` while the whisker is free.
pub fn detect_contact(touch: TouchConfig, knowledge: &Knowledge, samples: &mut [Sample]) -> Vec<Option<Face>> {
    let mut detector = ContactDetector::new(touch, &knowledge.sensing());
    let touched = samples.iter().map(|sample| detector.step(sample.reading_n_m, sample.dt_s)).collect();
    // Before it was determined, the whisker was free.
    samples.iter_mut().for_each(|sample| sample.reading_n_m -= detector.rest_reading_n_m());
    touched
}

/// Result of a replay.
#[derive(Clone, Debug)]
pub struct Replay {
    /// One entry per sample; `None` while the estimator has no contact.
    pub estimates: Vec<Option<Estimate>>,
    /// Final outline of the estimator, if it has one.
    pub outline: Option<CarriedOutline>,
    /// Wall-clock time of all steps.
    pub elapsed_ns: u128,
    /// Failure that ended the estimates early, if any.
    pub failure: Option<String>,
}

impl Replay {
    /// Replay of an estimator that failed before its first estimate.
    pub fn silent(samples: usize, reason: String) -> Self {
        Self { estimates: vec![None; samples], outline: None, elapsed_ns: 0, failure: Some(reason) }
    }
}

/// Replays samples with known contacts through an estimator.
pub fn replay(runner: &mut Runner, samples: &[Sample], touched: &[Option<Face>]) -> Replay {
    let start = Clock::now();
    let estimates = runner.run(samples, touched);
    let outline = runner.outline();
    Replay { estimates, outline, elapsed_ns: start.elapsed().as_nanos(), failure: None }
}
