//! Recordings played as messages, against the replay of the same traces.

mod played;

use std::fs;
use std::path::{Path, PathBuf};

use bag::messages::{
    AnyMessage, Header, JointState, MagneticField, PoseWithCovarianceStamped, Quaternion, TfMessage, Time, Transform,
    TransformStamped, Vector3, Wrench, WrenchStamped,
};
use evaluation::fit::{FitSettings, Models, fit};
use indicatif::ProgressBar;
use live_ros::{Drawing, Form, Latency, Mapper, Setup, Taken};
use serde_json::{Value, json};
use tempfile::TempDir;
use testbed::dataset::Dataset;
use testbed::front_end::FrontEndConfig;
use testbed::replay::{estimator, knowledge, samples};
use trace::{CalibrationFile, Role, Trace};
use whisker::estimators::Estimate;
use whisker::events::TouchConfig;
use whisker::frames::{Point, World};

use played::{messages_of, play, read};

const SEED: u64 = 1;
const NOISE_SD_N_M: f64 = 1e-7;

/// A golden trace with a calibration, and a folder for the mapping.
struct Bench {
    folder: TempDir,
    trace: Trace,
    calibration: PathBuf,
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden").join(name).with_extension("csv")
}

impl Bench {
    /// The calibration is fitted to the golden traces themselves, which suffices for a comparison of two paths.
    fn new(name: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["golden_pin", "golden_circle"] {
            let mut trace = Trace::read(&golden(name)).expect("a trace");
            (trace.sidecar.role, trace.sidecar.contour) = (Role::Calibration, None);
            trace.write(folder.path()).expect("written");
        }
        let dataset = Dataset::open(folder.path(), None).expect("a dataset");
        let models = Models::One { kind: "elastica".into(), config: json!({}) };
        let front_end = FrontEndConfig::default();
        let settings = FitSettings { models, noise: 0.01, seed: 1, front_end, sensors: Vec::new() };
        let calibrations = dataset.calibrations("white");
        fit(&dataset, &settings, &calibrations, &ProgressBar::hidden()).expect("fitted");
        let trace = Trace::read(&golden(name)).expect("a trace");
        let calibration = calibrations.join(format!("{}.json", trace.sidecar.whisker.name));
        Self { folder, trace, calibration }
    }

    /// A mapping with one whisker of this name, changed by `change`.
    fn mapping(&self, estimator: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
        let mut mapping = json!({
            "format": 1, "kind": "contact_mapping", "estimator": estimator, "seed": SEED,
            "whiskers": [{
                "name": self.trace.sidecar.name, "calibration": self.calibration, "rate_hz": self.trace.sidecar.rate_hz,
                "noise_sd_n_m": NOISE_SD_N_M, "moment": "/moment",
            }],
        });
        change(&mut mapping);
        let path = self.folder.path().join("mapping.json");
        fs::write(&path, mapping.to_string()).expect("written");
        path
    }

    /// Contacts of a replay: time, contact in World and covariance.
    fn replayed(&self, name: &str) -> Vec<(f64, Point<World>, Estimate)> {
        let faces = CalibrationFile::read(&self.calibration).expect("a calibration");
        let row = whisker::estimators::estimator(name).expect("a registered estimator");
        let faces = faces.calibrated(&self.calibration, row.sensor_model).expect("faces");
        let knowledge = knowledge(&self.trace.sidecar, &faces, NOISE_SD_N_M);
        let touch = TouchConfig::default();
        let mut estimator =
            estimator(row, &(row.defaults)(), touch, &knowledge, &self.trace.sidecar.name, SEED).expect("an estimator");
        let instants = &self.trace.recording.instants;
        let readings: Vec<f64> = instants.iter().map(|instant| instant.moment_z_n_m).collect();
        let estimates = estimator.run(&samples(&self.trace.recording, &readings));
        let known = instants.iter().zip(estimates);
        known.filter_map(|(now, estimate)| estimate.map(|of| (now.t_s, now.base.apply(of.contact), of))).collect()
    }

    /// Messages of the exported trace.
    fn exported(&self) -> Vec<(f64, String, AnyMessage)> {
        let recording = self.folder.path().join("recording");
        whisker_cli::ros::export_trace(&golden(&self.trace.sidecar.name), None, &recording).expect("exported");
        messages_of(&recording)
    }
}

/// Largest distance between published contacts and those of the replay; their numbers and times must agree.
fn largest_difference_m(taken: &Taken, replayed: &[(f64, Point<World>, Estimate)]) -> f64 {
    let messages: Vec<&PoseWithCovarianceStamped> = taken.contacts.iter().map(|contact| &contact.message).collect();
    assert_eq!(messages.len(), replayed.len());
    let off_m = messages.iter().zip(replayed).map(|(message, (t_s, contact, _))| {
        assert_eq!(message.header.stamp.nanoseconds(), (1e9 * t_s).round() as i64);
        let at = &message.pose.pose.position;
        (at.x - contact.x()).hypot(at.y - contact.y())
    });
    off_m.fold(0.0, f64::max)
}

#[test]
fn verif_contacts_of_a_played_recording_equal_those_of_a_replay() {
    let bench = Bench::new("golden_pin");
    let messages = bench.exported();
    for name in ["ekf", "outline", "recommended", "particle", "smoother"] {
        let mut setup = read(&bench.mapping(name, |_| {}));
        let taken = play(&mut setup, &messages);
        let replayed = bench.replayed(name);
        assert!(replayed.len() > 100, "{name}");
        let off_m = largest_difference_m(&taken, &replayed);
        assert!(off_m <= 1e-12, "{name}: {off_m} m");
        for (contact, (_, _, estimate)) in taken.contacts.iter().zip(&replayed) {
            let stated = estimate.covariance_m2.expect("a covariance").trace();
            let published = &contact.message.pose.covariance;
            assert!(((published[0][0] + published[1][1]) / stated - 1.0).abs() < 1e-6, "{name}");
            assert_eq!((published[2][2], published[5][5]), (0.0, 0.0));
        }
        assert!(taken.events.is_empty(), "{name}: {:?}", taken.events);
    }
}

/// The base is at rest on a flange that turns about a mast: world -> mast (static), mast -> flange (moving), flange -> base
/// (static), and the fixed frame on a branch of its own.
#[test]
fn verif_a_chain_of_frames_gives_the_same_contacts() {
    let bench = Bench::new("golden_pin");
    let at = |time_ns: u64, frame: &str| Header { stamp: Time::from_nanoseconds(time_ns), frame_id: frame.into() };
    let put = |header: Header, child: &str, x: f64, y: f64, z: f64, rotation: Quaternion| {
        let transform = Transform { translation: Vector3 { x, y, z }, rotation };
        TransformStamped { header, child_frame_id: child.into(), transform }
    };
    let ident = || Quaternion::about_z(0.0);
    let mut messages = Vec::new();
    let fixed = vec![
        put(at(0, "mast"), "fixed", -0.3, 0.1, 0.7, ident()),
        put(at(0, "flange"), "base", 0.02, 0.0, 0.05, ident()),
    ];
    messages.push((0.0, "/tf_static".to_owned(), AnyMessage::TfMessage(TfMessage { transforms: fixed })));
    for (t_s, topic, message) in bench.exported() {
        let frames = match message {
            AnyMessage::TfMessage(frames) => frames,
            AnyMessage::WrenchStamped(mut moment) => {
                moment.header.frame_id = "/base".into();
                messages.push((t_s, topic, AnyMessage::WrenchStamped(moment)));
                continue;
            }
            message => {
                messages.push((t_s, topic, message));
                continue;
            }
        };
        let base = &frames.transforms[0];
        let (x, y, turned) = (base.transform.translation.x, base.transform.translation.y, &base.transform.rotation);
        let yaw_rad = 2.0 * turned.z.atan2(turned.w);
        // Flange such that the base has the pose of the trace in the fixed frame.
        let (flange_x, flange_y) = (x - 0.02 * yaw_rad.cos() - 0.3, y - 0.02 * yaw_rad.sin() + 0.1);
        let header = Header { frame_id: "mast".into(), ..base.header.clone() };
        let flange = put(header, "flange", flange_x, flange_y, 0.4, turned.clone());
        // Another robot's frame does not matter.
        let other = put(at(5, "elsewhere"), "other", f64::from(i32::MAX), 0.0, 0.0, ident());
        let transforms = vec![other, flange];
        messages.push((t_s, topic, AnyMessage::TfMessage(TfMessage { transforms })));
    }
    let path = bench.mapping("ekf", |mapping| {
        mapping["fixed_frame"] = json!("fixed");
        mapping["whiskers"][0]["base_frame"] = json!("base");
    });
    let mut setup = read(&path);
    let taken = play(&mut setup, &messages);
    let off_m = largest_difference_m(&taken, &bench.replayed("ekf"));
    assert!(off_m <= 1e-9, "{off_m} m: rounding of the chain");
    let height_m = taken.contacts[0].message.pose.pose.position.z;
    assert!((height_m + 0.25).abs() < 1e-12, "{height_m} m: 0.4 + 0.05 - 0.7");
}

/// A plane whose x axis is the fixed frame's y axis and whose normal points along its x axis.
#[test]
fn verif_a_tilted_plane_gives_the_same_contacts_in_space() {
    let bench = Bench::new("golden_pin");
    let tilted = |base: &TransformStamped| {
        let (at, turned) = (&base.transform.translation, &base.transform.rotation);
        // The axes x, y, z of the plane are y, z, x of the fixed frame: a turn of 120 degrees, (1, 1, 1, 1) / 2.
        let (a, b) = (0.5 * (turned.w - turned.z), 0.5 * (turned.w + turned.z));
        let rotation = Quaternion { x: b, y: a, z: b, w: a };
        let translation = Vector3 { x: 0.2, y: at.x, z: at.y };
        TransformStamped { transform: Transform { translation, rotation }, ..base.clone() }
    };
    let mut messages = bench.exported();
    for (_, _, message) in &mut messages {
        if let AnyMessage::TfMessage(frames) = message {
            frames.transforms[0] = tilted(&frames.transforms[0]);
        }
    }
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut setup = read(&bench.mapping("ekf", |mapping| mapping["plane"] = json!({"rpy_rad": [quarter, 0, quarter]})));
    let taken = play(&mut setup, &messages);
    let replayed = bench.replayed("ekf");
    assert_eq!(taken.contacts.len(), replayed.len(), "{:?}", taken.events);
    for (contact, (_, expected, estimate)) in taken.contacts.iter().zip(&replayed) {
        let (at, covariance) = (&contact.message.pose.pose.position, &contact.message.pose.covariance);
        assert!((at.x - 0.2).abs() < 1e-12 && (at.y - expected.x()).hypot(at.z - expected.y()) < 1e-9, "{at:?}");
        let stated = estimate.covariance_m2.expect("a covariance").trace();
        assert!(covariance[0][0].abs() < 1e-15 * stated.sqrt() && covariance[1][1] + covariance[2][2] > 0.999 * stated);
    }
}

#[test]
fn robust_a_pose_off_the_plane_is_reported_once_and_not_used() {
    let bench = Bench::new("golden_pin");
    let mut messages = bench.exported();
    let last_s = messages.last().expect("messages").0;
    for (t_s, _, message) in &mut messages {
        if let AnyMessage::TfMessage(frames) = message
            && (0.4 * last_s..0.6 * last_s).contains(t_s)
        {
            frames.transforms[0].transform.translation.z += 0.01;
        }
    }
    let mut setup = read(&bench.mapping("ekf", |_| {}));
    let taken = play(&mut setup, &messages);
    let events: Vec<String> = taken.events.iter().map(ToString::to_string).collect();
    assert_eq!(events.len(), 2, "{events:?}");
    assert!(
        events[0].starts_with("pose off the plane: found a tilt of 0.0000 rad and a distance of 0.0100 m"),
        "{events:?}"
    );
    assert!(events[1].starts_with("poses arrive again"), "{events:?}");
    let is_off = |contact: &live_ros::Contact| {
        (0.4 * last_s..0.6 * last_s).contains(&(1e-9 * contact.message.header.stamp.nanoseconds() as f64))
    };
    assert!(!taken.contacts.iter().any(is_off) && setup.whiskers[0].counters().off_plane > 50);
}

#[test]
fn robust_transforms_that_stop_or_jump_stop_the_contacts() {
    let bench = Bench::new("golden_pin");
    let messages = bench.exported();
    let last_s = messages.last().expect("messages").0;
    let stops: Vec<_> =
        messages.iter().filter(|(t_s, topic, _)| topic != "/tf" || *t_s < 0.5 * last_s).cloned().collect();
    let mut setup = read(&bench.mapping("ekf", |_| {}));
    let taken = play(&mut setup, &stops);
    let newest_s =
        taken.contacts.iter().map(|of| 1e-9 * of.message.header.stamp.nanoseconds() as f64).fold(0.0, f64::max);
    assert!(newest_s < 0.5 * last_s && taken.events[0].to_string().starts_with("stale poses"), "{:?}", taken.events);
    let state = setup.whiskers[0].diagnose(last_s, Latency::default());
    assert_eq!((state.level.0, state.message.as_str()), (3, "no poses: no estimates"));
    assert!(taken.events[0].to_string().contains("--wait (wait_s of a mapping)"), "{}", taken.events[0]);

    // The clock of the transforms is set 5 s ahead and, later, back.
    let mut jumps = messages.clone();
    for (t_s, topic, message) in &mut jumps {
        if let AnyMessage::TfMessage(frames) = message
            && topic == "/tf"
            && (0.4 * last_s..0.5 * last_s).contains(t_s)
        {
            frames.transforms[0].header.stamp.sec += 5;
        }
    }
    let mut setup = read(&bench.mapping("ekf", |_| {}));
    let taken = play(&mut setup, &jumps);
    let clocks = taken.events.iter().filter(|event| event.to_string().starts_with("clock of the poses")).count();
    assert_eq!(clocks, 2, "{:?}", taken.events);
    assert!(taken.contacts.iter().any(|contact| contact.arrived_s > 0.7 * last_s), "it recovers");
    assert_eq!(setup.whiskers[0].diagnose(last_s, Latency::default()).level.0, 2);
}

/// Mapping and messages of a sensor with offset, common mode and a counter that wraps, made from the moments of the trace.
fn with_counts(bench: &Bench) -> (PathBuf, Vec<(f64, String, AnyMessage)>) {
    with_sensor(bench, [0.02, 1.1])
}

/// The same of a sensor with this common mode. Without one, the sensor is that of recordings, which the mapping need not name.
fn with_sensor(bench: &Bench, common_mode: [f64; 2]) -> (PathBuf, Vec<(f64, String, AnyMessage)>) {
    let is_recorded = common_mode == [0.0; 2];
    let mut calibration: Value = serde_json::from_slice(&fs::read(&bench.calibration).expect("read")).expect("JSON");
    let gain = 2.0e6;
    let sensor = json!({
        "name": "s", "array": "a", "common_mode": common_mode, "cross_talk": [],
        "characteristic": {"coefficients": [-gain], "range_n_m": [-1e-3, 1e-3]},
        "noise_sd_n_m": NOISE_SD_N_M, "offset_sd_n_m": 0.0, "gain_sd": 0.0,
    });
    if is_recorded {
        calibration["sensor"] = sensor;
    } else {
        calibration["front_end"] = json!({"name": "hall", "config": {}, "sensors": [sensor]});
    }
    let path = bench.folder.path().join("counts.json");
    fs::write(&path, calibration.to_string()).expect("written");
    let field = |time_ns: u64, x: f64, y: f64| MagneticField {
        header: Header { stamp: Time::from_nanoseconds(time_ns), frame_id: String::new() },
        magnetic_field: Vector3 { x, y, z: 0.0 },
        magnetic_field_covariance: [0.0; 9],
    };
    let mut messages = Vec::new();
    // A second of rest for the zeroing, before the trace.
    let rest_s = 1.0;
    let at_rest = (0..=250).map(|row| (0.004 * f64::from(row), 0.0, None));
    let moving =
        bench.trace.recording.instants.iter().map(|now| (rest_s + 0.004 + now.t_s, now.moment_z_n_m, Some(now.base)));
    for (t_s, moment_n_m, base) in at_rest.chain(moving) {
        let time_ns = (1e9 * t_s).round() as u64;
        let (x, y) = (30.0 * (3.0 * t_s).sin(), 50.0 * (2.0 * t_s).cos());
        let counts = (32_000.0 + common_mode[0] * x + common_mode[1] * y - gain * moment_n_m).rem_euclid(65536.0);
        messages.push((t_s, "/reference".to_owned(), AnyMessage::MagneticField(field(time_ns, x, y))));
        messages.push((t_s, "/counts".to_owned(), AnyMessage::MagneticField(field(time_ns, 0.0, counts))));
        if let Some(base) = base {
            let translation = Vector3 { x: base.origin().x(), y: base.origin().y(), z: 0.0 };
            let transform = Transform { translation, rotation: Quaternion::about_z(base.yaw_rad()) };
            let header = Header { stamp: Time::from_nanoseconds(time_ns), frame_id: "world".into() };
            let frame = TransformStamped { header, child_frame_id: "whisker_base_link".into(), transform };
            messages.push((t_s, "/tf".to_owned(), AnyMessage::TfMessage(TfMessage { transforms: vec![frame] })));
        }
    }
    let mapping = bench.mapping("ekf", |mapping| {
        let whisker = mapping["whiskers"][0].as_object_mut().expect("an object");
        whisker.remove("moment");
        whisker.insert("calibration".into(), json!(path));
        let mut counts = json!({"topic": "/counts", "message": "MagneticField", "modulo": 65536});
        if is_recorded {
            whisker.remove("noise_sd_n_m");
        } else {
            (counts["reference"], counts["sensor"]) = (json!("/reference"), json!("a.s"));
        }
        whisker.insert("counts".into(), counts);
    });
    (mapping, messages)
}

/// Asserts that published contacts are those of the replay but for the rounding of the counts.
fn assert_same(contacts: &[live_ros::Contact], replayed: &[(f64, Point<World>, Estimate)]) {
    assert_eq!(contacts.len(), replayed.len());
    for (contact, (_, expected, _)) in contacts.iter().zip(replayed) {
        let at = &contact.message.pose.pose.position;
        assert!((at.x - expected.x()).hypot(at.y - expected.y()) < 1e-8, "{at:?}");
    }
}

#[test]
fn verif_counts_give_the_contacts_of_their_moments() {
    let bench = Bench::new("golden_pin");
    let (mapping, messages) = with_counts(&bench);
    assert_same(&play(&mut read(&mapping), &messages).contacts, &bench.replayed("ekf"));
}

#[test]
fn verif_counts_of_the_sensor_of_recordings_give_the_contacts_of_their_moments() {
    let bench = Bench::new("golden_pin");
    let (mapping, messages) = with_sensor(&bench, [0.0; 2]);
    assert_same(&play(&mut read(&mapping), &messages).contacts, &bench.replayed("ekf"));
}

#[test]
fn robust_counts_of_a_sensor_that_the_calibration_lacks_are_refused() {
    let bench = Bench::new("golden_pin");
    let (mapping, _) = with_counts(&bench);
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut changed: Value = serde_json::from_slice(&fs::read(&mapping).expect("read")).expect("JSON");
        change(&mut changed["whiskers"][0]);
        let path = bench.folder.path().join("changed.json");
        fs::write(&path, changed.to_string()).expect("written");
        format!("{:#}", Setup::read(&path).err().expect("an error"))
    };
    let other = refused(&|whisker| whisker["counts"]["sensor"] = json!("a.t"));
    assert!(other.ends_with("counts.json: front_end.sensors: found a.s, expected `a.t` among them"), "{other}");
    let moments = refused(&|whisker| whisker["calibration"] = json!(bench.calibration));
    assert!(moments.contains("straight.json: sensor: found none, expected one, by which counts"), "{moments}");
}

#[test]
fn robust_counts_that_overtake_each_other_are_taken_in_order() {
    let bench = Bench::new("golden_pin");
    let (mapping, mut messages) = with_counts(&bench);
    // Counts arrive after their successors, before those of the reference for both.
    let counts: Vec<usize> = (0..messages.len()).filter(|&i| messages[i].1 == "/counts").collect();
    for pair in counts.chunks_exact(2).skip(200).step_by(3) {
        let (first, second) = (messages[pair[0]].clone(), messages[pair[1]].clone());
        (messages[pair[0]], messages[pair[1]]) = (second, first);
        (messages[pair[0]].0, messages[pair[1]].0) = (messages[pair[1]].0, messages[pair[0]].0);
    }
    let played = |reorder_s: f64| {
        let mut changed: Value = serde_json::from_slice(&fs::read(&mapping).expect("read")).expect("JSON");
        changed["timing"] = json!({"reorder_s": reorder_s});
        fs::write(&mapping, changed.to_string()).expect("written");
        let mut setup = read(&mapping);
        let taken = play(&mut setup, &messages);
        let diagnosed = setup.whiskers[0].diagnose(0.0, Latency::default());
        let value = |key: &str| diagnosed.values.iter().find(|of| of.key == key).expect("a value").value.clone();
        (taken.contacts, [value("counts_incomplete"), value("counts_late")])
    };
    let replayed = bench.replayed("ekf");
    let (contacts, left_out) = played(0.02);
    assert_same(&contacts, &replayed);
    assert_eq!(left_out, ["0", "0"]);
    // Without a wait they are late.
    let (contacts, [incomplete, late]) = played(0.0);
    assert!(contacts.len() < replayed.len());
    assert_eq!(incomplete, "0");
    assert!(late.parse::<u64>().expect("a number") > 20, "{late}");
}

#[test]
fn robust_counts_begin_anew_when_their_clock_is_set_back() {
    let bench = Bench::new("golden_pin");
    let (mapping, mut messages) = with_counts(&bench);
    // The recording is played twice; the second time with another offset of the sensor and in another plane.
    let length_s = messages.last().expect("messages").0;
    let again: Vec<_> = messages
        .iter()
        .cloned()
        .map(|(at_s, topic, mut message)| {
            match &mut message {
                AnyMessage::MagneticField(field) if topic == "/counts" => {
                    field.magnetic_field.y = (field.magnetic_field.y + 500.0).rem_euclid(65536.0);
                }
                AnyMessage::TfMessage(frames) => frames.transforms[0].transform.translation.z += 0.5,
                _ => {}
            }
            (length_s + 1.0 + at_s, topic, message)
        })
        .collect();
    messages.extend(again);
    let mut setup = read(&mapping);
    let taken = play(&mut setup, &messages);
    let replayed = bench.replayed("ekf");
    let (first, second) = taken.contacts.split_at(replayed.len());
    assert_same(first, &replayed);
    assert_same(second, &replayed);
    assert!(first.iter().all(|contact| contact.message.pose.pose.position.z == 0.0));
    assert!(second.iter().all(|contact| contact.message.pose.pose.position.z == 0.5));
    assert_eq!(taken.events.len(), 1, "{:?}", taken.events);
}

/// Positions of the bases by `whisker_sim.arm.panda.tool_pose` (NumPy) for the same joint angles; see the comment.
#[test]
fn val_urdf_kinematics_match_independent_numbers() {
    // T = arm.base @ panda.tool_pose([0.3, -0.5, 0.2, -2, 0.4, 1.7, 0.9], mount.in_flange) of left_1, whose rotation and
    // position are these; the plane of the mapping is the base's own, so that the pose is in the plane.
    let bench = Bench::new("golden_pin");
    let urdf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/live-arm/panda_whiskers.urdf");
    let up = [-0.02816945689908921_f64, -0.3502017416860434, 0.9362506191282717];
    let at = [-0.1719816500975364, 0.2920489375782815, 0.5368861917941483];
    // Roll and pitch of a plane with this normal.
    let (roll_rad, pitch_rad) = ((-up[1]).asin(), up[0].atan2(up[2]));
    // R = Rz(0) Ry(pitch) Rx(roll) has the third column (sin p cos r, -sin r, cos p cos r).
    assert!((pitch_rad.sin() * roll_rad.cos() - up[0]).abs() < 1e-12);
    let path = bench.mapping("ekf", |mapping| {
        mapping["urdf"] = json!(urdf);
        mapping["plane"] = json!({"rpy_rad": [roll_rad, pitch_rad, 0.0]});
        mapping["whiskers"][0]["base_frame"] = json!("left_1_base");
    });
    let mut setup = read(&path);
    let angles_rad = [0.3, -0.5, 0.2, -2.0, 0.4, 1.7, 0.9];
    let mut messages = Vec::new();
    // Arm and gripper publish in turn; the first joints every second time only.
    for row in 0..=100_u64 {
        let stamp = Time::from_nanoseconds(4_000_000 * row);
        let header = Header { stamp, frame_id: String::new() };
        let joints = if row % 2 == 0 { 1..=7 } else { 4..=7 };
        let joints = JointState {
            header: header.clone(),
            name: joints.clone().map(|joint| format!("panda_joint{joint}")).chain(["finger".into()]).collect(),
            position: joints.map(|joint: usize| angles_rad[joint - 1]).chain([f64::NAN]).collect(),
            ..JointState::default()
        };
        messages.push((0.004 * row as f64, "/joint_states".to_owned(), AnyMessage::JointState(joints)));
        let torque = Vector3 { x: 0.0, y: 0.0, z: 0.0 };
        let wrench = Wrench { force: Vector3::default(), torque };
        messages.push((
            0.004 * row as f64,
            "/moment".to_owned(),
            AnyMessage::WrenchStamped(WrenchStamped { header, wrench }),
        ));
    }
    let taken = play(&mut setup, &messages);
    assert!(taken.events.is_empty(), "{:?}", taken.events);
    let (_, shapes) = setup.whiskers[0].shapes(0.4).expect("a pose");
    let Form::Line(points, _) = &shapes[0].form else { panic!("a line") };
    let root = [points[0].x, points[0].y, points[0].z];
    for (found, expected) in root.iter().zip(at) {
        assert!((found - expected).abs() < 1e-12, "{root:?}");
    }
    let ahead = [-0.38655739722763033, 0.8675704557748352, 0.3128815796994844];
    let along = [points[1].x - root[0], points[1].y - root[1], points[1].z - root[2]];
    let length_m = along.iter().map(|of| of * of).sum::<f64>().sqrt();
    let cosine = along.iter().zip(ahead).map(|(a, b)| a * b).sum::<f64>() / length_m;
    assert!(cosine > 0.999, "{cosine}: the first part of the whisker is nearly its tangent");
}

/// Two joints, a quarter of a turn apart in two samples: the interpolated pose lies on the arc, not on its chord.
#[test]
fn val_transforms_are_interpolated_one_by_one() {
    let bench = Bench::new("golden_pin");
    let path = bench.mapping("ekf", |mapping| mapping["whiskers"][0]["base_frame"] = json!("base"));
    let mut setup = read(&path);
    let header = |time_ns, frame: &str| Header { stamp: Time::from_nanoseconds(time_ns), frame_id: frame.into() };
    let put = |header, child: &str, x, angle_rad| TransformStamped {
        header,
        child_frame_id: child.into(),
        transform: Transform { translation: Vector3 { x, y: 0.0, z: 0.0 }, rotation: Quaternion::about_z(angle_rad) },
    };
    let mut messages = Vec::new();
    let arm = vec![put(header(0, "joint"), "base", 0.5, 0.0)];
    messages.push((0.0, "/tf_static".to_owned(), AnyMessage::TfMessage(TfMessage { transforms: arm })));
    for (time_ns, angle_rad) in [(0, 0.0), (80_000_000, std::f64::consts::FRAC_PI_2)] {
        let joint = vec![put(header(time_ns, "world"), "joint", 0.1, angle_rad)];
        messages.push((
            1e-9 * time_ns as f64,
            "/tf".to_owned(),
            AnyMessage::TfMessage(TfMessage { transforms: joint }),
        ));
        if time_ns == 0 {
            let wrench = Wrench::default();
            let moment = WrenchStamped { header: header(20_000_000, ""), wrench };
            messages.push((0.04, "/moment".to_owned(), AnyMessage::WrenchStamped(moment)));
        }
    }
    play(&mut setup, &messages);
    let (_, shapes) = setup.whiskers[0].shapes(0.1).expect("a pose");
    let Form::Line(points, _) = &shapes[0].form else { panic!("a line") };
    // A quarter of the way: 22.5 degrees.
    let expected = (0.1 + 0.5 * 22.5_f64.to_radians().cos(), 0.5 * 22.5_f64.to_radians().sin());
    assert!((points[0].x - expected.0).hypot(points[0].y - expected.1) < 1e-12, "{:?} {expected:?}", points[0]);
}

/// Messages whose moments are changed.
fn with_moments(
    messages: &[(f64, String, AnyMessage)],
    mut change: impl FnMut(&mut WrenchStamped),
) -> Vec<(f64, String, AnyMessage)> {
    let mut messages = messages.to_vec();
    for (_, _, message) in &mut messages {
        if let AnyMessage::WrenchStamped(moment) = message {
            change(moment);
        }
    }
    messages
}

#[test]
fn robust_moments_in_another_frame_are_left_out_and_noted_once() {
    let bench = Bench::new("golden_pin");
    let messages = bench.exported();
    let played_in = |frame: &str| {
        let mut setup = read(&bench.mapping("ekf", |_| {}));
        let taken = play(&mut setup, &with_moments(&messages, |moment| moment.header.frame_id = frame.into()));
        (taken.contacts.len(), setup.router.foreign(), setup.router.take_notes())
    };
    let of_base = bench.replayed("ekf").len();
    for frame in ["", "whisker_base_link", "/whisker_base_link"] {
        assert_eq!(played_in(frame), (of_base, 0, Vec::new()), "{frame}");
    }
    let (contacts, foreign, notes) = played_in("sensor\n");
    assert_eq!((contacts, foreign, notes.len()), (0, bench.trace.sidecar.rows as u64, 1));
    assert!(
        notes[0].starts_with("/moment: found a moment in the frame `sensor\\n`")
            && notes[0].contains("expected one in the frame of the base, `whisker_base_link`"),
        "{notes:?}"
    );
}

#[test]
fn robust_a_whisker_whose_readings_are_not_used_is_no_running_one() {
    let bench = Bench::new("golden_pin");
    let messages = bench.exported();
    let last_s = messages.last().expect("messages").0;
    let is_moment = |(_, topic, _): &&(f64, String, AnyMessage)| topic == "/moment";
    let mut setup = read(&bench.mapping("ekf", |_| {}));
    play(&mut setup, &messages);
    let state = |setup: &mut Setup, now_s: f64| {
        let state = setup.whiskers[0].diagnose(now_s, Latency::default());
        (state.level.0, state.message)
    };
    assert_eq!(state(&mut setup, last_s), (0, "running".into()));
    assert!(setup.whiskers[0].shapes(last_s + 0.5).is_some());
    // The last moments again, for longer than a second.
    let repeated: Vec<_> = messages.iter().rev().filter(is_moment).take(200).cloned().collect();
    let again: Vec<_> = (0..400)
        .map(|step| {
            let (_, topic, message) = &repeated[step % 4];
            (last_s + 0.004 * step as f64, topic.clone(), message.clone())
        })
        .collect();
    play(&mut setup, &again);
    assert_eq!(state(&mut setup, last_s + 1.6), (3, "all readings are repeated: no estimates".into()));
    assert!(setup.whiskers[0].shapes(last_s + 1.6).is_none(), "the drawing of a whisker without readings");
    let bad = with_moments(&again, |moment| moment.wrench.torque.z = f64::NAN);
    play(&mut setup, &bad);
    assert_eq!(state(&mut setup, last_s + 1.6), (3, "all readings are not finite: no estimates".into()));
    assert_eq!(state(&mut setup, last_s + 9.0), (3, "no readings".into()));
}

#[test]
fn robust_a_contact_without_an_estimate_is_a_warning() {
    let bench = Bench::new("golden_pin");
    // The wrong sign: the face that seems to touch is not calibrated.
    let messages = with_moments(&bench.exported(), |moment| moment.wrench.torque.z *= -1.0);
    let mut setup = read(&bench.mapping("ekf", |_| {}));
    let (first, second) = messages.split_at(messages.len() - 150);
    play(&mut setup, first);
    setup.whiskers[0].diagnose(first.last().expect("messages").0, Latency::default());
    play(&mut setup, second);
    let state = setup.whiskers[0].diagnose(second.last().expect("messages").0, Latency::default());
    assert_eq!((state.level.0, state.message.as_str()), (1, "in contact without an estimate"));
}

#[test]
fn robust_frozen_readings_are_a_warning() {
    let bench = Bench::new("golden_pin");
    let replayed = bench.replayed("ekf");
    let held_s = replayed[replayed.len() / 2].0;
    let (mut held, mut noise) = (None, 0_u64);
    let messages = with_moments(&bench.exported(), |moment| {
        let torque = &mut moment.wrench.torque;
        noise = (noise * 37 + 11) % 101;
        torque.z += NOISE_SD_N_M * (noise as f64 / 50.0 - 1.0);
        if 1e-9 * moment.header.stamp.nanoseconds() as f64 >= held_s {
            torque.z = *held.get_or_insert(torque.z);
        }
    });
    let mut setup = read(&bench.mapping("ekf", |_| {}));
    let taken = play(&mut setup, &messages);
    assert!(taken.events[0].to_string().starts_with("frozen readings: found "), "{:?}", taken.events);
    let last_s = messages.last().expect("messages").0;
    let state = setup.whiskers[0].diagnose(last_s, Latency::default());
    assert_eq!(
        (state.level.0, state.message.as_str()),
        (1, "frozen readings, although the touched whisker moves: no estimates")
    );
    assert!(state.values.iter().any(|of| of.key == "frozen" && of.value.parse::<u64>().is_ok_and(|count| count > 50)));
    assert!(setup.whiskers[0].shapes(last_s).is_none());
}

#[test]
fn verif_shapes_and_map_show_the_contact() {
    let bench = Bench::new("golden_circle");
    let mut setup = read(&bench.mapping("outline", |_| {}));
    let taken = play(&mut setup, &bench.exported());
    let whisker = &setup.whiskers[0];
    let (time_ns, shapes) = whisker.shapes(taken.contacts.last().expect("a contact").arrived_s).expect("shapes");
    let names: Vec<&str> = shapes.iter().map(|shape| shape.name.as_str()).collect();
    for part in ["whisker", "outline", "band"] {
        assert!(names.contains(&format!("golden_circle/{part}").as_str()), "{part}: {names:?}");
    }
    let drawing = Drawing { frame: "world".into(), time_ns, lifetime_s: 0.5, shapes };
    let markers = drawing.markers().markers;
    assert_eq!(markers.len(), drawing.shapes.len());
    assert!(markers.iter().all(|marker| marker.header.frame_id == "world" && marker.lifetime.nanosec == 500_000_000));

    let map = Mapper::new(&setup.mapping).map(vec![whisker.observed()], time_ns);
    let [(layer, AnyMessage::OccupancyGrid(grid))] = &map.layers[..] else { panic!("a grid") };
    assert_eq!(*layer, "map");
    assert_eq!(grid.data.len(), (grid.info.width * grid.info.height) as usize);
    let cell = |x: f64, y: f64| {
        let size_m = f64::from(grid.info.resolution);
        let column = ((x - grid.info.origin.position.x) / size_m) as usize;
        grid.data[((y - grid.info.origin.position.y) / size_m) as usize * grid.info.width as usize + column]
    };
    // The cells at the last contacts are occupied or beside an occupied one, and a cell of the swept base is free.
    assert!(grid.data.iter().any(|of| *of > 60) && grid.data.iter().any(|of| (0..40).contains(of)));
    let last = &taken.contacts.last().expect("a contact").message.pose.pose.position;
    let around = [-2e-3, 0.0, 2e-3].iter().flat_map(|dx| [-2e-3, 0.0, 2e-3].map(|dy| cell(last.x + dx, last.y + dy)));
    assert!(around.into_iter().any(|of| of > 60), "{last:?}");
}

#[test]
fn robust_wrong_mappings_give_one_error_with_the_place() {
    let bench = Bench::new("golden_pin");
    let urdf = bench.folder.path().join("arm.urdf");
    fs::write(&urdf, r#"<robot name="a"><link name="world"/><link name="tip"/></robot>"#).expect("written");
    let no_xml = bench.folder.path().join("no.urdf");
    fs::write(&no_xml, "{}").expect("written");
    let deep = bench.folder.path().join("deep.urdf");
    let nested = format!("<robot name=\"a\">{}{}</robot>", "<a>".repeat(200_000), "</a>".repeat(200_000));
    fs::write(&deep, nested).expect("written");
    type Change<'a> = &'a dyn Fn(&mut Value);
    let cases: [(Change<'_>, &str); 17] = [
        (&|of| of["kind"] = json!("suite"), "kind: found suite, expected contact_mapping"),
        (&|of| of["format"] = json!(2), "format: found 2, expected 1"),
        (&|of| of["estimators"] = json!("ekf"), "unknown field `estimators`"),
        (&|of| of["estimator"] = json!("best"), "estimator: found `best`, expected one of recommended, sliding"),
        (&|of| of["config"] = json!({"fade": 1}), "config"),
        (&|of| of["whiskers"] = json!([]), "whiskers: found 0, expected 1 to 64 whiskers"),
        (&|of| of["whiskers"][0]["name"] = json!("1st"), "whiskers[0].name: found `1st`"),
        (
            &|of| of["whiskers"][0]["moment"] = json!("moment"),
            "whiskers[0].moment: found `moment`, expected an absolute name",
        ),
        (&|of| of["whiskers"][0]["noise_sd_n_m"] = Value::Null, "whiskers[0].noise_sd_n_m: found none"),
        (
            &|of| of["whiskers"][0]["noise_sd_n_m"] = json!(0.5),
            "whiskers[0].noise_sd_n_m: found 0.5, expected more than 0",
        ),
        (
            &|of| of["whiskers"][0]["noise_sd_n_m"] = json!(0),
            "whiskers[0].noise_sd_n_m: found 0, expected more than 0, at most ",
        ),
        (&|of| of["whiskers"][0]["rate_hz"] = json!(0), "whiskers[0].rate_hz: found 0, expected 0.001 to 1000000"),
        (&|of| of["plane"] = json!({"tilt_rad": -1}), "plane.tilt_rad: found -1, expected 0 to 0.5"),
        (&|of| of["timing"] = json!({"wait_s": 60}), "timing: found wait: found 60 s"),
        (&|of| of["urdf"] = json!("arm.urdf"), "link: found world, tip, expected `whisker_base_link` among them"),
        (
            &|of| of["urdf"] = json!("deep.urdf"),
            "robot: found deeper elements, expected elements nested at most 64 deep",
        ),
        (&|of| of["urdf"] = json!("no.urdf"), "expected the description of a robot (URDF)"),
    ];
    for (change, words) in cases {
        let path = bench.mapping("ekf", change);
        let error = format!("{:#}", Setup::read(&path).err().unwrap_or_else(|| panic!("{words}")));
        assert!(
            error.contains(words) && error.contains(bench.folder.path().to_str().expect("text")),
            "{words}: {error}"
        );
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    let missing = Setup::read(Path::new("no/such.json")).err().expect("an error").to_string();
    assert!(missing.starts_with("no/such.json: "), "{missing}");
}
