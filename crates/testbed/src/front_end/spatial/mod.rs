//! Front ends of traces in space: models of the sensor between the loads at the root and the readings, applied at
//! replay. A reading consists of the bending moments about two axes.
//!
//! To add a front end: one file with a [`SpatialChain`] and one row in [`SPATIAL_FRONT_ENDS`].

mod chain;
mod white;

use std::path::Path;

use anyhow::{Context, ensure};
use nalgebra::Vector2;
use serde_json::{Value, json};
use trace::{SpatialCalibrationFile, SpatialFrontEndFile, SpatialSensor, SpatialSidecar, SpatialTrace};

use super::{FrontEndConfig, check_made_through, hall, make};
use crate::settings::merged;

pub(super) use chain::moment_n_m;
pub use chain::{BendingAxes, SpatialChain, SpatialInput};

/// Entry of the registry of front ends of traces in space.
pub struct SpatialFrontEndRow {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Default noise added to the simulated loads, as a fraction of the largest reading.
    pub noise: f64,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Constructor from settings.
    build: fn(&Value) -> anyhow::Result<Box<dyn SpatialChain>>,
}

/// Registry of front ends of traces in space; the first is the default.
pub const SPATIAL_FRONT_ENDS: &[SpatialFrontEndRow] = &[
    SpatialFrontEndRow {
        name: "white",
        about: "bending moments at the root, each with white noise",
        noise: 0.01,
        defaults: || json!({}),
        build: white::build,
    },
    SpatialFrontEndRow {
        name: "hall",
        about: "magnet that turns with the root about two axes above a three-axis Hall sensor, with a reference sensor \
            that compensates the earth's field",
        noise: 0.0,
        defaults: hall::defaults,
        build: hall::build_spatial,
    },
];

/// Front end of traces in space with its settings.
pub struct SpatialFrontEnd {
    /// Entry in the registry.
    pub row: &'static SpatialFrontEndRow,
    config: Value,
    chain: Box<dyn SpatialChain>,
}

impl SpatialFrontEnd {
    /// Front end with this configuration.
    ///
    /// # Errors
    /// If the name is unknown or the settings are invalid.
    pub fn new(requested: &FrontEndConfig) -> anyhow::Result<Self> {
        let row = SPATIAL_FRONT_ENDS.iter().find(|row| row.name == requested.name).with_context(|| {
            let known: Vec<_> = SPATIAL_FRONT_ENDS.iter().map(|row| row.name).collect();
            format!("unknown front end `{}` of traces in space, expected one of: {}", requested.name, known.join(", "))
        })?;
        let place = || format!("settings of the front end `{}` of traces in space", row.name);
        let config = merged((row.defaults)(), &requested.config).with_context(place)?;
        let chain = (row.build)(&config).with_context(place)?;
        Ok(Self { row, config, chain })
    }

    /// Whether readings depend on the seed even without added noise.
    pub fn is_noisy(&self) -> bool {
        self.chain.has_sensor()
    }

    /// Default noise added to the readings of a trace, as a fraction of the largest; 0 for recordings of real sensors, which
    /// contain their own.
    pub fn default_noise(&self, sidecar: &SpatialSidecar) -> f64 {
        if sidecar.recorded.is_some() { 0.0 } else { self.row.noise }
    }

    /// Checks that a trace may be read through this front end.
    ///
    /// # Errors
    /// If the trace is a recording of a real sensor and the front end models one.
    pub fn check_trace(&self, sidecar: &SpatialSidecar) -> anyhow::Result<()> {
        let is_allowed = sidecar.recorded.is_none() || !self.chain.has_sensor();
        let (name, front_end) = (&sidecar.name, self.row.name);
        ensure!(
            is_allowed,
            "{name}: found a recording of a real sensor, expected a simulated trace for the front end `{front_end}`"
        );
        Ok(())
    }

    /// Description for a calibration or a run, with these sensors. `None` if readings are the moments themselves.
    pub fn describe(&self, sensors: Vec<SpatialSensor>) -> Option<SpatialFrontEndFile> {
        let described = || SpatialFrontEndFile { name: self.row.name.into(), config: self.config.clone(), sensors };
        self.chain.has_sensor().then(described)
    }

    /// Calibration of the sensor of a calibration's whisker. `None` if readings are the moments themselves.
    ///
    /// # Errors
    /// If the calibration at `path` was made through another front end.
    pub fn sensor<'a>(
        &self,
        path: &Path,
        calibration: &'a SpatialCalibrationFile,
    ) -> anyhow::Result<Option<&'a SpatialSensor>> {
        let found = calibration.front_end.as_ref().map(|file| (file.name.as_str(), &file.config));
        check_made_through(path, found, (self.row.name, &self.config), self.chain.has_sensor())?;
        let Some(file) = &calibration.front_end else { return Ok(None) };
        let (path, make) = (path.display(), make(self.row.name));
        let name = &calibration.whisker.name;
        let sensor = file.sensor(name).with_context(|| {
            let known: Vec<_> = file.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
            format!("{path}: front_end.sensors: found {}, expected `{name}` among them; {make}", known.join(", "))
        })?;
        Ok(Some(sensor))
    }

    /// Bending moments about y and z of the front end's [`Self::axes`] (N m), one entry per instant of a trace, with white noise of
    /// this standard deviation on each. Those of equal inputs and seeds are equal.
    ///
    /// # Errors
    /// If a required calibration is missing.
    pub fn bending_n_m(
        &self,
        trace: &SpatialTrace,
        noise_sd_n_m: f64,
        seed: u64,
        sensor: Option<&SpatialSensor>,
    ) -> anyhow::Result<Vec<Vector2<f64>>> {
        self.chain.readings_n_m(&SpatialInput { sensor, ..SpatialInput::new(trace, noise_sd_n_m, seed) })
    }

    /// The same without noise and errors of the sensor.
    pub fn exact_n_m(&self, trace: &SpatialTrace) -> impl Iterator<Item = Vector2<f64>> {
        let suspension = &trace.sidecar.suspension;
        let of_instant = move |now| self.axes().bending_n_m(moment_n_m(now), suspension).into();
        trace.recording.instants.iter().map(of_instant)
    }

    /// Axes about which the readings state the bending.
    pub fn axes(&self) -> BendingAxes {
        self.chain.axes()
    }

    /// Calibrates the sensor on recordings. `None` if the front end has none.
    ///
    /// # Errors
    /// If the recordings do not determine the calibration.
    pub fn calibrate(&self, recordings: &[SpatialInput]) -> anyhow::Result<Option<SpatialSensor>> {
        self.chain.calibrate(recordings)
    }
}

#[cfg(test)]
pub(super) use tests::{golden, spiral};

#[cfg(test)]
mod tests;
