//! Table of a trace: columns, rows, reading and writing.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use files::read_table;
use files::{Error, sha256, write_atomically, write_json};
use whisker::frames::{Base, Point, Pose, Twist, World};

use crate::{Outline, SPATIAL_COLUMNS, Sidecar, TraceRows};

/// Column names and the number of decimals written for each.
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

/// FurtherColumns columns, of the ground truth of a scene with friction, and the number of decimals written for each.
pub const FRICTION_COLUMNS: [(&str, usize); 3] =
    [("truth_friction_angle_rad", 10), ("truth_slip_m_s", 10), ("truth_sticking", 0)];

/// FurtherColumns columns, of the second contact with an object that is not convex, and the number of decimals written for each.
pub const SECOND_COLUMNS: [(&str, usize); 6] = [
    ("truth_second_contact_x_m", 10),
    ("truth_second_contact_y_m", 10),
    ("truth_second_surface_x_m", 10),
    ("truth_second_surface_y_m", 10),
    ("truth_second_arc_m", 10),
    ("truth_second_force_n", 12),
];

/// Further columns, of an object that gives way, and the number of decimals written for each.
pub const YIELDING_COLUMNS: [(&str, usize); 4] =
    [("truth_object_x_m", 10), ("truth_object_y_m", 10), ("truth_object_yaw_rad", 10), ("truth_indentation_m", 10)];

/// Largest magnitude of a position coordinate. Larger values are errors of the file.
pub const FARTHEST_M: f64 = 1e3;

/// Largest magnitude of a quantity of a trace that is neither a time nor a position, such as a moment (N m), an angle (rad) or
/// a force (N). Larger values are errors of the file.
pub const LARGEST: f64 = 1e6;

/// Upper bound of the preallocated rows: the row count of a sidecar is untrusted.
const MOST_ROWS_AT_FIRST: usize = 1 << 16;

/// Quantities available to an estimator at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instant {
    /// Time since the start of the recording.
    pub t_s: f64,
    /// Pose of the whisker base in World.
    pub base: Pose<Base, World>,
    /// Twist of the base in Base, if recorded.
    pub twist: Option<Twist>,
    /// Bending moment at the root about z, without measurement noise.
    pub moment_z_n_m: f64,
    /// Rotation of the root relative to the base, if recorded.
    pub rotation_z_rad: Option<f64>,
}

/// Ground truth at one instant. Only the simulator (or the rig) determines it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TruthInstant {
    /// Whether the whisker is in contact, if known.
    pub touching: Option<bool>,
    /// Whether the contact is at the tip.
    pub tip: Option<bool>,
    /// Whether there are several separate contacts. The stored contact is then the nearest one.
    pub split: Option<bool>,
    /// Contact on the whisker's centre line, in World.
    pub contact: Option<Point<World>>,
    /// Contact on the object's surface, in World.
    pub surface: Option<Point<World>>,
    /// Arc length from root to contact.
    pub arc_m: Option<f64>,
    /// Magnitude of the contact force.
    pub force_n: Option<f64>,
    /// Tangent angle of the centre line at the contact, in World.
    pub tangent_rad: Option<f64>,
    /// Friction. `None` without contact and in traces of scenes without friction.
    pub friction: Option<FrictionTruth>,
    /// Second contact. `None` where there is none and in traces of convex objects.
    pub second: Option<SecondTruth>,
    /// Displacement of an object that gives way, also without contact. `None` in traces of other objects.
    pub yielding: Option<YieldingTruth>,
}

/// Ground truth of an object that gives way at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YieldingTruth {
    /// Displacement in World, since the start, of the origin of the frame of the object's shape.
    pub moved_m: [f64; 2],
    /// Rotation about this origin since the start.
    pub yaw_rad: f64,
    /// Indentation of the surface at the contact, along the normal. Zero without contact.
    pub indentation_m: f64,
}

/// Ground truth of the second contact at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondTruth {
    /// Contact on the whisker's centre line, in World.
    pub contact: Point<World>,
    /// Contact on the object's surface, in World.
    pub surface: Point<World>,
    /// Arc length from root to contact.
    pub arc_m: f64,
    /// Magnitude of the force.
    pub force_n: f64,
}

/// Ground truth of the friction at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionTruth {
    /// Angle of the force on the whisker to the object's outward normal, positive towards the tip.
    pub angle_rad: f64,
    /// Velocity of the whisker's surface relative to the object's, along the whisker towards its tip.
    pub slip_m_s: f64,
    /// Whether the force is inside the friction cone.
    pub sticking: bool,
}

/// Part of a trace that is available to estimators.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Instants in order of time.
    pub instants: Vec<Instant>,
}

/// Ground truth of a trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// One entry per instant of the recording.
    pub instants: Vec<TruthInstant>,
}

/// Trace: sidecar, recording and ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Description and provenance.
    pub sidecar: Sidecar,
    /// Part that is available to estimators.
    pub recording: Recording,
    /// Ground truth, for scoring only.
    pub truth: Truth,
}

impl Trace {
    /// Moments of all rows (N m).
    pub fn moments_n_m(&self) -> Vec<f64> {
        self.recording.instants.iter().map(|instant| instant.moment_z_n_m).collect()
    }

    /// Reads the trace with this CSV or sidecar path and checks it against its sidecar.
    ///
    /// # Errors
    /// [`Error`] with file, line and column, value found and value expected.
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

    /// Reads the outline of the object from the trace's folder. `None` if the trace has no outline.
    ///
    /// # Errors
    /// [`Error`] with file and place, also if the hash of the file differs from the sidecar's.
    pub fn outline(&self, folder: &Path) -> Result<Option<Outline>, Error> {
        let Some(contour) = &self.sidecar.contour else { return Ok(None) };
        let path = folder.join(&contour.file);
        let bytes = read_table(&path)?;
        let outline = Outline::parse(&path, &bytes)?;
        let found = sha256(&bytes);
        if found != contour.sha256 {
            return Err(Error::value(&path, "sha256", found, format!("{}, as stated by the sidecar", contour.sha256)));
        }
        Ok(Some(outline))
    }

    /// Table in CSV.
    pub fn to_csv(&self) -> String {
        let further = FurtherColumns::of(&self.truth);
        let mut text = header(further);
        for (known, truth) in self.recording.instants.iter().zip(&self.truth.instants) {
            push_row(&mut text, known, truth, further);
        }
        text
    }

    /// Writes CSV and sidecar into a folder and returns the path of the CSV. The sidecar is written last: it marks the
    /// trace as complete.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, Error> {
        let path = folder.join(format!("{}.csv", self.sidecar.name));
        write_atomically(&path, self.to_csv().as_bytes())?;
        write_json(&path.with_extension("json"), &self.sidecar)?;
        Ok(path)
    }
}

/// Columns of a table beyond [`COLUMNS`]. A scene has friction, an object that is not convex or one that gives way, but no two of
/// these.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FurtherColumns {
    /// None.
    None,
    /// [`FRICTION_COLUMNS`].
    Friction,
    /// [`SECOND_COLUMNS`].
    Second,
    /// [`YIELDING_COLUMNS`].
    Yielding,
}

impl FurtherColumns {
    /// Those that this truth has values of.
    pub fn of(truth: &Truth) -> Self {
        let has = |value: fn(&TruthInstant) -> bool| truth.instants.iter().any(value);
        if has(|truth| truth.friction.is_some()) {
            Self::Friction
        } else if has(|truth| truth.second.is_some()) {
            Self::Second
        } else if has(|truth| truth.yielding.is_some()) {
            Self::Yielding
        } else {
            Self::None
        }
    }

    pub(crate) const fn columns(self) -> &'static [(&'static str, usize)] {
        match self {
            Self::None => &[],
            Self::Friction => &FRICTION_COLUMNS,
            Self::Second => &SECOND_COLUMNS,
            Self::Yielding => &YIELDING_COLUMNS,
        }
    }

    /// Number of these columns that are empty without contact.
    pub(crate) const fn of_contact(self) -> usize {
        match self {
            // The displacement of an object is known at any time.
            Self::Yielding => 0,
            _ => self.columns().len(),
        }
    }
}

/// Columns of a table.
pub(crate) fn columns(further: FurtherColumns) -> impl Iterator<Item = (&'static str, usize)> {
    COLUMNS.into_iter().chain(further.columns().iter().copied())
}

pub(crate) fn header(further: FurtherColumns) -> String {
    let names: Vec<&str> = columns(further).map(|(name, _)| name).collect();
    let mut text = names.join(",");
    text.push('\n');
    text
}

/// Whether a file begins with the columns of a trace, in the plane or in space.
///
/// # Errors
/// [`Error::Io`] with the path.
pub fn is_trace_table(path: &Path) -> Result<bool, Error> {
    let planar = COLUMNS.map(|(name, _)| name).join(",");
    let spatial = SPATIAL_COLUMNS.map(|(name, _)| name).join(",");
    let mut begin = Vec::new();
    let longest = planar.len().max(spatial.len()) as u64;
    File::open(path).and_then(|file| file.take(longest).read_to_end(&mut begin)).map_err(Error::io(path))?;
    Ok([planar, spatial].iter().any(|columns| begin.starts_with(columns.as_bytes())))
}

pub(crate) fn push_row(text: &mut String, known: &Instant, truth: &TruthInstant, further: FurtherColumns) {
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
    let (friction, second, yielding) = (truth.friction, truth.second, truth.yielding);
    let of_friction = || {
        [
            friction.map(|friction| friction.angle_rad),
            friction.map(|friction| friction.slip_m_s),
            flag(friction.map(|friction| friction.sticking)),
        ]
    };
    let of_second = || {
        [
            second.map(|second| second.contact.x()),
            second.map(|second| second.contact.y()),
            second.map(|second| second.surface.x()),
            second.map(|second| second.surface.y()),
            second.map(|second| second.arc_m),
            second.map(|second| second.force_n),
        ]
    };
    let of_yielding = || {
        [
            yielding.map(|yielding| yielding.moved_m[0]),
            yielding.map(|yielding| yielding.moved_m[1]),
            yielding.map(|yielding| yielding.yaw_rad),
            yielding.map(|yielding| yielding.indentation_m),
        ]
    };
    let further_cells: &[Option<f64>] = match further {
        FurtherColumns::None => &[],
        FurtherColumns::Friction => &of_friction(),
        FurtherColumns::Second => &of_second(),
        FurtherColumns::Yielding => &of_yielding(),
    };
    for (i, (cell, (_, decimals))) in cells.iter().chain(further_cells).zip(columns(further)).enumerate() {
        if i > 0 {
            text.push(',');
        }
        if let Some(value) = cell {
            text.push_str(&fixed(*value, decimals));
        }
    }
    text.push('\n');
}

/// Number with a fixed count of decimals. Zero is written without a sign.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|byte| byte == b'0' || byte == b'.') => digits.to_owned(),
        _ => text,
    }
}
