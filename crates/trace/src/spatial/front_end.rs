//! Front end in space and the calibration of its sensors, as stored with calibrations and runs.

use std::path::Path;

use files::Error;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::SpatialCharacteristic;

/// Front end in space and the calibration of its sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialFrontEndFile {
    /// Its name in the registry.
    pub name: String,
    /// Its settings.
    pub config: Value,
    /// Calibrated sensors: in a calibration that of its whisker.
    pub sensors: Vec<SpatialSensor>,
}

impl SpatialFrontEndFile {
    /// The sensor of the whisker of this name.
    pub fn sensor(&self, whisker: &str) -> Option<&SpatialSensor> {
        self.sensors.iter().find(|sensor| sensor.name == whisker)
    }

    /// Checks the numbers of the sensors.
    pub(super) fn check(&self, path: &Path) -> Result<(), Error> {
        self.sensors.iter().try_for_each(|sensor| sensor.check(path))
    }
}

/// Calibration of a three-axis Hall sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialSensor {
    /// Name of the sensor, that of its whisker.
    pub name: String,
    /// Common-mode coefficients: counts of each axis of this sensor per count of each axis of the reference, by rows.
    pub common_mode: [[f64; 3]; 3],
    /// Response of the counts to the bending, after common-mode compensation.
    pub characteristic: SpatialCharacteristic,
    /// RMS, for each bending moment at rest, of the part of the noise that varies within a recording (N m).
    pub noise_sd_n_m: [f64; 2],
    /// Standard deviation of the offset of each bending moment at rest, constant within a recording (N m).
    pub offset_sd_n_m: [f64; 2],
}

impl SpatialSensor {
    fn check(&self, path: &Path) -> Result<(), Error> {
        let key = |name: &str| format!("front_end.sensors.{}.{name}", self.name);
        if !self.characteristic.is_valid() {
            let expected =
                format!("a positive scale_n_m and {} finite coefficients of each axis", SpatialCharacteristic::terms());
            return Err(Error::value(path, key("characteristic"), format!("{:?}", self.characteristic), expected));
        }
        if let Some(number) = self.common_mode.iter().flatten().find(|number| !number.is_finite()) {
            return Err(Error::value(path, key("common_mode"), number, "finite numbers"));
        }
        for (name, of_axes) in [("noise_sd_n_m", self.noise_sd_n_m), ("offset_sd_n_m", self.offset_sd_n_m)] {
            if let Some(number) = of_axes.iter().find(|number| !(number.is_finite() && **number >= 0.0)) {
                return Err(Error::value(path, key(name), number, "a number of 0 or more"));
            }
        }
        Ok(())
    }
}
