//! The sidecar of a trace.

use std::path::Path;

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::Whisker;
use whisker::sensor::Face;

use crate::{Certificate, ObjectClass};

/// Least and most rows a second.
const RATES_HZ: [f64; 2] = [1e-3, 1e6];

/// What a trace is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Estimators are tried on it.
    Trial,
    /// Sensor models are fitted to it.
    Calibration,
}

impl Role {
    /// The word that files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Trial => "trial",
            Self::Calibration => "calibration",
        }
    }
}

/// What made a trace.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Generator {
    /// The program.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Version of MuJoCo, where it simulated.
    pub mujoco: Option<String>,
    /// Commit of the program, where known.
    pub git_commit: Option<String>,
    /// Hash of the program's sources.
    pub source_sha256: String,
}

/// What is to be known of a recording of a real sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recorded {
    /// Where the times come from.
    pub clock: String,
    /// `c1, c2, c3` by which readings became nominal moments: `counts - rest_counts = c1 M + c2 M^2 + c3 M^3`, `M` in N m.
    pub characteristic: [f64; 3],
    /// Root mean square of the readings of the calibration that this and the whisker leave unexplained.
    pub residual_counts: f64,
    /// Reading at rest.
    pub rest_counts: f64,
    /// Standard deviation of the noise that the readings have of themselves, at rest.
    pub noise_sd_n_m: f64,
    /// How far from rest a reading is taken for a contact.
    pub touch_counts: f64,
    /// Class of the object. `None` in recordings imported before it was stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_class: Option<ObjectClass>,
}

/// The object's outline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contour {
    /// Its file, beside the trace.
    pub file: String,
    /// Hash of that file.
    pub sha256: String,
    /// The polyline's largest distance from the true outline.
    pub chord_error_m: f64,
}

/// The sidecar of a trace: what it is, what made it, from what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sidecar {
    /// Version of the format.
    pub format: u32,
    /// `"trace"`.
    pub kind: String,
    /// Name of the trace.
    pub name: String,
    /// What it is for.
    pub role: Role,
    /// Group of trials that are scored together.
    pub group: String,
    /// Shape of the object.
    pub object: String,
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// Seed of the motion.
    pub seed: u64,
    /// Rows a second.
    pub rate_hz: f64,
    /// Number of rows.
    pub rows: usize,
    /// The whisker.
    pub whisker: Whisker,
    /// The scene as it was run. It belongs to the generator, which alone knows all shapes and motions.
    pub scene: Value,
    /// What made the trace.
    pub generator: Generator,
    /// Hash over all that determines the data.
    pub inputs_sha256: String,
    /// Hash of the CSV.
    pub csv_sha256: String,
    /// The object's outline, where there is one.
    pub contour: Option<Contour>,
    /// How far the truth lies from theory, where the trace was simulated.
    pub certificate: Option<Certificate>,
    /// What is to be known of the recording, where it was not simulated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<Recorded>,
    /// The recording of several whiskers that the trace belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
}

impl Sidecar {
    /// Class of the object: as the recording states it, else by the shape.
    pub fn object_class(&self) -> ObjectClass {
        let stated = self.recorded.as_ref().and_then(|recorded| recorded.object_class);
        stated.unwrap_or_else(|| ObjectClass::of_shape(&self.object))
    }

    /// Standard deviation of the noise that the readings have of themselves: none where they were simulated.
    pub fn own_noise_sd_n_m(&self) -> f64 {
        self.recorded.as_ref().map_or(0.0, |recorded| recorded.noise_sd_n_m)
    }

    /// Reads and checks the sidecar of the trace whose CSV or sidecar this is.
    ///
    /// # Errors
    /// [`Error`] names file and key, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        if path.is_dir() {
            return Err(Error::value(path, "path", "a folder", "a trace's .csv or .json file"));
        }
        let path = path.with_extension("json");
        let sidecar: Self = read_json(&path)?;
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
        plain_name(path, "name", &self.name)?;
        // Pictures are named after the group, and it is shown wherever the trace is.
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
    fn validate(&self, path: &Path) -> Result<(), Error> {
        let key = |name: &str| format!("recorded.{name}");
        if self.characteristic[0] == 0.0 {
            return Err(Error::value(path, key("characteristic"), "0 at first", "a sensor that reads something"));
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

/// Whether a name stays within the folder when a path is made of it, and on its line when it is shown.
pub fn is_plain_name(name: &str) -> bool {
    !(name.is_empty() || name.starts_with('.') || name.contains(['/', '\\']) || name.contains(char::is_control))
}

/// Checks that a rate is one at which something is sampled. Detectors keep as many readings as some time has, so that memory grows with it.
pub(crate) fn check_rate(path: &Path, rate_hz: f64) -> Result<(), Error> {
    let [least, most] = RATES_HZ;
    if !(least..=most).contains(&rate_hz) {
        return Err(Error::value(path, "rate_hz", rate_hz, format!("{least} to {most}")));
    }
    Ok(())
}

/// Checks that a name from a file stays within the folder when a path is made of it.
pub(crate) fn plain_name(path: &Path, key: &str, name: &str) -> Result<(), Error> {
    if !is_plain_name(name) {
        return Err(Error::value(path, key, format!("`{name}`"), "a plain file name"));
    }
    Ok(())
}
