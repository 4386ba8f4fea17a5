//! Conversion of traces and logs of the platform to ROS 2 recordings, and back.
//!
//! A trace becomes standard messages, one for each quantity and instant; an unknown quantity has no message. Time
//! counts from the beginning of the trace. Sidecar and outline are attachments, so that the trace is restored byte for
//! byte. `docs/ROS.md` has the table.

mod array;
mod space;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use bag::messages::{
    AnyMessage, Bool, Float64, Header, JointState, MagneticFieldArray, Point as RosPoint, PointStamped,
    Pose as RosPose, PoseStamped, Quaternion, TfMessage, Time, Transform, TransformStamped, Twist as RosTwist,
    TwistStamped, Vector3, Wrench, WrenchStamped,
};
use bag::{Attachment, Message, Publisher, Reader, Record, Writer, topics};
use files::{sha256, sha256_of_file, write_atomically, write_json};
use nalgebra as na;
use platform::record::LogSidecar;
use platform::streams::SIDECAR;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use strict_json::parse_json;
use testbed::provenance::watermark;
use testbed::results::{EstimateRow, csv_bytes, read_rows};
use trace::{Instant, Recording, SPATIAL_FORMAT, Sidecar, Trace, Truth, TruthInstant, is_plain_name};
use whisker::frames::{Base, Point, Pose, Twist, World};

use space::import_spatial_trace;

pub use array::export_array;
pub use space::export_spatial_trace;

const TOUCHING: &str = "/truth/touching";
const TIP: &str = "/truth/tip";
const SPLIT: &str = "/truth/split";
const CONTACT: &str = "/truth/contact";
const SURFACE: &str = "/truth/surface";
const ARC: &str = "/truth/arc_m";
const FORCE: &str = "/truth/force_n";
const TANGENT: &str = "/truth/tangent_rad";

/// Joint name of the base's yaw in [`topics::JOINT_STATES`]: not wrapped, unlike a rotation.
const YAW: &str = "base_yaw";
/// Joint name of the rotation of the whisker's root.
const ROTATION: &str = "root_rotation";

/// Writes a trace as a recording, with the contacts of an estimator if its `estimates/` table is given.
///
/// # Errors
/// If trace or estimates cannot be read or do not belong together, if the recording cannot be written, or if another file or
/// recording has its name.
pub fn export_trace(path: &Path, estimates: Option<&Path>, folder: &Path) -> anyhow::Result<Export> {
    let trace = Trace::read(path)?;
    let marks = trace.recording.instants.iter().zip(&trace.truth.instants).map(|(known, truth)| Mark {
        t_s: known.t_s,
        base_m: known.base.origin().vector().push(0.0),
        contact_m: truth.contact.map(|contact| contact.vector().push(0.0)),
    });
    let mark = |row: &EstimateRow| Mark {
        t_s: row.t_s,
        base_m: na::Vector3::new(row.base_x_m, row.base_y_m, 0.0),
        contact_m: row.truth_contact_x_m.zip(row.truth_contact_y_m).map(|(x, y)| na::Vector3::new(x, y, 0.0)),
    };
    let of_time = estimates_by_time(path, marks, estimates, "a planar trace", mark)?;
    let sidecar = read(&path.with_extension("json"))?;
    let outline = match &trace.sidecar.contour {
        Some(contour) => Some((&contour.file, read(&path.with_file_name(&contour.file))?)),
        None => None,
    };
    let staging = Staging::new(folder)?;
    let mut writer = Writer::create(&staging.recording)?;
    for (known, truth) in trace.recording.instants.iter().zip(&trace.truth.instants) {
        let time_ns = time_ns(known.t_s, path)?;
        let mut row = Row { writer: &mut writer, time_ns, prefix: String::new() };
        row.known(known)?;
        row.truth(truth)?;
        if let Some(estimate) = of_time.get(&time_ns) {
            row.detected(known, estimate)?;
        }
    }
    writer.attach(&format!("{}.json", trace.sidecar.name), "application/json", &sidecar)?;
    if let Some((file, outline)) = outline {
        writer.attach(file, "text/csv", &outline)?;
    }
    writer.finish()?;
    staging.finish()
}

/// Result of an export.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Export {
    /// The recording was written.
    Written,
    /// The recording existed with the same bytes.
    UpToDate,
}

/// SHA-256 of each file of a folder, by name.
fn digests(folder: &Path) -> anyhow::Result<BTreeMap<OsString, String>> {
    let context = || folder.display().to_string();
    let entries = fs::read_dir(folder).with_context(context)?;
    entries
        .map(|entry| {
            let entry = entry.with_context(context)?;
            Ok((entry.file_name(), sha256_of_file(&entry.path())?))
        })
        .collect()
}

/// Hidden folder beside a recording, in which it is written. An export that is repeated after a kill removes the
/// incomplete recording.
struct Staging<'a> {
    folder: PathBuf,
    /// The recording in the hidden folder, under its own name.
    recording: PathBuf,
    target: &'a Path,
}

impl<'a> Staging<'a> {
    fn new(target: &'a Path) -> anyhow::Result<Self> {
        let name = target
            .file_name()
            .with_context(|| format!("{}: path: expected the name of a new folder", target.display()))?;
        let folder = target.with_file_name(format!(".{}.export", name.display()));
        let staging = Self { recording: folder.join(name), folder, target };
        staging.remove()?;
        Ok(staging)
    }

    /// Gives the complete recording its name, unless one with the same bytes has it already.
    fn finish(self) -> anyhow::Result<Export> {
        let target = self.target;
        if !target.exists() {
            fs::rename(&self.recording, target).with_context(|| target.display().to_string())?;
            self.remove()?;
            return Ok(Export::Written);
        }
        let same = target.is_dir() && digests(target)? == digests(&self.recording)?;
        self.remove()?;
        ensure!(same, "{}: path: found another file or folder of that name: rename or remove it", target.display());
        Ok(Export::UpToDate)
    }

    fn remove(&self) -> anyhow::Result<()> {
        match fs::remove_dir_all(&self.folder) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(error).with_context(|| self.folder.display().to_string())
            }
            _ => Ok(()),
        }
    }
}

/// Converts a recording to a trace, if it contains one, else to a log of the platform with the magnetometer's readings.
/// Returns the files written.
///
/// With `salvage` an interrupted recording is converted up to its end.
///
/// # Errors
/// If the recording cannot be read, or contains neither.
pub fn import(path: &Path, salvage: bool, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let reader = Reader::open(path)?;
    // An interrupted recording has no metadata at its end.
    let attachments = if salvage { reader.attachments().unwrap_or_default() } else { reader.attachments()? };
    for attachment in &attachments {
        if let Ok(sidecar) = serde_json::from_slice::<Value>(&attachment.data)
            && sidecar["kind"] == "trace"
        {
            if sidecar["format"] == SPATIAL_FORMAT {
                return import_spatial_trace(path, &reader, attachment, folder);
            }
            return import_trace(path, &reader, attachment, &attachments, folder);
        }
    }
    let sidecar = attachments.iter().find(|attachment| attachment.name == SIDECAR);
    if let Some(attachment) = sidecar {
        parsed::<LogSidecar>(path, attachment)?;
    }
    import_readings(path, &reader, sidecar, salvage, folder)
}

/// Messages of one row.
struct Row<'a> {
    writer: &'a mut Writer,
    time_ns: u64,
    /// Beginning of the names of its topics.
    prefix: String,
}

impl Row<'_> {
    fn known(&mut self, known: &Instant) -> anyhow::Result<()> {
        let yaw_rad = known.base.yaw_rad();
        let (header, transform) = (self.header(topics::WORLD), transform(&known.base));
        let base = TransformStamped { header, child_frame_id: topics::WHISKER.into(), transform };
        self.write(topics::TF, &TfMessage { transforms: vec![base] })?;
        let mut joints = JointState { header: self.header(""), ..JointState::default() };
        for (name, angle_rad) in [(YAW, Some(yaw_rad)), (ROTATION, known.rotation_z_rad)] {
            if let Some(angle_rad) = angle_rad {
                joints.name.push(name.into());
                joints.position.push(angle_rad);
            }
        }
        self.write(topics::JOINT_STATES, &joints)?;
        if let Some(twist) = known.twist {
            let linear = Vector3 { x: twist.vx_m_s, y: twist.vy_m_s, z: 0.0 };
            let twist = RosTwist { linear, angular: Vector3 { x: 0.0, y: 0.0, z: twist.wz_rad_s } };
            self.write(topics::BASE_TWIST, &TwistStamped { header: self.header(topics::WHISKER), twist })?;
        }
        self.moment(topics::WHISKER, known.moment_z_n_m)
    }

    /// Moment about the z axis of a whisker's frame.
    fn moment(&mut self, frame: &str, z: f64) -> anyhow::Result<()> {
        // The other components of the wrench are unknown, hence not zero.
        let unknown = f64::NAN;
        let wrench = Wrench {
            force: Vector3 { x: unknown, y: unknown, z: unknown },
            torque: Vector3 { x: unknown, y: unknown, z },
        };
        self.write(topics::MOMENT, &WrenchStamped { header: self.header(frame), wrench })
    }

    fn truth(&mut self, truth: &TruthInstant) -> anyhow::Result<()> {
        for (topic, flag) in [(TOUCHING, truth.touching), (TIP, truth.tip), (SPLIT, truth.split)] {
            if let Some(data) = flag {
                self.write(topic, &Bool { data })?;
            }
        }
        for (topic, point) in [(CONTACT, truth.contact), (SURFACE, truth.surface)] {
            if let Some(point) = point {
                let point = RosPoint { x: point.x(), y: point.y(), z: 0.0 };
                self.write(topic, &PointStamped { header: self.header(topics::WORLD), point })?;
            }
        }
        for (topic, number) in [(ARC, truth.arc_m), (FORCE, truth.force_n), (TANGENT, truth.tangent_rad)] {
            if let Some(data) = number {
                self.write(topic, &Float64 { data })?;
            }
        }
        Ok(())
    }

    /// Estimated contact in the whisker's frame.
    fn detected(&mut self, known: &Instant, estimate: &EstimateRow) -> anyhow::Result<()> {
        if let (Some(x), Some(y)) = (estimate.contact_x_m, estimate.contact_y_m) {
            let contact = known.base.inverse().apply(Point::<World>::new(x, y));
            let position = RosPoint { x: contact.x(), y: contact.y(), z: 0.0 };
            let pose = RosPose { position, orientation: Quaternion::about_z(0.0) };
            self.write(topics::DETECTED_CONTACT, &PoseStamped { header: self.header(topics::WHISKER), pose })?;
        }
        Ok(())
    }

    fn header(&self, frame: &str) -> Header {
        Header { stamp: Time::from_nanoseconds(self.time_ns), frame_id: frame.into() }
    }

    fn write(&mut self, topic: &str, message: &impl Message) -> anyhow::Result<()> {
        Ok(self.writer.write(&format!("{}{topic}", self.prefix), self.time_ns, message)?)
    }
}

/// Pose of a base in the plane as a transform.
fn transform(base: &Pose<Base, World>) -> Transform {
    let origin = base.origin();
    Transform {
        translation: Vector3 { x: origin.x(), y: origin.y(), z: 0.0 },
        rotation: Quaternion::about_z(base.yaw_rad()),
    }
}

fn import_trace(
    path: &Path,
    reader: &Reader,
    attachment: &Attachment,
    attachments: &[Attachment],
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let place = || place_of(path, attachment).display().to_string();
    let sidecar: Sidecar = parsed(path, attachment)?;
    check_name(path, attachment, &sidecar.name)?;
    let (recording, truth) = rows(reader)?;
    let trace = Trace { sidecar, recording, truth };
    let table = trace.to_csv();
    let mut further = Vec::new();
    if let Some(contour) = &trace.sidecar.contour {
        let key = || format!("{}: contour.file `{}`", place(), contour.file);
        ensure!(is_plain_name(&contour.file), "{}: expected a plain file name", key());
        let outline = attachments.iter().find(|attachment| attachment.name == contour.file);
        let outline = outline.with_context(|| format!("{}: found no attachment of that name", key()))?;
        ensure!(sha256(&outline.data) == contour.sha256, "{}: found another file than the sidecar means", key());
        further.push((contour.file.clone(), outline.data.as_slice()));
    }
    restore(path, attachment, &trace.sidecar.name, (&table, &trace.sidecar.csv_sha256), further, folder)
}

/// Writes the files of a trace: its table, which must have this hash, further files, and its attached sidecar.
fn restore(
    path: &Path,
    attachment: &Attachment,
    name: &str,
    (table, csv_sha256): (&str, &str),
    further: Vec<(String, &[u8])>,
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let found = sha256(table);
    ensure!(found == csv_sha256, "{}: messages: found a table of hash {found}, expected {csv_sha256}", path.display());
    let mut files = vec![(format!("{name}.csv"), table.as_bytes())];
    files.extend(further);
    // The sidecar is written last: it marks a complete trace.
    files.push((format!("{name}.json"), &attachment.data));
    files.iter().try_for_each(|(file, bytes)| check_replaces_same(&folder.join(file), bytes))?;
    let mut written = Vec::new();
    for (file, bytes) in files {
        let file = folder.join(file);
        write_atomically(&file, bytes)?;
        written.push(file);
    }
    Ok(written)
}

/// Checks the name of a trace, which becomes that of its files.
fn check_name(path: &Path, attachment: &Attachment, name: &str) -> anyhow::Result<()> {
    let place = place_of(path, attachment);
    ensure!(is_plain_name(name), "{}: name: found `{name}`, expected a plain file name", place.display());
    Ok(())
}

/// Contents of an instant by which a trace and its estimates agree.
struct Mark {
    /// Time (s).
    t_s: f64,
    /// Position of the base (m), 3x1.
    base_m: na::Vector3<f64>,
    /// True contact (m), 3x1, if it is known.
    contact_m: Option<na::Vector3<f64>>,
}

/// Largest distance between the same points of a trace and of its estimates (m).
const SAME_M: f64 = 1e-9;

/// Estimates of a trace by time (ns), from a table whose instants must be among those of the trace; empty without one.
///
/// Their true contacts must be those of the trace. If the trace states none, the positions of the base must be the same;
/// otherwise they may have the noise of joint encoders.
fn estimates_by_time<One: Default + Serialize + DeserializeOwned>(
    path: &Path,
    marks: impl Iterator<Item = Mark>,
    table: Option<&Path>,
    kind: &str,
    mark: impl Fn(&One) -> Mark,
) -> anyhow::Result<BTreeMap<u64, One>> {
    let mut of_time = BTreeMap::new();
    let Some(table) = table else { return Ok(of_time) };
    let known: BTreeMap<u64, Mark> =
        marks.map(|mark| Ok((time_ns(mark.t_s, path)?, mark))).collect::<anyhow::Result<_>>()?;
    let has_truth = known.values().any(|mark| mark.contact_m.is_some());
    for estimate in estimates_of(table, kind)? {
        let found = mark(&estimate);
        let time_ns = time_ns(found.t_s, table)?;
        let (place, t_s) = (table.display(), found.t_s);
        let Some(expected) = known.get(&time_ns) else {
            bail!("{place}: t_s: found {t_s} s, expected a time of {}", path.display());
        };
        let is_same = match (found.contact_m, expected.contact_m) {
            (Some(found_m), Some(expected_m)) => (found_m - expected_m).norm() <= SAME_M,
            (None, None) => has_truth || (found.base_m - expected.base_m).norm() <= SAME_M,
            _ => false,
        };
        let what = if has_truth { "true contact" } else { "position of the base" };
        ensure!(is_same, "{place}: {t_s} s: found another {what}, expected that of {}", path.display());
        ensure!(
            of_time.insert(time_ns, estimate).is_none(),
            "{place}: t_s: found {t_s} s twice, expected each time once"
        );
    }
    Ok(of_time)
}

/// Reads a table of estimates, whose columns must be those of the rows.
fn estimates_of<One: Default + Serialize + DeserializeOwned>(path: &Path, kind: &str) -> anyhow::Result<Vec<One>> {
    let expected = csv_bytes(&[One::default()])?;
    let header = |bytes: &[u8]| bytes.split(|byte| *byte == b'\n').next().map(<[u8]>::to_vec);
    ensure!(
        header(&read(path)?) == header(&expected),
        "{}:1: found other columns than those of the estimates of {kind}, expected a table of `whisker evaluate`",
        path.display()
    );
    read_rows(path)
}

/// Checks that a converted file replaces nothing but itself.
fn check_replaces_same(file: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    ensure!(
        fs::read(file).map_or(true, |found| found.is_empty() || found == bytes),
        "{}: found a file with other contents, which the conversion would replace; give another --out, or remove it",
        file.display()
    );
    Ok(())
}

/// Text of an attachment.
fn parsed<T: DeserializeOwned + Serialize>(path: &Path, attachment: &Attachment) -> Result<T, files::Error> {
    parse_json(&attachment.data).map_err(files::Error::json(&place_of(path, attachment)))
}

/// Name of an attachment in errors.
fn place_of(path: &Path, attachment: &Attachment) -> PathBuf {
    format!("{}: attachment {}", path.display(), attachment.name).into()
}

/// Rows of a trace: each begins with a frame of the base, and the messages of the same time belong to it.
fn rows(reader: &Reader) -> anyhow::Result<(Recording, Truth)> {
    let begin = |t_s, base: Transform| Instant {
        t_s,
        base: Pose::new(base.translation.x, base.translation.y, 0.0),
        twist: None,
        moment_z_n_m: f64::NAN,
        rotation_z_rad: None,
    };
    let (instants, truth) = rows_of(reader, begin, |record, message, known, truth| {
        take(&record.topic, message, known, truth);
        Ok(())
    })?;
    Ok((Recording { instants }, Truth { instants: truth }))
}

/// Known quantities and truth of each row of a trace, in the plane or in space. A row begins with the time and a frame of the base;
/// `take` receives the further messages of the same time.
fn rows_of<Known, Of: Default>(
    reader: &Reader,
    begin: impl Fn(f64, Transform) -> Known,
    take: impl Fn(&Record, AnyMessage, &mut Known, &mut Of) -> anyhow::Result<()>,
) -> anyhow::Result<(Vec<Known>, Vec<Of>)> {
    let (mut instants, mut truth) = (Vec::<Known>::new(), Vec::<Of>::new());
    let mut row_ns = None;
    for record in reader.records() {
        let record = record?;
        let Some(message) = record.decode_any()? else { continue };
        if record.topic == topics::TF {
            instants.push(begin(seconds(record.time_ns), base_of(&record, message)?));
            truth.push(Of::default());
            row_ns = Some(record.time_ns);
            continue;
        }
        let (Some(known), Some(truth)) = (instants.last_mut(), truth.last_mut()) else {
            bail!(record.wrong("a message before any of /tf", "the base's frame first"));
        };
        if row_ns != Some(record.time_ns) {
            bail!(record.wrong(format!("{} ns", record.time_ns), "the time of the last message of /tf"));
        }
        take(&record, message, known, truth)?;
    }
    Ok((instants, truth))
}

/// Pose of the base in a message, which must contain no other frame.
fn base_of(record: &Record, message: AnyMessage) -> anyhow::Result<Transform> {
    if let AnyMessage::TfMessage(frames) = message
        && let [base] = frames.transforms.as_slice()
        && base.child_frame_id == topics::WHISKER
    {
        return Ok(base.transform.clone());
    }
    Err(record.wrong("other frames", format!("that of {} alone", topics::WHISKER)).into())
}

/// Enters a message into its row. Messages that are not part of a trace, such as estimated contacts, are ignored.
fn take(topic: &str, message: AnyMessage, known: &mut Instant, truth: &mut TruthInstant) {
    match (topic, message) {
        (topics::JOINT_STATES, AnyMessage::JointState(joints)) => {
            for (name, angle_rad) in joints.name.iter().zip(joints.position) {
                if name == YAW {
                    let origin = known.base.origin();
                    known.base = Pose::new(origin.x(), origin.y(), angle_rad);
                } else if name == ROTATION {
                    known.rotation_z_rad = Some(angle_rad);
                }
            }
        }
        (topics::BASE_TWIST, AnyMessage::TwistStamped(TwistStamped { twist, .. })) => {
            let (linear, angular) = (twist.linear, twist.angular);
            known.twist = Some(Twist { vx_m_s: linear.x, vy_m_s: linear.y, wz_rad_s: angular.z });
        }
        (topics::MOMENT, AnyMessage::WrenchStamped(moment)) => known.moment_z_n_m = moment.wrench.torque.z,
        (TOUCHING, AnyMessage::Bool(flag)) => truth.touching = Some(flag.data),
        (TIP, AnyMessage::Bool(flag)) => truth.tip = Some(flag.data),
        (SPLIT, AnyMessage::Bool(flag)) => truth.split = Some(flag.data),
        (CONTACT, AnyMessage::PointStamped(contact)) => truth.contact = Some(point(&contact)),
        (SURFACE, AnyMessage::PointStamped(surface)) => truth.surface = Some(point(&surface)),
        (ARC, AnyMessage::Float64(number)) => truth.arc_m = Some(number.data),
        (FORCE, AnyMessage::Float64(number)) => truth.force_n = Some(number.data),
        (TANGENT, AnyMessage::Float64(number)) => truth.tangent_rad = Some(number.data),
        _ => {}
    }
}

fn point(message: &PointStamped) -> Point<World> {
    Point::new(message.point.x, message.point.y)
}

/// Writes the readings of a magnetometer as a log. Without the sidecar of a log, as in foreign recordings, time counts
/// from the first reading, and pushes are unknown.
fn import_readings(
    path: &Path,
    reader: &Reader,
    sidecar: Option<&Attachment>,
    salvage: bool,
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut table = String::from("t_s,x_counts,y_counts,z_counts\n");
    let mut first_ns = sidecar.map(|_| 0);
    let mut last_ns = i64::MIN;
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) if salvage => {
                eprintln!("warning: {error}");
                break;
            }
            Err(error) => return Err(error.into()),
        };
        if record.topic != topics::MAGNETOMETER {
            continue;
        }
        for field in record.decode::<MagneticFieldArray>()?.magnetic_field_array {
            let stamp_ns = field.header.stamp.nanoseconds();
            if stamp_ns < last_ns {
                bail!(record.wrong(format!("a stamp of {stamp_ns} ns"), format!("none before the last, {last_ns} ns")));
            }
            last_ns = stamp_ns;
            let t_s = (stamp_ns - *first_ns.get_or_insert(stamp_ns)) as f64 / 1e9;
            let axes = field.magnetic_field;
            let mut counts = [0_u16; 3];
            for (count, value) in counts.iter_mut().zip([axes.x, axes.y, axes.z]) {
                if value.fract() != 0.0 || !(0.0..=f64::from(u16::MAX)).contains(&value) {
                    bail!(record.wrong(value, "the counts of a sensor, whole numbers from 0 to 65535"));
                }
                *count = value as u16;
            }
            let [x, y, z] = counts;
            table.push_str(&format!("{t_s:.6},{x},{y},{z}\n"));
        }
    }
    let Some(_) = first_ns.filter(|_| table.lines().nth(1).is_some()) else {
        bail!(
            "{}: found neither a trace nor readings on {}, expected one of them",
            path.display(),
            topics::MAGNETOMETER
        );
    };
    let files = [folder.join(SIDECAR), folder.join("log.csv")];
    check_replaces_same(&files[1], table.as_bytes())?;
    if let Some(attachment) = sidecar {
        check_replaces_same(&files[0], &attachment.data)?;
    }
    match sidecar {
        Some(attachment) => write_atomically(&files[0], &attachment.data)?,
        // Contacts may have been added to the sidecar of this table.
        None if files.iter().all(|file| file.is_file()) => {}
        None => {
            // Format and rate of OpenWhisker's driver; its recordings do not contain them.
            let format = platform::sensor::format("hex").expect("the platform's own format is registered");
            let mark = watermark([sha256(&table).as_str()]);
            write_json(&files[0], &LogSidecar::new(format.name, format.rate_hz, mark))?;
        }
    }
    // The table is written last: it marks a complete log.
    write_atomically(&files[1], table.as_bytes())?;
    Ok(files.into())
}

/// Time since the beginning of the trace (ns), from whole microseconds.
fn time_ns(t_s: f64, path: &Path) -> anyhow::Result<u64> {
    ensure!(t_s >= 0.0, "{}: t_s: found {t_s}, expected a time of 0 or more: messages have no other", path.display());
    Ok(1000 * (1e6 * t_s).round() as u64)
}

fn seconds(time_ns: u64) -> f64 {
    (time_ns / 1000) as f64 / 1e6
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    Ok(fs::read(path).map_err(files::Error::io(path))?)
}
