//! Array recordings: several whiskers on one arm, on a common clock, among several objects.
//!
//! Each whisker has a trace of its own. The recording's sidecar ties them together: it describes the arm, the mounts of
//! the whiskers and the objects. The joint table contains the arm's motion, the pose table the displacements of the
//! objects.

use std::collections::BTreeSet;
use std::path::Path;

use files::read_table;
use files::table::{number, reader};
use files::{Error, FORMAT, read_json, sha256};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::arm::{TILT_RAD, wrapped_rad};
use crate::sidecar::{check_rate, plain_name};
use crate::{Arm, Contour, Generator, JOINTS, JointInstant, Outline, PoseMatrix, Trace};

/// Largest deviation of a trace's base pose from the forward kinematics.
const BASE_M: f64 = 1e-6;
const BASE_RAD: f64 = 1e-6;

/// Largest deviation of a trace's base twist from the forward kinematics, in m/s and rad/s.
const TWIST: f64 = 1e-5;

/// Whisker of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountedWhisker {
    /// Name within the recording, for example `left_1`.
    pub name: String,
    /// Name of the whisker's trace.
    pub trace: String,
    /// Name of the array that the whisker belongs to.
    pub array: String,
    /// Pose of the whisker's base in the frame of the arm's flange.
    pub mount: PoseMatrix,
}

/// Object of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneObject {
    /// Name within the recording.
    pub name: String,
    /// Name of the shape.
    pub shape: String,
    /// Mass.
    pub mass_kg: f64,
    /// Height.
    pub height_m: f64,
    /// Coefficient of friction on the table.
    pub friction: f64,
    /// Initial outline at the height of the whiskers, in World.
    pub contour: Contour,
}

/// File that belongs to a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartFile {
    /// File name in the recording's folder.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// Sidecar of a recording, `<recording>.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArraySidecar {
    /// Format version.
    pub format: u32,
    /// `"recording"`.
    pub kind: String,
    /// Name of the recording.
    pub name: String,
    /// Seed of the scene.
    pub seed: u64,
    /// Sampling rate of all tables.
    pub rate_hz: f64,
    /// Number of rows of each table.
    pub rows: usize,
    /// Whiskers.
    pub whiskers: Vec<MountedWhisker>,
    /// The arm that carries them.
    pub arm: Arm,
    /// Objects.
    pub objects: Vec<SceneObject>,
    /// Table of joint angles and rates.
    pub joints: PartFile,
    /// Table of object displacements.
    pub poses: PartFile,
    /// Scene as simulated.
    pub scene: Value,
    /// Program that made the recording.
    pub generator: Generator,
    /// Hash of everything that determines the data.
    pub inputs_sha256: String,
}

/// Recording of several whiskers, without their traces.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayRecording {
    /// Description and provenance.
    pub sidecar: ArraySidecar,
    /// Exact joint states, one entry per instant.
    pub joints: Vec<JointInstant>,
    /// Initial outlines of the objects, in the sidecar's order.
    pub outlines: Vec<Outline>,
    /// Upper bound of the displacement of any point of each object: translation of its centre plus the contributions of
    /// rotation and tilt at the rim.
    pub moved_m: Vec<f64>,
}

impl ArrayRecording {
    /// Whether a JSON file is the sidecar of a recording.
    ///
    /// # Errors
    /// [`Error`] if the file cannot be read or is not valid JSON.
    pub fn is_one(path: &Path) -> Result<bool, Error> {
        let value: Value = read_json(path)?;
        Ok(value.get("kind").and_then(Value::as_str) == Some("recording"))
    }

    /// Reads a recording's sidecar `<recording>.json` and the tables that it names, and checks them against it.
    ///
    /// # Errors
    /// [`Error`] with file, line and column or key, value found and value expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let sidecar = ArraySidecar::read(path)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let part = |key: &str, file: &str, expected: &str| {
            let path = folder.join(file);
            let bytes = read_table(&path)?;
            let found = sha256(&bytes);
            if found != expected {
                return Err(Error::value(&path, "sha256", found, format!("{expected}, as stated by `{key}`")));
            }
            Ok((path, bytes))
        };
        let (joints_path, bytes) = part("joints", &sidecar.joints.file, &sidecar.joints.sha256)?;
        let joints = parse_joints(&joints_path, &bytes)?;
        check_rows(&joints_path, joints.len(), sidecar.rows)?;
        let (poses_path, bytes) = part("poses", &sidecar.poses.file, &sidecar.poses.sha256)?;
        let outlines = sidecar.objects.iter().map(|object| {
            let Contour { file, sha256, .. } = &object.contour;
            let (path, bytes) = part("contour", file, sha256)?;
            Outline::parse(&path, &bytes)
        });
        let outlines: Vec<Outline> = outlines.collect::<Result<_, _>>()?;
        let bodies: Vec<(&SceneObject, &Outline)> = sidecar.objects.iter().zip(&outlines).collect();
        let (clock_s, moved_m) = parse_poses(&poses_path, &bytes, &bodies)?;
        check_rows(&poses_path, clock_s.len(), sidecar.rows)?;
        check_clock(&poses_path, &clock_s, &joints)?;
        Ok(Self { joints, outlines, moved_m, sidecar })
    }

    /// Checks that a trace belongs to this recording: the sidecars name each other, the clocks agree, and the base
    /// follows the forward kinematics. `path` is the path of the trace's CSV. Returns the index of the trace's whisker
    /// in the recording.
    ///
    /// # Errors
    /// [`Error`] with line and column of the trace, or with the key of its sidecar.
    pub fn check(&self, path: &Path, trace: &Trace) -> Result<usize, Error> {
        let name = &self.sidecar.name;
        let beside = path.with_extension("json");
        let named = trace.sidecar.recording.as_deref();
        if named != Some(name) {
            let found = named.map_or_else(|| "no such key".into(), |named| format!("`{named}`"));
            return Err(Error::value(&beside, "recording", found, format!("`{name}`, which names this trace")));
        }
        let Some(place) = self.sidecar.place_of(&trace.sidecar.name) else {
            return Err(Error::value(&beside, "recording", format!("`{name}`"), "a recording that names this trace"));
        };
        let whisker = &self.sidecar.whiskers[place];
        if trace.sidecar.rate_hz != self.sidecar.rate_hz {
            return Err(Error::value(&beside, "rate_hz", trace.sidecar.rate_hz, self.sidecar.rate_hz));
        }
        check_rows(path, trace.recording.instants.len(), self.sidecar.rows)?;
        let clock_s: Vec<f64> = trace.recording.instants.iter().map(|instant| instant.t_s).collect();
        check_clock(path, &clock_s, &self.joints)?;
        let tilts_rad = self.sidecar.arm.tilts_rad(&whisker.mount, &self.joints);
        if let Some(row) = tilts_rad.iter().position(|tilt_rad| *tilt_rad > TILT_RAD) {
            return Err(Error::Table {
                path: path.into(),
                line: row as u64 + 2,
                place: "columns base_x_m, base_y_m, base_yaw_rad".into(),
                found: format!(
                    "a base tilted by {} rad, by the arm's joints and the mount of `{}`",
                    tilts_rad[row], whisker.name
                ),
                expected: format!("its z axis along that of World to within {TILT_RAD} rad"),
            });
        }
        let carried = self.sidecar.arm.carry(&whisker.mount, &self.joints);
        for (row, (instant, (base, twist))) in trace.recording.instants.iter().zip(&carried).enumerate() {
            let (found, expected) = (instant.base.origin(), base.origin());
            let mut pairs = vec![
                ("base_x_m", found.x(), expected.x(), BASE_M),
                ("base_y_m", found.y(), expected.y(), BASE_M),
                ("base_yaw_rad", instant.base.yaw_rad(), base.yaw_rad(), BASE_RAD),
            ];
            if let Some(found) = instant.twist {
                pairs.push(("base_vx_m_s", found.vx_m_s, twist.vx_m_s, TWIST));
                pairs.push(("base_vy_m_s", found.vy_m_s, twist.vy_m_s, TWIST));
                pairs.push(("base_wz_rad_s", found.wz_rad_s, twist.wz_rad_s, TWIST));
            }
            for (column, found, expected, most) in pairs {
                let off = found - expected;
                let off = if column == "base_yaw_rad" { wrapped_rad(off) } else { off };
                if off.abs() > most {
                    return Err(Error::Table {
                        path: path.into(),
                        line: row as u64 + 2,
                        place: format!("column {column}"),
                        found: found.to_string(),
                        expected: format!("{expected}, by the arm's joints and the mount of `{}`", whisker.name),
                    });
                }
            }
        }
        Ok(place)
    }
}

impl ArraySidecar {
    /// Reads a recording's sidecar without the tables that it names.
    ///
    /// # Errors
    /// [`Error`] with file and key, value found and value expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let sidecar: Self = read_json(path)?;
        sidecar.validate(path)?;
        Ok(sidecar)
    }

    /// Index of the whisker with this trace.
    pub fn place_of(&self, trace: &str) -> Option<usize> {
        self.whiskers.iter().position(|whisker| whisker.trace == trace)
    }

    fn validate(&self, path: &Path) -> Result<(), Error> {
        if self.format != FORMAT {
            return Err(Error::value(path, "format", self.format, FORMAT));
        }
        if self.kind != "recording" {
            return Err(Error::value(path, "kind", format!("`{}`", self.kind), "`recording`"));
        }
        plain_name(path, "name", &self.name)?;
        if path.file_stem().is_none_or(|stem| stem != self.name.as_str()) {
            return Err(Error::value(path, "name", format!("`{}`", self.name), "the name of its file"));
        }
        check_rate(path, self.rate_hz)?;
        if self.rows == 0 {
            return Err(Error::value(path, "rows", 0, "at least one row"));
        }
        if self.whiskers.is_empty() {
            return Err(Error::value(path, "whiskers", "an empty list", "at least one whisker"));
        }
        self.arm.base.validate(path, "arm.base")?;
        for (index, whisker) in self.whiskers.iter().enumerate() {
            let key = |key: &str| format!("whiskers[{index}].{key}");
            plain_name(path, &key("name"), &whisker.name)?;
            plain_name(path, &key("trace"), &whisker.trace)?;
            plain_name(path, &key("array"), &whisker.array)?;
            whisker.mount.validate(path, &key("mount"))?;
        }
        for (index, object) in self.objects.iter().enumerate() {
            plain_name(path, &format!("objects[{index}].name"), &object.name)?;
            plain_name(path, &format!("objects[{index}].contour.file"), &object.contour.file)?;
            let not_negative =
                [("mass_kg", object.mass_kg), ("height_m", object.height_m), ("friction", object.friction)];
            for (key, value) in not_negative {
                if !(value.is_finite() && value >= 0.0) {
                    return Err(Error::value(path, format!("objects[{index}].{key}"), value, "a number of 0 or more"));
                }
            }
        }
        distinct(path, "whiskers", "name", self.whiskers.iter().map(|whisker| &whisker.name))?;
        distinct(path, "whiskers", "trace", self.whiskers.iter().map(|whisker| &whisker.trace))?;
        distinct(path, "objects", "name", self.objects.iter().map(|object| &object.name))?;
        plain_name(path, "joints.file", &self.joints.file)?;
        plain_name(path, "poses.file", &self.poses.file)
    }
}

/// Checks that the names of a list's entries are unique.
fn distinct<'a>(path: &Path, list: &str, key: &str, names: impl Iterator<Item = &'a String>) -> Result<(), Error> {
    let mut seen = BTreeSet::new();
    for (index, name) in names.enumerate() {
        if !seen.insert(name) {
            return Err(Error::value(path, format!("{list}[{index}].{key}"), format!("`{name}` again"), "each once"));
        }
    }
    Ok(())
}

fn check_rows(path: &Path, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected {
        return Ok(());
    }
    Err(Error::Table {
        path: path.into(),
        line: found as u64 + 2,
        place: "row".into(),
        found: format!("the end after {found} rows"),
        expected: format!("{expected} rows, as stated by the recording"),
    })
}

/// Checks that a table has the same times as the joint table.
fn check_clock(path: &Path, clock_s: &[f64], joints: &[JointInstant]) -> Result<(), Error> {
    match clock_s.iter().zip(joints).position(|(t_s, joint)| *t_s != joint.t_s) {
        None => Ok(()),
        Some(row) => Err(Error::Table {
            path: path.into(),
            line: row as u64 + 2,
            place: "column t_s".into(),
            found: clock_s[row].to_string(),
            expected: format!("{}, the time in the joint table", joints[row].t_s),
        }),
    }
}

/// Rows of a numeric table whose first column is a strictly increasing time.
fn timed_rows(path: &Path, bytes: &[u8], names: &[&str]) -> Result<Vec<Vec<f64>>, Error> {
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for row in reader(path, bytes, names)? {
        let (line, record) = row?;
        let row: Vec<f64> =
            (0..names.len()).map(|i| number(path, line, &record, names, i)).collect::<Result<_, _>>()?;
        if let Some(last) = rows.last()
            && row[0] <= last[0]
        {
            return Err(Error::Table {
                path: path.into(),
                line,
                place: "column t_s".into(),
                found: row[0].to_string(),
                expected: format!("a time after {} (rows in order of time)", last[0]),
            });
        }
        rows.push(row);
    }
    Ok(rows)
}

/// Parses a joint table.
fn parse_joints(path: &Path, bytes: &[u8]) -> Result<Vec<JointInstant>, Error> {
    let angles = (1..=JOINTS).map(|joint| format!("q{joint}_rad"));
    let rates = (1..=JOINTS).map(|joint| format!("dq{joint}_rad_s"));
    let names: Vec<String> = std::iter::once("t_s".into()).chain(angles).chain(rates).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let rows = timed_rows(path, bytes, &names)?;
    let instant = |row: Vec<f64>| JointInstant {
        t_s: row[0],
        angles_rad: std::array::from_fn(|joint| row[1 + joint]),
        rates_rad_s: std::array::from_fn(|joint| row[1 + JOINTS + joint]),
    };
    Ok(rows.into_iter().map(instant).collect())
}

/// Parses a pose table into its clock and the largest displacement of each object.
///
/// The bound is the sum of the centre's translation, `2 r sin(yaw / 2)` for the rotation at the outermost vertex at
/// distance `r`, and `2 sqrt(r^2 + (h / 2)^2) sin(tilt / 2)` for the tilt at that vertex's height above or below the
/// centre. No point of the object moves farther.
fn parse_poses(path: &Path, bytes: &[u8], bodies: &[(&SceneObject, &Outline)]) -> Result<(Vec<f64>, Vec<f64>), Error> {
    const COLUMNS: [&str; 5] = ["x_m", "y_m", "z_m", "yaw_rad", "tilt_rad"];
    let of_objects = bodies.iter().flat_map(|(object, _)| COLUMNS.map(|column| format!("{}_{column}", object.name)));
    let names: Vec<String> = std::iter::once("t_s".into()).chain(of_objects).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let rows = timed_rows(path, bytes, &names)?;
    let moved_m = bodies.iter().enumerate().map(|(place, (object, outline))| {
        let middle = outline.middle();
        let rim_m = outline.vertices().iter().map(|at| at.distance(&middle)).fold(0.0, f64::max);
        let reach_m = rim_m.hypot(0.5 * object.height_m);
        let displaced_m = |row: &Vec<f64>| {
            let [x_m, y_m, z_m, yaw_rad, tilt_rad] =
                std::array::from_fn(|column| row[1 + COLUMNS.len() * place + column]);
            let chord_m = |reach_m: f64, turned_rad: f64| 2.0 * reach_m * (0.5 * turned_rad).sin().abs();
            x_m.hypot(y_m).hypot(z_m) + chord_m(rim_m, yaw_rad) + chord_m(reach_m, tilt_rad)
        };
        rows.iter().map(displaced_m).fold(0.0, f64::max)
    });
    let moved_m = moved_m.collect();
    Ok((rows.iter().map(|row| row[0]).collect(), moved_m))
}
