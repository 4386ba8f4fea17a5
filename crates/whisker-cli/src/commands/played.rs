//! Traces as the input of an estimator: options and preparation, shared by the commands that replay or play them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::bail;
use evaluation::plausibility::{Finding, TimeSteps};
use serde_json::Value;
use testbed::dataset::calibrations;
use testbed::fitted_traces::{check_fitted_traces, check_is_calibration};
use testbed::front_end::{FrontEnd, Mounting, Reader, Reading, SpatialFrontEnd};
use testbed::replay::{self, check_calibration, estimator, knowledge, noise_sd_n_m, read_by};
use testbed::results::RECOMMENDED;
use testbed::settings::merged_of;
use testbed::space;
use trace::{CalibrationFile, Instant, Sidecar, Trace, TraceRows};
use whisker::estimators::{Estimator, EstimatorRow, Knowledge, MethodClass};
use whisker::events::TouchConfig;
use whisker::space::estimators::SpatialEstimatorRow;

use super::{JsonOrFile, front_end, in_file, noise_fraction, seed};

/// Options of the estimator and of its input.
// Without its own group: the command that flattens these has a group of the same name.
#[derive(clap::Args)]
#[group(skip)]
pub(super) struct Arguments {
    #[command(flatten)]
    pub(super) method: MethodArguments,
    #[command(flatten)]
    front_end: front_end::Arguments,
    /// Measurement noise to add to a trace (in `live`: to a --recording; refused on stdin), as a fraction of the trace's
    /// largest reading [default: 0.01; 0 for a front end with its own noise and for a recording]
    #[arg(long, value_parser = noise_fraction)]
    noise: Option<f64>,
    /// Seed of the measurement noise and of the front end
    #[arg(long, default_value_t = 1, value_parser = seed)]
    pub(super) seed: u64,
}

/// An estimator and its settings.
#[derive(clap::Args)]
#[group(skip)]
pub(super) struct MethodArguments {
    /// Estimator (`whisker list estimators`; for a trace in space `space-estimators`)
    #[arg(long, default_value = RECOMMENDED)]
    estimator: String,
    /// Settings of the estimator, as JSON or as a JSON file: '{"fading": 1.01}'
    #[arg(long, default_value = "{}", value_name = "JSON or FILE", value_parser = JsonOrFile::parsed)]
    config: JsonOrFile,
}

impl MethodArguments {
    /// Row of the registry and settings.
    ///
    /// # Errors
    /// If the estimator is unknown or the settings are not an object.
    pub(super) fn registered(&self) -> anyhow::Result<(&'static EstimatorRow, Value)> {
        let row = replay::registered(&self.estimator)?;
        Ok((row, merged_of(row.name, (row.defaults)(), &self.config.value)?))
    }
}

/// Options of a replay in space.
pub(super) struct InSpace {
    pub(super) row: &'static SpatialEstimatorRow,
    pub(super) config: Value,
    pub(super) front_end: SpatialFrontEnd,
    /// Measurement noise to add, as a fraction of the trace's largest reading. `None` for the default.
    pub(super) noise: Option<f64>,
    pub(super) seed: u64,
}

/// A trace that is there, and the path of its calibration.
pub(super) struct Found {
    pub(super) path: PathBuf,
    pub(super) sidecar: Sidecar,
    pub(super) calibration: PathBuf,
    front_end: FrontEnd,
    rows: TraceRows,
}

/// A trace as the input of an estimator.
pub(super) struct Played {
    pub(super) path: PathBuf,
    pub(super) sidecar: Sidecar,
    pub(super) calibration: PathBuf,
    pub(super) knowledge: Arc<Knowledge>,
    /// Readings of the front end.
    pub(super) reader: Reader,
    /// Contradiction between its sampling rate and its times, if there is one.
    pub(super) rate: Option<Finding>,
    row: &'static EstimatorRow,
    config: Value,
    seed: u64,
}

impl Arguments {
    /// Whether an option is given that has a meaning for recordings alone.
    pub(super) fn is_for_recordings(&self) -> bool {
        self.noise.is_some() || !self.front_end.is_default()
    }

    /// Names the file of the estimator's settings, if there is one, in an error of them.
    pub(super) fn in_file<T>(&self, result: anyhow::Result<T>) -> anyhow::Result<T> {
        in_file(self.method.config.file.as_deref(), result)
    }

    /// The options for a trace in space.
    ///
    /// # Errors
    /// If the estimator or the front end is unknown, or settings are invalid.
    pub(super) fn in_space(&self) -> anyhow::Result<InSpace> {
        let front_end = self.front_end.in_space()?;
        let row = space::replay::registered(&self.method.estimator)?;
        let config = merged_of(row.name, row.defaults(), &self.method.config.value)?;
        Ok(InSpace { row, config, front_end, noise: self.noise, seed: self.seed })
    }

    /// Looks for a trace and its calibration.
    ///
    /// # Errors
    /// If there is no trace, or the front end cannot read it.
    pub(super) fn find(&self, path: &Path, calibration: Option<&Path>) -> anyhow::Result<Found> {
        check_trace(path)?;
        let (sidecar, rows) = TraceRows::open(path)?;
        let front_end = self.front_end.in_plane()?;
        front_end.check_trace(&sidecar)?;
        let folder = calibrations(beside(path), front_end.row.name);
        let default = || folder.join(format!("{}.json", sidecar.whisker.name));
        let calibration = calibration.map_or_else(default, Path::to_path_buf);
        Ok(Found { path: path.into(), sidecar, calibration, front_end, rows })
    }

    /// Prepares a trace and checks the whole of it.
    ///
    /// # Errors
    /// If trace or calibration are damaged or contradict one another, or the estimator is unknown.
    pub(super) fn prepare(&self, found: Found) -> anyhow::Result<Played> {
        let Found { path, sidecar, calibration: of_whisker, front_end, rows } = found;
        let calibration = read_calibration(&of_whisker, Some(beside(&path)))?;
        check_calibration(&of_whisker, &calibration, &sidecar)?;
        let mounting = Mounting::of(beside(&path), &sidecar)?;
        let sensor = front_end.sensor(&of_whisker, &calibration, &mounting)?;
        let (row, config) = self.method.registered()?;
        let faces = read_by(sensor, &calibration.calibrated(&of_whisker, row.sensor_model)?);
        let gate = calibration.gate();
        // The first pass checks the whole trace, so that no output is written for a damaged one.
        let mut largest: f64 = 0.0;
        let mut steps = TimeSteps::default();
        for row in rows {
            let Instant { t_s, moment_z_n_m: moment_n_m, .. } = row?.0;
            steps.push(t_s);
            if gate.admits(moment_n_m) {
                largest = largest.max(moment_n_m.abs());
            }
        }
        let rate = steps.contradiction_with(sidecar.rate_hz, sidecar.clock());
        let noise = self.noise.unwrap_or_else(|| front_end.row.default_noise(&sidecar));
        let added_sd_n_m = noise * largest;
        let reader = match front_end.reader(&sidecar, added_sd_n_m, self.seed) {
            Some(reader) => reader,
            None => {
                let (path_of_trace, path, calibration) = (&path, &of_whisker, &calibration);
                let reading = Reading { front_end: &front_end, path, calibration, added_sd_n_m, seed: self.seed };
                let readings_n_m = reading.of(&Trace::read(path_of_trace)?, &mounting, beside(path_of_trace))?;
                let mut readings_n_m = readings_n_m.into_iter();
                Box::new(move |_: &Instant| readings_n_m.next().expect("there is a reading an instant"))
            }
        };
        let knowledge = knowledge(&sidecar, &faces, noise_sd_n_m(added_sd_n_m, sensor, &sidecar));
        Ok(Played { path, sidecar, calibration: of_whisker, knowledge, reader, rate, row, config, seed: self.seed })
    }
}

impl Played {
    /// Builder of the estimator.
    pub(super) fn build(&self) -> impl Fn() -> anyhow::Result<Estimator> + Send + use<> {
        let (row, config, knowledge, seed) = (self.row, self.config.clone(), self.knowledge.clone(), self.seed);
        let name = self.sidecar.name.clone();
        move || estimator(row, &config, TouchConfig::default(), &knowledge, &name, seed)
    }

    /// Whether the estimates of a contact are revised at its end.
    pub(super) fn looks_back(&self) -> bool {
        self.row.class == MethodClass::Hindsight
    }
}

/// Folder of a trace.
pub(super) fn beside(trace: &Path) -> &Path {
    trace.parent().unwrap_or(Path::new(""))
}

/// Checks that there is a trace.
pub(super) fn check_trace(path: &Path) -> anyhow::Result<()> {
    if path.is_dir() {
        bail!("{}: is a folder, expected one of its traces (.csv)", path.display());
    }
    for file in ["csv", "json"].map(|extension| path.with_extension(extension)) {
        if !file.is_file() {
            bail!(
                "{}: no such file, expected a trace: a .csv with its .json beside it, as `whisker simulate ... --out \
                DIR` writes them into DIR",
                file.display()
            );
        }
    }
    Ok(())
}

/// Reads a calibration whose traces have not changed since the fit. `folder` contains the traces that it may be fitted to, if it is
/// known.
pub(super) fn read_calibration(path: &Path, folder: Option<&Path>) -> anyhow::Result<CalibrationFile> {
    check_is_calibration(path, folder, "another by --calibration")?;
    let calibration = CalibrationFile::read(path)?;
    check_fitted_traces(path, &calibration)?;
    Ok(calibration)
}
