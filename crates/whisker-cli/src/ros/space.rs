//! Traces in space as ROS 2 recordings, and back.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use bag::messages::{
    AnyMessage, Bool, Float64, JointState, PointStamped, Pose as RosPose, PoseStamped, PoseWithCovariance,
    PoseWithCovarianceStamped, Quaternion, Text, TfMessage, Transform, TransformStamped, Twist as RosTwist,
    TwistStamped, Vector3Stamped, Wrench, WrenchStamped,
};
use bag::messages::{Point as RosPoint, Vector3};
use bag::{Attachment, Reader, Record, Writer, topics};
use nalgebra::{self as na, UnitQuaternion};
use testbed::space::{SpatialEstimateRow, turned_to};
use trace::{
    Feature, SpatialContactTruth, SpatialInstant, SpatialPose, SpatialRecording, SpatialSidecar, SpatialTrace,
    SpatialTruth, SpatialTruthInstant, SpatialTwist,
};

use super::estimates::{Mark, estimates_by_time};
use super::read;
use super::restore::{check_name, parsed, restore};
use super::rows::{Row, rows_of, time_ns};
use super::staging::{Export, Staging};
use super::truth_topics::{ARC, CONTACT, SPLIT, SURFACE, TIP, TOUCHING};

const NORMAL: &str = "/truth/normal";
const FEATURE: &str = "/truth/feature";
const FORCE_VECTOR: &str = "/truth/force";
const TANGENT_VECTOR: &str = "/truth/tangent";
const DETECTED_COVARIANCE: &str = "/detected_contact_covariance";

/// Topics of the true contact. A row whose contact is not known has none of them.
const OF_CONTACT: [&str; 9] = [TIP, SPLIT, FEATURE, CONTACT, SURFACE, NORMAL, FORCE_VECTOR, TANGENT_VECTOR, ARC];

/// Joint names of the rotation of the whisker's root.
const ROOT: [&str; 3] = ["root_yaw", "root_pitch", "root_twist"];

/// Names of the features of a surface.
const FEATURES: [(&str, Feature); 3] = [("face", Feature::Face), ("edge", Feature::Edge), ("corner", Feature::Corner)];

/// Writes a trace in space as a recording, with the contacts of an estimator if its table of estimates is given.
///
/// # Errors
/// If trace or estimates cannot be read or do not belong together, if the recording cannot be written, or if another file or
/// recording has its name.
pub fn export_spatial_trace(path: &Path, estimates: Option<&Path>, folder: &Path) -> anyhow::Result<Export> {
    let trace = SpatialTrace::read(path)?;
    let marks = trace.recording.instants.iter().zip(&trace.truth.instants).map(|(known, truth)| Mark {
        t_s: known.t_s,
        base_m: known.base.position,
        contact_m: truth.contact_m(),
    });
    let mark = |row: &SpatialEstimateRow| Mark { t_s: row.t_s, base_m: row.base_m(), contact_m: row.truth_contact_m() };
    let of_time = estimates_by_time(path, marks, estimates, "a trace in space", mark)?;
    let sidecar = read(&path.with_extension("json"))?;
    let staging = Staging::new(folder)?;
    let mut writer = Writer::create(&staging.recording)?;
    for (known, truth) in trace.recording.instants.iter().zip(&trace.truth.instants) {
        let time_ns = time_ns(known.t_s, path)?;
        let mut row = Row { writer: &mut writer, time_ns, prefix: String::new() };
        row.known_in_space(known)?;
        row.truth_in_space(truth)?;
        if let Some(estimate) = of_time.get(&time_ns) {
            row.detected_in_space(known, estimate)?;
        }
    }
    writer.attach(&format!("{}.json", trace.sidecar.name), "application/json", &sidecar)?;
    writer.finish()?;
    staging.finish()
}

impl Row<'_> {
    fn known_in_space(&mut self, known: &SpatialInstant) -> anyhow::Result<()> {
        let SpatialPose { position, rotation } = known.base;
        let transform = Transform { translation: vector(&position), rotation: quaternion(&rotation) };
        let header = self.header(topics::WORLD);
        let base = TransformStamped { header, child_frame_id: topics::WHISKER.into(), transform };
        self.write(topics::TF, &TfMessage { transforms: vec![base] })?;
        if let Some(angles_rad) = known.rotation {
            let (name, position) = (ROOT.map(Into::into).into(), angles_rad.as_slice().into());
            self.write(
                topics::JOINT_STATES,
                &JointState { header: self.header(""), name, position, ..JointState::default() },
            )?;
        }
        if let Some(SpatialTwist { linear, angular }) = known.twist {
            let twist = RosTwist { linear: vector(&linear), angular: vector(&angular) };
            self.write(topics::BASE_TWIST, &TwistStamped { header: self.header(topics::WHISKER), twist })?;
        }
        // Unknown components are not zero.
        let unknown = f64::NAN;
        let wrench = Wrench {
            force: Vector3 { x: known.force_x_n.unwrap_or(unknown), y: unknown, z: unknown },
            torque: Vector3 { x: known.moment_x_n_m.unwrap_or(unknown), y: known.moment_y_n_m, z: known.moment_z_n_m },
        };
        self.write(topics::MOMENT, &WrenchStamped { header: self.header(topics::WHISKER), wrench })
    }

    fn truth_in_space(&mut self, truth: &SpatialTruthInstant) -> anyhow::Result<()> {
        if let Some(data) = truth.touching {
            self.write(TOUCHING, &Bool { data })?;
        }
        if let Some(place) = &truth.place {
            self.write(CONTACT, &PointStamped { header: self.header(topics::WORLD), point: point(place) })?;
        }
        let Some(contact) = &truth.contact else { return Ok(()) };
        for (topic, data) in [(TIP, contact.tip), (SPLIT, contact.split)] {
            self.write(topic, &Bool { data })?;
        }
        let (name, _) = FEATURES[contact.feature as usize];
        self.write(FEATURE, &Text { data: name.into() })?;
        for (topic, at) in [(CONTACT, &contact.contact), (SURFACE, &contact.surface)] {
            self.write(topic, &PointStamped { header: self.header(topics::WORLD), point: point(at) })?;
        }
        for (topic, of) in
            [(NORMAL, &contact.normal), (FORCE_VECTOR, &contact.force), (TANGENT_VECTOR, &contact.tangent)]
        {
            self.write(topic, &Vector3Stamped { header: self.header(topics::WORLD), vector: vector(of) })?;
        }
        self.write(ARC, &Float64 { data: contact.arc_m })
    }

    /// Estimated contact in the whisker's frame; its x axis is the normal out of the object.
    fn detected_in_space(&mut self, known: &SpatialInstant, estimate: &SpatialEstimateRow) -> anyhow::Result<()> {
        let (Some(contact), Some(normal)) = (estimate.contact_m(), estimate.normal()) else { return Ok(()) };
        let SpatialPose { position, rotation } = known.base;
        let at = rotation.inverse() * (contact - position);
        let normal = rotation.inverse() * normal;
        let pose = RosPose { position: point(&at), orientation: quaternion(&turned_to(&normal)) };
        let stamped = PoseStamped { header: self.header(topics::WHISKER), pose: pose.clone() };
        self.write(topics::DETECTED_CONTACT, &stamped)?;
        let Some(covariance) = estimate.covariance_m2() else { return Ok(()) };
        let to_base = rotation.inverse().to_rotation_matrix();
        let in_base = to_base * covariance * to_base.inverse();
        let in_base = (in_base + in_base.transpose()) * 0.5;
        // That of the orientation is not in the table.
        let mut covariance = [[0.0; 6]; 6];
        for (i, row) in covariance.iter_mut().take(3).enumerate() {
            (row[0], row[1], row[2]) = (in_base[(i, 0)], in_base[(i, 1)], in_base[(i, 2)]);
        }
        let pose = PoseWithCovariance { pose, covariance };
        self.write(DETECTED_COVARIANCE, &PoseWithCovarianceStamped { header: self.header(topics::WHISKER), pose })
    }
}

/// Restores a trace in space from its messages.
pub(super) fn import_spatial_trace(
    path: &Path,
    reader: &Reader,
    attachment: &Attachment,
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let sidecar: SpatialSidecar = parsed(path, attachment)?;
    check_name(path, attachment, &sidecar.name)?;
    let (recording, truth) = rows(reader)?;
    let trace = SpatialTrace { sidecar, recording, truth };
    let table = trace.to_csv();
    let SpatialSidecar { name, csv_sha256, .. } = &trace.sidecar;
    restore(path, attachment, name, (&table, csv_sha256), Vec::new(), folder)
}

/// Rows of a trace in space.
fn rows(reader: &Reader) -> anyhow::Result<(SpatialRecording, SpatialTruth)> {
    let begin = |t_s, Transform { translation, rotation }: Transform| {
        let rotation = na::Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
        // As written: normalising would change the last decimals of the table.
        let rotation = UnitQuaternion::new_unchecked(rotation);
        SpatialInstant {
            t_s,
            base: SpatialPose { position: of_vector(&translation), rotation },
            twist: None,
            moment_x_n_m: None,
            moment_y_n_m: f64::NAN,
            moment_z_n_m: f64::NAN,
            force_x_n: None,
            rotation: None,
        }
    };
    let (instants, mut truth) = rows_of(reader, begin, |record, message, known, truth: &mut SpatialTruthInstant| {
        if OF_CONTACT.contains(&record.topic.as_str()) {
            take_contact(record, message, truth.contact.get_or_insert(EMPTY))
        } else {
            take(record, message, known, truth)
        }
    })?;
    for truth in &mut truth {
        // A contact without a normal is one of which the place alone is known.
        if let Some(contact) = truth.contact.take_if(|contact| contact.normal == EMPTY.normal) {
            truth.place = Some(contact.contact);
        }
    }
    Ok((SpatialRecording { instants }, SpatialTruth { instants: truth }))
}

/// Enters a message into its row. Messages that are not part of a trace, such as estimated contacts, are ignored.
fn take(
    record: &Record,
    message: AnyMessage,
    known: &mut SpatialInstant,
    truth: &mut SpatialTruthInstant,
) -> anyhow::Result<()> {
    match (record.topic.as_str(), message) {
        (topics::JOINT_STATES, AnyMessage::JointState(joints)) => {
            let is_root = joints.name.iter().eq(ROOT.iter());
            ensure!(
                is_root && joints.position.len() == ROOT.len(),
                record.wrong("other joints", format!("{} with their angles", ROOT.join(", ")))
            );
            known.rotation = Some(na::Vector3::from_column_slice(&joints.position));
        }
        (topics::BASE_TWIST, AnyMessage::TwistStamped(TwistStamped { twist, .. })) => {
            known.twist = Some(SpatialTwist { linear: of_vector(&twist.linear), angular: of_vector(&twist.angular) });
        }
        (topics::MOMENT, AnyMessage::WrenchStamped(WrenchStamped { wrench, .. })) => {
            let stated = |value: f64| (!value.is_nan()).then_some(value);
            known.moment_x_n_m = stated(wrench.torque.x);
            (known.moment_y_n_m, known.moment_z_n_m) = (wrench.torque.y, wrench.torque.z);
            known.force_x_n = stated(wrench.force.x);
        }
        (TOUCHING, AnyMessage::Bool(flag)) => truth.touching = Some(flag.data),
        _ => {}
    }
    Ok(())
}

/// Enters a message about the true contact.
fn take_contact(record: &Record, message: AnyMessage, contact: &mut SpatialContactTruth) -> anyhow::Result<()> {
    match (record.topic.as_str(), message) {
        (TIP, AnyMessage::Bool(flag)) => contact.tip = flag.data,
        (SPLIT, AnyMessage::Bool(flag)) => contact.split = flag.data,
        (FEATURE, AnyMessage::Text(text)) => {
            let feature = FEATURES.iter().find(|(name, _)| *name == text.data);
            let Some((_, feature)) = feature else { bail!(record.wrong(text.data, "face, edge or corner")) };
            contact.feature = *feature;
        }
        (CONTACT, AnyMessage::PointStamped(at)) => contact.contact = of_point(&at.point),
        (SURFACE, AnyMessage::PointStamped(at)) => contact.surface = of_point(&at.point),
        (NORMAL, AnyMessage::Vector3Stamped(of)) => contact.normal = of_vector(&of.vector),
        (FORCE_VECTOR, AnyMessage::Vector3Stamped(of)) => contact.force = of_vector(&of.vector),
        (TANGENT_VECTOR, AnyMessage::Vector3Stamped(of)) => contact.tangent = of_vector(&of.vector),
        (ARC, AnyMessage::Float64(number)) => contact.arc_m = number.data,
        _ => {}
    }
    Ok(())
}

/// A contact before its messages.
const EMPTY: SpatialContactTruth = SpatialContactTruth {
    tip: false,
    split: false,
    feature: Feature::Face,
    contact: na::Vector3::new(0.0, 0.0, 0.0),
    surface: na::Vector3::new(0.0, 0.0, 0.0),
    normal: na::Vector3::new(0.0, 0.0, 0.0),
    arc_m: 0.0,
    force: na::Vector3::new(0.0, 0.0, 0.0),
    tangent: na::Vector3::new(0.0, 0.0, 0.0),
};

fn vector(of: &na::Vector3<f64>) -> Vector3 {
    Vector3 { x: of.x, y: of.y, z: of.z }
}

fn point(at: &na::Vector3<f64>) -> RosPoint {
    RosPoint { x: at.x, y: at.y, z: at.z }
}

fn quaternion(of: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion { x: of.i, y: of.j, z: of.k, w: of.w }
}

fn of_vector(of: &Vector3) -> na::Vector3<f64> {
    na::Vector3::new(of.x, of.y, of.z)
}

fn of_point(at: &RosPoint) -> na::Vector3<f64> {
    na::Vector3::new(at.x, at.y, at.z)
}
