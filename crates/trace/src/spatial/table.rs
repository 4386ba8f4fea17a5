//! Table of a trace in space: rows, reading and writing.

use std::path::{Path, PathBuf};

use csv::ByteRecord;
use files::table::{field_error, reader};
use files::{Error, read_table, sha256, write_atomically, write_json};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

use super::columns::{
    ANGULAR, ARC, AXIAL, CONTACT, FEATURE, FORCE, LINEAR, MOMENT, NORMAL, POSITION, QUATERNION, ROTATION, SPLIT,
    SURFACE, TANGENT, TIP, TOUCHING, most,
};
use super::{SPATIAL_COLUMNS, SpatialSidecar};
use crate::rows::flag;
use crate::table::fixed;

/// Number of columns.
const CELLS: usize = SPATIAL_COLUMNS.len();

/// Largest deviation of the norm of a quaternion, a normal or a tangent from 1: rounding of ten decimals.
const UNIT: f64 = 1e-6;

/// Pose of the base in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialPose {
    /// Position of the root (m).
    pub position: Vector3<f64>,
    /// Rotation from Base to World.
    pub rotation: UnitQuaternion<f64>,
}

impl SpatialPose {
    /// The pose with this position (m) and this unit quaternion, which is kept as given: normalising would change its last decimals
    /// when a trace is written again.
    ///
    /// # Errors
    /// The norm of the quaternion, if it is not 1.
    pub fn new(position: Vector3<f64>, quaternion: Quaternion<f64>) -> Result<Self, f64> {
        let norm = quaternion.norm();
        if (norm - 1.0).abs() > UNIT || norm.is_nan() {
            return Err(norm);
        }
        Ok(Self { position, rotation: UnitQuaternion::new_unchecked(quaternion) })
    }
}

/// Twist of the base relative to World, in Base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialTwist {
    /// Velocity of the root (m/s).
    pub linear: Vector3<f64>,
    /// Angular velocity (rad/s).
    pub angular: Vector3<f64>,
}

/// Feature of a solid's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// Smooth part.
    Face,
    /// Line where two smooth parts meet.
    Edge,
    /// Point where several edges meet, or apex.
    Corner,
}

/// Quantities available to an estimator at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialInstant {
    /// Time since the start of the recording.
    pub t_s: f64,
    /// Pose of the whisker base.
    pub base: SpatialPose,
    /// Twist of the base, if recorded.
    pub twist: Option<SpatialTwist>,
    /// Moment at the root in Base (N m): torsion about x, bending about y and z, without measurement noise. The torsion
    /// is `None` if the sensor does not measure it.
    pub moment_x_n_m: Option<f64>,
    /// Bending moment about y of Base (up and down).
    pub moment_y_n_m: f64,
    /// Bending moment about z of Base (left and right), the reading of a planar trace.
    pub moment_z_n_m: f64,
    /// Force of the whisker on the base along +x of Base, if measured.
    pub force_x_n: Option<f64>,
    /// Rotation of the root: yaw, pitch and twist (rad), if recorded.
    pub rotation: Option<Vector3<f64>>,
}

impl SpatialInstant {
    /// An instant of which only the pose of the base and the bending moments about y and z of Base (N m), 2x1, are known.
    pub fn measured(t_s: f64, base: SpatialPose, reading_n_m: Vector2<f64>) -> Self {
        Self {
            t_s,
            base,
            twist: None,
            moment_x_n_m: None,
            moment_y_n_m: reading_n_m.x,
            moment_z_n_m: reading_n_m.y,
            force_x_n: None,
            rotation: None,
        }
    }
}

/// Contact at one instant, in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialContactTruth {
    /// Whether the contact is at the tip.
    pub tip: bool,
    /// Whether there are several separate contacts. The stored contact is then the nearest one.
    pub split: bool,
    /// Feature of the solid that is touched.
    pub feature: Feature,
    /// Contact on the whisker's centre line (m).
    pub contact: Vector3<f64>,
    /// Contact on the solid's surface (m).
    pub surface: Vector3<f64>,
    /// Unit normal of the contact, out of the solid.
    pub normal: Vector3<f64>,
    /// Arc length from root to contact.
    pub arc_m: f64,
    /// Force of the solid on the whisker (N).
    pub force: Vector3<f64>,
    /// Unit tangent of the centre line at the contact, towards the tip.
    pub tangent: Vector3<f64>,
}

/// Ground truth at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialTruthInstant {
    /// Whether the whisker is in contact, if known.
    pub touching: Option<bool>,
    /// The contact, if there is one and it is completely known.
    pub contact: Option<SpatialContactTruth>,
    /// Place of a contact in World (m), 3x1, of which nothing else is known, as in recordings of real sensors. `None` if `contact`
    /// states it.
    pub place: Option<Vector3<f64>>,
}

impl SpatialTruthInstant {
    /// Contact on the whisker's centre line in World (m), 3x1, if it is known.
    pub fn contact_m(&self) -> Option<Vector3<f64>> {
        self.contact.map(|contact| contact.contact).or(self.place)
    }

    /// Whether the contact is single and on the side of the whisker: neither at the tip nor in several places, as far as this is
    /// known.
    pub fn is_single(&self) -> bool {
        self.contact.is_none_or(|contact| !contact.tip && !contact.split)
    }
}

/// Part of a trace in space that is available to estimators.
#[derive(Clone, Debug, PartialEq)]
pub struct SpatialRecording {
    /// Instants in order of time.
    pub instants: Vec<SpatialInstant>,
}

/// Ground truth of a trace in space.
#[derive(Clone, Debug, PartialEq)]
pub struct SpatialTruth {
    /// One entry per instant of the recording.
    pub instants: Vec<SpatialTruthInstant>,
}

/// Trace in space: sidecar, recording and ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct SpatialTrace {
    /// Description and provenance.
    pub sidecar: SpatialSidecar,
    /// Part that is available to estimators.
    pub recording: SpatialRecording,
    /// Ground truth, for scoring only.
    pub truth: SpatialTruth,
}

impl SpatialTrace {
    /// Reads the trace with this CSV or sidecar path and checks it against its sidecar.
    ///
    /// # Errors
    /// [`Error`] with file, line and column, value found and value expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let sidecar = SpatialSidecar::read(path)?;
        let path = path.with_extension("csv");
        let bytes = read_table(&path)?;
        let (mut instants, mut truth) = (Vec::new(), Vec::new());
        for row in reader(&path, &bytes, &SPATIAL_COLUMNS.map(|(name, _)| name))? {
            let (line, cells) = row?;
            let row = Row { path: &path, line, cells };
            let (known, of_truth) = row.parsed(instants.last().map(|last: &SpatialInstant| last.t_s))?;
            instants.push(known);
            truth.push(of_truth);
        }
        if instants.len() != sidecar.rows {
            return Err(Error::Table {
                path,
                line: instants.len() as u64 + 2,
                place: "row".into(),
                found: format!("the end after {} rows", instants.len()),
                expected: format!("{} rows, as stated by its sidecar", sidecar.rows),
            });
        }
        let found = sha256(&bytes);
        if found != sidecar.csv_sha256 {
            let expected = format!("{}, as stated by its sidecar", sidecar.csv_sha256);
            return Err(Error::value(&path, "sha256", found, expected));
        }
        Ok(Self { sidecar, recording: SpatialRecording { instants }, truth: SpatialTruth { instants: truth } })
    }

    /// Table in CSV.
    pub fn to_csv(&self) -> String {
        let names: Vec<&str> = SPATIAL_COLUMNS.iter().map(|(name, _)| *name).collect();
        let mut text = names.join(",") + "\n";
        for (known, truth) in self.recording.instants.iter().zip(&self.truth.instants) {
            let cells = cells(known, truth);
            let fields: Vec<String> = cells
                .iter()
                .zip(SPATIAL_COLUMNS)
                .map(|(cell, (_, decimals))| cell.map_or_else(String::new, |value| fixed(value, decimals)))
                .collect();
            text.push_str(&fields.join(","));
            text.push('\n');
        }
        text
    }

    /// Writes CSV and sidecar into a folder and returns the path of the CSV. Row count and hash of the sidecar are
    /// those of the written rows.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, Error> {
        let csv = self.to_csv();
        let sidecar =
            SpatialSidecar { rows: self.recording.instants.len(), csv_sha256: sha256(&csv), ..self.sidecar.clone() };
        let path = folder.join(format!("{}.csv", sidecar.name));
        write_atomically(&path, csv.as_bytes())?;
        write_json(&path.with_extension("json"), &sidecar)?;
        Ok(path)
    }
}

/// Row of the table.
struct Row<'a> {
    path: &'a Path,
    line: u64,
    cells: ByteRecord,
}

impl Row<'_> {
    fn wrong(&self, i: usize, expected: &str) -> Error {
        field_error(self.path, self.line, SPATIAL_COLUMNS[i].0, &self.cells[i], expected)
    }

    fn optional(&self, i: usize) -> Result<Option<f64>, Error> {
        if self.cells[i].is_empty() {
            return Ok(None);
        }
        match fast_float2::parse::<f64, _>(&self.cells[i]) {
            Ok(value) if value.abs() <= most(i) => Ok(Some(value)),
            Ok(value) if value.is_finite() => Err(self.wrong(i, &format!("a number of at most {}", most(i)))),
            _ => Err(self.wrong(i, "a finite number")),
        }
    }

    fn required(&self, i: usize) -> Result<f64, Error> {
        self.optional(i)?.ok_or_else(|| self.wrong(i, "a number"))
    }

    fn vector(&self, i: usize) -> Result<Vector3<f64>, Error> {
        Ok(Vector3::new(self.required(i)?, self.required(i + 1)?, self.required(i + 2)?))
    }

    fn optional_vector(&self, i: usize) -> Result<Option<Vector3<f64>>, Error> {
        if (i..i + 3).all(|i| self.cells[i].is_empty()) { Ok(None) } else { self.vector(i).map(Some) }
    }

    fn unit(&self, i: usize) -> Result<Vector3<f64>, Error> {
        let vector = self.vector(i)?;
        let norm = vector.norm();
        if (norm - 1.0).abs() > UNIT {
            return Err(self.wrong(i, &format!("a vector of length 1, not {norm:.9}")));
        }
        Ok(vector)
    }

    fn flag(&self, i: usize) -> Result<Option<bool>, Error> {
        flag(self.optional(i)?).map_err(|expected| self.wrong(i, expected))
    }

    fn known_flag(&self, i: usize) -> Result<bool, Error> {
        self.flag(i)?.ok_or_else(|| self.wrong(i, "0 or 1"))
    }

    fn base(&self) -> Result<SpatialPose, Error> {
        let position = self.vector(POSITION)?;
        let mut parts = [0.0; 4];
        for (i, part) in parts.iter_mut().enumerate() {
            *part = self.required(QUATERNION + i)?;
        }
        let [w, x, y, z] = parts;
        SpatialPose::new(position, Quaternion::new(w, x, y, z))
            .map_err(|norm| self.wrong(QUATERNION, &format!("a unit quaternion, not one of norm {norm:.9}")))
    }

    /// Parses the row, whose time must be after `last_s`.
    fn parsed(&self, last_s: Option<f64>) -> Result<(SpatialInstant, SpatialTruthInstant), Error> {
        let t_s = self.required(0)?;
        if let Some(last_s) = last_s
            && t_s <= last_s
        {
            return Err(self.wrong(0, &format!("a time after {last_s} (rows in order of time)")));
        }
        let twist = match (self.optional_vector(LINEAR)?, self.optional_vector(ANGULAR)?) {
            (Some(linear), Some(angular)) => Some(SpatialTwist { linear, angular }),
            (None, None) => None,
            _ => return Err(self.wrong(LINEAR, "all of the twist or none of it")),
        };
        let known = SpatialInstant {
            t_s,
            base: self.base()?,
            twist,
            moment_x_n_m: self.optional(MOMENT)?,
            moment_y_n_m: self.required(MOMENT + 1)?,
            moment_z_n_m: self.required(MOMENT + 2)?,
            force_x_n: self.optional(AXIAL)?,
            rotation: self.optional_vector(ROTATION)?,
        };
        let touching = self.flag(TOUCHING)?;
        let stated = (TIP..CELLS).find(|&i| !self.cells[i].is_empty());
        if let (Some(false), Some(i)) = (touching, stated) {
            return Err(self.wrong(i, "an empty field while truth_touching is 0"));
        }
        let is_empty = |mut cells: std::ops::Range<usize>| cells.all(|i| self.cells[i].is_empty());
        let (contact, place) = match stated {
            None => (None, None),
            Some(CONTACT) if is_empty(CONTACT + 3..CELLS) => (None, Some(self.vector(CONTACT)?)),
            Some(_) => (Some(self.contact()?), None),
        };
        Ok((known, SpatialTruthInstant { touching, contact, place }))
    }

    fn contact(&self) -> Result<SpatialContactTruth, Error> {
        let feature = match self.required(FEATURE)? {
            0.0 => Feature::Face,
            1.0 => Feature::Edge,
            2.0 => Feature::Corner,
            _ => return Err(self.wrong(FEATURE, "0 (face), 1 (edge) or 2 (corner)")),
        };
        Ok(SpatialContactTruth {
            tip: self.known_flag(TIP)?,
            split: self.known_flag(SPLIT)?,
            feature,
            contact: self.vector(CONTACT)?,
            surface: self.vector(SURFACE)?,
            normal: self.unit(NORMAL)?,
            arc_m: self.required(ARC)?,
            force: self.vector(FORCE)?,
            tangent: self.unit(TANGENT)?,
        })
    }
}

/// Values of a row in column order.
fn cells(known: &SpatialInstant, truth: &SpatialTruthInstant) -> [Option<f64>; CELLS] {
    let mut cells = [None; CELLS];
    let mut set = |first: usize, values: &[f64]| {
        for (cell, value) in cells[first..].iter_mut().zip(values) {
            *cell = Some(*value);
        }
    };
    let flag = |value: bool| f64::from(u8::from(value));
    let rotation = known.base.rotation.quaternion();
    set(0, &[known.t_s]);
    set(POSITION, known.base.position.as_slice());
    set(QUATERNION, &[rotation.w, rotation.i, rotation.j, rotation.k]);
    if let Some(twist) = known.twist {
        set(LINEAR, twist.linear.as_slice());
        set(ANGULAR, twist.angular.as_slice());
    }
    known.moment_x_n_m.iter().for_each(|moment| set(MOMENT, &[*moment]));
    set(MOMENT + 1, &[known.moment_y_n_m, known.moment_z_n_m]);
    known.force_x_n.iter().for_each(|force| set(AXIAL, &[*force]));
    known.rotation.iter().for_each(|rotation| set(ROTATION, rotation.as_slice()));
    truth.touching.iter().for_each(|touching| set(TOUCHING, &[flag(*touching)]));
    truth.place.iter().for_each(|place| set(CONTACT, place.as_slice()));
    if let Some(contact) = &truth.contact {
        let feature = f64::from(contact.feature as u8);
        set(TIP, &[flag(contact.tip), flag(contact.split), feature]);
        set(CONTACT, contact.contact.as_slice());
        set(SURFACE, contact.surface.as_slice());
        set(NORMAL, contact.normal.as_slice());
        set(ARC, &[contact.arc_m]);
        set(FORCE, contact.force.as_slice());
        set(TANGENT, contact.tangent.as_slice());
    }
    cells
}
