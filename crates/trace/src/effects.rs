//! Effects of sensor and mounting that are added to a simulated trace at replay.

use std::path::Path;

use files::Error;
use serde::{Deserialize, Serialize};

use crate::MOST_NOISE;

/// Effects that an evaluation adds to the readings and poses of a trace unless its settings state others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplayEffects {
    /// Standard deviation of the measurement noise, as a fraction of the largest reading of the set.
    pub noise: f64,
    /// Deviations from the calibration.
    #[serde(default, skip_serializing_if = "Miscalibration::is_none")]
    pub miscalibration: Miscalibration,
}

/// Deviations of sensor, whisker and mounting from their calibration. The truth is that of the actual whisker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Miscalibration {
    /// Relative deviation of the reading.
    #[serde(skip_serializing_if = "is_zero")]
    pub gain: f64,
    /// Constant deviation of the reading, as a fraction of the largest reading of the face's calibration.
    #[serde(skip_serializing_if = "is_zero")]
    pub offset: f64,
    /// Rate at which the offset grows from the start of the trace, as a fraction per second.
    #[serde(skip_serializing_if = "is_zero")]
    pub drift_per_s: f64,
    /// Relative deviation of Young's modulus of the wire.
    #[serde(skip_serializing_if = "is_zero")]
    pub stiffness: f64,
    /// Rotation of the calibrated Base in the actual one.
    #[serde(skip_serializing_if = "is_zero")]
    pub mount_rad: f64,
    /// Position of the origin of the calibrated Base in the actual one, along x.
    #[serde(skip_serializing_if = "is_zero")]
    pub mount_x_m: f64,
    /// Position of the origin of the calibrated Base in the actual one, along y.
    #[serde(skip_serializing_if = "is_zero")]
    pub mount_y_m: f64,
    /// Time by which the poses lag the readings.
    #[serde(skip_serializing_if = "is_zero")]
    pub latency_s: f64,
}

/// Whether a value is zero.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde requires")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Miscalibration {
    /// Whether all deviations are zero.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Names, values and largest sizes of all deviations.
    fn parts(&self) -> [(&'static str, f64, f64); 8] {
        [
            ("gain", self.gain, 0.5),
            ("offset", self.offset, 0.5),
            ("drift_per_s", self.drift_per_s, 0.5),
            ("stiffness", self.stiffness, 0.5),
            ("mount_rad", self.mount_rad, 0.5),
            ("mount_x_m", self.mount_x_m, 0.1),
            ("mount_y_m", self.mount_y_m, 0.1),
            ("latency_s", self.latency_s, 1.0),
        ]
    }

    /// Label in names of traces and groups, in plain characters, such as `gain_1e-2`; empty without deviations.
    pub fn label(&self) -> String {
        let words = self.parts().into_iter().filter(|(_, value, _)| *value != 0.0);
        words.map(|(name, value, _)| format!("{name}_{value:e}")).collect::<Vec<_>>().join("_")
    }

    /// The first deviation that is too large or not a number: its name, its value and the largest size.
    pub fn out_of_range(&self) -> Option<(&'static str, f64, f64)> {
        self.parts().into_iter().find(|(_, value, most)| !(-most..=*most).contains(value))
    }
}

impl ReplayEffects {
    pub(crate) fn validate(&self, path: &Path) -> Result<(), Error> {
        if !(0.0..=MOST_NOISE).contains(&self.noise) {
            return Err(Error::value(path, "replay.noise", self.noise, format!("0 to {MOST_NOISE}")));
        }
        match self.miscalibration.out_of_range() {
            Some((name, found, most)) => {
                let key = format!("replay.miscalibration.{name}");
                Err(Error::value(path, key, found, format!("-{most} to {most}")))
            }
            None => Ok(()),
        }
    }
}
