//! Mapping files: topics, frames and calibrations of the whiskers. They are specified in `docs/LIVE.md`.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use bag::messages::{MagneticField, MagneticFieldArray};
use bag::{Message, topics};
use files::{Error, FORMAT, read_json};
use live::Timing;
use live::counts::{MODULI, ZEROING_S, ZEROINGS_S};
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use testbed::map::MapConfig;
use testbed::results::RECOMMENDED;
use trace::RATES_HZ;

use crate::chain::Plane;

/// Kind of the file.
const KIND: &str = "contact_mapping";

/// Largest standard deviation of the noise that may be stated (N m).
const MOST_NOISE_N_M: f64 = 1e6;

/// Largest number of whiskers.
const MOST_WHISKERS: usize = 64;

/// Mapping of ROS 2 topics and frames to whiskers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mapping {
    /// Format version.
    pub format: u32,
    /// `"contact_mapping"`.
    pub kind: String,
    /// Frame at rest in which contacts are published.
    #[serde(default = "world")]
    pub fixed_frame: String,
    /// URDF file of the arm, relative to the folder of the mapping. Missing: poses are those of `/tf` and `/tf_static`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub urdf: Option<PathBuf>,
    /// Topic of the joint states, used with `urdf`.
    #[serde(default = "joint_states")]
    pub joint_states: String,
    /// Plane of planar estimators and tolerance of the poses.
    #[serde(default)]
    pub plane: PlaneEntry,
    /// Estimator of the registry.
    #[serde(default = "recommended")]
    pub estimator: String,
    /// Settings of the estimator.
    #[serde(default = "nothing")]
    pub config: Value,
    /// Seed of planar methods that draw random numbers.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Beginning of the names of the published topics.
    #[serde(default = "prefix")]
    pub prefix: String,
    /// Longest waits and gaps.
    #[serde(default)]
    pub timing: Timing,
    /// Settings of the map in the plane.
    #[serde(default)]
    pub map: MapConfig,
    /// Whiskers.
    pub whiskers: Vec<WhiskerEntry>,
}

/// Plane of the estimators.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlaneEntry {
    /// Orientation of the plane's axes in the fixed frame: roll, pitch and yaw about its x, y and z axes (rad).
    pub rpy_rad: [f64; 3],
    /// Largest angle between the z axis of a base and the normal of the plane (rad).
    pub tilt_rad: f64,
    /// Largest distance of a base from the plane through its first pose (m).
    pub height_m: f64,
}

impl Default for PlaneEntry {
    fn default() -> Self {
        Self { rpy_rad: [0.0; 3], tilt_rad: 0.02, height_m: 2e-3 }
    }
}

/// A whisker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WhiskerEntry {
    /// Name, as in topics.
    pub name: String,
    /// Calibration file, relative to the folder of the mapping.
    pub calibration: PathBuf,
    /// Frame at the root of the whisker: +x along the undeflected root, +z normal to the plane of the undeflected wire and, with
    /// planar estimators, to the plane of motion.
    #[serde(default = "base_frame")]
    pub base_frame: String,
    /// Nominal rate of the readings (Hz).
    pub rate_hz: f64,
    /// Standard deviation of the measurement noise. Missing: that of the sensor's calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_sd_n_m: Option<f64>,
    /// Topic of the moment. Planar estimators use its z component, estimators in space its y and z components. Missing: `counts` is
    /// given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<String>,
    /// Magnetometer. Missing: `moment` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counts: Option<CountsEntry>,
}

/// Magnetometer of a whisker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CountsEntry {
    /// Topic of the counts.
    pub topic: String,
    /// Message of this topic and of that of the reference.
    #[serde(default)]
    pub message: CountsMessage,
    /// Topic of the reference sensor, if the calibration has a common mode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<String>,
    /// Name of the sensor in the calibration, `array.sensor`. Missing: the calibration has one sensor alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Axis that is read, in the plane. Missing: [`Axis::Y`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// Axes of both channels, in space, in the order of `channels` in the mapping of the import. Missing: x and y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<[Axis; 2]>,
    /// Number of values of a counter that wraps, such as 65536. Missing: the counts do not wrap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modulo: Option<f64>,
    /// Duration of the zeroing at the beginning, with a free whisker (s).
    #[serde(default = "zeroing_s")]
    pub zeroing_s: f64,
}

/// Message with counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CountsMessage {
    /// `whisker_interfaces/msg/MagneticFieldArray`: several readings of a sensor.
    #[default]
    MagneticFieldArray,
    /// `sensor_msgs/msg/MagneticField`: one reading.
    MagneticField,
}

impl CountsMessage {
    /// Name of the type.
    pub(crate) fn type_name(self) -> &'static str {
        match self {
            Self::MagneticFieldArray => MagneticFieldArray::TYPE,
            Self::MagneticField => MagneticField::TYPE,
        }
    }
}

/// Axis of a magnetometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// First axis.
    X,
    /// Second axis.
    Y,
    /// Third axis.
    Z,
}

fn world() -> String {
    topics::WORLD.into()
}

fn joint_states() -> String {
    topics::JOINT_STATES.into()
}

fn recommended() -> String {
    RECOMMENDED.into()
}

fn nothing() -> Value {
    json!({})
}

fn first_seed() -> u64 {
    Mapping::FIRST_SEED
}

fn prefix() -> String {
    "/whiskers".into()
}

fn base_frame() -> String {
    topics::WHISKER.into()
}

fn zeroing_s() -> f64 {
    ZEROING_S
}

impl Mapping {
    /// Default of `seed`.
    pub(crate) const FIRST_SEED: u64 = 1;

    /// Reads and checks a mapping file.
    ///
    /// # Errors
    /// [`Error`] with file and place.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let mapping: Self = read_json(path)?;
        if mapping.format != FORMAT {
            return Err(Error::value(path, "format", mapping.format, FORMAT));
        }
        if mapping.kind != KIND {
            return Err(Error::value(path, "kind", &mapping.kind, KIND));
        }
        is_frame(path, "fixed_frame", &mapping.fixed_frame)?;
        is_topic(path, "joint_states", &mapping.joint_states)?;
        is_topic(path, "prefix", &mapping.prefix)?;
        mapping.plane.check(path)?;
        let in_timing =
            |error: anyhow::Error| Error::value(path, "timing", format!("{error}"), "settings of the timing");
        mapping.timing.validate().map_err(in_timing)?;
        let in_map = |error: anyhow::Error| Error::value(path, "map", format!("{error}"), "settings of a map");
        mapping.map.validate().map_err(in_map)?;
        if !(1..=MOST_WHISKERS).contains(&mapping.whiskers.len()) {
            return Err(Error::value(
                path,
                "whiskers",
                mapping.whiskers.len(),
                format!("1 to {MOST_WHISKERS} whiskers"),
            ));
        }
        for (index, whisker) in mapping.whiskers.iter().enumerate() {
            whisker.check(path, index)?;
            if mapping.whiskers[..index].iter().any(|other| other.name == whisker.name) {
                let found = format!("`{}` again", whisker.name);
                return Err(Error::value(path, format!("whiskers[{index}].name"), found, "each name once"));
            }
        }
        Ok(mapping)
    }
}

impl PlaneEntry {
    fn check(&self, path: &Path) -> Result<(), Error> {
        within(path, "plane.tilt_rad", self.tilt_rad, 0.0, 0.5)?;
        within(path, "plane.height_m", self.height_m, 0.0, 1.0)?;
        self.rpy_rad.iter().try_for_each(|angle_rad| within(path, "plane.rpy_rad", *angle_rad, -2.0 * PI, 2.0 * PI))
    }

    /// The plane.
    pub fn plane(&self) -> Plane {
        let [roll, pitch, yaw] = self.rpy_rad;
        let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        Plane { rotation, tilt_rad: self.tilt_rad, height_m: self.height_m }
    }
}

impl WhiskerEntry {
    fn check(&self, path: &Path, index: usize) -> Result<(), Error> {
        let key = |key: &str| format!("whiskers[{index}].{key}");
        if !is_token(&self.name) {
            let expected = "letters, digits and underscores, the first a letter";
            return Err(Error::value(path, key("name"), format!("`{}`", self.name), expected));
        }
        is_frame(path, &key("base_frame"), &self.base_frame)?;
        within(path, &key("rate_hz"), self.rate_hz, RATES_HZ[0], RATES_HZ[1])?;
        if let Some(noise_sd_n_m) = self.noise_sd_n_m {
            within(path, &key("noise_sd_n_m"), noise_sd_n_m, 0.0, MOST_NOISE_N_M)?;
        }
        match (&self.moment, &self.counts) {
            (Some(topic), None) => {
                if self.noise_sd_n_m.is_none() {
                    return Err(Error::value(path, key("noise_sd_n_m"), "none", "that of the moment"));
                }
                is_topic(path, &key("moment"), topic)
            }
            (None, Some(counts)) => counts.check(path, key),
            (moment, _) => {
                let found = if moment.is_some() { "moment and counts" } else { "neither moment nor counts" };
                Err(Error::value(path, key("moment"), found, "one of the two"))
            }
        }
    }
}

impl CountsEntry {
    /// Index of the axis that is read in the plane.
    pub(crate) fn planar_axis(&self) -> usize {
        self.axis.unwrap_or(Axis::Y) as usize
    }

    /// Indices of the axes that are read in space.
    pub(crate) fn spatial_axes(&self) -> [usize; 2] {
        self.axes.unwrap_or([Axis::X, Axis::Y]).map(|axis| axis as usize)
    }

    fn check(&self, path: &Path, key: impl Fn(&str) -> String) -> Result<(), Error> {
        is_topic(path, &key("counts.topic"), &self.topic)?;
        if let Some([first, second]) = self.axes.filter(|[first, second]| first == second) {
            let found = format!("{:?} and {:?}", first, second).to_lowercase();
            return Err(Error::value(path, key("counts.axes"), found, "two different axes"));
        }
        self.reference.iter().try_for_each(|topic| is_topic(path, &key("counts.reference"), topic))?;
        within(path, &key("counts.zeroing_s"), self.zeroing_s, ZEROINGS_S[0], ZEROINGS_S[1])?;
        self.modulo.iter().try_for_each(|modulo| within(path, &key("counts.modulo"), *modulo, MODULI[0], MODULI[1]))
    }
}

fn within(path: &Path, key: &str, found: f64, least: f64, most: f64) -> Result<(), Error> {
    if (least..=most).contains(&found) {
        return Ok(());
    }
    Err(Error::value(path, key, found, format!("{least} to {most}")))
}

fn is_token(text: &str) -> bool {
    text.starts_with(|first: char| first.is_ascii_alphabetic())
        && text.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
}

fn is_topic(path: &Path, key: &str, found: &str) -> Result<(), Error> {
    let is_name = found.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_token));
    if is_name {
        return Ok(());
    }
    Err(Error::value(path, key, format!("`{found}`"), "an absolute name of a topic, such as /moment"))
}

fn is_frame(path: &Path, key: &str, found: &str) -> Result<(), Error> {
    if !found.is_empty() && found.chars().all(|letter| !letter.is_control() && !letter.is_whitespace()) {
        return Ok(());
    }
    Err(Error::value(path, key, format!("`{found}`"), "the name of a frame"))
}
