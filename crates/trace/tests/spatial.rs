//! Traces in space: the golden trace of the Python generator, its physics, and damaged files.

use std::fs;
use std::path::{Path, PathBuf};

use files::sha256;
use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Value, json};
use trace::{SPATIAL_COLUMNS, Sidecar, SpatialSidecar, SpatialTrace, Trace, is_spatial};
use whisker::rod::SpatialLoad;

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space/golden_space.csv")
}

/// Error of the golden trace after changes of its rows and its sidecar.
fn damaged(change_csv: impl Fn(String) -> String, change_sidecar: impl Fn(&mut Value)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("golden_space.csv");
    let csv = change_csv(fs::read_to_string(golden()).unwrap());
    let mut sidecar: Value = serde_json::from_slice(&fs::read(golden().with_extension("json")).unwrap()).unwrap();
    sidecar["csv_sha256"] = json!(sha256(&csv));
    change_sidecar(&mut sidecar);
    fs::write(&path, csv).unwrap();
    fs::write(path.with_extension("json"), serde_json::to_vec_pretty(&sidecar).unwrap()).unwrap();
    let message = SpatialTrace::read(&path).unwrap_err().to_string();
    assert!(!message.contains('\n') && message.contains("golden_space"), "{message}");
    message
}

/// Replaces the field of a column in line 3.
fn with_field(csv: &str, column: &str, value: &str) -> String {
    let i = SPATIAL_COLUMNS.iter().position(|(name, _)| *name == column).unwrap();
    let mut lines: Vec<String> = csv.lines().map(str::to_owned).collect();
    let mut cells: Vec<&str> = lines[2].split(',').collect();
    cells[i] = value;
    lines[2] = cells.join(",");
    lines.join("\n") + "\n"
}

#[test]
fn regress_rewriting_preserves_the_bytes_of_the_golden_trace() {
    let trace = SpatialTrace::read(&golden()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let written = trace.write(folder.path()).unwrap();
    for extension in ["csv", "json"] {
        let old = fs::read(golden().with_extension(extension)).unwrap();
        let new = fs::read(written.with_extension(extension)).unwrap();
        assert!(old == new, "golden_space.{extension} changes when it is rewritten");
    }
}

#[test]
fn val_the_golden_trace_agrees_with_its_own_kinematics() {
    let trace = SpatialTrace::read(&golden()).unwrap();
    for pair in trace.recording.instants.windows(2) {
        let (from, to) = (&pair[0], &pair[1]);
        let twist = from.twist.expect("a twist");
        let dt_s = to.t_s - from.t_s;
        let moved = from.base.position + from.base.rotation * (dt_s * twist.linear);
        assert!((moved - to.base.position).norm() < 2e-5, "at {} s", to.t_s);
        let turned = from.base.rotation * UnitQuaternion::from_scaled_axis(dt_s * twist.angular);
        assert!(turned.angle_to(&to.base.rotation) < 1e-4, "at {} s", to.t_s);
    }
}

/// The rod of this crate under the force of the trace, at rest: contact, tangent and moment.
#[test]
fn val_the_golden_trace_agrees_with_the_rod() {
    let trace = SpatialTrace::read(&golden()).unwrap();
    let rod = trace.sidecar.rod().unwrap();
    let pushed = trace.truth.instants.iter().zip(&trace.recording.instants);
    let largest = pushed.clone().map(|(_, known)| known.moment_z_n_m.abs()).fold(0.0, f64::max);
    let mut compared = 0;
    // At the end of the rest in the middle of the push.
    for (truth, known) in pushed.filter(|(_, known)| (2.55..2.65).contains(&known.t_s)) {
        let contact = truth.contact.expect("a contact");
        let to_base = known.base.rotation.inverse();
        let point = to_base * (contact.contact - known.base.position);
        let found = rod.at_point(point).unwrap();
        assert!((found.load.arc_m - contact.arc_m).abs() < 2e-5);
        let force: Vector3<f64> = to_base * contact.force;
        let moment = Vector3::new(known.moment_x_n_m.unwrap(), known.moment_y_n_m, known.moment_z_n_m);
        let exact = rod.deflect(SpatialLoad { arc_m: found.load.arc_m, force_n: found.load.force_n }).unwrap();
        assert!((exact.moment_n_m - moment).norm() < 2e-3 * largest, "{} and {moment}", exact.moment_n_m);
        assert!((exact.force_n - force).norm() < 5e-3 * force.norm());
        assert!((contact.normal.dot(&contact.tangent)).abs() < 1e-6);
        compared += 1;
    }
    assert!(compared > 5);
}

#[test]
fn robust_damaged_traces_are_one_error_with_file_line_and_column() {
    let keep = |_: &mut Value| {};
    let field = |column: &'static str, value: &'static str| move |csv: String| with_field(&csv, column, value);
    let cases = [
        (damaged(field("base_qw", "0.9"), keep), vec![":3: column base_qw", "unit quaternion", "norm"]),
        (damaged(field("base_qx", ""), keep), vec![":3: column base_qx", "empty field", "a number"]),
        (damaged(field("moment_y_n_m", ""), keep), vec![":3: column moment_y_n_m"]),
        (damaged(field("base_vy_m_s", ""), keep), vec![":3: column base_vy_m_s"]),
        (damaged(field("moment_z_n_m", "nan"), keep), vec![":3: column moment_z_n_m", "nan"]),
        (damaged(field("base_x_m", "inf"), keep), vec![":3: column base_x_m", "inf"]),
        (damaged(field("base_z_m", "1e5"), keep), vec![":3: column base_z_m", "at most 1000"]),
        (damaged(field("truth_feature", "1"), keep), vec![":3: column truth_feature", "while truth_touching is 0"]),
        (damaged(field("t_s", "-1"), keep), vec![":3: column t_s", "order of time"]),
        (damaged(|csv| csv.replacen("base_qz", "base_yaw_rad", 1), keep), vec![":1: header, column 8", "`base_qz`"]),
        (damaged(|csv| csv.replacen(",base_z_m", "", 1), keep), vec![":1: header, column 4", "`base_z_m`"]),
        (damaged(|csv| csv.replacen("\n0.0", "\n0,0.0", 1), keep), vec![":2: row", "42 fields", "41 fields"]),
        (damaged(|_| String::new(), keep), vec![":1: header", "an empty file"]),
        (damaged(|csv| csv, |sidecar| sidecar["rows"] = json!(7)), vec!["expected 7 rows"]),
        (damaged(|csv| csv, |sidecar| sidecar["csv_sha256"] = json!("0")), vec!["sha256"]),
        (damaged(|csv| csv, |sidecar| sidecar["poisson_ratio"] = json!(2.0)), vec!["poisson_ratio", "found 2"]),
        (
            damaged(|csv| csv, |sidecar| sidecar["suspension"]["twist_n_m_rad"] = json!(0.0)),
            vec!["suspension.twist_n_m_rad"],
        ),
        (damaged(|csv| csv, |sidecar| sidecar["whisker"]["length_m"] = json!(-1.0)), vec!["whisker.", "found -1"]),
    ];
    for (message, words) in cases {
        assert!(words.iter().all(|word| message.contains(word)), "{message} lacks one of {words:?}");
    }
}

#[test]
fn robust_each_reader_names_the_other_kind_of_trace() {
    let planar = golden().with_file_name("../golden_pin.csv");
    assert!(is_spatial(&golden()).unwrap() && !is_spatial(&planar).unwrap());
    let message = Sidecar::read(&golden()).unwrap_err().to_string();
    assert!(message.contains("golden_space.json:2:3: format: found 2, a trace in space, expected 1"), "{message}");
    assert_eq!(Trace::read(&golden()).unwrap_err().to_string(), message);
    let message = SpatialSidecar::read(&planar).unwrap_err().to_string();
    assert!(message.contains("golden_pin.json:2:3: format: found 1, a planar trace, expected 2"), "{message}");
}
