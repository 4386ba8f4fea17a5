//! Sidecar of a trace.

use std::path::Path;

use files::{Error, FORMAT, read_json, sha256};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::Whisker;
use whisker::sensor::Face;

use crate::spatial::other_format;
use crate::{Certificate, Characteristic, ObjectClass, ReplayEffects};

/// Smallest and largest sampling rate (Hz).
pub const RATES_HZ: [f64; 2] = [1e-3, 1e6];

/// Purpose of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Evaluation of estimators.
    Trial,
    /// Fitting of sensor models.
    Calibration,
}

impl Role {
    /// Name as used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Trial => "trial",
            Self::Calibration => "calibration",
        }
    }
}

/// Program that made a trace.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Generator {
    /// Name of the program.
    pub name: String,
    /// Version of the program.
    pub version: String,
    /// Version of MuJoCo, for simulated traces.
    pub mujoco: Option<String>,
    /// Commit of the program, if known.
    pub git_commit: Option<String>,
    /// Hash of the program's source files.
    pub source_sha256: String,
}

/// Properties of a recording of a real sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recorded {
    /// Source of the times.
    pub clock: String,
    /// Coefficients `c1, c2, c3` of the conversion from readings to nominal moments: `counts - rest_counts = c1 M + c2
    /// M^2 + c3 M^3`, `M` in N m.
    pub characteristic: [f64; 3],
    /// Smallest and largest moment of the range in which the conversion inverts this polynomial; beyond it, the conversion is
    /// linear. `None` in recordings imported before it was stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range_n_m: Option<[f64; 2]>,
    /// RMS residual of the calibration's readings with this characteristic and whisker.
    pub residual_counts: f64,
    /// Reading at rest.
    pub rest_counts: f64,
    /// Standard deviation of the sensor noise at rest.
    pub noise_sd_n_m: f64,
    /// Contact threshold: smallest deviation from the reading at rest that counts as contact.
    pub touch_counts: f64,
    /// Class of the object. `None` in recordings imported before it was stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_class: Option<ObjectClass>,
}

/// Reference to the object's outline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contour {
    /// File name, in the trace's folder.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Largest distance of the polyline from the true outline.
    pub chord_error_m: f64,
}

/// Sidecar of a trace: description and provenance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sidecar {
    /// Format version.
    pub format: u32,
    /// `"trace"`.
    pub kind: String,
    /// Name of the trace.
    pub name: String,
    /// Purpose of the trace.
    pub role: Role,
    /// Group of trials that are scored together; part of file names of figures.
    pub group: String,
    /// Name of the object's shape.
    pub object: String,
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// Seed of the motion.
    pub seed: u64,
    /// Sampling rate.
    pub rate_hz: f64,
    /// Number of rows.
    pub rows: usize,
    /// Whisker.
    pub whisker: Whisker,
    /// Scene as simulated. Its schema belongs to the generator, which defines the shapes and motions.
    pub scene: Value,
    /// Program that made the trace.
    pub generator: Generator,
    /// Hash of everything that determines the data.
    pub inputs_sha256: String,
    /// SHA-256 of the CSV.
    pub csv_sha256: String,
    /// Outline of the object, if there is one.
    pub contour: Option<Contour>,
    /// Deviation of the ground truth from theory, for simulated traces.
    pub certificate: Option<Certificate>,
    /// Properties of the recording, for traces of a real sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<Recorded>,
    /// Name of the array recording that the trace belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// Effects to be added at replay, if the scene states any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replay: Option<ReplayEffects>,
}

/// Scene key of the velocity of a moving object.
const OBJECT_VELOCITY: &str = "object_velocity_m_s";

/// Scene keys of an object that gives way: its free stand, and the stiffness of its surface.
const YIELDING: [&str; 2] = ["object_stand", "object_stiffness_n_m"];

/// Elements of an array of two numbers; `None` for any other value.
fn two_numbers(value: &Value) -> Option<[f64; 2]> {
    let [x, y] = value.as_array()?.as_slice() else { return None };
    Some([x.as_f64()?, y.as_f64()?])
}

impl Sidecar {
    /// Class of the object: as the recording states it, else by the shape.
    pub fn object_class(&self) -> ObjectClass {
        let stated = self.recorded.as_ref().and_then(|recorded| recorded.object_class);
        stated.unwrap_or_else(|| ObjectClass::of_shape(&self.object))
    }

    /// Constant velocity of the object in World (m/s), zero for an object at rest.
    pub fn object_velocity_m_s(&self) -> [f64; 2] {
        self.scene.get(OBJECT_VELOCITY).and_then(two_numbers).unwrap_or_default()
    }

    /// Whether the object gives way to the whisker: it stands freely, or its surface is elastic.
    pub fn is_yielding(&self) -> bool {
        YIELDING.iter().any(|key| self.scene.get(key).is_some_and(|stated| !stated.is_null()))
    }

    /// Place in World, at the start, of the origin of the frame of the object's shape.
    pub fn object_center_m(&self) -> [f64; 2] {
        self.scene.get("object").and_then(|object| object.get("center_m")).and_then(two_numbers).unwrap_or_default()
    }

    /// Whether the object and its surface are at rest throughout the trace.
    pub fn is_object_at_rest(&self) -> bool {
        self.object_velocity_m_s() == [0.0; 2] && !self.is_yielding()
    }

    /// Standard deviation of the noise already contained in the readings; 0 for simulated traces.
    pub fn own_noise_sd_n_m(&self) -> f64 {
        self.recorded.as_ref().map_or(0.0, |recorded| recorded.noise_sd_n_m)
    }

    /// Source of the times of a recording. `None` if the trace was simulated.
    pub fn clock(&self) -> Option<&str> {
        self.recorded.as_ref().map(|recorded| recorded.clock.as_str())
    }

    /// Hash of everything that a calibration from the trace may depend on: the sidecar, which contains the hashes of its
    /// files, without scene, certificate and provenance. Scores also depend on the scene, which states the object.
    pub fn data_sha256(&self) -> String {
        hash_of_data(self)
    }

    /// Reads and checks the sidecar of the trace with this CSV or sidecar path.
    ///
    /// # Errors
    /// [`Error`] with file and key, value found and value expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        if path.is_dir() {
            return Err(Error::value(path, "path", "a folder", "a trace's .csv or .json file"));
        }
        let path = path.with_extension("json");
        let sidecar: Self = read_json(&path).map_err(|error| other_format(&path, FORMAT, "trace", error))?;
        sidecar.validate(&path)?;
        Ok(sidecar)
    }

    pub(crate) fn validate(&self, path: &Path) -> Result<(), Error> {
        if self.format != FORMAT {
            return Err(Error::value(path, "format", self.format, FORMAT));
        }
        if self.kind != "trace" {
            return Err(Error::value(path, "kind", &self.kind, "trace"));
        }
        check_rate(path, self.rate_hz)?;
        if let Some(recorded) = &self.recorded {
            recorded.validate(path)?;
        }
        if let Some(replay) = &self.replay {
            replay.validate(path)?;
        }
        if let Some(velocity_m_s) = self.scene.get(OBJECT_VELOCITY).filter(|value| two_numbers(value).is_none()) {
            return Err(Error::value(path, format!("scene.{OBJECT_VELOCITY}"), velocity_m_s, "two numbers"));
        }
        plain_name(path, "name", &self.name)?;
        // Figures are named after the group, which is also shown with the trace.
        plain_name(path, "group", &self.group)?;
        plain_name(path, "object", &self.object)?;
        if let Some(recording) = &self.recording {
            plain_name(path, "recording", recording)?;
        }
        plain_name(path, "whisker.name", &self.whisker.name)?;
        if let Some(contour) = &self.contour {
            plain_name(path, "contour.file", &contour.file)?;
        }
        if path.file_stem().is_none_or(|stem| stem != self.name.as_str()) {
            return Err(Error::value(path, "name", format!("`{}`", self.name), "the name of its file"));
        }
        self.whisker
            .validate()
            .map_err(|error| Error::value(path, format!("whisker.{}", error.key), error.found, error.expected))
    }
}

impl Recorded {
    /// Characteristic of the sensor. `None` if its range is not stated.
    pub fn characteristic(&self) -> Option<Characteristic> {
        Some(Characteristic { coefficients: self.characteristic.to_vec(), range_n_m: self.range_n_m? })
    }

    fn validate(&self, path: &Path) -> Result<(), Error> {
        let key = |name: &str| format!("recorded.{name}");
        if self.characteristic[0] == 0.0 {
            return Err(Error::value(
                path,
                key("characteristic"),
                "a zero first coefficient",
                "a nonzero first coefficient",
            ));
        }
        if let Some(found) = self.characteristic().filter(|characteristic| !characteristic.is_valid()) {
            let expected = "a range that contains 0 and on which the characteristic is monotone";
            return Err(Error::value(path, key("range_n_m"), format!("{:?}", found.range_n_m), expected));
        }
        let not_negative = [
            ("residual_counts", self.residual_counts),
            ("noise_sd_n_m", self.noise_sd_n_m),
            ("touch_counts", self.touch_counts),
        ];
        for (name, found) in not_negative {
            if !(found.is_finite() && found >= 0.0) {
                return Err(Error::value(path, key(name), found, "a number of 0 or more"));
            }
        }
        Ok(())
    }
}

/// Hash of a sidecar without scene, certificate and provenance.
pub(crate) fn hash_of_data(sidecar: &impl Serialize) -> String {
    let mut value = serde_json::to_value(sidecar).expect("numbers and names serialise");
    for key in ["scene", "generator", "inputs_sha256", "certificate"] {
        value.as_object_mut().expect("a struct is an object").shift_remove(key);
    }
    sha256(value.to_string())
}

/// Whether a name is a single path component without control characters.
pub fn is_plain_name(name: &str) -> bool {
    !(name.is_empty() || name.starts_with('.') || name.contains(['/', '\\']) || name.contains(char::is_control))
}

/// Checks the sampling rate. Detectors buffer the readings of a fixed duration, so an unbounded rate would mean
/// unbounded memory.
pub(crate) fn check_rate(path: &Path, rate_hz: f64) -> Result<(), Error> {
    let [least, most] = RATES_HZ;
    if !(least..=most).contains(&rate_hz) {
        return Err(Error::value(path, "rate_hz", rate_hz, format!("{least} to {most}")));
    }
    Ok(())
}

/// Checks that a name from a file is a plain file name.
pub(crate) fn plain_name(path: &Path, key: &str, name: &str) -> Result<(), Error> {
    if !is_plain_name(name) {
        return Err(Error::value(path, key, format!("`{name}`"), "a plain file name"));
    }
    Ok(())
}
