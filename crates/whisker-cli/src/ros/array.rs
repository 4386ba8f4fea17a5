//! Conversion of an array recording, several whiskers on one arm, to a ROS 2 recording.

use std::path::Path;

use anyhow::Context;
use bag::messages::{JointState, TfMessage, TransformStamped, Vector3};
use bag::{Writer, topics};
use trace::{ArrayRecording, JointInstant, MountedWhisker, Trace};

use super::plane::transform;
use super::rows::{Row, time_ns};
use super::staging::{Export, Staging};

/// Writes an array recording: the angles of the arm's joints, the frames of the whiskers' bases, and for each whisker its
/// moment and its true contacts, the topics after `/<whisker>`.
///
/// # Errors
/// As [`super::export_trace`].
pub fn export_array(path: &Path, folder: &Path) -> anyhow::Result<Export> {
    let recording = ArrayRecording::read(path)?;
    let folder_of_traces = path.parent().unwrap_or(Path::new(""));
    let mut traces = Vec::new();
    for whisker in &recording.sidecar.whiskers {
        let file = folder_of_traces.join(format!("{}.csv", whisker.trace));
        let trace = Trace::read(&file)?;
        recording.check(&file, &trace)?;
        traces.push(trace);
    }
    let arm = &recording.sidecar.arm;
    let heights_m: Vec<Vec<f64>> =
        recording.sidecar.whiskers.iter().map(|whisker| arm.heights_m(&whisker.mount, &recording.joints)).collect();
    let staging = Staging::new(folder)?;
    let mut writer = Writer::create(&staging.recording)?;
    for (place, joints) in recording.joints.iter().enumerate() {
        let time_ns = time_ns(joints.t_s, path)?;
        let mut row = Row { writer: &mut writer, time_ns, prefix: String::new() };
        row.write(topics::JOINT_STATES, &joint_state(&row, &arm.name, joints))?;
        let mut frames = TfMessage::default();
        for ((whisker, trace), heights_m) in recording.sidecar.whiskers.iter().zip(&traces).zip(&heights_m) {
            frames.transforms.push(base(&row, whisker, &trace.recording.instants[place], heights_m[place]));
        }
        row.write(topics::TF, &frames)?;
        for (whisker, trace) in recording.sidecar.whiskers.iter().zip(&traces) {
            row.prefix = format!("/{}", whisker.name);
            row.moment(&frame_of(whisker), trace.recording.instants[place].moment_z_n_m)?;
            row.truth(&trace.truth.instants[place])?;
        }
    }
    let sidecar = std::fs::read(path).with_context(|| path.display().to_string())?;
    writer.attach(&format!("{}.json", recording.sidecar.name), "application/json", &sidecar)?;
    writer.finish()?;
    staging.finish()
}

/// Name of the frame of a whisker's base.
fn frame_of(whisker: &MountedWhisker) -> String {
    format!("{}_base", whisker.name)
}

fn joint_state(row: &Row<'_>, arm: &str, joints: &JointInstant) -> JointState {
    JointState {
        header: row.header(""),
        name: (1..=joints.angles_rad.len()).map(|joint| format!("{arm}_joint{joint}")).collect(),
        position: joints.angles_rad.into(),
        velocity: joints.rates_rad_s.into(),
        effort: Vec::new(),
    }
}

/// Frame of a base: the pose of its trace, at its height above the origin of World.
fn base(row: &Row<'_>, whisker: &MountedWhisker, known: &trace::Instant, height_m: f64) -> TransformStamped {
    let mut transform = transform(&known.base);
    transform.translation = Vector3 { z: height_m, ..transform.translation };
    TransformStamped { header: row.header(topics::WORLD), child_frame_id: frame_of(whisker), transform }
}
