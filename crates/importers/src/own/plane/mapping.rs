//! Keys of a mapping in the plane.

use std::path::Path;

use files::Error;
use serde::{Deserialize, Serialize};
use trace::{FARTHEST_M, LARGEST};
use whisker::frames::Pose;

use crate::own::PoseKeys;
use crate::own::mapping::{Channels, Keys, Moving, StatedAtRest, validate_at_rest};
use crate::own::quantity::{Quantity, check_sign, positive};
use crate::own::units::{Angle, Length, Reading};

/// Largest degree of a fitted characteristic, which has three coefficients in a sidecar.
const MOST_DEGREE: usize = 3;

/// Columns of the pose.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PoseColumns {
    #[serde(default)]
    pub(super) of: Moving,
    pub(super) x: Quantity<Length>,
    pub(super) y: Quantity<Length>,
    #[serde(default)]
    pub(super) yaw: Quantity<Angle>,
}

impl Keys for PoseColumns {
    fn columns(&self) -> Vec<&str> {
        [&self.x.column, &self.y.column, &self.yaw.column].into_iter().flatten().map(String::as_str).collect()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        self.x.validate(path, &format!("{key}.x"), FARTHEST_M)?;
        self.y.validate(path, &format!("{key}.y"), FARTHEST_M)?;
        self.yaw.validate(path, &format!("{key}.yaw"), LARGEST)
    }
}

impl PoseKeys for PoseColumns {
    fn positions(&self) -> Vec<&Quantity<Length>> {
        vec![&self.x, &self.y]
    }
}

/// Constant pose.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Placement {
    x: Quantity<Length>,
    y: Quantity<Length>,
    #[serde(default)]
    yaw: Quantity<Angle>,
}

impl Default for Placement {
    fn default() -> Self {
        Self { x: Quantity::zero(), y: Quantity::zero(), yaw: Quantity::default() }
    }
}

impl Placement {
    pub(super) fn pose<From, To>(&self) -> Pose<From, To> {
        let Self { x, y, yaw } = self;
        let constant = |value: Option<f64>| value.unwrap_or_default();
        Pose::new(constant(x.constant()), constant(y.constant()), constant(yaw.constant()))
    }
}

impl Keys for Placement {
    fn columns(&self) -> Vec<&str> {
        Vec::new()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        self.x.validate_constant(path, &format!("{key}.x"), FARTHEST_M)?;
        self.y.validate_constant(path, &format!("{key}.y"), FARTHEST_M)?;
        self.yaw.validate_constant(path, &format!("{key}.yaw"), LARGEST)
    }
}

/// Column of the sensor's reading, and its conversion to the moment.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReadingColumn {
    pub(super) column: String,
    pub(super) unit: Reading,
    #[serde(default = "positive")]
    pub(super) sign: f64,
    /// Reading of the free whisker ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rest: Option<f64>,
    /// ... or the duration at the start of each recording in which the whisker is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rest_s: Option<f64>,
    /// Standard deviation of the noise, in the unit of the reading. `None` to estimate it while the whisker is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    noise_sd: Option<f64>,
    /// Distance from rest, in the unit of the reading, beyond which the whisker touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    touch: Option<f64>,
    /// Counts by powers of the moment (N m). `None` to fit them to the calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) characteristic: Option<[f64; 3]>,
    /// Degree of the fitted characteristic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) degree: Option<usize>,
}

impl Keys for ReadingColumn {
    fn columns(&self) -> Vec<&str> {
        vec![&self.column]
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        check_sign(path, key, self.sign)?;
        validate_at_rest(path, key, self)?;
        let key = |name: &str| format!("{key}.{name}");
        if self.unit != Reading::Counts && (self.characteristic.is_some() || self.degree.is_some()) {
            return Err(Error::value(path, key("unit"), "a unit of moment", "`counts` for a characteristic"));
        }
        if self.characteristic.is_some() && self.degree.is_some() {
            return Err(Error::value(path, key("degree"), "`characteristic` and `degree`", "one of them"));
        }
        if let Some(found) = self.degree.filter(|degree| !(1..=MOST_DEGREE).contains(degree)) {
            return Err(Error::value(path, key("degree"), found, format!("1 to {MOST_DEGREE}")));
        }
        Ok(())
    }
}

impl Channels for ReadingColumn {
    fn unit(&self) -> Reading {
        self.unit
    }

    fn stated(&self, _channel: usize) -> StatedAtRest {
        StatedAtRest { rest: self.rest, noise_sd: self.noise_sd }
    }

    fn rest_s(&self) -> Option<f64> {
        self.rest_s
    }

    fn touch(&self) -> Option<f64> {
        self.touch
    }
}

/// True contact: columns, or a known place.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ContactColumns {
    pub(super) x: Quantity<Length>,
    pub(super) y: Quantity<Length>,
    /// Radius of the pin whose axis the place is. `None` if the place is that of the contact itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    radius: Option<Quantity<Length>>,
}

impl ContactColumns {
    pub(super) fn radius_m(&self) -> Option<f64> {
        self.radius.as_ref().and_then(Quantity::constant)
    }
}

impl Keys for ContactColumns {
    fn columns(&self) -> Vec<&str> {
        [&self.x.column, &self.y.column].into_iter().flatten().map(String::as_str).collect()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        self.x.validate(path, &format!("{key}.x"), FARTHEST_M)?;
        self.y.validate(path, &format!("{key}.y"), FARTHEST_M)?;
        self.radius.as_ref().map_or(Ok(()), |radius| radius.validate_radius(path, &format!("{key}.radius"), FARTHEST_M))
    }
}
