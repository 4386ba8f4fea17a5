//! Front ends of traces in space: models of the sensor between the loads at the root and the readings, applied at
//! replay. A reading is a vector: bending about two axes and, where a sensor has them, torsion and axial force.
//!
//! To add a front end: one file with a [`SpatialChain`] and one row in [`SPATIAL_FRONT_ENDS`].

mod chain;
mod white;

use anyhow::{Context, ensure};
use serde_json::Value;

use super::{FrontEndConfig, hall};
use crate::settings::merged;

pub(super) use chain::moment_n_m;
pub use chain::{BendingAxes, SpatialChain, SpatialInput, SpatialNoise, SpatialReading};
pub use hall::{SpatialCharacteristic, SpatialSensor};

/// Entry of the registry of front ends of traces in space.
pub struct SpatialFrontEndRow {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Default noise added to the simulated loads, as a fraction of the largest moment and of the largest axial force.
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
        about: "root moments and, if measured, axial force, each with white noise",
        noise: 0.01,
        defaults: white::defaults,
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
        Ok(Self { row, chain })
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

    /// Readings of a recording, one entry per instant. Those of equal inputs and seeds are equal.
    ///
    /// # Errors
    /// If a required calibration is missing.
    pub fn readings(&self, input: &SpatialInput) -> anyhow::Result<Vec<SpatialReading>> {
        self.chain.readings(input)
    }
}

/// Checks that settings have no key beyond those of `known`.
fn check_keys(config: &Value, known: &Value) -> anyhow::Result<()> {
    for key in config.as_object().into_iter().flat_map(|settings| settings.keys()) {
        let expected: Vec<&str> = known.as_object().into_iter().flatten().map(|(key, _)| key.as_str()).collect();
        ensure!(known.get(key).is_some(), "unknown key `{key}`, expected one of: {}", expected.join(", "));
    }
    Ok(())
}

#[cfg(test)]
pub(super) use tests::{golden, spiral};

#[cfg(test)]
mod tests;
