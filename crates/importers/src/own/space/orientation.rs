//! Orientation of a pose, as robots state it.

use std::path::Path;
use std::rc::Rc;

use files::Error;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use trace::LARGEST;

use crate::own::quantity::Quantity;
use crate::own::recording::Columns;
use crate::own::series::{Series, join, table_error};
use crate::own::units::Angle;

/// Largest deviation of the norm of a recorded quaternion from 1.
const UNIT: f64 = 0.01;

/// Smallest rotation of a single orientation from its neighbours that is a glitch.
const GLITCH_RAD: f64 = 0.1;

/// Largest angular velocity of a robot (rad/s). A rotation that it explains is not a glitch.
const FASTEST_RAD_S: f64 = 10.0;

/// Rotation from the recorded frame to that of the positions, by columns or constants.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum Orientation {
    /// Rotations about x, y and z of the frame of the positions, in this order.
    RollPitchYaw {
        #[serde(default)]
        roll: Quantity<Angle>,
        #[serde(default)]
        pitch: Quantity<Angle>,
        #[serde(default)]
        yaw: Quantity<Angle>,
    },
    /// Axis of the rotation times its angle.
    RotationVector { x: Quantity<Angle>, y: Quantity<Angle>, z: Quantity<Angle> },
    /// Unit quaternion.
    Quaternion { w: Component, x: Component, y: Component, z: Component },
}

/// Component of a quaternion.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Component {
    Column(String),
    Value(f64),
}

impl Component {
    fn column(&self) -> Option<&str> {
        match self {
            Self::Column(name) => Some(name),
            Self::Value(_) => None,
        }
    }
}

impl Default for Orientation {
    fn default() -> Self {
        let [roll, pitch, yaw] = [(); 3].map(|()| Quantity::default());
        Self::RollPitchYaw { roll, pitch, yaw }
    }
}

impl Orientation {
    pub(super) fn columns(&self) -> Vec<&str> {
        match self {
            Self::RollPitchYaw { roll: x, pitch: y, yaw: z } | Self::RotationVector { x, y, z } => {
                [x, y, z].into_iter().filter_map(|angle| angle.column.as_deref()).collect()
            }
            Self::Quaternion { w, x, y, z } => [w, x, y, z].into_iter().filter_map(Component::column).collect(),
        }
    }

    /// Checks the values of the orientation with this key.
    ///
    /// # Errors
    /// [`Error::Value`] with file and key.
    pub(super) fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        let angles = match self {
            Self::RollPitchYaw { roll, pitch, yaw } => [("roll", roll), ("pitch", pitch), ("yaw", yaw)],
            Self::RotationVector { x, y, z } => [("x", x), ("y", y), ("z", z)],
            Self::Quaternion { .. } => {
                return match self.rotation(|_| 1.0) {
                    Err(norm) if self.columns().is_empty() => {
                        Err(Error::value(path, key, format!("a quaternion of norm {norm}"), "a unit quaternion"))
                    }
                    _ => Ok(()),
                };
            }
        };
        angles.iter().try_for_each(|(name, angle)| angle.validate(path, &format!("{key}.{name}"), LARGEST))
    }

    /// The orientation. `None` if it is not constant.
    pub(super) fn constant(&self) -> Option<UnitQuaternion<f64>> {
        self.columns().is_empty().then(|| self.rotation(|_| 0.0).ok())?
    }

    /// Orientations at increasing times: interpolated linearly between the quaternions of the samples. Their sign is continuous, and
    /// w is not negative in the first one.
    ///
    /// # Errors
    /// [`Error`] if the columns have times of their own, or at the first value that is implausible.
    pub(super) fn at(
        &self,
        path: &Path,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<UnitQuaternion<f64>>, Error> {
        if let Some(constant) = self.constant() {
            return Ok(vec![constant; clock_s.len()]);
        }
        let names = self.columns();
        let clock = &columns.series(names[0]).clock;
        if names.iter().any(|name| !Rc::ptr_eq(&columns.series(name).clock, clock)) {
            let found =
                format!("fields with times of their own: {}", join(names.iter().map(|name| format!("`{name}`"))));
            return Err(Error::value(path, "pose.orientation", found, "fields of the same messages"));
        }
        if let Self::RollPitchYaw { roll: x, pitch: y, yaw: z } | Self::RotationVector { x, y, z } = self {
            columns.check_ranges(path, &[x, y, z], LARGEST, "rad")?;
        }
        let mut samples: Vec<Quaternion<f64>> = Vec::with_capacity(clock.times_s.len());
        for (i, line) in clock.places.iter().enumerate() {
            let value = |name: &str| columns.series(name).values[i].unwrap_or_default();
            let rotation = self.rotation(value).map_err(|norm| {
                let expected = "a norm of 1; compare the columns of w, x, y and z".into();
                table_error(path, &names, *line, format!("a quaternion of norm {norm:.4}"), expected)
            })?;
            let is_opposite = samples.last().is_some_and(|last| last.dot(rotation.quaternion()) < 0.0);
            samples.push(if is_opposite { -rotation.into_inner() } else { rotation.into_inner() });
        }
        let component = |place: usize| Series {
            clock: clock.clone(),
            values: samples.iter().map(|rotation| Some(rotation.coords[place])).collect(),
        };
        let components = [0, 1, 2, 3].map(component);
        // A component changes by at most half of the angle.
        let glitches = components.iter().flat_map(|series| series.glitches(0.5 * GLITCH_RAD, 0.5 * FASTEST_RAD_S));
        if let Some(glitch) = glitches.min_by_key(|glitch| glitch.line) {
            let expected = "single orientations near those of the rows before and after: remove the row".into();
            let found = "a rotation from those of the rows before and after".into();
            return Err(table_error(path, &names, glitch.line, found, expected));
        }
        let [x, y, z, w] = components.map(|series| series.at(clock_s));
        let is_negative = w.first().is_some_and(|w| w.unwrap_or_default() < 0.0);
        let sign = if is_negative { -1.0 } else { 1.0 };
        let rotation = |row: usize| {
            let [w, x, y, z] = [&w, &x, &y, &z].map(|component| sign * component[row].unwrap_or_default());
            UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
        };
        Ok((0..clock_s.len()).map(rotation).collect())
    }

    /// The rotation with these values of the columns, in their units. The norm of a quaternion if it is not 1.
    fn rotation<'a>(&'a self, column: impl Fn(&'a str) -> f64) -> Result<UnitQuaternion<f64>, f64> {
        let angle = |quantity: &'a Quantity<Angle>| match &quantity.column {
            Some(name) => quantity.factor() * column(name),
            None => quantity.constant().unwrap_or_default(),
        };
        let component = |component: &'a Component| match component {
            Component::Column(name) => column(name),
            Component::Value(value) => *value,
        };
        match self {
            Self::RollPitchYaw { roll, pitch, yaw } => {
                Ok(UnitQuaternion::from_euler_angles(angle(roll), angle(pitch), angle(yaw)))
            }
            Self::RotationVector { x, y, z } => {
                Ok(UnitQuaternion::from_scaled_axis(Vector3::new(angle(x), angle(y), angle(z))))
            }
            Self::Quaternion { w, x, y, z } => {
                let quaternion = Quaternion::new(component(w), component(x), component(y), component(z));
                let norm = quaternion.norm();
                let is_unit = (norm - 1.0).abs() <= UNIT;
                if is_unit { Ok(UnitQuaternion::new_normalize(quaternion)) } else { Err(norm) }
            }
        }
    }
}
