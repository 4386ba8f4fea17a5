//! Replay of recordings with single wrong readings, and of recordings that give no estimate.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use files::{sha256, write_json};
use trace::{CalibrationFile, Trace};

fn whisker(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_whisker")).args(arguments).output().unwrap()
}

fn good(arguments: &[&str]) -> String {
    let output = whisker(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?} ended with {:?}: {errors}", output.status);
    errors
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Imported example of own recordings with a calibration.
struct Laboratory {
    folder: tempfile::TempDir,
    trial: Trace,
}

/// Estimated contact of each row. `None` without an estimate.
type Contacts = Vec<Option<[f64; 2]>>;

impl Laboratory {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mapping = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/own-data/import.json");
        good(&["import", "csv", text(&mapping), "--out", text(folder.path())]);
        good(&["fit", text(folder.path()), "--model", "polynomial"]);
        let trial = Trace::read(&folder.path().join("trial_1.csv")).unwrap();
        Self { folder, trial }
    }

    /// Writes the trial with a change and replays it. Returns the estimated contacts and the notes.
    fn replay(&self, estimator: &str, change: impl FnOnce(&mut Trace)) -> (Contacts, String) {
        let mut trial = self.trial.clone();
        change(&mut trial);
        trial.sidecar.rows = trial.recording.instants.len();
        trial.sidecar.csv_sha256 = sha256(trial.to_csv());
        let path = self.folder.path().join("trial_1.csv");
        fs::write(&path, trial.to_csv()).unwrap();
        write_json(&path.with_extension("json"), &trial.sidecar).unwrap();
        let estimates: PathBuf = self.folder.path().join("estimates.txt");
        let notes = good(&["replay", text(&path), "--estimator", estimator, "--out", text(&estimates)]);
        let mut table = csv::Reader::from_path(&estimates).unwrap();
        let header = table.headers().unwrap().clone();
        let place = |name: &str| header.iter().position(|column| column == name).unwrap();
        let (x, y) = (place("contact_x_m"), place("contact_y_m"));
        let contact = |row: csv::StringRecord| Some([row[x].parse().ok()?, row[y].parse().ok()?]);
        (table.records().map(|row| contact(row.unwrap())).collect(), notes)
    }
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

const GLITCH_N_M: f64 = 1.0;

#[test]
fn robust_a_glitch_is_gated_and_counted() {
    let laboratory = Laboratory::new();
    let touching = |row: &usize| laboratory.trial.truth.instants[*row].contact.is_some();
    let touch = (0..laboratory.trial.truth.instants.len()).find(touching).unwrap();
    for estimator in ["recommended", "outline", "paper-ekf", "smoother"] {
        // The noise that is added to a simulated trace is relative to its largest reading without glitches.
        let (clean, notes) = laboratory.replay(estimator, |trial| trial.sidecar.recorded = None);
        assert_eq!(notes, "", "{estimator}");
        let estimated = clean.iter().flatten().count();
        assert!(estimated > 400, "{estimator}: {estimated} estimates");
        for row in [10, touch, 300] {
            let (found, notes) = laboratory.replay(estimator, |trial| {
                trial.sidecar.recorded = None;
                trial.recording.instants[row].moment_z_n_m = GLITCH_N_M;
            });
            assert!(notes.contains("gated: 1 of "), "{estimator}, row {row}: {notes}");
            assert_eq!(found.len(), clean.len());
            assert!(found[row].is_none());
            let lost = estimated - found.iter().flatten().count();
            assert!(lost <= 3, "{estimator}, row {row}: {lost} estimates lost");
            let pairs = clean.iter().zip(&found).skip(touch + 100).filter_map(|(a, b)| Some(distance_m((*a)?, (*b)?)));
            let worst_m = pairs.fold(0.0, f64::max);
            assert!(worst_m < 1e-3, "{estimator}, row {row}: {worst_m} m from the estimates without a glitch");
        }
    }
}

#[test]
fn robust_glitches_of_calibrations_and_trials_are_gated_and_counted() {
    let laboratory = Laboratory::new();
    let folder = laboratory.folder.path();
    let held_out_n_m = || {
        let calibration = CalibrationFile::read(&folder.join("calibrations/lab-whisker.json")).unwrap();
        calibration.faces[0].model(None).unwrap().heldout_rms_n_m
    };
    let clean_n_m = held_out_n_m();
    for name in ["calibration_1", "trial_1"] {
        let path = folder.join(format!("{name}.csv"));
        let mut trace = Trace::read(&path).unwrap();
        trace.recording.instants[200].moment_z_n_m = GLITCH_N_M;
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        fs::write(&path, trace.to_csv()).unwrap();
        write_json(&path.with_extension("json"), &trace.sidecar).unwrap();
    }
    let notes = good(&["fit", text(folder), "--model", "polynomial"]);
    assert!(notes.contains("gated: 1 of 360 readings of calibration_1, far above all others"), "{notes}");
    let change = held_out_n_m() / clean_n_m;
    assert!((0.9..1.1).contains(&change), "{change}");
    let results = tempfile::tempdir().unwrap();
    let run = ["--estimators", "ekf", "--name", "run", "--results", text(results.path())];
    let notes = good(&[&["evaluate", text(folder)], &run[..]].concat());
    assert!(notes.contains("gated: 1 of 500 readings of trial_1"), "{notes}");
}

#[test]
fn robust_many_glitches_leave_the_other_estimates() {
    let laboratory = Laboratory::new();
    let (clean, _) = laboratory.replay("recommended", |_| {});
    let (found, notes) = laboratory.replay("recommended", |trial| {
        let instants = trial.recording.instants.iter_mut().skip(5).step_by(20);
        instants.enumerate().for_each(|(i, instant)| instant.moment_z_n_m = if i % 2 == 0 { -1.0 } else { 0.5 });
    });
    assert!(notes.contains("gated: 25 of "), "{notes}");
    let lost = clean.iter().flatten().count() - found.iter().flatten().count();
    assert!(lost < 40, "{lost} estimates lost");
}

#[test]
fn robust_a_recording_without_a_touch_says_so() {
    let laboratory = Laboratory::new();
    let (found, notes) = laboratory.replay("recommended", |trial| {
        trial.recording.instants.truncate(35);
        trial.truth.instants.truncate(35);
    });
    assert!(found.iter().all(Option::is_none));
    assert!(
        notes.starts_with("no estimates: no touch was detected in 35 rows: the detector's signal reached "),
        "{notes}"
    );
    assert!(notes.contains("its threshold is "), "{notes}");
}

#[test]
fn robust_a_touch_with_a_face_without_calibration_says_so() {
    let laboratory = Laboratory::new();
    let (found, notes) = laboratory.replay("recommended", |trial| {
        trial.recording.instants.iter_mut().for_each(|instant| instant.moment_z_n_m *= -1.0);
    });
    assert!(found.iter().all(Option::is_none));
    assert!(notes.contains("rows touch with the face `right`") && notes.contains("does not calibrate"), "{notes}");
}

#[test]
fn robust_readings_in_another_unit_are_all_gated() {
    let laboratory = Laboratory::new();
    let (_, notes) = laboratory.replay("recommended", |trial| {
        trial
            .recording
            .instants
            .iter_mut()
            .for_each(|instant| instant.moment_z_n_m = 1.0 + 1e6 * instant.moment_z_n_m.abs());
    });
    assert!(notes.contains("gated: ") && notes.contains("every reading was gated"), "{notes}");
}
