//! Whiskers of a mapping, and the way of messages to them.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail};
use files::Error;
use live::LiveEstimator;
use live::counts::{Counts, Sensor};
use serde_json::Value;
use testbed::fitted_traces::check_fitted_traces;
use testbed::map::Observer;
use testbed::replay::{estimator, read_by};
use testbed::settings::merged;
use trace::{CalibrationFile, CrossTalk, SensorFile};
use whisker::estimators::{ESTIMATORS, EstimatorRow, Knowledge, MethodClass};
use whisker::events::TouchConfig;

use crate::arm::{Arm, read_urdf};
use crate::chain::{Chain, Source};
use crate::epoch::Epoch;
use crate::frames::Frames;
use crate::mapping::{CountsEntry, Mapping, WhiskerEntry};
use crate::router::Router;
use crate::whisker::{Fixed, Whisker};

/// Whiskers of a mapping, ready to estimate.
pub struct Setup {
    /// The mapping.
    pub mapping: Mapping,
    /// The whiskers, in its order.
    pub whiskers: Vec<Whisker>,
    /// The way of messages to them.
    pub router: Router,
}

/// Parts that the whiskers have in common.
struct Common<'a> {
    path: &'a Path,
    mapping: &'a Mapping,
    robot: Option<urdf_rs::Robot>,
    row: &'static EstimatorRow,
    config: Value,
    epoch: Epoch,
}

impl Setup {
    /// Reads a mapping with the files that it names, and builds the estimators.
    ///
    /// # Errors
    /// If a file cannot be read or is invalid, or the files contradict each other.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let mapping = Mapping::read(path)?;
        let row = ESTIMATORS.iter().find(|row| row.name == mapping.estimator).ok_or_else(|| {
            let known: Vec<_> = ESTIMATORS.iter().map(|row| row.name).collect();
            Error::value(path, "estimator", format!("`{}`", mapping.estimator), format!("one of {}", known.join(", ")))
        })?;
        let config =
            merged((row.defaults)(), &mapping.config).with_context(|| format!("{}: config", path.display()))?;
        let robot = mapping.urdf.as_ref().map(|urdf| read_urdf(&beside(path, urdf))).transpose()?;
        let epoch = Epoch::default();
        let mut router = Router::new(&mapping, epoch.clone());
        let common = Common { path, mapping: &mapping, robot, row, config, epoch };
        let whiskers = (0..mapping.whiskers.len()).map(|index| common.whisker(index, &mut router));
        Ok(Self { whiskers: whiskers.collect::<Result<_, _>>()?, router, mapping })
    }
}

impl Common<'_> {
    fn whisker(&self, index: usize, router: &mut Router) -> anyhow::Result<Whisker> {
        let entry = &self.mapping.whiskers[index];
        let plane = self.mapping.plane.plane();
        let chain = Chain::new(self.source(entry)?, plane);
        let file = beside(self.path, &entry.calibration);
        let calibration = CalibrationFile::read(&file)?;
        check_fitted_traces(&file, &calibration)?;
        let labelled = |label: Option<&str>| calibration.sensor_of_counts(&file, label);
        let sensor = entry.counts.as_ref().map(|counts| labelled(counts.sensor.as_deref())).transpose()?.cloned();
        if entry.moment.is_some() && calibration.front_end.is_some() {
            let found = "moment, with a calibration of a sensor's counts";
            let key = format!("whiskers[{index}].moment");
            return Err(Error::value(self.path, key, found, "counts, or a calibration of moments").into());
        }
        let knowledge = Arc::new(Knowledge {
            whisker: calibration.whisker.clone(),
            rest: calibration.whisker.rest_shape(),
            faces: read_by(sensor.as_ref(), &calibration.calibrated(&file, self.row.sensor_model)?),
            noise_sd_n_m: entry
                .noise_sd_n_m
                .or(sensor.as_ref().map(|sensor| sensor.noise_sd_n_m))
                .context("noise_sd_n_m: found none, expected that of the moment")?,
            base_noise: Default::default(),
            rate_hz: entry.rate_hz,
            contact_prior: None,
        });
        let counts = match (&entry.counts, sensor) {
            (Some(counts), Some(sensor)) => {
                let neighbours = neighbours_of(self.mapping, &sensor)?;
                router.add_neighbours(index, &neighbours);
                Some(self.counts(index, counts, sensor, &neighbours, &|label| labelled(Some(label)).cloned())?)
            }
            _ => None,
        };
        let (row, config, seed) = (self.row, self.config.clone(), self.mapping.seed);
        let (of_build, name) = (knowledge.clone(), entry.name.clone());
        let build = move || estimator(row, &config, TouchConfig::default(), &of_build, &name, seed);
        let looks_back = row.class == MethodClass::Hindsight;
        let estimator = LiveEstimator::with_motion(Box::new(build), &knowledge, looks_back, self.mapping.timing, chain)
            .with_context(|| format!("{}: config", self.path.display()))?;
        let observer = Observer::new(&knowledge, index, &self.mapping.map)?;
        let (name, frame, epoch) = (entry.name.clone(), self.mapping.fixed_frame.clone(), self.epoch.clone());
        Whisker::new(Fixed { name, frame, plane, knowledge, epoch }, estimator, counts, observer)
    }

    fn source(&self, entry: &WhiskerEntry) -> Result<Source, Error> {
        let (fixed, base) = (&self.mapping.fixed_frame, &entry.base_frame);
        match (&self.robot, &self.mapping.urdf) {
            (Some(robot), Some(urdf)) => Ok(Source::Arm(Arm::new(&beside(self.path, urdf), robot, fixed, base)?)),
            _ => Ok(Source::Frames(Frames::new(fixed, base))),
        }
    }

    /// Conversion of the counts of a whisker.
    fn counts(
        &self,
        index: usize,
        entry: &CountsEntry,
        own: SensorFile,
        others: &[&CountsEntry],
        sensor: &dyn Fn(&str) -> Result<SensorFile, Error>,
    ) -> anyhow::Result<Counts> {
        let has_reference = entry.reference.is_some();
        if own.common_mode != [0.0; 2] && !has_reference {
            let key = format!("whiskers[{index}].counts.reference");
            let expected = "the topic of the reference sensor, whose common mode the calibration has";
            return Err(Error::value(self.path, key, "none", expected).into());
        }
        let mut neighbours = Vec::new();
        for (talk, other) in own.cross_talk.iter().zip(others) {
            let of_other = sensor(&of_talk(&own, talk))?;
            neighbours.push((talk.clone(), Sensor::new(of_other, other.axis as usize, other.modulo)));
        }
        let own = Sensor::new(own, entry.axis as usize, entry.modulo);
        let rate_hz = self.mapping.whiskers[index].rate_hz;
        Ok(Counts::new(own, has_reference, neighbours, entry.zeroing_s, self.mapping.timing, rate_hz))
    }
}

/// Sensors of the whiskers whose magnets a sensor measures, in the order of its cross-talk.
fn neighbours_of<'a>(mapping: &'a Mapping, own: &SensorFile) -> anyhow::Result<Vec<&'a CountsEntry>> {
    let mut found = Vec::new();
    for talk in &own.cross_talk {
        let label = of_talk(own, talk);
        let mut counts = mapping.whiskers.iter().filter_map(|whisker| whisker.counts.as_ref());
        let Some(other) = counts.find(|counts| counts.sensor.as_ref() == Some(&label)) else {
            bail!(
                "whiskers: found none with the sensor `{label}`, expected one: the calibration of `{}` has a cross-talk from it",
                own.label()
            );
        };
        found.push(other);
    }
    Ok(found)
}

/// Label of the sensor from which a sensor has a cross-talk.
fn of_talk(own: &SensorFile, talk: &CrossTalk) -> String {
    format!("{}.{}", own.array, talk.from)
}

/// Path of a file that a mapping names.
fn beside(mapping: &Path, file: &Path) -> std::path::PathBuf {
    mapping.parent().unwrap_or(Path::new("")).join(file)
}
