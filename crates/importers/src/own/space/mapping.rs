//! Keys of a mapping in space.

use std::ops::RangeInclusive;
use std::path::Path;

use files::Error;
use nalgebra::{Isometry3, Translation3, Unit, Vector3};
use serde::{Deserialize, Serialize};
use trace::{BendingResponse, FARTHEST_M};

use super::orientation::Orientation;
use crate::own::PoseKeys;
use crate::own::mapping::{Channels, Keys, Moving, StatedAtRest, validate_at_rest};
use crate::own::quantity::{Quantity, check_sign, positive};
use crate::own::units::{Length, Reading};

/// Sizes of the largest component of the direction of a pin.
const AXES: RangeInclusive<f64> = 1e-6..=1e6;

/// Columns of the pose.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SpatialPoseColumns {
    #[serde(default)]
    pub(super) of: Moving,
    pub(super) x: Quantity<Length>,
    pub(super) y: Quantity<Length>,
    pub(super) z: Quantity<Length>,
    #[serde(default)]
    pub(super) orientation: Orientation,
}

impl Keys for SpatialPoseColumns {
    fn columns(&self) -> Vec<&str> {
        let positions = [&self.x.column, &self.y.column, &self.z.column].into_iter().flatten().map(String::as_str);
        positions.chain(self.orientation.columns()).collect()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        for (name, place) in [("x", &self.x), ("y", &self.y), ("z", &self.z)] {
            place.validate(path, &format!("{key}.{name}"), FARTHEST_M)?;
        }
        self.orientation.validate(path, &format!("{key}.orientation"))
    }
}

impl PoseKeys for SpatialPoseColumns {
    fn positions(&self) -> Vec<&Quantity<Length>> {
        vec![&self.x, &self.y, &self.z]
    }
}

/// Constant pose.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SpatialPlacement {
    x: Quantity<Length>,
    y: Quantity<Length>,
    z: Quantity<Length>,
    #[serde(default)]
    orientation: Orientation,
}

impl Default for SpatialPlacement {
    fn default() -> Self {
        let [x, y, z] = [(); 3].map(|()| Quantity::zero());
        Self { x, y, z, orientation: Orientation::default() }
    }
}

impl SpatialPlacement {
    pub(super) fn pose(&self) -> Isometry3<f64> {
        let position = Vector3::from([&self.x, &self.y, &self.z].map(|place| place.constant().unwrap_or_default()));
        Isometry3::from_parts(Translation3::from(position), self.orientation.constant().unwrap_or_default())
    }
}

impl Keys for SpatialPlacement {
    fn columns(&self) -> Vec<&str> {
        Vec::new()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        for (name, place) in [("x", &self.x), ("y", &self.y), ("z", &self.z)] {
            place.validate_constant(path, &format!("{key}.{name}"), FARTHEST_M)?;
        }
        let key = format!("{key}.orientation");
        self.orientation.validate(path, &key)?;
        if self.orientation.constant().is_none() {
            return Err(Error::value(path, key, "columns", "constant values"));
        }
        Ok(())
    }
}

/// Columns of a sensor with two channels, and their conversion to the bending moments.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SpatialReading {
    /// The moments about y and z of Base, or the counts of both channels in any order.
    pub(super) channels: [ChannelColumn; 2],
    unit: Reading,
    /// Readings of the free whisker ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rest: Option<[f64; 2]>,
    /// ... or the duration at the start of each recording in which the whisker is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rest_s: Option<f64>,
    /// Standard deviations of the noise, in the unit of the reading. `None` to estimate them while the whisker is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    noise_sd: Option<[f64; 2]>,
    /// Distance from rest, over both channels, in the unit of the reading, beyond which the whisker touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    touch: Option<f64>,
    /// Response of the sensor. `None` to fit it to the calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) counts_per_n_m: Option<BendingResponse>,
}

/// Column of a channel.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ChannelColumn {
    column: String,
    #[serde(default = "positive")]
    pub(super) sign: f64,
}

impl Keys for SpatialReading {
    fn columns(&self) -> Vec<&str> {
        self.channels.iter().map(|channel| channel.column.as_str()).collect()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        for (i, channel) in self.channels.iter().enumerate() {
            check_sign(path, &format!("{key}.channels[{i}]"), channel.sign)?;
        }
        let [first, second] = &self.channels;
        if first.column == second.column {
            let found = format!("`{}` twice", first.column);
            return Err(Error::value(path, format!("{key}.channels"), found, "two bending channels"));
        }
        validate_at_rest(path, key, self)?;
        let Some(response) = &self.counts_per_n_m else { return Ok(()) };
        if self.unit != Reading::Counts {
            return Err(Error::value(
                path,
                format!("{key}.unit"),
                "a unit of moment",
                "`counts`, since `counts_per_n_m` is stated",
            ));
        }
        response.validate(path, key)
    }
}

impl Channels for SpatialReading {
    fn unit(&self) -> Reading {
        self.unit
    }

    fn stated(&self, channel: usize) -> StatedAtRest {
        let of = |values: Option<[f64; 2]>| values.map(|values| values[channel]);
        StatedAtRest { rest: of(self.rest), noise_sd: of(self.noise_sd) }
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
pub(crate) struct SpatialContactColumns {
    pub(super) x: Quantity<Length>,
    pub(super) y: Quantity<Length>,
    pub(super) z: Quantity<Length>,
    /// Direction of the pin whose axis passes through the place, in World. `None` if the place is a point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    axis: Option<[f64; 3]>,
    /// Radius of the pin. `None` if the contact lies on the axis, or in the place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    radius: Option<Quantity<Length>>,
}

impl SpatialContactColumns {
    pub(super) fn axis(&self) -> Option<Unit<Vector3<f64>>> {
        let axis = Vector3::from(self.axis?);
        AXES.contains(&axis.amax()).then(|| Unit::new_normalize(axis))
    }

    pub(super) fn radius_m(&self) -> Option<f64> {
        self.radius.as_ref().and_then(Quantity::constant)
    }
}

impl Keys for SpatialContactColumns {
    fn columns(&self) -> Vec<&str> {
        [&self.x.column, &self.y.column, &self.z.column].into_iter().flatten().map(String::as_str).collect()
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        for (name, place) in [("x", &self.x), ("y", &self.y), ("z", &self.z)] {
            place.validate(path, &format!("{key}.{name}"), FARTHEST_M)?;
        }
        if let Some(axis) = self.axis.filter(|_| self.axis().is_none()) {
            return Err(Error::value(
                path,
                format!("{key}.axis"),
                format!("{axis:?}"),
                format!("three numbers, the largest of a size of {:e} to {:e}", AXES.start(), AXES.end()),
            ));
        }
        let Some(radius) = &self.radius else { return Ok(()) };
        let key = format!("{key}.radius");
        if self.axis.is_none() {
            let expected = "`axis`, the direction of the pin, or no radius for a contact that is a point";
            return Err(Error::value(path, key, "a radius without `axis`", expected));
        }
        radius.validate_radius(path, &key, FARTHEST_M)
    }
}
