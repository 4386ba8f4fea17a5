//! Estimators of the plane.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use live::counts::{self, Conversion, Counts, Reading, Sensor, ZEROING_S};
use live::wire::{self, BadLine, Given, Line, PriorLine};
use live::{LiveEstimator, Planar, Poses, Status, Timing, noise_n_m};
use serde_json::Value;
use testbed::fitted_traces::above_calibrations;
use testbed::protocol::PROTOCOL;
use testbed::replay::{method, read_by};
use trace::{CalibrationFile, SensorFile};
use whisker::estimators::{Estimator, EstimatorRow, Knowledge, MethodClass, Runner};
use whisker::events::TouchConfig;

use super::method::{Begun, Method, Taken, check_counts, check_noise, check_prior};
use crate::commands::live::sink::ZEROING;
use crate::commands::played::read_calibration;

/// An estimator of the plane with its settings.
pub(super) struct InPlane {
    pub(super) row: &'static EstimatorRow,
    pub(super) config: Value,
}

impl Method for InPlane {
    type Kind = Planar;
    type Motion = Poses;
    type Prior = PriorLine;
    type Calibration = CalibrationFile;
    type Given = Given;
    type Conversion = CountsOf;

    const PROTOCOL: u32 = PROTOCOL;

    fn read(path: &Path) -> anyhow::Result<CalibrationFile> {
        read_calibration(path, above_calibrations(path))
    }

    fn parse(line: &str) -> Result<Line, BadLine> {
        wire::parse(line)
    }

    fn name(prior: &PriorLine) -> Option<&str> {
        prior.name.as_deref()
    }

    fn begin(
        &self,
        calibration: &CalibrationFile,
        path: &Path,
        prior: &PriorLine,
        timing: Timing,
    ) -> anyhow::Result<Begun<Self>> {
        let largest_n_m = calibration.largest_reading_n_m();
        check_prior((prior.protocol, Self::PROTOCOL), prior.rate_hz)?;
        let sensor = CountsOf::sensor(calibration, path, prior)?;
        let of_sensor = sensor.map(|sensor| sensor.noise_sd_n_m);
        check_noise(prior.noise_sd_n_m, of_sensor, largest_n_m)?;
        let noise_sd_n_m = noise_n_m(prior.noise_sd_n_m, of_sensor).with_context(|| {
            format!(
                "noise_sd_n_m: found none, expected the standard deviation of the noise: the first line names no sensor of {}, \
                 and that calibration has none of recordings",
                path.display()
            )
        })?;
        let whisker = &calibration.whisker;
        if let Some(difference) = prior.whisker.as_ref().and_then(|stated| stated.difference(whisker)) {
            bail!("whisker.{difference}, as in {}", path.display());
        }
        let expected = |key: &str, expected: String| anyhow::anyhow!("{key}: found other numbers, expected {expected}");
        let base_noise = prior.base_noise.map(|of| of.base_noise().map_err(|form| expected("base_noise", form)));
        let contact_prior = prior.told.map(|of| of.contact_prior().map_err(|form| expected("told", form)));
        let knowledge = Arc::new(Knowledge {
            whisker: whisker.clone(),
            rest: whisker.rest_shape(),
            faces: read_by(sensor, &calibration.calibrated(path, self.row.sensor_model)?),
            noise_sd_n_m,
            base_noise: base_noise.transpose()?.unwrap_or_default(),
            rate_hz: prior.rate_hz,
            contact_prior: contact_prior.transpose()?,
        });
        let (row, config, seed) = (self.row, self.config.clone(), prior.seed.unwrap_or_default());
        let of_build = knowledge.clone();
        let build = move || {
            let method = method(row, &config, &of_build)?;
            Ok(Estimator::new(Runner::new(method, of_build.clone(), seed), TouchConfig::default()))
        };
        let looks_back = row.class == MethodClass::Hindsight;
        let estimator = LiveEstimator::new(Box::new(build), &knowledge, looks_back, timing)?;
        Ok((estimator, CountsOf::new(sensor, calibration, path, prior, timing)))
    }

    fn convert(conversion: &mut CountsOf, t_s: f64, given: Given, at_s: f64) -> Result<Taken<f64>, String> {
        let (counts, reference) = match given {
            Given::Moment(n_m) => return Ok(Taken::Reading(n_m)),
            Given::Counts(counts, reference) => (counts, reference),
        };
        let CountsOf { counts: conversion, has_common_mode, path } = conversion;
        let conversion = conversion.as_mut().map_err(|reason| reason.clone())?;
        match reference {
            Some([x, y]) => conversion.take(counts::Stream::Reference, t_s, [x, y, 0.0], at_s),
            None if *has_common_mode => {
                return Err(format!(
                    "reference_counts: found none, expected those of the reference sensor, whose common mode {} has",
                    path.display()
                ));
            }
            None => {}
        }
        conversion.take(counts::Stream::Own, t_s, [counts, 0.0, 0.0], at_s);
        // The counts of the reference have the same time, so that none wait.
        Ok(match conversion.next(at_s).map(|converted| converted.reading) {
            Some(Reading::Of(n_m)) => Taken::Reading(n_m),
            Some(Reading::Zeroing) => Taken::LeftOut(ZEROING),
            Some(Reading::Late | Reading::Incomplete) | None => Taken::LeftOut(Status::Late.name()),
        })
    }

    fn zeroings_repeated(conversion: &CountsOf) -> u64 {
        conversion.counts.as_ref().map_or(0, Conversion::zeroings_repeated)
    }
}

/// Conversion of the counts of a whisker.
pub(super) struct CountsOf {
    /// The reason if its counts cannot be converted.
    counts: Result<Counts, String>,
    has_common_mode: bool,
    /// Path of the calibration.
    path: PathBuf,
}

impl CountsOf {
    /// The sensor whose counts may follow a first line: the one that it states, or that of the recordings.
    fn sensor<'a>(
        calibration: &'a CalibrationFile,
        path: &Path,
        prior: &PriorLine,
    ) -> anyhow::Result<Option<&'a SensorFile>> {
        let PriorLine { sensor: label, zeroing_s, modulo, .. } = prior;
        check_counts(*zeroing_s, *modulo)?;
        // With a front end, the lines of a whisker are moments unless its first line states otherwise.
        if label.is_none() && zeroing_s.is_none() && modulo.is_none() {
            return Ok(calibration.sensor.as_ref());
        }
        let sensor = calibration.sensor_of_counts(path, label.as_deref())?;
        if let Some(talk) = sensor.cross_talk.first() {
            bail!(
                "{}: front_end.sensors.{}.cross_talk: found one from `{}`, expected none on stdin; `ros2-node contact` \
                compensates it",
                path.display(),
                sensor.label(),
                talk.from
            );
        }
        Ok(Some(sensor))
    }

    fn new(
        sensor: Option<&SensorFile>,
        calibration: &CalibrationFile,
        path: &Path,
        prior: &PriorLine,
        timing: Timing,
    ) -> Self {
        let has_common_mode = sensor.is_some_and(|sensor| sensor.common_mode != [0.0; 2]);
        let zeroing_s = prior.zeroing_s.unwrap_or(ZEROING_S);
        let conversion = |sensor: &SensorFile| {
            let noise_sd_n_m = sensor.noise_sd_n_m.max(prior.noise_sd_n_m.unwrap_or_default());
            let own = Sensor::new(SensorFile { noise_sd_n_m, ..sensor.clone() }, 0, prior.modulo);
            Counts::new(own, has_common_mode, Vec::new(), zeroing_s, timing, prior.rate_hz)
        };
        let reason = || {
            let known: Vec<_> = calibration.sensors().map(SensorFile::label).collect();
            let path = path.display();
            if known.is_empty() {
                return format!(
                    "counts: found those of a whisker whose calibration {path} has no sensor, expected reading_n_m, or a \
                    calibration that `whisker fit` made of imported recordings"
                );
            }
            let known = known.join(", ");
            format!(
                "counts: found some, although the first line of the whisker states none of sensor, zeroing_s and modulo; \
                 expected one of them for the sensors of {path}: {known}"
            )
        };
        Self { counts: sensor.map(conversion).ok_or_else(reason), has_common_mode, path: path.into() }
    }
}
