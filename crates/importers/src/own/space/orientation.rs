//! Orientation of a pose, as robots state it.

use std::path::Path;

use files::Error;
use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use trace::LARGEST;

use crate::own::quantity::Quantity;
use crate::own::recording::Columns;
use crate::own::series::{Series, table_error};
use crate::own::units::Angle;

/// Largest deviation of the norm of a recorded quaternion from 1.
const MOST_NORM_DEVIATION: f64 = 0.01;

/// Smallest rotation of a single orientation from its neighbours that is a glitch.
const GLITCH_RAD: f64 = 0.1;

/// Largest angular velocity of a robot (rad/s). A rotation that it explains is not a glitch.
const FASTEST_RAD_S: f64 = 10.0;

/// Rotation from the recorded frame to that of the positions, by columns or constants.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", try_from = "Forms")]
pub(crate) enum Orientation {
    RollPitchYaw(RollPitchYaw),
    RotationVector(RotationVector),
    Quaternion(Components),
}

/// Rotations about x, y and z of the frame of the positions, in this order.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RollPitchYaw {
    #[serde(default)]
    roll: Quantity<Angle>,
    #[serde(default)]
    pitch: Quantity<Angle>,
    #[serde(default)]
    yaw: Quantity<Angle>,
}

/// Axis of the rotation times its angle.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RotationVector {
    x: Quantity<Angle>,
    y: Quantity<Angle>,
    z: Quantity<Angle>,
}

/// Unit quaternion.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Components {
    w: Component,
    x: Component,
    y: Component,
    z: Component,
}

/// The forms of an orientation, one of which is given.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Forms {
    roll_pitch_yaw: Option<RollPitchYaw>,
    rotation_vector: Option<RotationVector>,
    quaternion: Option<Components>,
}

impl TryFrom<Forms> for Orientation {
    type Error = String;

    fn try_from(forms: Forms) -> Result<Self, String> {
        let Forms { roll_pitch_yaw, rotation_vector, quaternion } = forms;
        let found = match (roll_pitch_yaw, rotation_vector, quaternion) {
            (Some(angles), None, None) => return Ok(Self::RollPitchYaw(angles)),
            (None, Some(vector), None) => return Ok(Self::RotationVector(vector)),
            (None, None, Some(components)) => return Ok(Self::Quaternion(components)),
            (None, None, None) => "no form",
            _ => "several forms",
        };
        Err(format!("found {found} of an orientation, expected one of roll_pitch_yaw, rotation_vector and quaternion"))
    }
}

/// Component of a quaternion.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged, expecting = "the name of a column, or a number")]
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
        Self::RollPitchYaw(RollPitchYaw::default())
    }
}

impl Orientation {
    pub(super) fn columns(&self) -> Vec<&str> {
        match self {
            Self::RollPitchYaw(RollPitchYaw { roll: x, pitch: y, yaw: z })
            | Self::RotationVector(RotationVector { x, y, z }) => {
                [x, y, z].into_iter().filter_map(|angle| angle.column.as_deref()).collect()
            }
            Self::Quaternion(Components { w, x, y, z }) => {
                [w, x, y, z].into_iter().filter_map(Component::column).collect()
            }
        }
    }

    /// Checks the values of the orientation with this key.
    ///
    /// # Errors
    /// [`Error::Value`] with file and key.
    pub(super) fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        let angles = match self {
            Self::RollPitchYaw(RollPitchYaw { roll, pitch, yaw }) => [("roll", roll), ("pitch", pitch), ("yaw", yaw)],
            Self::RotationVector(RotationVector { x, y, z }) => [("x", x), ("y", y), ("z", z)],
            Self::Quaternion(_) => {
                return match self.rotation(|_| 1.0) {
                    Err(norm) if self.columns().is_empty() => Err(Error::value(
                        path,
                        key,
                        format!("a quaternion of norm {norm}"),
                        format!("a norm of 1 within {MOST_NORM_DEVIATION}"),
                    )),
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

    /// Orientations at increasing times, between samples at constant angular velocity.
    ///
    /// # Errors
    /// [`Error`] if the columns have times of their own, or at the first value that is implausible.
    pub(super) fn at(
        &self,
        mapping: &Path,
        path: &Path,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<UnitQuaternion<f64>>, Error> {
        if let Some(constant) = self.constant() {
            return Ok(vec![constant; clock_s.len()]);
        }
        let names = self.columns();
        columns.check_one_clock(mapping, path, "pose.orientation", &names)?;
        let clock = &columns.series(names[0]).clock;
        if let Self::RollPitchYaw(RollPitchYaw { roll: x, pitch: y, yaw: z })
        | Self::RotationVector(RotationVector { x, y, z }) = self
        {
            columns.check_ranges(path, &[x, y, z], LARGEST, "rad")?;
        }
        let mut samples: Vec<UnitQuaternion<f64>> = Vec::with_capacity(clock.times_s.len());
        for (i, line) in clock.places.iter().enumerate() {
            let value = |name: &str| columns.series(name).values[i].unwrap_or_default();
            let rotation = self.rotation(value).map_err(|norm| {
                let expected =
                    format!("a norm of 1 within {MOST_NORM_DEVIATION}; compare the columns of w, x, y and z");
                table_error(path, &names, *line, format!("a quaternion of norm {norm:.4}"), expected)
            })?;
            let is_opposite = samples.last().is_some_and(|last| last.coords.dot(&rotation.coords) < 0.0);
            samples.push(if is_opposite { Unit::new_unchecked(-rotation.into_inner()) } else { rotation });
        }
        let component = |place: usize| Series {
            clock: clock.clone(),
            values: samples.iter().map(|rotation| Some(rotation.coords[place])).collect(),
        };
        let components = [0, 1, 2, 3].map(component);
        // A component changes by at most half of the angle.
        let glitches = components.iter().flat_map(|series| series.glitches(0.5 * GLITCH_RAD, 0.5 * FASTEST_RAD_S));
        if let Some(glitch) = glitches.min_by_key(|glitch| glitch.line) {
            let i = clock.places.partition_point(|line| *line < glitch.line);
            let angle_rad = samples[i].angle_to(&samples[i - 1]).min(samples[i].angle_to(&samples[i + 1]));
            let found = format!("an orientation {angle_rad:.3} rad from those of the rows before and after");
            let expected = format!("at most {:.3} rad: remove the row", 2.0 * glitch.most);
            return Err(table_error(path, &names, glitch.line, found, expected));
        }
        let rotation = |time_s: &f64| {
            let next = clock.times_s.partition_point(|sample_s| sample_s < time_s);
            if next == 0 || clock.times_s.get(next) == Some(time_s) {
                return samples[next];
            }
            let [from, to] = [next - 1, next.min(samples.len() - 1)];
            let share = (time_s - clock.times_s[from]) / (clock.times_s[to] - clock.times_s[from]);
            // Between opposite orientations there is no shortest way.
            samples[from].try_slerp(&samples[to], share, f64::EPSILON).unwrap_or(samples[from])
        };
        Ok(clock_s.iter().map(rotation).collect())
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
            Self::RollPitchYaw(RollPitchYaw { roll, pitch, yaw }) => {
                Ok(UnitQuaternion::from_euler_angles(angle(roll), angle(pitch), angle(yaw)))
            }
            Self::RotationVector(RotationVector { x, y, z }) => {
                Ok(UnitQuaternion::from_scaled_axis(Vector3::new(angle(x), angle(y), angle(z))))
            }
            Self::Quaternion(Components { w, x, y, z }) => {
                let quaternion = Quaternion::new(component(w), component(x), component(y), component(z));
                let norm = quaternion.norm();
                let is_unit = (norm - 1.0).abs() <= MOST_NORM_DEVIATION;
                if is_unit { Ok(UnitQuaternion::new_normalize(quaternion)) } else { Err(norm) }
            }
        }
    }
}
