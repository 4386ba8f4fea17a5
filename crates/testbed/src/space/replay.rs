//! Replay of a trace in space through an estimator.

use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant as Clock;

use anyhow::{Context, bail};
use nalgebra::Vector2;
use serde_json::Value;
use trace::{SpatialCalibrationFile, SpatialPose, SpatialSensor, SpatialSidecar, SpatialTrace};
use whisker::estimators;
use whisker::events::TouchConfig;
use whisker::frames::{Base, World};
use whisker::space::estimators::{
    Estimate, Estimator, Knowledge, SPATIAL_ESTIMATORS, Sample, SpatialEstimatorRow, spatial_estimator,
};
use whisker::space::frames::Pose;
use whisker::space::sensor::CalibratedSpace;

use super::to_base;
use crate::fitted_traces::{above_calibrations, check_fitted_traces, check_is_calibration};
use crate::settings::SettingsOf;

/// The registry's row of this name.
///
/// # Errors
/// If there is none.
pub fn registered(name: &str) -> anyhow::Result<&'static SpatialEstimatorRow> {
    spatial_estimator(name).with_context(|| {
        let known: Vec<_> = SPATIAL_ESTIMATORS.iter().map(|row| row.name).collect();
        let hint = if estimators::estimator(name).is_some() { " (it is one for planar traces)" } else { "" };
        format!("unknown estimator in space `{name}`{hint}, expected one of: {}", known.join(", "))
    })
}

/// Reads a calibration in space whose traces have not changed since the fit, for a command with the option `--calibration`.
///
/// # Errors
/// As [`read_fitted`]. The error for a missing file states how to make it.
pub fn read_calibration(path: &Path) -> anyhow::Result<SpatialCalibrationFile> {
    check_is_calibration(path, above_calibrations(path), "another by --calibration")?;
    read_fitted(path)
}

/// Reads a calibration in space whose traces have not changed since the fit.
///
/// # Errors
/// If the file cannot be read, or its traces have changed, see [`check_fitted_traces`].
pub fn read_fitted(path: &Path) -> anyhow::Result<SpatialCalibrationFile> {
    let calibration = SpatialCalibrationFile::read(path)?;
    check_fitted_traces(path, &calibration)?;
    Ok(calibration)
}

/// Checks that a calibration, whose path is used in error messages, is one of the whisker of a trace.
///
/// # Errors
/// If it is one of another whisker.
pub fn check_calibration(
    path: &Path,
    calibration: &SpatialCalibrationFile,
    sidecar: &SpatialSidecar,
) -> anyhow::Result<()> {
    if let Some(difference) = calibration.whisker.difference(&sidecar.whisker) {
        bail!("{}: whisker.{difference}, as in {}; fit a calibration to this whisker", path.display(), sidecar.name);
    }
    if calibration.spatial_whisker() != sidecar.spatial_whisker() {
        bail!("{}: suspension, poisson_ratio: found other values than those of {}", path.display(), sidecar.name);
    }
    Ok(())
}

/// The calibrated whisker of a trace from a calibration, whose path is used in error messages.
///
/// # Errors
/// As [`check_calibration`].
pub fn calibrated(
    path: &Path,
    calibration: &SpatialCalibrationFile,
    sidecar: &SpatialSidecar,
) -> anyhow::Result<Arc<CalibratedSpace>> {
    check_calibration(path, calibration, sidecar)?;
    Ok(calibration.calibrated(path, None)?)
}

/// Prior information of an estimator for a whisker that is read with white noise of this standard deviation on the moments, and by
/// a sensor if there is one: its noise adds to that of the moments, its offset to the error of the sensor model. Both are those of
/// an average direction of bending.
pub fn knowledge(
    calibrated: &Arc<CalibratedSpace>,
    added_sd_n_m: f64,
    sensor: Option<&SpatialSensor>,
    rate_hz: f64,
) -> Arc<Knowledge> {
    let of_sensor_n_m = sensor.map_or(0.0, |sensor| rms(sensor.noise_sd_n_m));
    let noise_sd_n_m = added_sd_n_m.hypot(of_sensor_n_m);
    Arc::new(Knowledge { calibrated: read_by(calibrated, sensor), noise_sd_n_m, rate_hz })
}

/// The calibrated whisker with the offset of a sensor, if there is one, in the error of its sensor model.
pub fn read_by(calibrated: &Arc<CalibratedSpace>, sensor: Option<&SpatialSensor>) -> Arc<CalibratedSpace> {
    sensor.map_or_else(|| calibrated.clone(), |sensor| Arc::new(calibrated.read_by(rms(sensor.offset_sd_n_m))))
}

/// Standard deviation in an average direction of bending, from those of both moments.
fn rms([y_n_m, z_n_m]: [f64; 2]) -> f64 {
    y_n_m.hypot(z_n_m) * FRAC_1_SQRT_2
}

/// Samples of a robot: base motions from the recorded poses, and readings.
pub fn samples(trace: &SpatialTrace, readings_n_m: &[Vector2<f64>]) -> Vec<Sample> {
    let mut steps = SpatialSteps::default();
    let rows = trace.recording.instants.iter().zip(readings_n_m);
    rows.map(|(now, &reading_n_m)| steps.sample(now.t_s, &now.base, reading_n_m)).collect()
}

/// Converts poses and readings to samples one by one, in order of time.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpatialSteps {
    /// Pose of World in the frame of the base at the last instant, and its time.
    last: Option<(Pose<World, Base>, f64)>,
}

impl SpatialSteps {
    /// Sample of the next instant with this pose of the base and this reading.
    pub fn sample(&mut self, t_s: f64, base: &SpatialPose, reading_n_m: Vector2<f64>) -> Sample {
        let to_base = to_base(base);
        let (motion, dt_s) = match self.last.replace((to_base, t_s)) {
            Some((before, before_s)) => (before.inverse().then(&to_base), t_s - before_s),
            None => (Pose::identity(), 0.0),
        };
        Sample { motion, dt_s, reading_n_m }
    }
}

/// Result of a replay.
#[derive(Clone, Debug)]
pub struct SpatialReplay {
    /// One entry per sample; `None` while the estimator has no contact.
    pub estimates: Vec<Option<Estimate>>,
    /// Wall-clock time of each step with an estimate or a revision, and of a revision at the end of the recording (us).
    pub steps_us: Vec<f64>,
    /// Reason why an external program failed; there are no estimates after it.
    pub failure: Option<String>,
}

/// Builds a registered estimator with its own contact detector.
///
/// # Errors
/// If its settings are invalid.
pub fn build(row: &SpatialEstimatorRow, config: &Value, knowledge: &Arc<Knowledge>) -> anyhow::Result<Estimator> {
    row.build(config, TouchConfig::default(), knowledge).with_context(|| SettingsOf(row.name.into()))
}

/// Replays samples through a registered estimator.
///
/// # Errors
/// If its settings are invalid.
pub fn replay(
    row: &SpatialEstimatorRow,
    config: &Value,
    knowledge: &Arc<Knowledge>,
    samples: &[Sample],
) -> anyhow::Result<SpatialReplay> {
    let mut estimator = build(row, config, knowledge)?;
    let mut steps_us = Vec::new();
    let mut estimates = Vec::with_capacity(samples.len());
    for sample in samples {
        let (start, may_revise) = (Clock::now(), estimator.is_following());
        estimator.push(sample, &mut estimates);
        let has_revised = may_revise && !estimator.is_following();
        if has_revised || estimates.last().is_some_and(Option::is_some) {
            steps_us.push(1e6 * start.elapsed().as_secs_f64());
        }
    }
    let (start, may_revise) = (Clock::now(), estimator.is_following());
    estimator.end(&mut estimates);
    if may_revise {
        steps_us.push(1e6 * start.elapsed().as_secs_f64());
    }
    Ok(SpatialReplay { estimates, steps_us, failure: None })
}
