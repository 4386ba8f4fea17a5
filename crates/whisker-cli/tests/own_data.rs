//! From the recordings of a laboratory to estimates: import, check, fit, replay and evaluation of the example.

mod command;
#[path = "own_data/laboratory.rs"]
mod laboratory;
#[path = "own_data/made.rs"]
mod made;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use bag::messages::{
    Header, MagneticField, Point as RosPoint, Pose as RosPose, PoseStamped, Quaternion, Time, Vector3,
};
use bag::{Publisher, Writer};
use serde_json::{Value, json};
use trace::{CalibrationFile, Recorded, SensorFile, Sidecar, Trace};

use command::{assert_fails, text, whisker};
use laboratory::{assert_stored, copied, good, lived, root};

fn example() -> PathBuf {
    root().join("examples/own-data")
}

/// Numbers of a column of a table; rows with an empty field are left out.
fn column(path: &Path, name: &str) -> Vec<f64> {
    let mut table = csv::Reader::from_path(path).unwrap();
    let place = table.headers().unwrap().iter().position(|column| column == name).unwrap();
    table.records().filter_map(|row| row.unwrap()[place].parse().ok()).collect()
}

/// Copy of the example with a changed mapping.
fn changed(change: impl FnOnce(String) -> String) -> tempfile::TempDir {
    let folder = copied(&example());
    let mapping = folder.path().join("import.json");
    fs::write(&mapping, change(fs::read_to_string(&mapping).unwrap())).unwrap();
    folder
}

/// Imports a copy of the example and returns its standard error.
fn imported(folder: &Path) -> (PathBuf, Output) {
    let out = folder.join("traces");
    let output = whisker(&["import", "csv", text(&folder.join("import.json")), "--out", text(&out)]);
    (out, output)
}

/// Asserts that the import of a folder fails with a single error that contains every one of `words`.
fn fails_on(folder: &Path, words: &[&str]) {
    assert_fails(imported(folder).1, words);
}

fn fails(change: impl FnOnce(String) -> String, words: &[&str]) {
    fails_on(changed(change).path(), words);
}

#[test]
#[ignore = "writes examples/own-data"]
fn write_example() {
    for (name, rows) in made::recordings() {
        fs::write(example().join(format!("{name}.csv")), made::csv(&rows)).unwrap();
    }
}

#[test]
fn regress_example_is_that_of_the_elastica() {
    for (name, rows) in made::recordings() {
        assert_stored(&example().join(format!("{name}.csv")), &made::csv(&rows));
    }
}

#[test]
fn verif_own_csv_gives_accurate_contacts() {
    let work = tempfile::tempdir().unwrap();
    let traces = work.path().join("lab");
    let mapping = example().join("import.json");
    let (listed, notes) = good(&["import", "csv", text(&mapping), "--out", text(&traces)]);
    assert!(listed.contains("lab-whisker") && notes.contains("trial_1: interpolated"), "{listed}{notes}");
    assert!(!notes.contains("warning"), "{notes}");
    good(&["check", text(&traces)]);
    let sidecar = Sidecar::read(&traces.join("trial_1.json")).unwrap();
    let recorded = sidecar.recorded.unwrap();
    // The stiffness of the whisker determines the scale of the counts.
    assert!((recorded.characteristic[0] / -3e7 - 1.0).abs() < 0.03, "{:?}", recorded.characteristic);
    assert_eq!(recorded.rest_counts, 512.0);
    assert!((1e-8..2e-7).contains(&recorded.noise_sd_n_m), "{}", recorded.noise_sd_n_m);

    good(&["fit", text(&traces), "--model", "spline"]);
    let results = work.path().join("results");
    good(&["evaluate", text(&traces), "--estimators", "recommended", "--results", text(&results)]);
    let error_m = column(&results.join("lab/trials.csv"), "late_mean_m");
    assert!(error_m.len() == 1 && error_m[0] < 0.3e-3, "{error_m:?}");
    let estimates = work.path().join("estimates.csv");
    let trial = traces.join("trial_1.csv");
    good(&["replay", text(&trial), "--out", text(&estimates)]);
    // No noise is added to a recording: the readings are those of the trace.
    let moments: Vec<f64> =
        Trace::read(&trial).unwrap().recording.instants.iter().map(|instant| instant.moment_z_n_m).collect();
    assert_eq!(column(&estimates, "reading_n_m").len(), moments.len());
    for (reading, moment) in column(&estimates, "reading_n_m").iter().zip(&moments) {
        assert!((reading - moment).abs() < 1e-14, "{reading} {moment}");
    }
}

/// The recordings of the example as rosbag2 folders, with the readings on this topic; the topics have times of their own.
fn bags(folder: &Path, readings: &str) {
    for (name, rows) in made::recordings() {
        let mut writer = Writer::create(&folder.join(name)).unwrap();
        for row in rows {
            let time_ns = |late_ms: f64| (1e6 * (row.time_ms + late_ms)) as u64;
            let header = |time_ns| Header { stamp: Time::from_nanoseconds(time_ns), frame_id: "world".into() };
            let (x_mm, y_mm, yaw_deg) = row.flange;
            let position = RosPoint { x: 1e-3 * x_mm, y: 1e-3 * y_mm, z: 0.3 };
            let pose = RosPose { position, orientation: Quaternion::about_z(yaw_deg.to_radians()) };
            writer.write("/flange", time_ns(0.0), &PoseStamped { header: header(time_ns(0.0)), pose }).unwrap();
            let magnetic_field = Vector3 { x: 0.0, y: row.counts, z: 0.0 };
            let header = header(time_ns(0.4));
            let field = MagneticField { header, magnetic_field, magnetic_field_covariance: [0.0; 9] };
            writer.write(readings, time_ns(7.0), &field).unwrap();
        }
        writer.finish().unwrap();
    }
}

#[test]
fn verif_own_bag_gives_the_same_contacts_as_the_csv() {
    let work = tempfile::tempdir().unwrap();
    bags(work.path(), "/magnetometer");
    let mapping = work.path().join("import.json");
    fs::copy(example().join("import_bag.json"), &mapping).unwrap();
    let (from_bag, from_csv) = (work.path().join("bag"), work.path().join("csv"));
    good(&["import", "bag", text(&mapping), "--out", text(&from_bag)]);
    good(&["check", text(&from_bag)]);
    good(&["import", "csv", text(&example().join("import.json")), "--out", text(&from_csv)]);
    let read = |folder: &Path| Trace::read(&folder.join("trial_1.csv")).unwrap();
    let (bag, csv) = (read(&from_bag), read(&from_csv));
    let characteristic = |trace: &Trace| trace.sidecar.recorded.as_ref().unwrap().characteristic[0];
    assert!((characteristic(&bag) / characteristic(&csv) - 1.0).abs() < 0.02);
    for (bag, csv) in bag.truth.instants.iter().zip(&csv.truth.instants) {
        let (Some(bag), Some(csv)) = (bag.contact, csv.contact) else { continue };
        assert!(bag.distance(&csv) < 0.3e-3, "{bag:?} {csv:?}");
    }
}

#[test]
fn verif_a_topic_whose_name_begins_with_that_of_an_earlier_one() {
    let work = tempfile::tempdir().unwrap();
    let of_bag = fs::read_to_string(example().join("import_bag.json")).unwrap();
    let moments = |readings: &str| {
        let folder = work.path().join(&readings[1..]);
        fs::create_dir_all(&folder).unwrap();
        bags(&folder, readings);
        let (mapping, traces) = (folder.join("import.json"), folder.join("traces"));
        fs::write(&mapping, of_bag.replace("/magnetometer/", &format!("{readings}/"))).unwrap();
        good(&["import", "bag", text(&mapping), "--out", text(&traces)]);
        fs::read(traces.join("trial_1.csv")).unwrap()
    };
    assert_eq!(moments("/flange/hall"), moments("/magnetometer"));
}

#[test]
fn verif_live_counts_have_the_contacts_of_their_moments() {
    let (work, mapping) = (tempfile::tempdir().unwrap(), example().join("import.json"));
    let traces = work.path().join("lab");
    good(&["import", "csv", text(&mapping), "--out", text(&traces)]);
    let (_, notes) = good(&["fit", text(&traces), "--model", "spline"]);
    assert!(!notes.contains("no sensor"), "{notes}");
    let calibration = traces.join("calibrations/lab-whisker.json");
    let (checked, _) = good(&["check", text(&calibration)]);
    assert!(checked.contains("sensor lab-whisker.lab-whisker of recordings"), "{checked}");

    // The sensor is that of the import.
    let sensor = CalibrationFile::read(&calibration).unwrap().sensor.unwrap();
    let recorded = |name: &str| Sidecar::read(&traces.join(name)).unwrap().recorded.unwrap();
    assert_eq!(Some(&sensor.characteristic), recorded("trial_1.json").characteristic().as_ref());
    let of_calibration: Vec<Recorded> = (1..=4).map(|index| recorded(&format!("calibration_{index}.json"))).collect();
    let mean_square = of_calibration.iter().map(|of| of.noise_sd_n_m.powi(2)).sum::<f64>() / 4.0;
    assert_eq!(sensor.noise_sd_n_m, mean_square.sqrt());

    let trial = Trace::read(&traces.join("trial_1.csv")).unwrap();
    let rest = trial.sidecar.recorded.as_ref().unwrap().rest_counts;
    let rows: Vec<(f64, Value, f64)> = trial
        .recording
        .instants
        .iter()
        .map(|now| {
            let (at, yaw_rad) = (now.base.origin(), now.base.yaw_rad());
            let pose = json!({"t_s": now.t_s, "base_x_m": at.x(), "base_y_m": at.y(), "base_yaw_rad": yaw_rad});
            (now.t_s, pose, rest + sensor.characteristic.counts(now.moment_z_n_m))
        })
        .collect();
    let with = |pose: &Value, key: &str, value: f64| {
        let mut line = pose.clone();
        line[key] = value.into();
        line
    };
    let mut of_counts = vec![json!({"protocol": 1, "rate_hz": 100, "zeroing_s": 0.3})];
    of_counts.extend(rows.iter().map(|(_, pose, counts)| with(pose, "counts", *counts)));
    let answers = lived(&calibration, "ekf", &of_counts);
    assert_eq!(answers.len(), rows.len());
    let (zeroing, answers) =
        answers.split_at(answers.iter().take_while(|answer| answer["status"] == "zeroing").count());
    assert_eq!(zeroing.len(), 31);
    assert!(zeroing.iter().zip(&rows).all(|(answer, (t_s, ..))| *answer == json!({"t_s": t_s, "status": "zeroing"})));

    let (at_rest, moving) = rows.split_at(zeroing.len());
    let zero = at_rest.iter().map(|(_, _, counts)| counts).sum::<f64>() / at_rest.len() as f64;
    let noise_sd_n_m = sensor.noise_sd_n_m;
    let mut of_moments = vec![json!({"protocol": 1, "rate_hz": 100, "noise_sd_n_m": noise_sd_n_m})];
    of_moments.extend(
        moving
            .iter()
            .map(|(_, pose, counts)| with(pose, "reading_n_m", sensor.characteristic.moment_n_m(counts - zero))),
    );
    assert_eq!(answers, lived(&calibration, "ekf", &of_moments));
    assert!(answers.iter().filter(|answer| answer["contact_x_m"].is_f64()).count() > 100);
}

#[test]
fn robust_recordings_that_state_different_characteristics_give_no_sensor() {
    let folder = changed(|text| text);
    let (traces, _) = imported(folder.path());
    let path = traces.join("calibration_3.json");
    let stored: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let fitted = |change: &dyn Fn(&mut Value)| -> (Option<SensorFile>, String) {
        let mut sidecar = stored.clone();
        change(&mut sidecar["recorded"]);
        fs::write(&path, sidecar.to_string()).unwrap();
        let (_, notes) = good(&["fit", text(&traces), "--model", "spline"]);
        (CalibrationFile::read(&traces.join("calibrations/lab-whisker.json")).unwrap().sensor, notes)
    };
    let (sensor, notes) = fitted(&|recorded| recorded["characteristic"] = json!([-3.1e7, 0.0, 0.0]));
    assert_eq!(sensor, None);
    for words in
        ["no sensor", "calibration_3: recorded.characteristic: found [-31000000.0", "expected [", "calibration_1"]
    {
        assert!(notes.contains(words), "does not contain `{words}`: {notes}");
    }
    // As in recordings of an earlier version.
    let (sensor, notes) = fitted(&|recorded| drop(recorded.as_object_mut().unwrap().remove("range_n_m")));
    assert_eq!(sensor, None);
    assert!(notes.contains("calibration_3: recorded.range_n_m: found none, expected"), "{notes}");
    assert!(fitted(&|_| {}).0.is_some());
}

#[test]
fn robust_mapping_with_an_unknown_unit() {
    fails(|text| text.replacen("\"ms\"", "\"minutes\"", 1), &["import.json:6:", "minutes", "`ms`"]);
}

#[test]
fn robust_mapping_with_an_unknown_key() {
    fails(|text| text.replacen("rate_hz", "rate", 1), &["import.json:5:", "rate", "rate_hz"]);
}

#[test]
fn robust_mapping_with_neither_column_nor_value() {
    let change = |text: String| text.replacen("\"column\": \"flange_y_mm\", ", "", 1);
    fails(change, &["pose.y", "neither `column` nor `value`"]);
}

#[test]
fn robust_recording_named_like_an_outline() {
    let change =
        |text: String| text.replacen("\"trial_1.csv\",", "\"trial_1.csv\", \"name\": \"calibration_1.contour\",", 1);
    fails(change, &["recordings[4].name", "`calibration_1.contour`", "a name that does not end in `.contour`"]);
}

#[test]
fn robust_missing_column() {
    let change = |text: String| text.replacen("flange_y_mm", "flange_z_mm", 1);
    fails(change, &["calibration_1.csv:1", "header", "flange_y_mm", "one column `flange_z_mm`"]);
}

#[test]
fn robust_cell_that_is_no_number() {
    let folder = changed(|text| text);
    let path = folder.path().join("trial_1.csv");
    let lines: Vec<String> = fs::read_to_string(&path).unwrap().lines().map(Into::into).collect();
    let damaged =
        lines.iter().enumerate().map(|(i, line)| if i == 7 { line.replacen(',', ",1,5", 1) } else { line.clone() });
    fs::write(&path, damaged.collect::<Vec<_>>().join("\n")).unwrap();
    fails_on(folder.path(), &["trial_1.csv:8", "found 6 fields", "5 fields"]);
    let damaged =
        lines.iter().enumerate().map(|(i, line)| if i == 7 { line.replacen(',', ",x", 1) } else { line.clone() });
    fs::write(&path, damaged.collect::<Vec<_>>().join("\n")).unwrap();
    fails_on(folder.path(), &["trial_1.csv:8", "column 2 (flange_x_mm)", "a finite number"]);
}

#[test]
fn robust_times_out_of_order() {
    let folder = changed(|text| text);
    let path = folder.path().join("trial_1.csv");
    let mut lines: Vec<String> = fs::read_to_string(&path).unwrap().lines().map(Into::into).collect();
    lines.swap(20, 40);
    fs::write(&path, lines.join("\n")).unwrap();
    fails_on(folder.path(), &["trial_1.csv:22", "time", "times that do not decrease"]);
}

/// Example whose trial lacks the rows of 0.9 s.
fn with_gap(change: impl FnOnce(String) -> String) -> tempfile::TempDir {
    let folder = changed(change);
    let path = folder.path().join("trial_1.csv");
    let text = fs::read_to_string(&path).unwrap();
    let kept = text.lines().enumerate().filter(|(i, _)| !(200..290).contains(i)).map(|(_, line)| line);
    fs::write(&path, kept.collect::<Vec<_>>().join("\n")).unwrap();
    folder
}

#[test]
fn robust_gap_in_the_times() {
    fails_on(with_gap(|text| text).path(), &["trial_1.csv:201", "a gap of 0.9", "at most 0.5 s", "leave"]);
    let folder = with_gap(|text| text.replacen("\"rate_hz\"", "\"gaps\": \"leave\", \"rate_hz\"", 1));
    let (traces, output) = imported(folder.path());
    let notes = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && notes.contains("trial_1: 1 gaps without rows"), "{notes}");
    let trace = Trace::read(&traces.join("trial_1.csv")).unwrap();
    let steps = trace.recording.instants.windows(2).map(|pair| pair[1].t_s - pair[0].t_s);
    let longest_s = steps.fold(0.0, f64::max);
    assert!((0.85..1.0).contains(&longest_s), "{longest_s}");
    good(&["check", text(&traces)]);
}

#[test]
fn robust_times_in_the_wrong_unit() {
    fails(
        |text| text.replacen("\"ms\"", "\"s\"", 1),
        &["calibration_1.csv", "rate_hz", "compare the unit of the times"],
    );
}

#[test]
fn robust_poses_in_the_wrong_unit() {
    let change =
        |text: String| text.replacen("\"flange_x_mm\", \"unit\": \"mm\"", "\"flange_x_mm\", \"unit\": \"m\"", 1);
    fails(change, &["reading.characteristic", "0 of 919 contacts", "within reach of the whisker", "compare units"]);
    // With a stated characteristic the import succeeds with a warning.
    let folder = changed(|text| change(text).replacen("\"rest_s\"", "\"characteristic\": [-3e7, 0, 0], \"rest_s\"", 1));
    let (_, output) = imported(folder.path());
    let warnings = String::from_utf8(output.stderr).unwrap();
    let cause = warnings.lines().find(|line| line.contains("frame of the poses")).unwrap();
    assert!(cause.starts_with("warning: calibration_1: "), "{cause}");
    assert!(cause.ends_with("; likewise calibration_2, calibration_3, calibration_4, trial_1"), "{cause}");
}

/// Example with a changed line of the trial, from 1.
fn with_line(line: usize, change: impl Fn(Vec<&str>) -> String) -> tempfile::TempDir {
    let folder = changed(|text| text);
    let path = folder.path().join("trial_1.csv");
    let text = fs::read_to_string(&path).unwrap();
    let mut lines: Vec<String> = text.lines().map(Into::into).collect();
    lines[line - 1] = change(lines[line - 1].split(',').collect());
    fs::write(&path, lines.join("\n") + "\n").unwrap();
    folder
}

#[test]
fn robust_glitches_of_the_yaw_and_impossible_values_are_named_with_their_row() {
    let turned = |cells: Vec<&str>| {
        let yaw_deg: f64 = cells[3].parse().unwrap();
        format!("{},{},{},{},{}", cells[0], cells[1], cells[2], yaw_deg - 180.0, cells[4])
    };
    fails_on(with_line(100, turned).path(), &["trial_1.csv:100: column `flange_yaw_deg`: found ", "remove the row"]);
    let huge = |cells: Vec<&str>| format!("{},{},{},{},1e30", cells[0], cells[1], cells[2], cells[3]);
    fails_on(
        with_line(12, huge).path(),
        &["trial_1.csv:12: column `hall_counts`: found 1", "a magnitude of at most 10000000000 counts"],
    );
}

#[test]
fn robust_single_positions_that_may_be_glitches_are_noted() {
    let moved = |cells: Vec<&str>| format!("{},{},0,{},{}", cells[0], cells[1], cells[3], cells[4]);
    let folder = with_line(100, moved);
    let (traces, output) = imported(folder.path());
    let notes = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && traces.join("trial_1.csv").is_file(), "{notes}");
    let noted: Vec<&str> = notes.lines().filter(|line| line.contains("the first of")).collect();
    let [note] = noted[..] else { panic!("printed: {notes}") };
    for words in ["trial_1: ", "trial_1.csv:100: column `flange_y_mm`: found 0 m between 0.1", "the first of 1 such"] {
        assert!(note.contains(words), "does not contain `{words}`: {note}");
    }
}

#[test]
fn robust_a_rest_longer_than_the_recording() {
    let change = |text: String| text.replacen("\"rest_s\": 0.3", "\"rest_s\": 30", 1);
    fails(change, &["calibration_1.csv", "reading.rest_s", "found 30 s for a recording of 3."]);
}

#[test]
fn robust_a_last_row_without_a_line_end_is_left_out() {
    let folder = changed(|text| text);
    let path = folder.path().join("trial_1.csv");
    let kept = fs::read(&path).unwrap();
    let (complete, _) = imported(folder.path());
    let rows = |folder: &Path| Trace::read(&folder.join("trial_1.csv")).unwrap().recording.instants;
    let complete = rows(&complete);
    // Without its last digit and the line end.
    fs::write(&path, &kept[..kept.len() - 2]).unwrap();
    fs::remove_dir_all(folder.path().join("traces")).unwrap();
    let (traces, output) = imported(folder.path());
    let notes = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && notes.contains("trial_1: last row left out"), "{notes}");
    let kept = rows(&traces);
    assert!(kept.len() < complete.len());
    assert!(kept.iter().zip(&complete).all(|(one, other)| one.moment_z_n_m == other.moment_z_n_m));
}

#[test]
fn robust_characteristic_that_the_calibration_does_not_determine() {
    let change = |text: String| text.replace("\"calibration\"", "\"trial\"");
    fails(change, &["import.json", "reading.characteristic", "no recording with the role `calibration`"]);
}

#[test]
fn robust_a_damaged_trial_does_not_stop_the_others() {
    let folder = changed(|text| text);
    fs::write(folder.path().join("trial_1.csv"), "time_ms\n").unwrap();
    let (traces, output) = imported(folder.path());
    assert_eq!(output.status.code(), Some(3));
    assert!(traces.join("calibration_4.csv").is_file() && !traces.join("trial_1.csv").exists());
}

#[test]
fn robust_an_import_replaces_imported_traces_alone() {
    let folder = changed(|mapping| mapping);
    let (traces, output) = imported(folder.path());
    assert!(output.status.success());
    assert!(imported(folder.path()).1.status.success(), "an import again replaces the first");
    let sidecar = traces.join("trial_1.json");
    let simulated = fs::read_to_string(&sidecar).unwrap().replace(r#""name": "csv""#, r#""name": "whisker_sim""#);
    for text in ["years of work", r#"{"kind": "settings"}"#, simulated.as_str()] {
        fs::write(&sidecar, text).unwrap();
        fails_on(folder.path(), &["trial_1.json", "expected such a file or none"]);
        assert_eq!(fs::read_to_string(&sidecar).unwrap(), text);
    }
}

#[test]
fn robust_an_import_names_the_traces_that_it_does_not_yield() {
    let folder = changed(|mapping| mapping);
    let (traces, output) = imported(folder.path());
    assert!(output.status.success() && !String::from_utf8_lossy(&output.stderr).contains("does not yield"));
    fs::write(traces.join("notes.json"), r#"{"kind": "notes"}"#).unwrap();
    // A renamed trial, and a calibration that is left out.
    let mapping = folder.path().join("import.json");
    let of_first = r#"{"file": "calibration_1.csv", "role": "calibration", "face": "left"},"#;
    let changed = fs::read_to_string(&mapping).unwrap().replace(of_first, "");
    fs::write(&mapping, changed.replace(r#""trial_1.csv","#, r#""trial_1.csv", "name": "renamed","#)).unwrap();
    let (_, output) = imported(folder.path());
    let warning = String::from_utf8(output.stderr).unwrap();
    let words = "also contains traces that this import does not yield, and that are fitted and evaluated with it: calibration_1, trial_1\n";
    assert!(output.status.success() && warning.contains(words), "{warning}");
    assert!(["calibration_1.csv", "trial_1.json", "notes.json"].iter().all(|name| traces.join(name).is_file()));

    // A trial that is refused.
    let recording = folder.path().join("trial_1.csv");
    let damaged = fs::read_to_string(&recording).unwrap().replace("flange_y_mm", "y");
    fs::write(&recording, damaged).unwrap();
    let (_, output) = imported(folder.path());
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(3) && warning.contains("calibration_1, renamed, trial_1\n"), "{warning}");
}

#[test]
fn robust_an_import_into_the_folder_of_the_recordings_leaves_them() {
    let folder = changed(|mapping| mapping);
    let recording = folder.path().join("trial_1.csv");
    let kept = fs::read(&recording).unwrap();
    let output = whisker(&["import", "csv", text(&folder.path().join("import.json")), "--out", text(folder.path())]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.code() == Some(1) && errors.contains("found something other than a trace, expected"),
        "{errors}"
    );
    assert_eq!(fs::read(&recording).unwrap(), kept);
    assert!(!folder.path().join("trial_1.json").exists());
}
