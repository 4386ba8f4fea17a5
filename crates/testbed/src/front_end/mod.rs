//! Front ends: models of the sensor between the root moment of a simulated trace and the reading, applied at replay.
//!
//! To add a front end: one file with a [`Chain`] and one row in [`FRONT_ENDS`].

mod chain;
mod hall;
mod mounting;
mod spatial;
mod white;
mod whole;

use std::path::Path;

use anyhow::{Context, bail};
use serde_json::{Value, json};
use trace::{CalibrationFile, FrontEndFile, SensorFile, Sidecar};

use crate::settings::merged;
use chain::noise;

pub use chain::{Chain, Reader, SensorInput};
pub use hall::{Config as HallConfig, shift_counts};
pub use mounting::{BoardSlot, Mounting};
pub use spatial::{BendingAxes, SPATIAL_FRONT_ENDS, SpatialChain, SpatialFrontEnd, SpatialFrontEndRow, SpatialInput};
pub use whole::Reading;

/// Entry of the registry of front ends.
pub struct FrontEndRow {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Default measurement noise added to simulated moments, as a fraction of the largest reading.
    pub noise: f64,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Constructor from settings.
    build: fn(&Value) -> anyhow::Result<Box<dyn Chain>>,
}

impl FrontEndRow {
    /// Default measurement noise as a fraction of the largest reading; 0 for recordings of real sensors, which contain
    /// their own.
    pub fn default_noise(&self, sidecar: &Sidecar) -> f64 {
        if sidecar.recorded.is_some() { 0.0 } else { self.noise }
    }
}

/// Registry of front ends; the first is the default.
pub const FRONT_ENDS: &[FrontEndRow] = &[
    FrontEndRow {
        name: "white",
        about: "root moment with white noise",
        noise: 0.01,
        defaults: || json!({}),
        build: white::build,
    },
    FrontEndRow {
        name: "hall",
        about: "magnet at the root above a Hall sensor, with a reference sensor that compensates the earth's field \
            (Lin et al. 2022)",
        noise: 0.0,
        defaults: hall::defaults,
        build: hall::build,
    },
];

/// Configuration of a front end: name and settings that override its defaults.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontEndConfig {
    /// Name in the registry.
    pub name: String,
    /// Settings; missing ones take their defaults.
    pub config: Value,
}

/// Remedy for a calibration that was made through another front end.
fn make(front_end: &str) -> String {
    format!("run `whisker fit --front-end {front_end}` to make one")
}

/// Checks that a calibration at `path` was made through the expected front end: its name and its settings.
fn check_made_through(
    path: &Path,
    found: Option<(&str, &Value)>,
    (name, config): (&str, &Value),
    has_sensor: bool,
) -> anyhow::Result<()> {
    let (path, make) = (path.display(), make(name));
    let Some((found_name, found_config)) = found else {
        if has_sensor {
            bail!("{path}: front_end: found none, expected `{name}`; {make}");
        }
        return Ok(());
    };
    if found_name != name {
        bail!("{path}: front_end.name: found `{found_name}`, expected `{name}`; {make}");
    }
    for (key, expected) in config.as_object().into_iter().flatten() {
        let found = &found_config[key];
        if found != expected {
            bail!("{path}: front_end.config.{key}: found {found}, expected {expected}; {make}");
        }
    }
    Ok(())
}

impl Default for FrontEndConfig {
    fn default() -> Self {
        Self { name: FRONT_ENDS[0].name.into(), config: json!({}) }
    }
}

/// Front end with its settings.
pub struct FrontEnd {
    /// Entry in the registry.
    pub row: &'static FrontEndRow,
    config: Value,
    chain: Box<dyn Chain>,
}

impl FrontEnd {
    /// Front end with this configuration.
    ///
    /// # Errors
    /// If the name is unknown or the settings are invalid.
    pub fn new(requested: &FrontEndConfig) -> anyhow::Result<Self> {
        let row = FRONT_ENDS.iter().find(|row| row.name == requested.name).with_context(|| {
            let known: Vec<_> = FRONT_ENDS.iter().map(|row| row.name).collect();
            format!("unknown front end `{}`, expected one of: {}", requested.name, known.join(", "))
        })?;
        let place = || format!("settings of the front end `{}`", row.name);
        let config = merged((row.defaults)(), &requested.config).with_context(place)?;
        let chain = (row.build)(&config).with_context(place)?;
        Ok(Self { row, config, chain })
    }

    /// Whether it has sensors, which must be calibrated, and whose readings depend on the seed even without added noise.
    pub fn has_sensor(&self) -> bool {
        self.chain.has_sensor()
    }

    /// Checks that a trace may be read through this front end.
    ///
    /// # Errors
    /// If the trace is a recording of a real sensor and the front end models one.
    pub fn check_trace(&self, sidecar: &Sidecar) -> anyhow::Result<()> {
        if sidecar.recorded.is_some() && self.has_sensor() {
            bail!(
                "{}: found a recording of a real sensor, expected a simulated trace for the front end `{}`",
                sidecar.name,
                self.row.name
            );
        }
        Ok(())
    }

    /// Description for a calibration file, with these sensors.
    pub fn describe(&self, sensors: Vec<SensorFile>) -> FrontEndFile {
        FrontEndFile { name: self.row.name.into(), config: self.config.clone(), sensors }
    }

    /// Calibrates the sensors of these mountings on recordings. `None` if readings are the moments themselves.
    ///
    /// # Errors
    /// If the recordings do not determine the calibration.
    pub fn calibrate(
        &self,
        mountings: &[Mounting],
        recordings: &[SensorInput],
    ) -> anyhow::Result<Option<FrontEndFile>> {
        let mut sensors = Vec::new();
        for mounting in mountings {
            sensors.extend(self.chain.calibrate(mounting, recordings)?);
        }
        Ok(self.chain.has_sensor().then(|| self.describe(sensors)))
    }

    /// Calibration of a mounting's sensor. `None` if readings are the moments themselves.
    ///
    /// # Errors
    /// If the calibration at `path` was made through another front end, or does not contain the sensor.
    pub fn sensor<'a>(
        &self,
        path: &Path,
        calibration: &'a CalibrationFile,
        mounting: &Mounting,
    ) -> anyhow::Result<Option<&'a SensorFile>> {
        let found = calibration.front_end.as_ref().map(|file| (file.name.as_str(), &file.config));
        check_made_through(path, found, (self.row.name, &self.config), self.chain.has_sensor())?;
        let Some(file) = &calibration.front_end else { return Ok(None) };
        let path = path.display();
        let sensor = file.sensor(&mounting.array, &mounting.sensor).with_context(|| {
            let known: Vec<_> = file.sensors.iter().map(|sensor| format!("{}/{}", sensor.array, sensor.name)).collect();
            let wanted = format!("{}/{}", mounting.array, mounting.sensor);
            format!(
                "{path}: front_end.sensors: found {}, expected {wanted} among them; run `whisker fit --sensors \
                {wanted}` to add it",
                known.join(", ")
            )
        })?;
        Ok(Some(sensor))
    }

    /// Readings of a recording, one entry per instant.
    ///
    /// # Errors
    /// If a required calibration is missing.
    pub fn readings_n_m(&self, input: &SensorInput) -> anyhow::Result<Vec<f64>> {
        self.chain.readings_n_m(input)
    }

    /// Streaming reader of a trace with the same readings as [`Self::readings_n_m`]. `None` if the front end requires
    /// the whole recording.
    pub fn reader(&self, sidecar: &Sidecar, noise_sd_n_m: f64, seed: u64) -> Option<Reader> {
        let mut standard = noise(sidecar, seed);
        self.chain.reader(Box::new(move || noise_sd_n_m * standard()))
    }

    /// Report tables of a sensor: file names and contents.
    ///
    /// # Errors
    /// If a row cannot be serialised.
    pub fn tables(&self, sensor: &SensorFile) -> anyhow::Result<Vec<(String, Vec<u8>)>> {
        Ok(self.table_files(sensor).zip(self.chain.table_bytes(sensor)?).collect())
    }

    /// File names of the report tables of a sensor.
    pub fn table_files(&self, sensor: &SensorFile) -> impl Iterator<Item = String> {
        self.chain.tables().iter().map(|table| format!("{}.{table}.csv", sensor.label()))
    }
}
