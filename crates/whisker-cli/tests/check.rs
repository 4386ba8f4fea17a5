//! `whisker check` on a golden trace with a wrong unit, sign or rate, valid by its format, and on the folder of a run.

mod golden;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use files::{sha256, write_json};
use serde_json::{Value, json};
use trace::Trace;
use whisker::frames::Pose;

use golden::write_dataset;

fn check(path: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_whisker")).arg("check").arg(path).output().unwrap()
}

/// Asserts that `check` fails on a changed golden trace with a single line that contains every one of `words`.
fn finds(change: impl FnOnce(&mut Trace), words: &[&str]) {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    let folder = tempfile::tempdir().unwrap();
    fs::copy(golden.join("golden_pin.contour.csv"), folder.path().join("golden_pin.contour.csv")).unwrap();
    let mut trace = Trace::read(&golden.join("golden_pin.csv")).unwrap();
    change(&mut trace);
    let path = folder.path().join("golden_pin.csv");
    trace.sidecar.csv_sha256 = sha256(trace.to_csv());
    fs::write(&path, trace.to_csv()).unwrap();
    write_json(&path.with_extension("json"), &trace.sidecar).unwrap();
    let output = check(&path);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    for word in words {
        assert!(text.contains(word), "does not contain `{word}`: {text}");
    }
}

#[test]
fn robust_poses_in_millimetres() {
    let millimetres = |trace: &mut Trace| {
        for instant in &mut trace.recording.instants {
            let origin = instant.base.origin();
            instant.base = Pose::new(1e3 * origin.x(), 1e3 * origin.y(), instant.base.yaw_rad());
        }
    };
    finds(millimetres, &["golden_pin.csv", "base_vx_m_s", "poses look like millimetres"]);
}

#[test]
fn robust_yaw_in_degrees() {
    let degrees = |trace: &mut Trace| {
        for instant in &mut trace.recording.instants {
            let origin = instant.base.origin();
            instant.base = Pose::new(origin.x(), origin.y(), instant.base.yaw_rad().to_degrees());
        }
    };
    finds(degrees, &["golden_pin.csv", "base_wz_rad_s", "yaw looks like degrees"]);
}

#[test]
fn robust_moment_a_thousand_times_too_large() {
    let newton_millimetres =
        |trace: &mut Trace| trace.recording.instants.iter_mut().for_each(|instant| instant.moment_z_n_m *= 1e3);
    finds(newton_millimetres, &["moment_z_n_m", "the moment looks 1000 times too large (N mm instead of N m?)"]);
}

#[test]
fn robust_500_hz_under_a_rate_of_250_hz() {
    let twice = |trace: &mut Trace| trace.recording.instants.iter_mut().for_each(|instant| instant.t_s *= 0.5);
    finds(twice, &["rate_hz", "rate_hz 250 but times step 2.0000 ms"]);
}

#[test]
fn robust_moment_of_the_wrong_sign() {
    let negated = |trace: &mut Trace| {
        for instant in &mut trace.recording.instants {
            instant.moment_z_n_m *= -1.0;
            instant.rotation_z_rad = instant.rotation_z_rad.map(|rotation_rad| -rotation_rad);
        }
    };
    finds(negated, &["face", "the sign of the moment is wrong"]);
}

#[test]
fn robust_a_single_glitch() {
    let glitch = |trace: &mut Trace| trace.recording.instants[150].moment_z_n_m = -1.0;
    finds(glitch, &["-1e0 N m in line 152", "a glitch of the sensor"]);
}

#[test]
fn verif_results_in_space_and_tables_of_recordings_pass() {
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../results/reference");
    for (folder, found) in [("spatial", "run in space `spatial`"), ("recordings", "settings of `whisker recordings`")] {
        let output = check(&reference.join(folder));
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains(found), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn robust_a_table_of_scores_without_rows() {
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../results/reference");
    let folder = tempfile::tempdir().unwrap();
    for table in ["standard/summary.csv", "spatial/space_summary.csv"] {
        let text = fs::read_to_string(reference.join(table)).unwrap();
        let path = folder.path().join(Path::new(table).file_name().unwrap());
        fs::write(&path, format!("{}\n", text.lines().next().unwrap())).unwrap();
        let output = check(&path);
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(1) && text.contains("found no rows, expected at least one"), "{text}");
    }
}

#[test]
fn verif_golden_traces_pass() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    for name in ["golden_pin.csv", "golden_circle.csv"] {
        let output = check(&golden.join(name));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn verif_other_files_in_a_folder_of_traces_are_left_out() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    let output = check(&golden);
    let found = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(found.contains("golden_pin") && !found.contains("butterworth"), "{found}");

    // A trace without its sidecar is no other file.
    let folder = tempfile::tempdir().unwrap();
    fs::copy(golden.join("golden_pin.csv"), folder.path().join("golden_pin.csv")).unwrap();
    fs::write(folder.path().join("notes.csv"), "time,remark\n0,none\n").unwrap();
    let output = check(folder.path());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.code() == Some(1) && errors.contains("golden_pin.json") && !errors.contains("notes"),
        "{errors}"
    );
}

#[test]
fn verif_rows_of_unknown_truth_are_counted() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    let folder = tempfile::tempdir().unwrap();
    let mut trace = Trace::read(&golden.join("golden_pin.csv")).unwrap();
    trace.sidecar.contour = None;
    let free = |truth: &&mut trace::TruthInstant| truth.touching == Some(false);
    let unknown = trace.truth.instants.iter_mut().filter(free).take(10).map(|truth| truth.touching = None).count();
    trace.sidecar.csv_sha256 = sha256(trace.to_csv());
    trace.write(folder.path()).unwrap();
    let found = String::from_utf8(check(&folder.path().join("golden_pin.csv")).stdout).unwrap();
    assert!(found.contains("touching in ") && found.contains(&format!("unknown in {unknown}")), "{found}");
}

fn good(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_whisker")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Golden traces with a calibration.
fn calibrated_dataset() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_dataset(folder.path());
    good(&["fit", folder.path().to_str().unwrap(), "--model", "elastica"]);
    folder
}

#[test]
fn robust_missing_files_of_a_run_are_named() {
    let (traces, results) = (calibrated_dataset(), tempfile::tempdir().unwrap());
    let given = [traces.path(), results.path()].map(|path| path.to_str().unwrap());
    good(&["evaluate", given[0], "--estimators", "ekf", "--seeds", "1", "--results", given[1], "--name", "run"]);
    let run = results.path().join("run");
    let checked = check(&run);
    let found = String::from_utf8(checked.stdout).unwrap();
    assert!(checked.status.success() && found.contains("run `run` of 1 estimators\n"), "{found}");

    for name in ["trials.csv", "estimates/pin.ekf.csv"] {
        fs::remove_file(run.join(name)).unwrap();
    }
    let error = "run.json: found a run without trials.csv, estimates/pin.ekf.csv, expected all files of the run; run the same \
                 `whisker evaluate` again\n";
    for path in [run.clone(), run.join("run.json")] {
        let checked = check(&path);
        let errors = String::from_utf8(checked.stderr).unwrap();
        assert!(checked.status.code() == Some(1) && errors.ends_with(error) && errors.lines().count() == 1, "{errors}");
    }
    good(&["evaluate", given[0], "--estimators", "ekf", "--seeds", "1", "--results", given[1], "--name", "run"]);
    assert!(check(&run).status.success());

    // A description with tables over all trials, as it is kept in results/reference.
    let excerpt = tempfile::tempdir().unwrap();
    for name in ["run.json", "summary.csv"] {
        fs::copy(run.join(name), excerpt.path().join(name)).unwrap();
    }
    let checked = check(excerpt.path());
    let found = String::from_utf8(checked.stdout).unwrap();
    assert!(checked.status.success() && found.contains(", an excerpt without its trials"), "{found}");

    fs::remove_file(run.join("run.json")).unwrap();
    let errors = String::from_utf8(check(&run).stderr).unwrap();
    assert!(errors.contains("run.json: no such file, expected the description of the run"), "{errors}");
}

#[test]
fn regress_damaged_tables_in_the_subfolders_of_a_run_are_named() {
    let (traces, results) = (calibrated_dataset(), tempfile::tempdir().unwrap());
    let given = [traces.path(), results.path()].map(|path| path.to_str().unwrap());
    good(&["evaluate", given[0], "--estimators", "ekf", "--seeds", "1", "--results", given[1], "--name", "run"]);
    let run = results.path().join("run");
    // A file of the user.
    fs::write(run.join("estimates/notes.csv"), "time,remark\n").unwrap();
    assert!(check(&run).status.success());
    for (table, line) in [("bounds/pin.csv", 3), ("estimates/pin.ekf.csv", 2)] {
        let text = fs::read_to_string(run.join(table)).unwrap();
        let mut lines: Vec<String> = text.lines().map(Into::into).collect();
        let (_, others) = lines[line - 1].split_once(',').unwrap();
        lines[line - 1] = format!("early,{others}");
        fs::write(run.join(table), lines.join("\n") + "\n").unwrap();
    }
    for path in [run.clone(), run.join("run.json")] {
        let checked = check(&path);
        let errors = String::from_utf8(checked.stderr).unwrap();
        let errors: Vec<&str> = errors.lines().collect();
        let words = [
            "bounds/pin.csv:3: column `t_s`: found `early`, expected a number",
            "estimates/pin.ekf.csv:2: column `t_s`",
        ];
        assert!(checked.status.code() == Some(1) && errors.len() == 2, "{errors:?}");
        for (error, words) in errors.iter().zip(words) {
            assert!(error.starts_with("error: ") && error.contains(words), "{error}");
        }
    }
}

#[test]
fn regress_damaged_tables_in_the_subfolders_of_a_run_in_space_are_named() {
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../results/reference/spatial");
    let run = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(reference).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file()) {
        fs::copy(entry.path(), run.path().join(entry.file_name())).unwrap();
    }
    fs::create_dir(run.path().join("space_estimates")).unwrap();
    fs::write(run.path().join("space_estimates/pin.line.csv"), "t_s,x_m\n0,0\n").unwrap();
    let checked = check(run.path());
    let errors = String::from_utf8(checked.stderr).unwrap();
    assert!(checked.status.code() == Some(1) && errors.lines().count() == 1, "{errors}");
    assert!(errors.contains("space_estimates/pin.line.csv:2: unknown field `x_m`, expected one of"), "{errors}");
}

#[test]
fn robust_a_rate_that_contradicts_the_times_is_noted_by_replay_and_evaluation() {
    let (traces, results) = (calibrated_dataset(), tempfile::tempdir().unwrap());
    let trace = traces.path().join("pin.csv");
    let given = [traces.path(), results.path(), &trace].map(|path| path.to_str().unwrap());
    let replay = ["replay", given[2], "--estimator", "ekf"];
    let evaluate =
        ["evaluate", given[0], "--estimators", "ekf", "--seeds", "1", "--results", given[1], "--name", "run"];
    let notes = |arguments: &[&str]| String::from_utf8(good(arguments).stderr).unwrap();
    for arguments in [&replay[..], &evaluate] {
        let notes = notes(arguments);
        assert!(!notes.contains("rate_hz"), "{notes}");
    }
    let sidecar = trace.with_extension("json");
    let mut changed: Value = serde_json::from_slice(&fs::read(&sidecar).unwrap()).unwrap();
    changed["rate_hz"] = json!(2500.0);
    fs::write(&sidecar, changed.to_string()).unwrap();
    let words = "note: pin: rate_hz: found 2500 with times that step 0.004000 s, expected steps of 0.000400 s: rate_hz 2500 but times \
                 step 4.0000 ms (250.0000 Hz); the estimators rely on rate_hz\n";
    // The second evaluation is up to date or made anew; both state the note.
    for arguments in [&replay[..], &[&evaluate[..], &["--force"]].concat(), &evaluate] {
        let notes = notes(arguments);
        assert_eq!(notes.matches(words).count(), 1, "{notes}");
    }
}
