//! The table of a trace: columns, rows, reading and writing.

use std::path::{Path, PathBuf};

use files::read_table;
use files::{Error, sha256, write_atomically, write_json};
use whisker::frames::{Base, Point, Pose, Twist, World};

use crate::{Outline, Sidecar, TraceRows};

/// Names of the columns and the decimals with which each is written.
pub const COLUMNS: [(&str, usize); 19] = [
    ("t_s", 6),
    ("base_x_m", 10),
    ("base_y_m", 10),
    ("base_yaw_rad", 10),
    ("base_vx_m_s", 10),
    ("base_vy_m_s", 10),
    ("base_wz_rad_s", 10),
    ("moment_z_n_m", 15),
    ("rotation_z_rad", 10),
    ("truth_touching", 0),
    ("truth_tip", 0),
    ("truth_split", 0),
    ("truth_contact_x_m", 10),
    ("truth_contact_y_m", 10),
    ("truth_surface_x_m", 10),
    ("truth_surface_y_m", 10),
    ("truth_arc_m", 10),
    ("truth_force_n", 12),
    ("truth_tangent_rad", 10),
];

/// Places farther than this from the world's origin, in each direction, are an error of the file.
pub(crate) const FARTHEST_M: f64 = 1e3;

/// Rows for which room is made before they are read: a sidecar may claim any number.
const MOST_ROWS_AT_FIRST: usize = 1 << 16;

/// What the robot knows at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instant {
    /// Time since the start.
    pub t_s: f64,
    /// Pose of the base.
    pub base: Pose<Base, World>,
    /// Twist of the base, where recorded.
    pub twist: Option<Twist>,
    /// Bending moment at the root, without measurement noise.
    pub moment_z_n_m: f64,
    /// Rotation of the root against the base, where recorded.
    pub rotation_z_rad: Option<f64>,
}

/// What only the simulator knows at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TruthInstant {
    /// Whether the whisker touches, where known.
    pub touching: Option<bool>,
    /// Whether it touches with its tip.
    pub tip: Option<bool>,
    /// Whether it touches in places apart from one another, of which the contact is but the nearest.
    pub split: Option<bool>,
    /// Contact on the centre line.
    pub contact: Option<Point<World>>,
    /// Contact on the object's surface.
    pub surface: Option<Point<World>>,
    /// Arc length of the contact.
    pub arc_m: Option<f64>,
    /// Magnitude of the contact force.
    pub force_n: Option<f64>,
    /// Tangent angle of the centre line at the contact, in World.
    pub tangent_rad: Option<f64>,
}

/// What the robot knows of a trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The instants, in order of time.
    pub instants: Vec<Instant>,
}

/// What only the simulator knows of a trace, instant by instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// One entry an instant of the recording.
    pub instants: Vec<TruthInstant>,
}

/// A trace: sidecar, recording and truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// What it is and what made it.
    pub sidecar: Sidecar,
    /// What the robot knows.
    pub recording: Recording,
    /// What only the simulator knows.
    pub truth: Truth,
}

impl Trace {
    /// Reads the trace whose CSV or sidecar this is, and checks it against its sidecar.
    ///
    /// # Errors
    /// [`Error`] names file, line and column, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let (sidecar, rows) = TraceRows::open(path)?;
        let most = sidecar.rows.min(MOST_ROWS_AT_FIRST);
        let (mut instants, mut truth) = (Vec::with_capacity(most), Vec::with_capacity(most));
        for row in rows {
            let (known, of_truth) = row?;
            instants.push(known);
            truth.push(of_truth);
        }
        Ok(Self { sidecar, recording: Recording { instants }, truth: Truth { instants: truth } })
    }

    /// Reads the object's outline, where the trace has one; `folder` is the trace's own.
    ///
    /// # Errors
    /// [`Error`] names file and place; a file that is not the one the sidecar means is an error too.
    pub fn outline(&self, folder: &Path) -> Result<Option<Outline>, Error> {
        let Some(contour) = &self.sidecar.contour else { return Ok(None) };
        let path = folder.join(&contour.file);
        let bytes = read_table(&path)?;
        let outline = Outline::parse(&path, &bytes)?;
        let found = sha256(&bytes);
        if found != contour.sha256 {
            return Err(Error::value(&path, "sha256", found, format!("{}, as the sidecar says", contour.sha256)));
        }
        Ok(Some(outline))
    }

    /// The table as it stands in the CSV.
    pub fn to_csv(&self) -> String {
        let mut text = header();
        for (known, truth) in self.recording.instants.iter().zip(&self.truth.instants) {
            push_row(&mut text, known, truth);
        }
        text
    }

    /// Writes CSV and sidecar into a folder; the sidecar, which makes the trace complete, last. Returns the path of the CSV.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, Error> {
        let path = folder.join(format!("{}.csv", self.sidecar.name));
        write_atomically(&path, self.to_csv().as_bytes())?;
        write_json(&path.with_extension("json"), &self.sidecar)?;
        Ok(path)
    }
}

pub(crate) fn header() -> String {
    let mut text = COLUMNS.map(|(name, _)| name).join(",");
    text.push('\n');
    text
}

pub(crate) fn push_row(text: &mut String, known: &Instant, truth: &TruthInstant) {
    let flag = |value: Option<bool>| value.map(|v| f64::from(u8::from(v)));
    let origin = known.base.origin();
    let cells: [Option<f64>; COLUMNS.len()] = [
        Some(known.t_s),
        Some(origin.x()),
        Some(origin.y()),
        Some(known.base.yaw_rad()),
        known.twist.map(|twist| twist.vx_m_s),
        known.twist.map(|twist| twist.vy_m_s),
        known.twist.map(|twist| twist.wz_rad_s),
        Some(known.moment_z_n_m),
        known.rotation_z_rad,
        flag(truth.touching),
        flag(truth.tip),
        flag(truth.split),
        truth.contact.map(|p| p.x()),
        truth.contact.map(|p| p.y()),
        truth.surface.map(|p| p.x()),
        truth.surface.map(|p| p.y()),
        truth.arc_m,
        truth.force_n,
        truth.tangent_rad,
    ];
    for (i, (cell, (_, decimals))) in cells.iter().zip(COLUMNS).enumerate() {
        if i > 0 {
            text.push(',');
        }
        if let Some(value) = cell {
            text.push_str(&fixed(*value, decimals));
        }
    }
    text.push('\n');
}

/// A number with this many decimals; what rounds to zero has no sign.
fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|byte| byte == b'0' || byte == b'.') => digits.to_owned(),
        _ => text,
    }
}
