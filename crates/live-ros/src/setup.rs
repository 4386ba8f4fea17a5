//! Whiskers of a mapping, and the way of messages to them.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail};
use files::Error;
use live::counts::{BendingCounts, Counts, Sensor};
use live::{LiveEstimator, check_noise, noise_n_m};
use serde_json::Value;
use testbed::fitted_traces::check_fitted_traces;
use testbed::map::{MapConfig, Observer};
use testbed::replay::{estimator, read_by};
use testbed::settings::merged;
use testbed::space::replay::{knowledge, read_fitted};
use testbed::space::run::SpatialRunWhisker;
use trace::{BendingSensor, CalibrationFile, CrossTalk, SensorFile, SpatialCalibrationFile, is_spatial};
use whisker::estimators::{ESTIMATORS, EstimatorRow, Knowledge, MethodClass};
use whisker::events::TouchConfig;
use whisker::space::estimators::{SPATIAL_ESTIMATORS, SpatialEstimatorRow};

use crate::arm::{Arm, read_urdf};
use crate::chain::{Chain, InSpace, OnPlane, Source};
use crate::epoch::Epoch;
use crate::frames::Frames;
use crate::mapping::{CountsEntry, Mapping, PlaneEntry, WhiskerEntry};
use crate::planar::PlanarGeometry;
use crate::router::Router;
use crate::spatial::SpatialGeometry;
use crate::whisker::{Estimation, Fixed, Whisker};

/// Whiskers of a mapping, ready to estimate.
pub struct Setup {
    /// The mapping.
    pub mapping: Mapping,
    /// Whether calibrations and estimators are those of space.
    pub is_in_space: bool,
    /// The whiskers, in the order of the mapping.
    pub whiskers: Vec<Box<dyn Whisker>>,
    /// The way of messages to them.
    pub router: Router,
}

/// Parts that the whiskers have in common.
struct Common<'a, R: 'static> {
    path: &'a Path,
    mapping: &'a Mapping,
    robot: Option<urdf_rs::Robot>,
    row: &'static R,
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
        let is_in_space = is_in_space(path, &mapping)?;
        let epoch = Epoch::default();
        let mut router = Router::new(&mapping, epoch.clone());
        let indices = 0..mapping.whiskers.len();
        let whiskers = if is_in_space {
            check_spatial(path, &mapping)?;
            let row = registered(path, &mapping, SPATIAL_ESTIMATORS, |row| row.name)?;
            let common = Common::new(path, &mapping, row, row.defaults(), epoch)?;
            indices.map(|index| common.in_space(index)).collect::<Result<_, _>>()?
        } else {
            let row = registered(path, &mapping, ESTIMATORS, |row| row.name)?;
            let common = Common::new(path, &mapping, row, (row.defaults)(), epoch)?;
            indices.map(|index| common.in_plane(index, &mut router)).collect::<Result<_, _>>()?
        };
        Ok(Self { is_in_space, whiskers, router, mapping })
    }
}

/// Whether the calibrations of a mapping are those of space.
fn is_in_space(path: &Path, mapping: &Mapping) -> anyhow::Result<bool> {
    let mut in_space = 0;
    for entry in &mapping.whiskers {
        in_space += usize::from(is_spatial(&beside(path, &entry.calibration))?);
    }
    match in_space {
        0 => Ok(false),
        count if count == mapping.whiskers.len() => Ok(true),
        count => {
            let found = format!("{count} of {} calibrations in space", mapping.whiskers.len());
            Err(Error::value(path, "whiskers", found, "all calibrations in the plane or all in space").into())
        }
    }
}

/// Checks that a mapping of whiskers in space has no settings of the plane.
fn check_spatial(path: &Path, mapping: &Mapping) -> Result<(), Error> {
    let refused = |key: &str, expected| {
        Err(Error::value(path, key, "a setting of planar estimators, with calibrations in space", expected))
    };
    if mapping.plane != PlaneEntry::default() {
        return refused("plane", "the default: no pose is projected onto a plane");
    }
    if mapping.map != MapConfig::default() {
        return refused("map", "the default: maps in space have no settings");
    }
    if mapping.seed != Mapping::FIRST_SEED {
        return refused("seed", "the default: methods in space that draw random numbers have a seed in `config`");
    }
    for (index, counts) in mapping.whiskers.iter().map(|whisker| &whisker.counts).enumerate() {
        let Some(CountsEntry { axis, sensor, reference, .. }) = counts else { continue };
        let of_one_channel = [
            ("axis", axis.is_some(), "`axes`, those of both channels"),
            ("sensor", sensor.is_some(), "none: a calibration in space has one sensor"),
            ("reference", reference.is_some(), "none: sensors in space have no common mode"),
        ];
        if let Some((key, _, expected)) = of_one_channel.into_iter().find(|(_, is_stated, _)| *is_stated) {
            return refused(&format!("whiskers[{index}].counts.{key}"), expected);
        }
    }
    Ok(())
}

/// Row of the estimator that a mapping names.
fn registered<R>(
    path: &Path,
    mapping: &Mapping,
    rows: &'static [R],
    name: fn(&R) -> &'static str,
) -> Result<&'static R, Error> {
    rows.iter().find(|&row| name(row) == mapping.estimator).ok_or_else(|| {
        let known: Vec<_> = rows.iter().map(name).collect();
        Error::value(path, "estimator", format!("`{}`", mapping.estimator), format!("one of {}", known.join(", ")))
    })
}

impl<'a, R> Common<'a, R> {
    fn new(
        path: &'a Path,
        mapping: &'a Mapping,
        row: &'static R,
        defaults: Value,
        epoch: Epoch,
    ) -> anyhow::Result<Self> {
        let config = merged(defaults, &mapping.config).with_context(|| format!("{}: config", path.display()))?;
        let robot = mapping.urdf.as_ref().map(|urdf| read_urdf(&beside(path, urdf))).transpose()?;
        Ok(Self { path, mapping, robot, row, config, epoch })
    }

    fn fixed(&self, entry: &WhiskerEntry) -> Fixed {
        Fixed { name: entry.name.clone(), frame: self.mapping.fixed_frame.clone(), epoch: self.epoch.clone() }
    }

    fn source(&self, entry: &WhiskerEntry) -> Result<Source, Error> {
        let (fixed, base) = (&self.mapping.fixed_frame, &entry.base_frame);
        match (&self.robot, &self.mapping.urdf) {
            (Some(robot), Some(urdf)) => Ok(Source::Arm(Arm::new(&beside(self.path, urdf), robot, fixed, base)?)),
            _ => Ok(Source::Frames(Frames::new(fixed, base))),
        }
    }

    /// Place of an error in the settings of the estimator.
    fn in_config(&self) -> String {
        format!("{}: config", self.path.display())
    }

    /// Error for a moment without the standard deviation of its noise.
    fn no_noise(&self, index: usize) -> Error {
        let expected = "the standard deviation of the moment's noise (N m)";
        Error::value(self.path, format!("whiskers[{index}].noise_sd_n_m"), "none", expected)
    }

    /// Checks the stated noise of a whisker, see [`check_noise`].
    fn check_noise(&self, index: usize, of_sensor: Option<f64>, largest_n_m: f64) -> Result<(), Error> {
        let stated = self.mapping.whiskers[index].noise_sd_n_m;
        check_noise(stated, of_sensor, largest_n_m).map_err(|(found, expected)| {
            Error::value(self.path, format!("whiskers[{index}].noise_sd_n_m"), found, expected)
        })
    }

    /// Error for `moment` with a calibration of a sensor's counts.
    fn no_moments(&self, index: usize, expected: &str) -> Error {
        let found = "moment, with a calibration of a sensor's counts";
        Error::value(self.path, format!("whiskers[{index}].moment"), found, expected)
    }
}

impl Common<'_, SpatialEstimatorRow> {
    fn in_space(&self, index: usize) -> anyhow::Result<Box<dyn Whisker>> {
        let entry = &self.mapping.whiskers[index];
        let chain = Chain::new(self.source(entry)?, InSpace);
        let file = beside(self.path, &entry.calibration);
        let calibration = read_fitted(&file)?;
        if calibration.front_end.is_some() {
            let key = format!("whiskers[{index}].calibration");
            let found = "one of a simulated sensor, through a front end";
            return Err(
                Error::value(self.path, key, found, "a calibration of moments or of imported recordings").into()
            );
        }
        let sensor = calibration.sensor;
        let of_sensor = sensor.map(|sensor| sensor.noise_sd_n_m);
        let noise_sd_n_m = noise_n_m(entry.noise_sd_n_m, of_sensor).ok_or_else(|| self.no_noise(index))?;
        self.check_noise(index, of_sensor, calibration.largest_reading_n_m)?;
        let timing = self.mapping.timing;
        let counts = entry.counts.as_ref().map(|counts| {
            let sensor = sensor.ok_or_else(|| {
                let expected = "one that `whisker fit` made of imported recordings, whose sensor converts counts";
                let key = format!("whiskers[{index}].calibration");
                Error::value(self.path, key, "a calibration without a sensor, with `counts`", expected)
            })?;
            let sensor = BendingSensor { noise_sd_n_m, ..sensor };
            let (largest_n_m, axes) = (calibration.largest_reading_n_m, counts.spatial_axes());
            let CountsEntry { modulo, zeroing_s, .. } = *counts;
            Ok::<_, Error>(BendingCounts::new(sensor, largest_n_m, axes, modulo, zeroing_s, timing, entry.rate_hz))
        });
        let counts = counts.transpose()?;
        let knowledge = knowledge(&calibration.calibrated(&file, None)?, noise_sd_n_m, None, entry.rate_hz);
        let (row, config, of_build) = (self.row, self.config.clone(), knowledge.clone());
        let build = move || Ok(row.build(&config, TouchConfig::default(), &of_build)?);
        let estimator = LiveEstimator::in_space_with_motion(Box::new(build), &knowledge, timing, chain)
            .with_context(|| self.in_config())?;
        let SpatialCalibrationFile { whisker, suspension, poisson_ratio, .. } = calibration;
        let geometry = SpatialGeometry::new(&SpatialRunWhisker { whisker, suspension, poisson_ratio }, knowledge)?;
        Ok(Box::new(Estimation::new(self.fixed(entry), geometry, estimator, counts)))
    }
}

impl Common<'_, EstimatorRow> {
    fn in_plane(&self, index: usize, router: &mut Router) -> anyhow::Result<Box<dyn Whisker>> {
        let entry = &self.mapping.whiskers[index];
        let plane = self.mapping.plane.plane();
        let chain = Chain::new(self.source(entry)?, OnPlane::new(plane));
        let file = beside(self.path, &entry.calibration);
        let calibration = CalibrationFile::read(&file)?;
        check_fitted_traces(&file, &calibration)?;
        let labelled = |label: Option<&str>| calibration.sensor_of_counts(&file, label);
        let sensor = entry.counts.as_ref().map(|counts| labelled(counts.sensor.as_deref())).transpose()?.cloned();
        if entry.moment.is_some() && calibration.front_end.is_some() {
            return Err(self.no_moments(index, "counts, or a calibration of moments").into());
        }
        let of_sensor = sensor.as_ref().map(|sensor| sensor.noise_sd_n_m);
        self.check_noise(index, of_sensor, calibration.largest_reading_n_m())?;
        let knowledge = Arc::new(Knowledge {
            whisker: calibration.whisker.clone(),
            rest: calibration.whisker.rest_shape(),
            faces: read_by(sensor.as_ref(), &calibration.calibrated(&file, self.row.sensor_model)?),
            noise_sd_n_m: noise_n_m(entry.noise_sd_n_m, of_sensor).ok_or_else(|| self.no_noise(index))?,
            base_noise: Default::default(),
            rate_hz: entry.rate_hz,
            contact_prior: None,
        });
        if entry.counts.as_ref().is_some_and(|counts| counts.axes.is_some()) {
            let key = format!("whiskers[{index}].counts.axes");
            return Err(Error::value(self.path, key, "two axes, in the plane", "`axis`, a single one").into());
        }
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
            .with_context(|| self.in_config())?;
        let observer = Observer::new(&knowledge, index, &self.mapping.map)?;
        let geometry = PlanarGeometry::new(plane, knowledge, observer)?;
        Ok(Box::new(Estimation::new(self.fixed(entry), geometry, estimator, counts)))
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
            neighbours.push((talk.clone(), Sensor::new(of_other, other.planar_axis(), other.modulo)));
        }
        let WhiskerEntry { rate_hz, noise_sd_n_m, .. } = self.mapping.whiskers[index];
        let noise_sd_n_m = own.noise_sd_n_m.max(noise_sd_n_m.unwrap_or_default());
        let own = Sensor::new(SensorFile { noise_sd_n_m, ..own }, entry.planar_axis(), entry.modulo);
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
