//! Fit and evaluation in space on synthetic traces of the rod: files, determinism, and refused inputs.

mod space_dataset;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use evaluation::participant::Program;
use evaluation::space::evaluate::{SpatialEvaluateSettings, evaluate};
use evaluation::space::fit::{SpatialFitSettings, SpatialFitted, fit};
use evaluation::space::{SpatialWritten, evaluate_into};
use indicatif::ProgressBar;
use nalgebra::{Matrix6, Vector3};
use serde_json::{Value, json};
use tempfile::TempDir;
use testbed::dataset::Dataset;
use testbed::front_end::{BendingAxes, FrontEndConfig};
use testbed::space::SpatialEstimateRow;
use testbed::space::replay::read_calibration;
use testbed::space::run::SpatialRun;
use trace::{CalibrationFile, LearntMounting, Role, SpatialCalibrationFile, SpatialTrace};
use whisker::space::frames::Point;
use whisker::space::sensor::{Across, Around, Axis, Mounting};

use space_dataset::{dataset, fit_settings, golden, lines, trace};

fn settings(estimators: &[&str], seeds: &[u64]) -> SpatialEvaluateSettings {
    SpatialEvaluateSettings {
        estimators: Some(estimators.iter().map(|name| (*name).into()).collect()),
        config: Default::default(),
        noise: 0.01,
        seeds: seeds.into(),
        front_end: FrontEndConfig::default(),
        calibrations: None,
        programs: Vec::new(),
    }
}

fn hall(config: Value) -> FrontEndConfig {
    FrontEndConfig { name: "hall".into(), config }
}

/// Fits the calibration trace of a dataset through the front end `hall` with these settings.
fn fit_hall(dataset: &Dataset, config: Value) -> SpatialFitted {
    let settings = SpatialFitSettings { noise: 0.0, front_end: hall(config), ..fit_settings() };
    fit(dataset, &settings, &dataset.calibrations("hall"), &ProgressBar::hidden()).unwrap().remove(0)
}

fn calibrations(folder: &Path) -> PathBuf {
    folder.join("calibrations")
}

/// The first calibration of a dataset, fitted into the calibrations of a folder.
fn fit_first(dataset: &Dataset, folder: &Path) -> SpatialFitted {
    fit(dataset, &fit_settings(), &calibrations(folder), &ProgressBar::hidden()).unwrap().remove(0)
}

#[test]
fn verif_a_calibration_is_read_back_bit_for_bit_and_reused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let run = || fit(&dataset, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden()).unwrap();
    let first = run().remove(0);
    assert!(first.is_new && first.calibration.lines == 54);
    let bytes = fs::read(&first.path).unwrap();
    let read = SpatialCalibrationFile::read(&first.path).unwrap();
    assert_eq!(read, first.calibration);
    files::write_json(&first.path, &read).unwrap();
    assert_eq!(fs::read(&first.path).unwrap(), bytes);
    assert!(!run().remove(0).is_new);

    let face = read.calibrated(&first.path, None).unwrap();
    let rod = golden().sidecar.rod().unwrap();
    let contact = Around::new(0.045, 2e-3, 1.5e-3).contact(&face.axis);
    let expected = rod.at_point(contact.vector()).unwrap().deflection.moment_n_m.yz();
    let found = face.predict(contact).unwrap().reading_n_m;
    assert!((found - expected).norm() < 0.02 * face.largest_reading_n_m);
    assert!(face.predict(Point::from_vector(contact.vector() + Vector3::new(0.0, 0.02, 0.0))).is_none());
}

#[test]
fn verif_an_evaluation_is_the_same_on_one_thread_and_on_many() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    fit(&dataset, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden()).unwrap();
    let settings = settings(&["point", "line"], &[1, 2, 3]);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| evaluate(&dataset, &settings, &ProgressBar::hidden()).unwrap())
    };
    let (one, many) = (on(1), on(4));
    assert_eq!((&one.trials, &one.summary), (&many.trials, &many.summary));
    assert_eq!(one.trials.len(), 6);
    assert!(one.trials.iter().all(|trial| trial.answered == Some(1.0) && trial.bound_m.is_some()));
}

#[test]
fn verif_no_estimate_is_expected_at_the_tip_or_outside_of_the_calibrated_domain() {
    let folder = tempfile::tempdir().unwrap();
    let lines = dataset(folder.path(), 9);
    fit(&lines, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden()).unwrap();
    let rod = golden().sidecar.rod().unwrap();
    let press = |place: Around, tip: bool| {
        let mut trace = trace("press", Role::Trial, &rod, &[Some(place); 500]);
        let contacts = trace.truth.instants.iter_mut().filter_map(|truth| truth.contact.as_mut());
        contacts.for_each(|contact| contact.tip = tip);
        trace.write(folder.path()).unwrap();
        let dataset = Dataset::open(folder.path(), None).unwrap();
        let found = evaluate(&dataset, &settings(&["point"], &[1]), &ProgressBar::hidden()).unwrap();
        found.trials[0].answered
    };
    let (inside, outside) = (Around::new(0.045, 2e-3, 1.2e-3), Around::new(0.020, 2e-4, 1e-4));
    assert_eq!((press(inside, false), press(inside, true), press(outside, false)), (Some(1.0), None, None));
}

#[test]
fn robust_a_set_with_contacts_outside_of_the_calibrated_domain_is_remarked() {
    let folder = tempfile::tempdir().unwrap();
    let lines = dataset(folder.path(), 9);
    fit(&lines, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden()).unwrap();
    let rod = golden().sidecar.rod().unwrap();
    let remarks = |rows_outside: usize| {
        let (inside, outside) = (Around::new(0.045, 2e-3, 1.2e-3), Around::new(0.020, 2e-4, 1e-4));
        let mut places = vec![Some(inside); 500 - rows_outside];
        places.extend(vec![Some(outside); rows_outside]);
        trace("press", Role::Trial, &rod, &places).write(folder.path()).unwrap();
        let (dataset, out) = (Dataset::open(folder.path(), None).unwrap(), tempfile::tempdir().unwrap());
        let run = || {
            let settings = settings(&["point"], &[1]);
            evaluate_into(&out.path().join("run"), &dataset, &settings, false, &ProgressBar::hidden()).unwrap()
        };
        let [first, again] = [run(), run()];
        assert!(first.is_new && !again.is_new && first.remarks.lines() == again.remarks.lines());
        first.remarks.lines()
    };
    assert_eq!(remarks(50), [""; 0]);
    let [remark] = &remarks(300)[..] else { panic!("one remark") };
    assert!(remark.contains("outside the calibrated domain: 300 of 500 in "), "{remark}");
}

#[test]
fn verif_a_trial_in_space_is_read_by_a_hall_sensor_that_the_fit_calibrates() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let fitted = fit_hall(&dataset, json!({}));
    assert!(fitted.is_new && fitted.path == folder.path().join("calibrations/hall/curved.json"));
    assert_eq!(SpatialCalibrationFile::read(&fitted.path).unwrap(), fitted.calibration);
    let front_end = fitted.calibration.front_end.as_ref().unwrap();
    let sensor = front_end.sensor("curved").unwrap();
    assert!(!fit_hall(&dataset, json!({})).is_new);
    assert!(fit_hall(&dataset, json!({"gap_m": 3e-3})).is_new);
    assert!(fit_hall(&dataset, json!({})).is_new);

    let results = folder.path().join("results");
    let settings = SpatialEvaluateSettings { noise: 0.0, front_end: hall(json!({})), ..settings(&["point"], &[1, 2]) };
    let run = |settings: &SpatialEvaluateSettings| {
        evaluate_into(&results, &dataset, settings, false, &ProgressBar::hidden()).unwrap().is_new
    };
    assert!(run(&settings) && !run(&settings));
    assert_eq!(SpatialRun::read(&results).unwrap().unwrap().front_end.as_ref(), Some(front_end));
    let trials = SpatialRun::trials(&results).unwrap();
    let [y_n_m, z_n_m] = sensor.noise_sd_n_m;
    let stated = trials
        .iter()
        .all(|trial| (trial.noise_sd_n_m.powi(2) * 2.0 / (y_n_m.powi(2) + z_n_m.powi(2)) - 1.0).abs() < 1e-9);
    assert!(stated && trials[0].rmse_m.is_some() && trials[0].rmse_m != trials[1].rmse_m, "{trials:?}");

    // The readings are the moments about the axes of the springs, up to noise and offset.
    let rod = golden().sidecar.rod().unwrap();
    let contact = rod.at_point(
        Around::new(0.045, 2e-3, 1.2e-3).contact(&Axis::new(&golden().sidecar.whisker, Across::Normal)).vector(),
    );
    let mut moment_n_m = contact.unwrap().deflection.moment_n_m;
    // The trace states no torsion.
    moment_n_m.x = 0.0;
    let expected = BendingAxes::Springs.bending_n_m(moment_n_m, &golden().sidecar.suspension);
    let rows = SpatialRun::estimates(&results, "press", "point").unwrap();
    let pressed: Vec<_> = rows.iter().filter(|row| row.truth_contact_x_m.is_some()).collect();
    let mean =
        |of: fn(&SpatialEstimateRow) -> f64| pressed.iter().map(|row| of(row)).sum::<f64>() / pressed.len() as f64;
    let found = [mean(|row| row.moment_y_n_m), mean(|row| row.moment_z_n_m)];
    for axis in 0..2 {
        let (error, sd) = (found[axis] - expected[axis], sensor.offset_sd_n_m[axis].hypot(sensor.noise_sd_n_m[axis]));
        assert!(error.abs() < 5.0 * sd, "axis {axis}: {error} beyond {sd}");
    }
}

#[test]
fn robust_a_calibration_in_space_through_another_front_end_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let white = folder.path().join("calibrations");
    fit(&dataset, &fit_settings(), &white, &ProgressBar::hidden()).unwrap();
    fit_hall(&dataset, json!({"earth_t": 4e-5}));
    let refused = |calibrations: &Path, front_end: FrontEndConfig, words: &[&str]| {
        let calibrations = Some(calibrations.to_path_buf());
        let settings = SpatialEvaluateSettings { calibrations, front_end, ..settings(&["point"], &[1]) };
        for error in [
            evaluate(&dataset, &settings, &ProgressBar::hidden()).unwrap_err(),
            evaluate_into(&folder.path().join("results"), &dataset, &settings, false, &ProgressBar::hidden())
                .unwrap_err(),
        ] {
            let text = format!("{error:#}");
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
        }
    };
    refused(&white, hall(json!({})), &["curved.json: front_end: found none, expected `hall`", "--front-end hall"]);
    let through_hall = white.join("hall");
    let default = FrontEndConfig::default();
    refused(&through_hall, default, &["hall/curved.json: front_end.name: found `hall`, expected `white`"]);
    refused(&through_hall, hall(json!({})), &["front_end.config.earth_t: found 0.00004, expected 0.000048"]);
    refused(&through_hall, hall(json!({"gap_m": -1.0})), &["front end `hall` of traces in space", "`gap_m`"]);

    let path = through_hall.join("curved.json");
    let text = fs::read_to_string(&path).unwrap();
    let mut file: Value = serde_json::from_str(&text).unwrap();
    file["front_end"]["sensors"][0]["noise_sd_n_m"][1] = json!(-1.0);
    fs::write(&path, file.to_string()).unwrap();
    refused(
        &through_hall,
        hall(json!({"earth_t": 4e-5})),
        &["front_end.sensors.curved.noise_sd_n_m: found -1, expected"],
    );
    file["front_end"]["sensors"][0]["noise_sd_n_m"][1] = json!(1e-8);
    file["front_end"]["sensors"][0]["characteristic"]["coefficients"][0] = json!([1.0]);
    fs::write(&path, file.to_string()).unwrap();
    refused(
        &through_hall,
        hall(json!({"earth_t": 4e-5})),
        &["front_end.sensors.curved.characteristic", "20 finite coefficients"],
    );
}

#[test]
fn robust_a_finished_run_is_kept_while_nothing_changed_and_other_settings_do_not_replace_it() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    fit(&dataset, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden()).unwrap();
    let results = folder.path().join("results");
    let run = |noise: f64, names: &[&str], force: bool| {
        let settings = SpatialEvaluateSettings {
            front_end: FrontEndConfig::default(),
            estimators: Some(names.iter().map(|&name| name.into()).collect()),
            config: Default::default(),
            noise,
            seeds: vec![1],
            calibrations: None,
            programs: Vec::new(),
        };
        evaluate_into(&results, &dataset, &settings, force, &ProgressBar::hidden())
    };
    let first = run(0.01, &["point"], false).unwrap();
    assert!(first.is_new);
    let again = run(0.01, &["point"], false).unwrap();
    assert!(!again.is_new, "evaluated although nothing had changed");
    assert_eq!(again.summary, first.summary);
    let message = run(0.02, &["point", "line"], false).unwrap_err().to_string();
    for words in ["noise: 0.01 there, 0.02 here", "estimators: none only there, line only here", "--force"] {
        assert!(message.contains(words), "{message}");
    }
    // A file of the user, and what a killed evaluation leaves.
    fs::write(results.join("notes.txt"), "mine").unwrap();
    fs::create_dir(folder.path().join(".results.0123456789abcdef.part")).unwrap();
    assert!(run(0.02, &["point", "line"], true).unwrap().is_new);
    assert!(results.join("notes.txt").is_file(), "a file of the user is lost");
    fs::remove_file(results.join("space_estimates/press.line.csv")).unwrap();
    assert!(run(0.02, &["point", "line"], false).unwrap().is_new, "a run without its estimates was kept");
    assert!(!run(0.02, &["point", "line"], false).unwrap().is_new);
    let mut entries = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(entries.all(|name| !name.to_string_lossy().starts_with('.')), "a temporary folder stays");
    trace("press", Role::Trial, &golden().sidecar.rod().unwrap(), &vec![None; 300]).write(folder.path()).unwrap();
    let changed = run(0.02, &["point", "line"], false).unwrap();
    assert!(changed.is_new, "a stale run was kept");
    assert_eq!(changed.times[0].p99_us, None, "a time of a step although no step had an estimate");
}

#[test]
fn robust_a_learnt_mounting_is_a_setting_of_the_run_and_its_touch_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let fitted = fit_first(&dataset, folder.path());
    let results = folder.path().join("results");
    let run = |calibrations: Option<PathBuf>, force: bool| {
        let settings = SpatialEvaluateSettings { calibrations, ..settings(&["point"], &[1]) };
        evaluate_into(&results, &dataset, &settings, force, &ProgressBar::hidden())
    };
    let first = run(None, false).unwrap();
    assert!(first.mounted.is_empty() && first.unscored.is_empty());
    let [calibration] = &SpatialRun::read(&results).unwrap().unwrap().calibrations[..] else {
        panic!("one calibration")
    };
    assert_eq!(
        (&calibration.whisker, &calibration.model),
        (&fitted.calibration.whisker.name, &fitted.calibration.chosen)
    );

    let deviation = Mounting {
        shift_m: Vector3::new(1e-4, 0.0, 0.0),
        turn_rad: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-8,
    };
    let mounting = Some(LearntMounting { deviation, traces: vec!["press".into()], data_sha256: "ab".into() });
    let mounted = folder.path().join("mounted");
    fs::create_dir(&mounted).unwrap();
    let path = mounted.join(fitted.path.file_name().unwrap());
    files::write_json(&path, &SpatialCalibrationFile { mounting, ..fitted.calibration }).unwrap();
    let message = run(Some(mounted.clone()), false).unwrap_err().to_string();
    let words = "mounting: that of the calibrations there, that of `curved` learnt from press (ab) here";
    assert!(message.contains(words) && message.contains("--force"), "{message}");
    assert_eq!(run(Some(mounted.clone()), true).unwrap().mounted, ["press"]);
    let again = run(Some(mounted), false).unwrap();
    assert!(!again.is_new && again.mounted == ["press"]);
}

#[test]
fn robust_a_calibration_of_changed_or_other_traces_is_refused_even_if_the_run_is_finished() {
    let folder = tempfile::tempdir().unwrap();
    let results = folder.path().join("results");
    let fit = |dataset: &Dataset| fit_first(dataset, folder.path());
    let run = || {
        let dataset = Dataset::open(folder.path(), None).unwrap();
        evaluate_into(&results, &dataset, &settings(&["point"], &[1]), false, &ProgressBar::hidden())
    };
    let refused = |error: anyhow::Error, words: &[&str]| {
        let message = format!("{error:#}");
        for word in words.iter().chain(&["curved.json", "whisker fit"]) {
            assert!(message.contains(word), "does not contain `{word}`: {message}");
        }
    };
    let made = dataset(folder.path(), 9);
    let path = fit(&made).path;
    assert!(run().unwrap().is_new && !run().unwrap().is_new);

    let rod = golden().sidecar.rod().unwrap();
    let write = |name: &str, directions: u32| {
        trace(name, Role::Calibration, &rod, &lines(directions)).write(folder.path()).unwrap();
    };
    write("lines", 10);
    refused(run().unwrap_err(), &["data_sha256", "have changed"]);
    refused(read_calibration(&path).unwrap_err(), &["data_sha256", "have changed"]);
    assert!(fit(&made).is_new);
    assert!(run().unwrap().is_new);

    write("more_lines", 9);
    refused(run().unwrap_err(), &["was not fitted to", "more_lines.csv"]);
    fit(&Dataset::open(folder.path(), None).unwrap());
    for end in ["csv", "json"] {
        fs::remove_file(folder.path().join("more_lines").with_extension(end)).unwrap();
    }
    refused(run().unwrap_err(), &["more_lines.csv is missing"]);
    refused(read_calibration(&path).unwrap_err(), &["more_lines.csv is missing"]);

    // A calibration without its traces cannot be compared.
    let copy = folder.path().join("copy.json");
    fs::copy(&path, &copy).unwrap();
    read_calibration(&copy).unwrap();
}

/// A folder with [`dataset`] and its calibrations.
#[cfg(unix)]
fn fitted() -> (TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    fit_first(&dataset, folder.path());
    (folder, dataset)
}

/// Result of a shell script as the only participant, on a fitted folder.
#[cfg(unix)]
fn of_script(folder: &Path, dataset: &Dataset, script: &str, noise: f64) -> anyhow::Result<SpatialWritten> {
    let path = folder.join("mine.sh");
    fs::write(&path, script).unwrap();
    let settings = SpatialEvaluateSettings {
        front_end: FrontEndConfig::default(),
        estimators: Some(Vec::new()),
        config: Default::default(),
        noise,
        seeds: vec![1],
        calibrations: None,
        programs: vec![Program::new(&format!("sh {}", path.display()), Duration::from_secs(60))?],
    };
    evaluate_into(&folder.join("results"), dataset, &settings, true, &ProgressBar::hidden())
}

/// Script that keeps what it reads and answers every row of a touch with this line.
#[cfg(unix)]
fn answers(folder: &Path, answer: &str) -> String {
    let kept = folder.join("kept").display().to_string();
    format!(
        "read -r line; printf '%s\\n' \"$line\" > {kept}
while read -r line; do printf '%s\\n' \"$line\" >> {kept}; \\
case \"$line\" in *'\"touched\":true'*) echo '{answer}';; *) echo null;; esac; done"
    )
}

#[test]
#[cfg(unix)]
fn verif_a_program_receives_the_sensor_model_and_its_answers_are_scored() {
    let (folder, dataset) = fitted();
    let axis = Axis::new(&golden().sidecar.whisker, Across::Normal);
    let contact = Around::new(0.045, 2e-3, 1.2e-3).contact(&axis);
    let [x, y, z] = contact.vector().into();
    let answer = format!(
        "{{\"contact_x_m\": {x}, \"contact_y_m\": {y}, \"contact_z_m\": {}, \"cov_xx_m2\": 1e-8, \"cov_xy_m2\": 0, \
         \"cov_xz_m2\": 0, \"cov_yy_m2\": 1e-8, \"cov_yz_m2\": 0, \"cov_zz_m2\": 1e-8}}",
        z + 1e-4
    );
    let written = of_script(folder.path(), &dataset, &answers(folder.path(), &answer), 0.01).unwrap();
    assert_eq!(written.failures, []);
    let scores = &written.summary[0];
    assert_eq!((scores.estimator.as_str(), scores.answered, scores.coverage), ("mine", Some(1.0), Some(1.0)));
    assert!((scores.rmse_m.unwrap() - 1e-4).abs() < 1e-6 && (scores.nees.unwrap() - 1.0 / 3.0).abs() < 1e-2);
    // Without a stated normal, that of the mechanics.
    assert!(scores.normal_rad.unwrap() < 0.05, "{scores:?}");

    let kept = fs::read_to_string(folder.path().join("kept")).unwrap();
    let lines: Vec<Value> = kept.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let (known, rows) = (&lines[0], &lines[1..]);
    let face = SpatialCalibrationFile::read(&calibrations(folder.path()).join("curved.json")).unwrap();
    let face = face.calibrated(Path::new("curved.json"), None).unwrap();
    assert_eq!((known["protocol"].as_u64(), rows.len()), (Some(2), 550));
    let of = |name: &str, i: usize| known["table"][name][i].as_f64().unwrap();
    let nodes: u64 = known["shape"].as_array().unwrap().iter().map(|count| count.as_u64().unwrap()).product();
    for column in known["table"].as_object().unwrap().values() {
        assert_eq!(column.as_array().unwrap().len(), nodes as usize);
    }
    let middle = nodes as usize / 2 + 3;
    let at = Around::new(of("arc_m", middle), of("left_m", middle), of("up_m", middle));
    let node = at.contact(&face.axis);
    assert!((node.vector() - Vector3::new(of("x_m", middle), of("y_m", middle), of("z_m", middle))).norm() < 1e-15);
    let expected = face.model.predict(node);
    assert_eq!(expected.reading_n_m.y, of("moment_z_n_m", middle));
    assert_eq!(expected.gradient_n[(0, 2)], of("moment_y_by_z_n", middle));
    let touched = rows.iter().filter(|row| row["touched"] == true).count();
    assert!((450..=500).contains(&touched), "{touched}");
    assert_eq!((rows[3]["base_qw"].as_f64(), rows[3]["last_x_m"].as_f64()), (Some(1.0), Some(0.0)));
}

#[test]
#[cfg(unix)]
fn robust_a_wrong_answer_of_a_program_in_space_fails_the_trial() {
    let place = "\"contact_x_m\": 0.04, \"contact_y_m\": 0, \"contact_z_m\": 0";
    let spread =
        "\"cov_xx_m2\": 1e-8, \"cov_xy_m2\": 0, \"cov_xz_m2\": 0, \"cov_yy_m2\": 1e-8, \"cov_yz_m2\": 0, \"cov_zz_m2\"";
    let cases = [
        ("[0.04, 0, 0]".into(), "expected null or contact_x_m"),
        (format!("{{{place}}}"), "missing field `cov_xx_m2`"),
        (format!("{{{place}, {spread}: -1e-8}}"), "expected a positive definite matrix"),
        (format!("{{{place}, {spread}: 1e-8, \"normal_x\": 1}}"), "all of normal_x, normal_y and normal_z, or none"),
        (
            format!("{{{place}, {spread}: 1e-8, \"normal_x\": 1, \"normal_y\": 1, \"normal_z\": 0}}"),
            "expected a unit vector",
        ),
        (format!("{{{place}, {spread}: 1e-8, \"radius_m\": 0.01}}"), "all of radius_m and radius_sd_m, or none"),
        (format!("{{{place}, {spread}: 1e-8, \"twist\": 1}}"), "unknown field `twist`"),
    ];
    let (folder, dataset) = fitted();
    for (answer, words) in cases {
        let written = of_script(folder.path(), &dataset, &answers(folder.path(), &answer), 0.01).unwrap();
        assert!(written.is_new, "{answer}");
        let [failure] = written.failures.as_slice() else { panic!("{answer}: {:?}", written.failures) };
        assert!(failure.reason.starts_with("answer to row 5") && failure.reason.contains(words), "{}", failure.reason);
        assert_eq!((written.summary[0].answered, written.summary[0].rmse_m), (Some(0.0), None));
        let again = SpatialRun::failures(&folder.path().join("results")).unwrap();
        assert_eq!(again, written.failures);
    }
}

#[test]
#[cfg(unix)]
fn robust_a_program_in_space_has_a_name_of_its_own_and_starts() {
    let (_folder, dataset) = fitted();
    let run = |commands: &[&str]| {
        let program = |text: &&str| Program::new(text, Duration::from_secs(60)).unwrap();
        let settings = SpatialEvaluateSettings {
            front_end: FrontEndConfig::default(),
            estimators: Some(vec!["line".into()]),
            config: Default::default(),
            noise: 0.01,
            seeds: vec![1],
            calibrations: None,
            programs: commands.iter().map(program).collect(),
        };
        format!("{:#}", evaluate(&dataset, &settings, &ProgressBar::hidden()).unwrap_err())
    };
    assert!(run(&["patch-fit=sh mine.sh"]).contains("`patch-fit` is the name of a registered estimator"));
    assert!(run(&["a=sh", "a=sh"]).contains("program `a`: found twice"));
    assert!(run(&["/nowhere/mine"]).contains("--exec: `/nowhere/mine` does not start"));
}

#[test]
fn robust_a_calibration_in_one_plane_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 2);
    let refused = fit(&dataset, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden());
    let message = format!("{:#}", refused.unwrap_err());
    assert!(
        message.contains("do not surround the whisker: found contacts up to 0.000 mm out of its plane"),
        "{message}"
    );
}

/// The trace of [`dataset`] with contacts `scale` times as far from the root, those of a real sensor as places only.
fn scaled(scale: f64, recorded: bool) -> SpatialTrace {
    let rod = golden().sidecar.rod().unwrap();
    let mut trace = trace("lines", Role::Calibration, &rod, &lines(9));
    for truth in &mut trace.truth.instants {
        if let Some(contact) = &mut truth.contact {
            contact.contact *= scale;
        }
        if recorded {
            truth.place = truth.contact_m();
            truth.contact = None;
        }
    }
    let of_sensor = json!({
        "clock": "recorded", "counts_per_n_m": [[1e6, 0.0], [0.0, 1e6]], "residual_counts": [1.0, 1.0],
        "rest_counts": [0.0, 0.0], "noise_sd_n_m": [1e-9, 1e-9], "touch_counts": 1.0, "object_class": "pin"
    });
    if recorded {
        trace.sidecar.recorded = Some(serde_json::from_value(of_sensor).unwrap());
    }
    trace
}

#[test]
fn robust_a_calibration_with_contacts_in_millimetres_is_refused() {
    let refused = |recorded: bool, words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let fitted = |scale: f64| {
            scaled(scale, recorded).write(folder.path()).unwrap();
            let dataset = Dataset::open(folder.path(), None).unwrap();
            fit(&dataset, &fit_settings(), &calibrations(folder.path()), &ProgressBar::hidden())
        };
        let message = format!("{:#}", fitted(1e3).unwrap_err());
        assert!(!calibrations(folder.path()).join("curved.json").exists());
        for word in words.iter().chain(&["whisker `curved`: ", "unit"]) {
            assert!(message.contains(word), "does not contain `{word}`: {message}");
        }
        fitted(1.0).unwrap();
    };
    refused(
        false,
        &["not those of a whisker of 80.000 mm: found contacts up to", "mm away", "expected both within its length"],
    );
    refused(
        true,
        &["of 432 contacts that cannot be fitted (", "coordinates about the undeflected whisker not unique", "sign"],
    );
}

#[test]
fn robust_a_missing_calibration_says_how_to_make_it() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let path = calibrations(folder.path()).join("curved.json");
    let missing = format!("{}: no such calibration; make it from calibration traces by `whisker fit", path.display());
    let message = evaluate(&dataset, &settings(&["point"], &[1]), &ProgressBar::hidden()).unwrap_err().to_string();
    assert_eq!(
        message,
        format!("{missing}`, with the same --front-end, or name the folder of others by --calibrations")
    );
    let message = read_calibration(&path).unwrap_err().to_string();
    let made = folder.path().display();
    assert_eq!(message, format!("{missing} {made}`, with the same --front-end, or name another by --calibration"));
    let message = read_calibration(Path::new("calibrations/none.json")).unwrap_err().to_string();
    assert!(message.contains("`whisker fit .`"), "{message}");
    let message = read_calibration(Path::new("none.json")).unwrap_err().to_string();
    assert!(message.contains("`whisker fit`"), "{message}");
}

#[test]
fn robust_a_stored_model_that_cannot_be_loaded_is_named_without_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let fitted = fit_first(&dataset, folder.path());
    let mut file = fitted.calibration;
    file.models[0].model.as_object_mut().unwrap().insert("colour".into(), json!(vec![0.125; 1000]));
    let message = file.calibrated(&fitted.path, None).unwrap_err().to_string();
    let label = &file.models[0].label;
    assert!(message.contains(&format!("curved.json: models.{label}.model: sensor model `polynomial`: ")), "{message}");
    assert!(message.contains("colour") && !message.contains("0.125"), "{message}");
    assert!(message.ends_with(", expected a model as `whisker fit` stores it; fit it again"), "{message}");
}

#[test]
fn robust_each_kind_of_calibration_names_the_other_and_a_recording_of_one_moment_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 9);
    let fitted = fit_first(&dataset, folder.path());
    let message = CalibrationFile::read(&fitted.path).unwrap_err().to_string();
    assert!(message.contains("found 2, a calibration in space, expected 1, a planar calibration"), "{message}");
    let planar = folder.path().join("planar.json");
    fs::write(&planar, "{\n  \"format\": 1,\n  \"kind\": \"calibration\"\n}\n").unwrap();
    let message = SpatialCalibrationFile::read(&planar).unwrap_err().to_string();
    assert!(message.contains("planar.json:2:3: format: found 1, a planar calibration"), "{message}");

    let csv = folder.path().join("lines.csv");
    let text = fs::read_to_string(&csv).unwrap();
    let mut rows = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let column = header.iter().position(|name| *name == "moment_y_n_m").unwrap();
    let mut first = rows.next().unwrap();
    first[column] = "";
    let rest: Vec<String> = text.lines().skip(2).map(Into::into).collect();
    fs::write(&csv, format!("{}\n{}\n{}\n", header.join(","), first.join(","), rest.join("\n"))).unwrap();
    let message = SpatialTrace::read(&csv).unwrap_err().to_string();
    assert!(message.contains("moment_y_n_m") && message.contains("expected a number"), "{message}");
}
