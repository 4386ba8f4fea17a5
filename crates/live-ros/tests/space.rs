//! Recordings in space played as messages, against the replay of the same traces.

mod played;
#[path = "../../evaluation/tests/space_dataset/mod.rs"]
mod space_dataset;

use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

use bag::messages::{
    AnyMessage, Header, MagneticField, PointCloud2, Quaternion, TfMessage, Time, Transform, TransformStamped,
};
use evaluation::space::fit::fit;
use files::write_json;
use indicatif::ProgressBar;
use live_ros::{Drawing, Form, Latency, Mapper, Mapping, Setup, Taken};
use nalgebra::{Isometry3, Matrix2, Matrix3, Translation3, UnitQuaternion, Vector2, Vector3};
use serde_json::{Value, json};
use tempfile::TempDir;
use testbed::space::replay::{knowledge, read_calibration, registered, replay, samples};
use testbed::space::{readings_n_m, to_world};
use trace::{BendingResponse, BendingSensor, SpatialCalibrationFile, SpatialTrace};
use whisker::frames::World;
use whisker::space::estimators::Estimate;
use whisker::space::frames::Pose;

use played::{messages_of, play, read};
use space_dataset::{dataset, fit_settings, golden};

const NOISE_SD_N_M: f64 = 1e-7;

/// The golden trace in space with a calibration, and a folder for the mapping.
struct Bench {
    folder: TempDir,
    trace: SpatialTrace,
    calibration: PathBuf,
}

impl Bench {
    /// The calibration is fitted to contacts of the rod.
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let dataset = dataset(folder.path(), 9);
        let calibrations = dataset.calibrations("white");
        let fitted = fit(&dataset, &fit_settings(), &calibrations, &ProgressBar::hidden()).expect("fitted").remove(0);
        Self { folder, trace: golden(), calibration: fitted.path }
    }

    /// A mapping with one whisker, changed by `change`.
    fn mapping(&self, estimator: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
        let mut mapping = json!({
            "format": 1, "kind": "contact_mapping", "estimator": estimator,
            "whiskers": [{
                "name": "w", "calibration": self.calibration, "rate_hz": self.trace.sidecar.rate_hz,
                "noise_sd_n_m": NOISE_SD_N_M, "moment": "/moment",
            }],
        });
        change(&mut mapping);
        let path = self.folder.path().join("mapping.json");
        fs::write(&path, mapping.to_string()).expect("written");
        path
    }

    /// Times and estimates of a replay, with the poses of the base.
    fn replayed(&self, estimator: &str) -> Vec<(f64, Pose<whisker::frames::Base, World>, Estimate)> {
        let calibrated = read_calibration(&self.calibration).and_then(|of| Ok(of.calibrated(&self.calibration, None)?));
        let knowledge = knowledge(&calibrated.expect("valid"), NOISE_SD_N_M, None, self.trace.sidecar.rate_hz);
        let row = registered(estimator).expect("a registered estimator");
        let samples = samples(&self.trace, &readings_n_m(&self.trace));
        let estimates = replay(row, &row.defaults(), &knowledge, &samples).expect("replayed").estimates;
        let known = self.trace.recording.instants.iter().zip(estimates);
        known.filter_map(|(now, estimate)| Some((now.t_s, to_world(&now.base), estimate?))).collect()
    }

    /// Messages of the exported trace.
    fn exported(&self) -> Vec<(f64, String, AnyMessage)> {
        let recording = self.folder.path().join("recording");
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space/golden_space.csv");
        whisker_cli::ros::export_spatial_trace(&golden, None, &recording).expect("exported");
        messages_of(&recording)
    }
}

/// Asserts that published contacts are those of a replay in another frame, which is `World` turned and moved by `by`.
fn assert_same(taken: &Taken, bench: &Bench, estimator: &str, by: &Isometry3<f64>, tolerance: f64) {
    let replayed = bench.replayed(estimator);
    assert!(replayed.len() > 100, "{estimator}: {}", replayed.len());
    assert_eq!(taken.contacts.len(), replayed.len(), "{estimator}: {:?}", taken.events);
    for (contact, (t_s, base, estimate)) in taken.contacts.iter().zip(&replayed) {
        let message = &contact.message;
        assert_eq!(message.header.stamp.nanoseconds(), (1e9 * t_s).round() as i64);
        let (at, turned) = (&message.pose.pose.position, &message.pose.pose.orientation);
        let expected = by * nalgebra::Point3::from(base.apply(estimate.contact).vector());
        let away_m = (Vector3::new(at.x, at.y, at.z) - expected.coords).norm();
        assert!(away_m <= tolerance, "{estimator}: {away_m} m");
        let turned = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(turned.w, turned.x, turned.y, turned.z));
        let normal = by.rotation * base.turn_vector(estimate.normal);
        assert!((turned * Vector3::x() - normal).norm() < 1e-7, "{estimator}");
        let turn = by.rotation.to_rotation_matrix();
        let turned = |of: Matrix3<f64>| turn * base.turn(of) * turn.transpose();
        let stated = |first: usize| Matrix3::from_fn(|i, j| message.pose.covariance[first + i][first + j]);
        let contact = turned(estimate.covariance_m2);
        assert!((stated(0) - contact).norm() < 1e-6 * contact.norm(), "{estimator}");
        // Rotations w change the normal by w x n; that about the normal may be any.
        let rotation = normal.cross_matrix() * turned(estimate.normal_covariance) * normal.cross_matrix().transpose();
        let rotation = rotation + normal * normal.transpose() * (PI * PI / 3.0);
        let is_stated = estimate.normal_covariance.trace() > 0.0;
        assert!(!is_stated || (stated(3) - rotation).norm() < 1e-6 * rotation.norm(), "{estimator}");
        assert!(is_stated || stated(3)[(0, 0)] == -1.0, "{estimator}");
        assert!((0..3).all(|i| (3..6).all(|j| message.pose.covariance[i][j] == 0.0)));
    }
}

#[test]
fn verif_contacts_of_a_played_recording_in_space_equal_those_of_a_replay() {
    let bench = Bench::new();
    let messages = bench.exported();
    for name in ["point", "line", "recommended", "batch-recommended"] {
        let mut setup = read(&bench.mapping(name, |_| {}));
        assert!(setup.is_in_space);
        let taken = play(&mut setup, &messages);
        // The quaternions of the trace have twelve decimals; those of messages are normalised.
        assert_same(&taken, &bench, name, &Isometry3::identity(), 1e-9);
        assert!(taken.events.is_empty(), "{name}: {:?}", taken.events);
    }
}

/// A magnetometer whose axes z and x are the channels of the sensor, with counts at rest, from which the moments follow.
#[test]
fn verif_counts_of_a_magnetometer_in_space_give_the_contacts_of_the_moments() {
    let bench = Bench::new();
    let response = BendingResponse::new(Matrix2::new(2e7, 5e6, -4e6, 3e7)).expect("it can be inverted");
    let mut calibration = SpatialCalibrationFile::read(&bench.calibration).expect("valid");
    calibration.sensor = Some(BendingSensor { counts_per_n_m: response, noise_sd_n_m: NOISE_SD_N_M });
    write_json(&bench.calibration, &calibration).expect("written");
    let counts_of = |of: (f64, String, AnyMessage)| match of {
        (t_s, _, AnyMessage::WrenchStamped(wrench)) => {
            let torque = wrench.wrench.torque;
            let counts = response.counts(Vector2::new(torque.y, torque.z)) + Vector2::new(512.0, -140.0);
            let magnetic_field = bag::messages::Vector3 { x: counts.y, y: 7.0, z: counts.x };
            let field = MagneticField { header: wrench.header, magnetic_field, magnetic_field_covariance: [0.0; 9] };
            (t_s, "/counts".to_owned(), AnyMessage::MagneticField(field))
        }
        other => other,
    };
    let messages: Vec<_> = bench.exported().into_iter().map(counts_of).collect();
    let taken = play(
        &mut read(&bench.mapping("line", |of| {
            let whisker = of["whiskers"][0].as_object_mut().expect("an object");
            whisker.remove("moment");
            whisker.remove("noise_sd_n_m");
            whisker.insert(
                "counts".into(),
                json!({"topic": "/counts", "message": "MagneticField", "axes": ["z", "x"], "zeroing_s": 0.02}),
            );
        })),
        &messages,
    );
    assert_same(&taken, &bench, "line", &Isometry3::identity(), 1e-7);
}

/// The base is at rest on a flange that an arm moves, tilted about all axes: world -> flange (moving), flange -> base (static).
#[test]
fn verif_frames_that_tilt_give_the_same_contacts_in_space() {
    let bench = Bench::new();
    let turn = UnitQuaternion::from_euler_angles(0.4, -0.7, 2.0);
    let by = Isometry3::from_parts(Translation3::new(0.3, -0.2, 0.8), turn);
    let offset = UnitQuaternion::from_euler_angles(-0.3, 0.2, 1.1);
    let on_flange = Isometry3::from_parts(Translation3::new(0.02, -0.01, 0.05), offset);
    let put = |header: Header, child: &str, pose: &Isometry3<f64>| {
        let (at, turned) = (pose.translation.vector, pose.rotation);
        let translation = bag::messages::Vector3 { x: at.x, y: at.y, z: at.z };
        let rotation = Quaternion { x: turned.i, y: turned.j, z: turned.k, w: turned.w };
        TransformStamped { header, child_frame_id: child.into(), transform: Transform { translation, rotation } }
    };
    let at_rest = Header { stamp: Time::from_nanoseconds(0), frame_id: "flange".into() };
    let fixed = TfMessage { transforms: vec![put(at_rest, "whisker_base_link", &on_flange)] };
    let mut messages = vec![(0.0, "/tf_static".to_owned(), AnyMessage::TfMessage(fixed))];
    for (t_s, topic, message) in bench.exported() {
        let AnyMessage::TfMessage(frames) = &message else {
            messages.push((t_s, topic, message));
            continue;
        };
        let (of, at) = (&frames.transforms[0], &frames.transforms[0].transform.translation);
        let turned = &of.transform.rotation;
        let rotation =
            UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(turned.w, turned.x, turned.y, turned.z));
        let base = by * Isometry3::from_parts(Translation3::new(at.x, at.y, at.z), rotation);
        let transforms = vec![put(of.header.clone(), "flange", &(base * on_flange.inverse()))];
        messages.push((t_s, topic, AnyMessage::TfMessage(TfMessage { transforms })));
    }
    let taken = play(&mut read(&bench.mapping("line", |_| {})), &messages);
    assert_same(&taken, &bench, "line", &by, 1e-9);
}

/// Points of a cloud with `N` fields.
fn points<const N: usize>(cloud: &PointCloud2) -> Vec<[f32; N]> {
    assert_eq!((cloud.point_step as usize, cloud.fields.len()), (4 * N, N));
    assert!(cloud.fields.iter().zip(0..).all(|(field, place)| field.offset == 4 * place && field.datatype == 7));
    assert!(cloud.fields.iter().map(|field| field.name.as_str()).take(3).eq(["x", "y", "z"]));
    assert_eq!(cloud.data.len(), (cloud.width * cloud.point_step) as usize);
    let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("four bytes"));
    let point = |bytes: &[u8]| std::array::from_fn(|i| number(&bytes[4 * i..4 * i + 4]));
    cloud.data.chunks_exact(4 * N).map(point).collect()
}

#[test]
fn verif_shapes_and_map_in_space_show_the_contact() {
    let bench = Bench::new();
    let mut setup = read(&bench.mapping("line", |_| {}));
    let mut messages = bench.exported();
    // Up to the last contact.
    let (end_s, ..) = *bench.replayed("line").last().expect("a contact");
    messages.retain(|(at_s, ..)| *at_s < end_s + 1e-6);
    let taken = play(&mut setup, &messages);
    let last = taken.contacts.last().expect("a contact");
    let at = &last.message.pose.pose.position;
    let (time_ns, shapes) = setup.whiskers[0].shapes(last.arrived_s).expect("shapes");
    assert_eq!(time_ns, last.time_ns);
    let names: Vec<&str> = shapes.iter().map(|shape| shape.name.as_str()).collect();
    assert_eq!(names, ["w/whisker", "w/contact", "w/normal"]);
    let Form::Line(wire, _) = &shapes[0].form else { panic!("a line") };
    let away_m = |of: &bag::messages::Point| Vector3::new(of.x - at.x, of.y - at.y, of.z - at.z).norm();
    let nearest_m = wire.iter().map(away_m).fold(f64::INFINITY, f64::min);
    assert!(nearest_m < 2e-3, "the bent wire passes through the contact: {nearest_m} m");
    let Form::Ellipsoid(pose, diameters) = &shapes[1].form else { panic!("an ellipsoid") };
    assert!(away_m(&pose.position) < 1e-12 && diameters.iter().all(|diameter| (2e-4..0.1).contains(diameter)));
    let drawing = Drawing { frame: "world".into(), time_ns, lifetime_s: 0.5, shapes };
    assert_eq!(drawing.markers().markers.len(), 3);
    let state = setup.whiskers[0].diagnose(0.0, Latency::default());
    assert_eq!((state.level.0, state.message.as_str()), (0, "running"));

    let map = Mapper::new(&setup.mapping).map(vec![setup.whiskers[0].observed()], time_ns);
    let [(first, AnyMessage::PointCloud2(touched)), (second, AnyMessage::PointCloud2(voxels))] = &map.layers[..] else {
        panic!("two clouds")
    };
    assert_eq!((*first, *second), ("map_points", "map_voxels"));
    assert!(map.shapes.is_empty() && !map.is_too_large);
    let touched = points::<8>(touched);
    let off_m = |of: &[f32; 8]| {
        let away = Vector3::new(f64::from(of[0]) - at.x, f64::from(of[1]) - at.y, f64::from(of[2]) - at.z);
        away.norm()
    };
    assert!(!touched.is_empty() && touched.iter().any(|of| off_m(of) < 2e-3), "{touched:?}");
    assert!(touched.iter().all(|of| (1e-7..1e-3).contains(&of[6]) && of[7] == 0.0));
    let occupied: Vec<bool> = points::<4>(voxels).iter().map(|of| of[3] == 1.0).collect();
    assert!(occupied.contains(&true) && occupied.iter().filter(|is_occupied| !**is_occupied).count() > 20);
}

#[test]
fn robust_mappings_that_do_not_fit_calibrations_in_space_are_refused() {
    let bench = Bench::new();
    type Change<'a> = &'a dyn Fn(&mut Value);
    let cases: [(Change<'_>, &str); 9] = [
        (
            &|of| of["estimator"] = json!("ekf"),
            "estimator: found `ekf`, expected one of recommended, batch-recommended",
        ),
        (&|of| of["config"] = json!({"fade": 1}), "config"),
        (
            &|of| of["plane"] = json!({"tilt_rad": 0.1}),
            "plane: found a setting of planar estimators, with calibrations in space, expected the default: no pose",
        ),
        (
            &|of| of["seed"] = json!(2),
            "seed: found a setting of planar estimators, with calibrations in space, expected",
        ),
        (
            &|of| of["map"] = json!({"cell_m": 0.004}),
            "map: found a setting of planar estimators, with calibrations in space, expected the default: maps in space",
        ),
        (
            &|of| {
                of["whiskers"][0]["moment"] = Value::Null;
                of["whiskers"][0]["counts"] = json!({"topic": "/counts"});
            },
            "whiskers[0].calibration: found a calibration without a sensor, with `counts`, expected one that `whisker fit` made",
        ),
        (
            &|of| {
                of["whiskers"][0]["moment"] = Value::Null;
                of["whiskers"][0]["counts"] = json!({"topic": "/counts", "axis": "x"});
            },
            "whiskers[0].counts.axis: found a setting of planar estimators, with calibrations in space, expected `axes`",
        ),
        (
            &|of| {
                of["whiskers"][0]["moment"] = Value::Null;
                of["whiskers"][0]["counts"] = json!({"topic": "/counts", "axes": ["x", "x"]});
            },
            "whiskers[0].counts.axes: found x and x, expected two different axes",
        ),
        (
            &|of| {
                let mut other = of["whiskers"][0].clone();
                (other["name"], other["calibration"]) = (json!("v"), json!("planar.json"));
                of["whiskers"].as_array_mut().expect("a list").push(other);
            },
            "whiskers: found 1 of 2 calibrations in space, expected all calibrations in the plane or all in space",
        ),
    ];
    fs::write(bench.folder.path().join("planar.json"), r#"{"format": 1}"#).expect("written");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/live-space/mapping.json");
    assert_eq!(Mapping::read(&example).expect("valid").whiskers.len(), 1);
    for (change, words) in cases {
        let path = bench.mapping("point", change);
        let error = format!("{:#}", Setup::read(&path).err().unwrap_or_else(|| panic!("{words}")));
        assert!(error.contains(words) && error.lines().count() == 1, "{words}: {error}");
        assert!(error.contains(path.to_str().expect("text")), "{error}");
    }
}
