//! Traces and logs as ROS 2 recordings and back.

use std::fs;
use std::path::{Path, PathBuf};

use bag::messages::{Header, MagneticField, MagneticFieldArray, PoseWithCovarianceStamped, Time, Vector3};
use bag::{Publisher, Reader, Writer, topics};
use serde_json::{Value, json};
use testbed::results::{EstimateRow, csv_bytes};
use testbed::space::SpatialEstimateRow;
use trace::{SpatialTrace, Trace};
use whisker_cli::ros::{Export, export_spatial_trace, export_trace, import};

fn golden() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../datasets/golden"))
}

fn field(time_ns: u64, x: f64) -> MagneticField {
    MagneticField {
        header: Header { stamp: Time::from_nanoseconds(time_ns), frame_id: String::new() },
        magnetic_field: Vector3 { x, y: 65535.0, z: 0.0 },
        magnetic_field_covariance: [0.0; 9],
    }
}

/// Recording in the format of OpenWhisker, with wall-clock times.
fn record(folder: &Path, fields: Vec<MagneticField>) {
    let mut writer = Writer::create(folder).unwrap();
    let readings = MagneticFieldArray { magnetic_field_array: fields };
    writer.write(topics::MAGNETOMETER, 1_705_004_055_000_000_000, &readings).unwrap();
    writer.finish().unwrap();
}

#[test]
fn verif_traces_are_restored_byte_for_byte() {
    let home = tempfile::tempdir().unwrap();
    for name in ["golden_circle", "golden_pin"] {
        let folder = home.path().join(name);
        export_trace(&golden().join(format!("{name}.csv")), None, &folder).unwrap();
        let files = import(&folder, false, &home.path().join("back")).unwrap();
        assert_eq!(files.len(), 3);
        for file in files {
            let original = golden().join(file.file_name().unwrap());
            assert_eq!(fs::read(&file).unwrap(), fs::read(original).unwrap(), "{}", file.display());
        }
    }
}

fn golden_space() -> PathBuf {
    golden().join("space/golden_space.csv")
}

#[test]
fn verif_a_trace_in_space_is_restored_byte_for_byte() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("recording");
    assert_eq!(export_spatial_trace(&golden_space(), None, &folder).unwrap(), Export::Written);
    assert_eq!(export_spatial_trace(&golden_space(), None, &folder).unwrap(), Export::UpToDate);
    let files = import(&folder, false, &home.path().join("back")).unwrap();
    assert_eq!(files.len(), 2);
    for file in files {
        let original = golden_space().with_file_name(file.file_name().unwrap());
        assert_eq!(fs::read(&file).unwrap(), fs::read(original).unwrap(), "{}", file.display());
    }
}

#[test]
fn verif_estimates_in_space_are_contacts_in_the_frame_of_the_whisker() {
    let home = tempfile::tempdir().unwrap();
    let trace = SpatialTrace::read(&golden_space()).unwrap();
    let (row, truth) = trace.truth.instants.iter().enumerate().find_map(|(i, at)| Some((i, at.contact?))).unwrap();
    let known = &trace.recording.instants[row];
    let turned = known.base.rotation * nalgebra::Vector3::x();
    let estimate = SpatialEstimateRow {
        t_s: known.t_s,
        contact_x_m: Some(truth.contact.x),
        contact_y_m: Some(truth.contact.y),
        contact_z_m: Some(truth.contact.z),
        normal_x: Some(truth.normal.x),
        normal_y: Some(truth.normal.y),
        normal_z: Some(truth.normal.z),
        cov_xx_m2: Some(turned.x * turned.x),
        cov_xy_m2: Some(turned.x * turned.y),
        cov_xz_m2: Some(turned.x * turned.z),
        cov_yy_m2: Some(turned.y * turned.y),
        cov_yz_m2: Some(turned.y * turned.z),
        cov_zz_m2: Some(turned.z * turned.z),
        truth_contact_x_m: Some(truth.contact.x),
        truth_contact_y_m: Some(truth.contact.y),
        truth_contact_z_m: Some(truth.contact.z),
        ..SpatialEstimateRow::default()
    };
    let table = home.path().join("estimates.csv");
    fs::write(&table, csv_bytes(std::slice::from_ref(&estimate)).unwrap()).unwrap();
    let folder = home.path().join("recording");
    export_spatial_trace(&golden_space(), Some(&table), &folder).unwrap();
    let reader = Reader::open(&folder).unwrap();
    let found: Vec<PoseWithCovarianceStamped> = reader
        .records()
        .map(Result::unwrap)
        .filter(|record| record.topic == "/detected_contact_covariance")
        .map(|record| record.decode().unwrap())
        .collect();
    let [PoseWithCovarianceStamped { header, pose }] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!(header.frame_id, topics::WHISKER);
    let position = nalgebra::Vector3::new(pose.pose.position.x, pose.pose.position.y, pose.pose.position.z);
    let back = known.base.rotation * position + known.base.position;
    assert!((back - truth.contact).norm() < 1e-12, "{back}");
    let turn = &pose.pose.orientation;
    let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(turn.w, turn.x, turn.y, turn.z));
    assert!((known.base.rotation * turn * nalgebra::Vector3::x() - truth.normal).norm() < 1e-9);
    // The variance is that along x of the whisker's frame.
    assert!((pose.covariance[0][0] - 1.0).abs() < 1e-9 && pose.covariance[1][1].abs() < 1e-9);
    assert_eq!(import(&folder, false, &home.path().join("back")).unwrap().len(), 2);

    let refused = |rows: &[SpatialEstimateRow]| {
        fs::write(&table, csv_bytes(rows).unwrap()).unwrap();
        export_spatial_trace(&golden_space(), Some(&table), &home.path().join("other")).unwrap_err().to_string()
    };
    let message = refused(&[SpatialEstimateRow { t_s: 12345.0, ..estimate.clone() }]);
    assert!(message.contains("t_s: found 12345 s, expected a time of "), "{message}");
    let message =
        refused(&[SpatialEstimateRow { truth_contact_y_m: Some(truth.contact.y + 1e-3), ..estimate.clone() }]);
    assert!(message.contains("found another true contact, expected that of "), "{message}");
    let message = refused(&[estimate.clone(), estimate]);
    assert!(message.contains(" s twice, expected each time once"), "{message}");
}

#[test]
fn robust_a_table_of_estimates_goes_with_the_kind_of_its_trace() {
    let home = tempfile::tempdir().unwrap();
    let planar = home.path().join("planar.csv");
    fs::write(&planar, csv_bytes(&[EstimateRow::default()]).unwrap()).unwrap();
    let message = export_spatial_trace(&golden_space(), Some(&planar), &home.path().join("a")).unwrap_err();
    assert!(format!("{message:#}").contains("planar.csv:1: found other columns"), "{message:#}");
    let spatial = home.path().join("spatial.csv");
    fs::write(&spatial, csv_bytes(&[SpatialEstimateRow::default()]).unwrap()).unwrap();
    let message = export_trace(&golden().join("golden_pin.csv"), Some(&spatial), &home.path().join("b")).unwrap_err();
    assert!(format!("{message:#}").contains("spatial.csv:1: found other columns"), "{message:#}");
    let message =
        export_trace(&golden().join("golden_pin.csv"), Some(home.path()), &home.path().join("c")).unwrap_err();
    let expected = format!("{}: found a folder, expected a file", home.path().display());
    assert_eq!(format!("{message:#}"), expected);
}

#[test]
fn robust_a_repeated_export_keeps_an_equal_recording_and_refuses_another() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("recording");
    let export = |name: &str| export_trace(&golden().join(name), None, &folder);
    assert_eq!(export("golden_pin.csv").unwrap(), Export::Written);
    let files = tree(home.path());
    assert_eq!(export("golden_pin.csv").unwrap(), Export::UpToDate);
    let message = export("golden_circle.csv").unwrap_err().to_string();
    assert!(message.contains("path: found another file or folder of that name"), "{message}");
    assert_eq!(tree(home.path()), files);
    assert_eq!(export("golden_pin.csv").unwrap(), Export::UpToDate);
}

#[test]
fn verif_foreign_readings_become_a_log() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("foreign");
    let begin_ns = 1_705_004_054_969_568_000;
    record(&folder, vec![field(begin_ns, 0.0), field(begin_ns + 1_250_000, 7.0)]);
    let files = import(&folder, false, home.path()).unwrap();
    let table = "t_s,x_counts,y_counts,z_counts\n0.000000,0,65535,0\n0.001250,7,65535,0\n";
    assert_eq!(fs::read_to_string(&files[1]).unwrap(), table);
}

#[test]
fn robust_a_message_without_a_reading_is_an_error() {
    let home = tempfile::tempdir().unwrap();
    let cases = [
        ("tesla", vec![field(0, 1e-4)], "found 0.0001, expected the counts of a sensor"),
        ("beyond", vec![field(0, 65536.0)], "found 65536, expected the counts of a sensor"),
        ("unknown", vec![field(0, f64::NAN)], "found NaN, expected the counts of a sensor"),
        ("back", vec![field(5, 1.0), field(4, 1.0)], "found a stamp of 4 ns, expected none before"),
        ("empty", vec![], "found neither a trace nor readings on /magnetometer_reading"),
    ];
    for (name, fields, words) in cases {
        let folder = home.path().join(name);
        record(&folder, fields);
        let message = import(&folder, false, &home.path().join("log")).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
    assert!(!home.path().join("log").exists());
}

#[test]
fn robust_an_invalid_sidecar_of_a_log_is_an_error() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("foreign");
    let mut writer = Writer::create(&folder).unwrap();
    writer.attach("log.json", "application/json", b"{\"kind\": \"diary\"}").unwrap();
    writer.finish().unwrap();
    let message = import(&folder, false, &home.path().join("log")).unwrap_err().to_string();
    assert!(message.contains("attachment log.json:1:17: missing field"), "{message}");
}

#[test]
fn robust_estimates_of_another_trace_leave_no_recording_behind() {
    let home = tempfile::tempdir().unwrap();
    let (estimates, folder) = (home.path().join("estimates.csv"), home.path().join("recording"));
    let late = EstimateRow { t_s: 12345.0, ..EstimateRow::default() };
    fs::write(&estimates, csv_bytes(&[late]).unwrap()).unwrap();
    let message = export_trace(&golden().join("golden_pin.csv"), Some(&estimates), &folder).unwrap_err().to_string();
    assert!(message.contains("t_s: found 12345 s, expected a time of "), "{message}");
    // A trace with other contacts at the same times.
    let circle = Trace::read(&golden().join("golden_circle.csv")).unwrap();
    let rows: Vec<EstimateRow> = circle
        .recording
        .instants
        .iter()
        .zip(&circle.truth.instants)
        .map(|(known, truth)| EstimateRow {
            t_s: known.t_s,
            truth_contact_x_m: truth.contact.map(|contact| contact.x()),
            truth_contact_y_m: truth.contact.map(|contact| contact.y()),
            ..EstimateRow::default()
        })
        .collect();
    fs::write(&estimates, csv_bytes(&rows).unwrap()).unwrap();
    let message = export_trace(&golden().join("golden_pin.csv"), Some(&estimates), &folder).unwrap_err().to_string();
    assert!(message.contains("found another true contact, expected that of "), "{message}");
    assert_eq!(tree(home.path()), [estimates]);
}

#[test]
fn robust_an_interrupted_recording_is_converted_only_on_request() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("run");
    let mut writer = Writer::create(&folder).unwrap();
    for i in 0..8000 {
        let readings = MagneticFieldArray { magnetic_field_array: vec![field(i * 1_250_000, i as f64)] };
        writer.write(topics::MAGNETOMETER, i * 1_250_000, &readings).unwrap();
    }
    writer.finish().unwrap();
    let file = folder.join("run_0.mcap");
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    let log = home.path().join("log");
    assert!(import(&folder, false, &log).is_err());
    let files = import(&folder, true, &log).unwrap();
    assert!(fs::read_to_string(&files[1]).unwrap().lines().count() > 1000);
}

/// Files of a folder and its subfolders, sorted.
fn tree(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(tree(&path));
        }
        found.push(path);
    }
    found.sort();
    found
}

#[test]
fn robust_a_foreign_recording_writes_only_into_its_folder() {
    let home = tempfile::tempdir().unwrap();
    let (sound, out) = (home.path().join("sound"), home.path().join("deep/out"));
    export_trace(&golden().join("golden_pin.csv"), None, &sound).unwrap();
    let reader = Reader::open(&sound).unwrap();
    let sidecar: Value = serde_json::from_slice(&reader.attachments().unwrap()[0].data).unwrap();
    let absolute = home.path().join("escaped").display().to_string();
    for (i, name) in ["../escaped", &absolute, "deeper/escaped", "..", ".", "", "a\\b", "a\0b"].into_iter().enumerate()
    {
        for key in ["name", "contour"] {
            let mut hostile = sidecar.clone();
            match key {
                "name" => hostile["name"] = json!(name),
                _ => hostile["contour"]["file"] = json!(name),
            }
            let folder = home.path().join(format!("{key}_{i}"));
            let mut writer = Writer::create(&folder).unwrap();
            for record in reader.records().map(Result::unwrap) {
                let message = record.decode_any().unwrap().unwrap();
                message.write(&mut writer, &record.topic, record.time_ns).unwrap();
            }
            writer.attach("hostile.json", "application/json", hostile.to_string().as_bytes()).unwrap();
            writer.attach(name, "text/csv", &reader.attachments().unwrap()[1].data).unwrap();
            writer.finish().unwrap();
            let before = tree(home.path());
            let message = import(&folder, false, &out).unwrap_err().to_string();
            assert!(message.contains(key) && message.contains("expected a plain file name"), "{message}");
            assert_eq!(tree(home.path()), before);
        }
    }
}

#[test]
fn robust_unrequested_attachments_are_not_written() {
    let home = tempfile::tempdir().unwrap();
    let (folder, out) = (home.path().join("foreign"), home.path().join("deep/out"));
    let mut writer = Writer::create(&folder).unwrap();
    let readings = MagneticFieldArray { magnetic_field_array: vec![field(0, 1.0)] };
    writer.write(topics::MAGNETOMETER, 0, &readings).unwrap();
    for name in ["../escaped", &home.path().join("escaped").display().to_string(), "../log.json", "escaped"] {
        writer.attach(name, "text/plain", b"hostile").unwrap();
    }
    writer.finish().unwrap();
    let files = import(&folder, false, &out).unwrap();
    assert_eq!(files, [out.join("log.json"), out.join("log.csv")]);
    let mut expected = tree(&folder);
    expected.extend([folder, out.clone(), home.path().join("deep"), out.join("log.csv"), out.join("log.json")]);
    expected.sort();
    assert_eq!(tree(home.path()), expected);
}

#[test]
fn robust_info_prints_no_control_characters_of_a_recording() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("hostile");
    let mut writer = Writer::create(&folder).unwrap();
    let readings = MagneticFieldArray { magnetic_field_array: vec![field(0, 1.0)] };
    writer.write("/\u{1b}[2J\u{7}\u{9b}31mtopic\n", 0, &readings).unwrap();
    writer.attach("\u{1b}]0;title\u{7}", "text/plain", b"none").unwrap();
    writer.finish().unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_whisker"))
        .args(["bag", "info", folder.to_str().unwrap()])
        .output()
        .unwrap();
    for bytes in [output.stdout, output.stderr] {
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.lines().all(|line| !line.contains(char::is_control)), "{text:?}");
    }
}
