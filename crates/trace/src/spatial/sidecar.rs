//! Sidecar of a trace in space.

use std::path::Path;

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::Whisker;
use whisker::rod::{Rod, Suspension};
use whisker::space::sensor::SpatialWhisker;

use super::{SpatialCertificate, SpatialRecorded};
use crate::Role;
use crate::sidecar::{Generator, check_rate, hash_of_data, plain_name};

/// Format version of traces in space.
pub const SPATIAL_FORMAT: u32 = 2;

/// Stiffness of the three springs at the root, in series, as in [`Suspension`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedSuspension {
    /// Stiffness in yaw (N m/rad).
    pub yaw_n_m_rad: f64,
    /// Stiffness in pitch (N m/rad).
    pub pitch_n_m_rad: f64,
    /// Stiffness in twist (N m/rad).
    pub twist_n_m_rad: f64,
}

impl StatedSuspension {
    /// A suspension with the same stiffness about all axes (N m/rad).
    pub fn isotropic(stiffness_n_m_rad: f64) -> Self {
        Self { yaw_n_m_rad: stiffness_n_m_rad, pitch_n_m_rad: stiffness_n_m_rad, twist_n_m_rad: stiffness_n_m_rad }
    }

    /// A whisker on this suspension.
    pub(super) fn whisker(self, whisker: &Whisker, poisson_ratio: f64) -> SpatialWhisker {
        SpatialWhisker { whisker: whisker.clone(), suspension: self.into(), poisson_ratio }
    }
}

impl From<Suspension> for StatedSuspension {
    fn from(suspension: Suspension) -> Self {
        let Suspension { yaw_n_m_rad, pitch_n_m_rad, twist_n_m_rad } = suspension;
        Self { yaw_n_m_rad, pitch_n_m_rad, twist_n_m_rad }
    }
}

impl From<StatedSuspension> for Suspension {
    fn from(stated: StatedSuspension) -> Self {
        let StatedSuspension { yaw_n_m_rad, pitch_n_m_rad, twist_n_m_rad } = stated;
        Self { yaw_n_m_rad, pitch_n_m_rad, twist_n_m_rad }
    }
}

/// Sidecar of a trace in space: description and provenance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialSidecar {
    /// Format version.
    pub format: u32,
    /// `"trace"`.
    pub kind: String,
    /// Name of the trace.
    pub name: String,
    /// Purpose of the trace.
    pub role: Role,
    /// Group of trials that are scored together.
    pub group: String,
    /// Name of the solid's shape.
    pub object: String,
    /// Seed of the motion.
    pub seed: u64,
    /// Sampling rate.
    pub rate_hz: f64,
    /// Number of rows.
    pub rows: usize,
    /// Whisker in its own plane.
    pub whisker: Whisker,
    /// Springs at the root.
    pub suspension: StatedSuspension,
    /// Poisson ratio of the wire, which gives its stiffness in twist.
    pub poisson_ratio: f64,
    /// Scene as simulated. Its schema belongs to the generator, which defines the solids and motions.
    pub scene: Value,
    /// Program that made the trace.
    pub generator: Generator,
    /// Hash of everything that determines the data.
    pub inputs_sha256: String,
    /// SHA-256 of the CSV.
    pub csv_sha256: String,
    /// Deviation of the ground truth from theory, for simulated traces.
    pub certificate: Option<SpatialCertificate>,
    /// Properties of the recording, for traces of a real sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<SpatialRecorded>,
}

impl SpatialSidecar {
    /// Reads and checks the sidecar of the trace with this CSV or sidecar path.
    ///
    /// # Errors
    /// [`Error`] with file and key, value found and value expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        if path.is_dir() {
            return Err(Error::value(path, "path", "a folder", "a trace's .csv or .json file"));
        }
        let path = path.with_extension("json");
        let sidecar: Self = read_json(&path).map_err(|error| other_format(&path, SPATIAL_FORMAT, "trace", error))?;
        sidecar.validate(&path)?;
        Ok(sidecar)
    }

    /// The whisker with its properties out of its plane.
    pub fn spatial_whisker(&self) -> SpatialWhisker {
        self.suspension.whisker(&self.whisker, self.poisson_ratio)
    }

    /// Mechanics of the whisker in space.
    ///
    /// # Errors
    /// [`whisker::Invalid`] if a parameter is out of its range.
    pub fn rod(&self) -> Result<Rod, whisker::Invalid> {
        self.spatial_whisker().rod()
    }

    /// Standard deviation of the noise that the readings contain, root mean square over both moments; 0 for simulated traces.
    pub fn own_noise_sd_n_m(&self) -> f64 {
        self.recorded.as_ref().map_or(0.0, SpatialRecorded::mean_noise_sd_n_m)
    }

    /// Source of the times of a recording. `None` if the trace was simulated.
    pub fn clock(&self) -> Option<&str> {
        self.recorded.as_ref().map(|recorded| recorded.clock.as_str())
    }

    /// Hash of everything that a calibration from the trace may depend on, as [`crate::Sidecar::data_sha256`].
    pub fn data_sha256(&self) -> String {
        hash_of_data(self)
    }

    fn validate(&self, path: &Path) -> Result<(), Error> {
        if self.format != SPATIAL_FORMAT {
            return Err(Error::value(path, "format", self.format, SPATIAL_FORMAT));
        }
        if self.kind != "trace" {
            return Err(Error::value(path, "kind", &self.kind, "trace"));
        }
        check_rate(path, self.rate_hz)?;
        if let Some(recorded) = &self.recorded {
            recorded.validate(path)?;
        }
        for (key, name) in [
            ("name", &self.name),
            ("group", &self.group),
            ("object", &self.object),
            ("whisker.name", &self.whisker.name),
        ] {
            plain_name(path, key, name)?;
        }
        if path.file_stem().is_none_or(|stem| stem != self.name.as_str()) {
            return Err(Error::value(path, "name", format!("`{}`", self.name), "the name of its file"));
        }
        check_whisker(path, &self.spatial_whisker())
    }
}

/// Checks the parameters of a whisker in a file.
pub(super) fn check_whisker(path: &Path, whisker: &SpatialWhisker) -> Result<(), Error> {
    whisker.rod().map(drop).map_err(|error| {
        let of_whisker = !error.key.starts_with("suspension") && error.key != "poisson_ratio";
        let key = if of_whisker { format!("whisker.{}", error.key) } else { error.key.to_owned() };
        Error::value(path, key, error.found, error.expected)
    })
}

/// Whether the sidecar of the trace with this CSV or sidecar path states the format of traces in space.
///
/// # Errors
/// [`Error`] if the sidecar cannot be read as JSON.
pub fn is_spatial(path: &Path) -> Result<bool, Error> {
    let value: Value = read_json(&path.with_extension("json"))?;
    Ok(value.get("format").and_then(Value::as_u64) == Some(SPATIAL_FORMAT.into()))
}

/// The error of a file of a kind, `trace` or `calibration`, that does not parse as one of the format `expected`. If it states
/// the other format, the error says so, at its place.
pub(crate) fn other_format(path: &Path, expected: u32, kind: &str, error: Error) -> Error {
    let (in_space, planar) = (format!("a {kind} in space"), format!("a planar {kind}"));
    let (other, found, wanted) = match expected {
        FORMAT => (SPATIAL_FORMAT, in_space, planar),
        _ => (FORMAT, planar, in_space),
    };
    let stated = read_json::<Value>(path).ok().and_then(|value| value.get("format").and_then(Value::as_u64));
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let (true, Some(start)) = (stated == Some(other.into()), text.find("\"format\"")) else { return error };
    let before = &text[..start];
    let column = before.rfind('\n').map_or(start, |newline| start - newline - 1) + 1;
    Error::Json {
        path: path.into(),
        line: before.matches('\n').count() + 1,
        column,
        message: format!("format: found {other}, {found}, expected {expected}, {wanted}"),
    }
}
