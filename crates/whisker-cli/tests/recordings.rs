//! Array recordings, from the files to the maps.
//!
//! The arm is planar: three of its seven joints move (two links and the hand). It carries copies of one whisker side by
//! side along the sweep of a golden trace. Since the hand does not rotate, all have the same motion, and each sweeps
//! over its own copy of the disc.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::slice;

use evaluation::evaluate::{EvaluateSettings, Evaluated, evaluate};
use evaluation::fit::{FitSettings, Models, fit};
use files::{sha256, write_json};
use indicatif::ProgressBar;
use serde_json::{Value, json};
use testbed::dataset::Dataset;
use testbed::encoders::Encoders;
use testbed::results::{EstimateRow, GridRow, MapObjectRow, MapPointRow, MapRow, Run, read_rows};
use trace::{Outline, Role, Trace};
use whisker::frames::{Point, Pose, World};

/// Name of the recording; its whiskers with array and offset along World's x, which is also that of the disc.
const NAME: &str = "scene_00";
const WHISKERS: [(&str, &str, f64); 2] = [("left_1", "left", 0.0), ("left_2", "left", 0.12)];

/// Length of each link.
const LINK_M: f64 = 0.3;

/// Position of the arm's base in World.
const BASE: [f64; 2] = [-0.4, -0.2];

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden")
}

/// Inverse kinematics: joint angles that move the hand along a trace.
fn joints(trace: &Trace) -> Vec<[f64; 7]> {
    let angles = |instant: &trace::Instant| {
        let at = instant.base.origin();
        let (x, y) = (at.x() - BASE[0], at.y() - BASE[1]);
        let elbow = ((x * x + y * y) / (2.0 * LINK_M * LINK_M) - 1.0).acos();
        let shoulder = y.atan2(x) - 0.5 * elbow;
        [shoulder, elbow, instant.base.yaw_rad() - shoulder - elbow, 0.0, 0.0, 0.0, 0.0]
    };
    trace.recording.instants.iter().map(angles).collect()
}

/// Joint rates for the twist of the base.
fn rates(instant: &trace::Instant, angles: &[f64; 7]) -> [f64; 7] {
    let twist = instant.twist.unwrap();
    let velocity = instant.base.rotation() * nalgebra::Vector2::new(twist.vx_m_s, twist.vy_m_s);
    let (first, second) = (angles[0], angles[0] + angles[1]);
    let jacobian = nalgebra::Matrix2::new(
        -LINK_M * (first.sin() + second.sin()),
        -LINK_M * second.sin(),
        LINK_M * (first.cos() + second.cos()),
        LINK_M * second.cos(),
    );
    let rates = jacobian.try_inverse().unwrap() * velocity;
    [rates.x, rates.y, twist.wz_rad_s - rates.sum(), 0.0, 0.0, 0.0, 0.0]
}

fn matrix(x_m: f64, y_m: f64) -> Value {
    json!([1.0, 0.0, 0.0, x_m, 0.0, 1.0, 0.0, y_m, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
}

/// Writes a recording with its traces and the calibration traces of the whisker.
fn write_recording(folder: &Path) {
    let source = Trace::read(&golden().join("golden_circle.csv")).unwrap();
    let outline = source.outline(&golden()).unwrap().unwrap();
    let moved = |point: Point<World>, by_m: f64| Point::new(point.x() + by_m, point.y());
    let (mut whiskers, mut objects) = (Vec::new(), Vec::new());
    for (name, array, by_m) in WHISKERS {
        let mut trace = source.clone();
        // The trace rotates by about 1e-6 rad, so a laterally mounted whisker moves slightly.
        for (instant, truth) in trace.recording.instants.iter_mut().zip(&mut trace.truth.instants) {
            let (sin, cos) = instant.base.yaw_rad().sin_cos();
            let at = instant.base.origin();
            instant.base = Pose::new(at.x() + by_m * cos, at.y() + by_m * sin, instant.base.yaw_rad());
            let twist = instant.twist.as_mut().unwrap();
            twist.vy_m_s += by_m * twist.wz_rad_s;
            truth.contact = truth.contact.map(|point| moved(point, by_m));
            truth.surface = truth.surface.map(|point| moved(point, by_m));
        }
        trace.sidecar.name = format!("{NAME}_{name}");
        (trace.sidecar.object, trace.sidecar.group, trace.sidecar.contour) = ("several".into(), "arm".into(), None);
        trace.sidecar.recording = Some(NAME.into());
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace.write(folder).unwrap();
        whiskers.push(json!({
            "name": name, "trace": trace.sidecar.name, "array": array, "mount": matrix(by_m, 0.0),
        }));
        let file = format!("{NAME}.disc_{name}.contour.csv");
        let contour = outline.vertices().iter().map(|vertex| moved(*vertex, by_m)).collect();
        let contour = Outline::new(contour).unwrap().to_csv();
        fs::write(folder.join(&file), &contour).unwrap();
        objects.push(json!({
            "name": format!("disc_{name}"), "shape": "cylinder", "mass_kg": 0.05, "height_m": 0.1, "friction": 0.5,
            "contour": {"file": file, "sha256": sha256(&contour), "chord_error_m": 1e-6},
        }));
    }
    let columns = |what: &str, unit: &str| (1..=7).map(|i| format!(",{what}{i}_{unit}")).collect::<String>();
    let mut table = format!("t_s{}{}\n", columns("q", "rad"), columns("dq", "rad_s"));
    for (instant, angles) in source.recording.instants.iter().zip(joints(&source)) {
        let cells =
            angles.iter().chain(&rates(instant, &angles)).map(|value| format!(",{value:.12}")).collect::<String>();
        table += &format!("{:.6}{cells}\n", instant.t_s);
    }
    fs::write(folder.join(format!("{NAME}.joints.csv")), &table).unwrap();
    let of_object = |(name, _, _): &(&str, &str, f64)| {
        ["x_m", "y_m", "z_m", "yaw_rad", "tilt_rad"].map(|column| format!(",disc_{name}_{column}")).concat()
    };
    let mut poses = format!("t_s{}\n", WHISKERS.iter().map(of_object).collect::<String>());
    for instant in &source.recording.instants {
        let at_rest = ",0.0000000000".repeat(5 * WHISKERS.len());
        poses += &format!("{:.6}{at_rest}\n", instant.t_s);
    }
    fs::write(folder.join(format!("{NAME}.objects.csv")), &poses).unwrap();
    let link = |a_m: f64| json!({"a_m": a_m, "alpha_rad": 0.0, "d_m": 0.0});
    let links: Vec<Value> = [0.0, LINK_M, LINK_M, 0.0, 0.0, 0.0, 0.0].map(link).to_vec();
    let part = |file: &str, text: &str| json!({"file": format!("{NAME}.{file}.csv"), "sha256": sha256(text)});
    let recording = json!({
        "format": 1, "kind": "recording", "name": NAME, "seed": 0, "rate_hz": source.sidecar.rate_hz,
        "rows": source.sidecar.rows, "whiskers": whiskers,
        "arm": {"name": "planar", "base": matrix(BASE[0], BASE[1]), "links": links, "flange_d_m": 0.0},
        "objects": objects, "joints": part("joints", &table), "poses": part("objects", &poses), "scene": {},
        "generator": source.sidecar.generator, "inputs_sha256": "ab",
    });
    write_json(&folder.join(format!("{NAME}.json")), &recording).unwrap();
    write_calibration(folder);
}

/// Writes the calibration traces of the whisker.
fn write_calibration(folder: &Path) {
    for (golden_name, name) in [("golden_pin", "grid_0"), ("golden_circle", "grid_1")] {
        let mut trace = Trace::read(&golden().join(format!("{golden_name}.csv"))).unwrap();
        (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), Role::Calibration, None);
        trace.write(folder).unwrap();
    }
}

fn evaluated(dataset: &Dataset, encoders: Vec<Encoders>, results: &Path) -> Evaluated {
    try_evaluated(dataset, encoders, results).unwrap()
}

fn try_evaluated(dataset: &Dataset, encoders: Vec<Encoders>, results: &Path) -> anyhow::Result<Evaluated> {
    let models = Models::One { kind: "elastica".into(), config: json!({}) };
    let settings = FitSettings { models, noise: 0.01, seed: 1, front_end: Default::default(), sensors: Vec::new() };
    fit(dataset, &settings, &dataset.calibrations("white"), &ProgressBar::hidden()).unwrap();
    let settings = EvaluateSettings {
        name: "arm".into(),
        estimators: Some(vec!["sliding".into()]),
        noise: vec![0.01],
        seeds: vec![1],
        encoders,
        results: results.into(),
        ..Default::default()
    };
    evaluate(slice::from_ref(dataset), &settings, &ProgressBar::hidden())
}

#[test]
fn verif_two_whiskers_map_two_discs() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    write_recording(traces.path());
    let dataset = Dataset::open(traces.path(), None).unwrap();
    let noisy = Encoders { resolution_rad: 1e-6, noise_rad: 1e-4 };
    let encoders = || vec![Encoders::default(), noisy];
    let run = evaluated(&dataset, encoders(), results.path());
    assert!(run.failures.is_empty(), "{:?}", run.failures);
    let maps: Vec<MapRow> = read_rows(&run.folder.join("maps.csv")).unwrap();
    assert_eq!(maps.len(), 2);
    for map in &maps {
        assert_eq!((map.whiskers, map.objects_touched, map.objects_found), (2, 2, 2), "{map:?}");
        assert_eq!((map.objects_split, map.objects_merged), (0, 0), "{map:?}");
    }
    // A contact at rest is constant in World, also with noisy encoders.
    assert!(maps.iter().all(|map| map.points_mean_m.is_some_and(|mean_m| mean_m < 1e-4)), "{maps:?}");
    let objects: Vec<MapObjectRow> = read_rows(&run.folder.join("map_objects.csv")).unwrap();
    let mut matched: Vec<&str> = objects.iter().take(2).filter_map(|row| row.matched.as_deref()).collect();
    matched.sort_unstable();
    assert_eq!(matched, ["disc_left_1", "disc_left_2"]);
    // Noisy encoders change the measured base pose, not the reading.
    let estimates = |trace: &str| -> Vec<EstimateRow> {
        read_rows(&run.folder.join(format!("estimates/{trace}.sliding.csv"))).unwrap()
    };
    let (exact, noisy) = (estimates("scene_00_left_1"), estimates("scene_00_left_1_noise_1e-4_step_1e-6"));
    assert!(exact.iter().zip(&noisy).all(|(a, b)| a.reading_n_m == b.reading_n_m));
    let off_m: Vec<f64> =
        exact.iter().zip(&noisy).map(|(a, b)| (a.base_x_m - b.base_x_m).hypot(a.base_y_m - b.base_y_m)).collect();
    let rms_m = (off_m.iter().map(|off| off * off).sum::<f64>() / off_m.len() as f64).sqrt();
    assert!((3e-5..3e-4).contains(&rms_m), "{rms_m}");
    let run_file = Run::read(&run.folder.join("run.json")).unwrap();
    assert_eq!(run_file.recordings.iter().map(|recording| recording.encoders).collect::<Vec<_>>(), encoders());
    let points: Vec<MapPointRow> = read_rows(&run.folder.join("maps/scene_00.sliding.points.csv")).unwrap();
    assert_eq!(points.len(), maps[0].points);
    let grid: Vec<GridRow> = read_rows(&run.folder.join("maps/scene_00.sliding.grid.csv")).unwrap();
    let occupied = grid.iter().filter(|cell| cell.occupied > 0.5).count();
    assert!(occupied > 2 && grid.len() > 10 * occupied, "{occupied} of {}", grid.len());
    assert!(!evaluated(&dataset, encoders(), results.path()).is_new);
}

/// Checks the error of `whisker check` for a recording with one changed file.
fn check_fails(file: &str, change: impl FnOnce(String) -> String, words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    write_recording(folder.path());
    let path = folder.path().join(file);
    fs::write(&path, change(fs::read_to_string(&path).unwrap())).unwrap();
    let recording = folder.path().join(format!("{NAME}.json"));
    let output = Command::new(env!("CARGO_BIN_EXE_whisker")).arg("check").arg(&recording).output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    for word in words {
        assert!(text.contains(word), "does not contain `{word}`: {text}");
    }
}

#[test]
fn verif_check_accepts_recordings() {
    let folder = tempfile::tempdir().unwrap();
    write_recording(folder.path());
    let output = Command::new(env!("CARGO_BIN_EXE_whisker")).arg("check").arg(folder.path()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("recording `scene_00` of 2 whiskers among 2 objects"), "{text}");
}

#[test]
fn robust_damaged_recordings_are_reported_with_file_and_key() {
    let replaced = |from: &'static str, to: &'static str| move |text: String| text.replacen(from, to, 1);
    let json = "scene_00.json";
    check_fails(json, replaced("\"seed\"", "\"sead\""), &["scene_00.json", "unknown field `sead`"]);
    check_fails(json, replaced("\"recording\"", "\"recordings\""), &["scene_00.json", "kind"]);
    check_fails(json, replaced("\"left_2\"", "\"left_1\""), &["whiskers[1].name", "`left_1` again", "each once"]);
    check_fails(json, replaced("0.12,", "0.13,"), &["scene_00_left_2.csv:2", "base_x_m", "the mount of `left_2`"]);
    let tilted = |text: String| {
        let mut recording: Value = serde_json::from_str(&text).unwrap();
        let (sin, cos) = 0.01_f64.sin_cos();
        recording["whiskers"][1]["mount"] =
            json!([1.0, 0.0, 0.0, 0.12, 0.0, cos, -sin, 0.0, 0.0, sin, cos, 0.0, 0.0, 0.0, 0.0, 1.0]);
        recording.to_string()
    };
    check_fails(json, tilted, &["scene_00_left_2.csv:2", "tilted by 0.01", "`left_2`", "to within 0.001 rad"]);
    check_fails(json, replaced("\"rows\": 363", "\"rows\": 362"), &["scene_00.joints.csv:365", "363 rows", "362 rows"]);
    let joints = "scene_00.joints.csv";
    check_fails(joints, replaced("q1_rad", "q1_deg"), &[joints, "sha256", "as stated by `joints`"]);
    check_fails(
        "scene_00.objects.csv",
        replaced("0.0000000000", "0.1"),
        &["objects.csv", "sha256", "as stated by `poses`"],
    );
    check_fails("scene_00.disc_left_1.contour.csv", replaced("0", "1"), &["contour.csv", "sha256"]);
    let trace = "scene_00_left_1.json";
    check_fails(trace, replaced("\"recording\": \"scene_00\"", "\"recording\": \"scene_01\""), &[trace, "`scene_01`"]);
}

#[test]
fn robust_encoders_need_an_arm() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    write_calibration(traces.path());
    let mut trace = Trace::read(&golden().join("golden_pin.csv")).unwrap();
    (trace.sidecar.name, trace.sidecar.contour) = ("pin".into(), None);
    trace.write(traces.path()).unwrap();
    let dataset = Dataset::open(traces.path(), None).unwrap();
    let encoders = vec![Encoders { resolution_rad: 1e-5, noise_rad: 1e-4 }];
    let error = try_evaluated(&dataset, encoders, results.path()).unwrap_err();
    assert_eq!(error.to_string(), "encoders: found no recording of an arm among the traces, expected at least one");
}

#[test]
fn robust_unknown_encoder_settings_are_reported() {
    let output = Command::new(env!("CARGO_BIN_EXE_whisker"))
        .args(["evaluate", "datasets/golden", "--encoders", "{\"noise_deg\": 1}"])
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && text.contains("unknown field `noise_deg`"), "{text}");
}

/// The exported recording contains the angles of the arm, the frames of the bases and the moments of the traces.
#[test]
fn verif_an_exported_recording_has_the_motion_and_the_moments_of_its_traces() {
    let folder = tempfile::tempdir().unwrap();
    write_recording(folder.path());
    let (path, out) = (folder.path().join(NAME).with_extension("json"), folder.path().join("exported"));
    let export = ["bag", "export", path.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let done = Command::new(env!("CARGO_BIN_EXE_whisker")).args(export).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let traces: Vec<Trace> = WHISKERS
        .iter()
        .map(|(name, _, _)| Trace::read(&folder.path().join(format!("{NAME}_{name}.csv"))).unwrap())
        .collect();
    let (mut frames, mut moments, mut joints) = (0, 0, 0);
    for record in bag::Reader::open(&out).unwrap().records() {
        let record = record.unwrap();
        let row = |count: usize| count / WHISKERS.len();
        match record.decode_any().unwrap().unwrap() {
            bag::messages::AnyMessage::JointState(state) => {
                assert_eq!((state.name.len(), state.position.len(), state.velocity.len()), (7, 7, 7));
                joints += 1;
            }
            bag::messages::AnyMessage::TfMessage(found) => {
                for (transform, (trace, (name, _, _))) in found.transforms.iter().zip(traces.iter().zip(WHISKERS)) {
                    let (base, at) = (trace.recording.instants[row(frames)].base, &transform.transform.translation);
                    assert_eq!(transform.child_frame_id, format!("{name}_base"));
                    assert_eq!((at.x, at.y, at.z), (base.origin().x(), base.origin().y(), 0.0));
                    frames += 1;
                }
            }
            bag::messages::AnyMessage::WrenchStamped(moment) => {
                let trace = &traces[moments % WHISKERS.len()];
                assert_eq!(moment.wrench.torque.z, trace.recording.instants[row(moments)].moment_z_n_m);
                moments += 1;
            }
            _ => {}
        }
    }
    let rows = traces[0].recording.instants.len();
    assert_eq!((joints, frames, moments), (rows, rows * WHISKERS.len(), rows * WHISKERS.len()));
    let with_estimates =
        Command::new(env!("CARGO_BIN_EXE_whisker")).args(export).args(["--estimates", "e.csv"]).output().unwrap();
    assert!(
        String::from_utf8_lossy(&with_estimates.stderr)
            .contains("--estimates: found with a recording of several whiskers")
    );
}
