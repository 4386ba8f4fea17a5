//! Traces in the plane as ROS 2 recordings, and back.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use bag::messages::{
    AnyMessage, Bool, Float64, JointState, Point as RosPoint, PointStamped, Pose as RosPose, PoseStamped, Quaternion,
    TfMessage, Transform, TransformStamped, Twist as RosTwist, TwistStamped, Vector3, Wrench, WrenchStamped,
};
use bag::{Attachment, Reader, Writer, topics};
use files::sha256;
use nalgebra as na;
use testbed::results::EstimateRow;
use trace::{Instant, Recording, Sidecar, Trace, Truth, TruthInstant, is_plain_name};
use whisker::frames::{Base, Point, Pose, Twist, World};

use super::estimates::{Mark, estimates_by_time};
use super::read;
use super::restore::{check_name, parsed, place_of, restore};
use super::rows::{Row, rows_of, time_ns};
use super::staging::{Export, Staging};
use super::truth_topics::{ARC, CONTACT, FORCE, SPLIT, SURFACE, TANGENT, TIP, TOUCHING};

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
    pub(super) fn moment(&mut self, frame: &str, z: f64) -> anyhow::Result<()> {
        // The other components of the wrench are unknown, hence not zero.
        let unknown = f64::NAN;
        let wrench = Wrench {
            force: Vector3 { x: unknown, y: unknown, z: unknown },
            torque: Vector3 { x: unknown, y: unknown, z },
        };
        self.write(topics::MOMENT, &WrenchStamped { header: self.header(frame), wrench })
    }

    pub(super) fn truth(&mut self, truth: &TruthInstant) -> anyhow::Result<()> {
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
}

/// Pose of a base in the plane as a transform.
pub(super) fn transform(base: &Pose<Base, World>) -> Transform {
    let origin = base.origin();
    Transform {
        translation: Vector3 { x: origin.x(), y: origin.y(), z: 0.0 },
        rotation: Quaternion::about_z(base.yaw_rad()),
    }
}

/// Restores a trace from its messages and attachments.
pub(super) fn import_trace(
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
