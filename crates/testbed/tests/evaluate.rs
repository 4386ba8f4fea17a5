//! Evaluation of the golden traces: files written, failures, reuse of up-to-date runs.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::slice;
use std::time::Duration;

use files::sha256;
use indicatif::ProgressBar;
use nalgebra::Matrix3;
use serde_json::json;
use testbed::bound::TraceBound;
use testbed::dataset::Dataset;
use testbed::evaluate::{EvaluateSettings, Evaluated, evaluate};
use testbed::fit::{FitSettings, Models, fit};
use testbed::front_end::FrontEndConfig;
use testbed::participant::Program;
use testbed::results::RUN_FILES;
use testbed::results::files::{Writer, run_file};
use trace::{CalibrationFile, Role, Trace, TruthInstant};
use whisker::estimators::BaseNoise;

/// Dataset of the golden pin as a trial and as a calibration, and of a trial without any contact.
fn dataset(folder: &Path) -> Dataset {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    let write = |of: &str, name: &str, role: Role, change: &dyn Fn(&mut Trace)| {
        let mut trace = Trace::read(&golden.join(format!("{of}.csv"))).unwrap();
        (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), role, None);
        change(&mut trace);
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace.write(folder).unwrap();
    };
    write("golden_pin", "pin", Role::Trial, &|_| {});
    write("golden_pin", "grid_0", Role::Calibration, &|_| {});
    write("golden_circle", "grid_1", Role::Calibration, &|_| {});
    write("golden_pin", "nothing", Role::Trial, &|trace| {
        trace.recording.instants.iter_mut().for_each(|instant| instant.moment_z_n_m = 0.0);
        trace.truth.instants.fill(TruthInstant { touching: Some(false), ..TruthInstant::default() });
    });
    Dataset::open(folder, None).unwrap()
}

fn fitted(dataset: &Dataset, front_end: &FrontEndConfig, out: &Path) {
    let models = Models::One { kind: "elastica".into(), config: json!({}) };
    let settings = FitSettings { models, noise: 0.01, seed: 1, front_end: front_end.clone(), sensors: Vec::new() };
    fit(dataset, &settings, out).unwrap();
}

fn evaluated(dataset: &Dataset, results: &Path) -> Evaluated {
    fitted(dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let settings = EvaluateSettings {
        programs: vec![Program::new("mute=true", Duration::from_secs(60)).unwrap()],
        ..settings(results)
    };
    evaluate(slice::from_ref(dataset), &settings, &ProgressBar::hidden()).unwrap()
}

fn settings(results: &Path) -> EvaluateSettings {
    EvaluateSettings {
        name: "golden".into(),
        estimators: Some(vec!["ekf".into()]),
        noise: vec![0.01],
        seeds: vec![1],
        results: results.into(),
        ..Default::default()
    }
}

#[test]
fn robust_a_trial_without_a_touch_is_recorded_as_a_failure_and_not_repeated() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    let first = evaluated(&dataset, results.path());
    assert!(first.is_new);
    let failures: Vec<_> =
        first.failures.iter().map(|row| (row.trace.as_str(), row.estimator.as_deref(), row.reason.as_str())).collect();
    let no_answer = "ended (exit status: 0) before its answer to row 1 of 301";
    assert_eq!(
        failures,
        [
            ("nothing", None, "the whisker never touches, so that the trial cannot be scored"),
            ("nothing", Some("mute"), no_answer),
            ("pin", Some("mute"), no_answer),
        ]
    );
    assert!(first.summary.iter().all(|row| row.head.trials == 1));
    assert_files_of_the_registry(&first.folder);
    let again = evaluated(&dataset, results.path());
    assert!(!again.is_new);
    // An unreadable table is rewritten.
    let table = results.path().join("golden/failures.csv");
    fs::write(&table, fs::read_to_string(&table).unwrap() + "torn").unwrap();
    let rewritten = evaluated(&dataset, results.path());
    assert!(rewritten.is_new && rewritten.failures == first.failures);
    assert_eq!((again.failures, again.summary), (first.failures, first.summary));
}

/// Checks that every file of a run is registered, and that the run has every file that exists once per run.
fn assert_files_of_the_registry(run: &Path) {
    let mut folders = vec![run.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let file = run_file(&path).unwrap_or_else(|| panic!("{}: not in RUN_FILES", path.display()));
            assert_eq!(file.writer, Writer::Evaluate, "{}", path.display());
            if let Some(rows) = file.rows {
                (rows.count)(&path).unwrap();
            }
        }
    }
    let single = RUN_FILES.iter().filter(|file| file.writer == Writer::Evaluate && file.is_single());
    single.for_each(|file| assert!(file.path(run).is_file(), "{}: missing", file.name));
}

fn hall() -> FrontEndConfig {
    FrontEndConfig { name: "hall".into(), config: json!({"earth_t": 40e-6}) }
}

#[test]
fn verif_readings_of_a_hall_sensor_do_not_depend_on_the_number_of_threads() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    let tables = |threads: usize| {
        let calibrations = results.path().join(format!("calibrations-{threads}"));
        let settings = EvaluateSettings {
            name: format!("threads-{threads}"),
            front_end: hall(),
            noise: vec![0.0],
            seeds: vec![1, 2, 3],
            calibrations: Some(calibrations.clone()),
            ..settings(results.path())
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let evaluated = pool.install(|| {
            fitted(&dataset, &hall(), &calibrations);
            evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden()).unwrap()
        });
        let again = evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden()).unwrap();
        assert!(evaluated.is_new && !again.is_new);
        let of_sensor = ["sensors/straight.straight.turn.csv", "sensors/straight.straight.transfer.csv"];
        let files = ["trials.csv", "estimates/pin.ekf.csv"].into_iter().chain(of_sensor);
        files.map(|file| fs::read(evaluated.folder.join(file)).unwrap()).collect::<Vec<_>>()
    };
    let one = tables(1);
    assert!(one == tables(2), "tables differ between one thread and two");
    let trials = String::from_utf8(one[0].clone()).unwrap();
    let rows: Vec<&str> = trials.lines().skip(1).collect();
    assert!(rows.len() == 3 && rows[0] != rows[1], "seeds differ in the noise of the sensor");
}

#[test]
fn robust_a_calibration_through_another_front_end_is_reported() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    let folder = |name: &str| results.path().join(name);
    fitted(&dataset, &FrontEndConfig::default(), &folder("white"));
    fitted(&dataset, &hall(), &folder("hall"));
    let refused = |calibrations: &str, front_end: FrontEndConfig, words: &[&str]| {
        let calibrations = Some(folder(calibrations));
        let settings = EvaluateSettings { front_end, calibrations, ..settings(results.path()) };
        let error = evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden()).unwrap_err();
        let text = format!("{error:#}");
        assert!(words.iter().all(|word| text.contains(word)) && text.lines().count() == 1, "{text}");
    };
    refused("white", hall(), &["white/straight.json", "front_end", "found none", "`hall`", "--front-end hall"]);
    refused("hall", FrontEndConfig::default(), &["hall/straight.json", "front_end.name", "`hall`", "expected `white`"]);
    let other = FrontEndConfig { config: json!({}), ..hall() };
    refused("hall", other, &["front_end.config.earth_t", "found 0.00004", "expected 0.000048"]);
    let path = folder("hall").join("straight.json");
    let renamed = fs::read_to_string(&path).unwrap().replacen("\"array\": \"straight\"", "\"array\": \"left\"", 1);
    fs::write(&path, renamed).unwrap();
    refused("hall", hall(), &["front_end.sensors", "found left/straight", "straight/straight", "--sensors"]);
}

#[test]
fn verif_the_bound_continues_through_chatter_and_restarts_after_a_lift_off() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    fitted(&dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let trace = Trace::read(&folder.path().join("pin.csv")).unwrap();
    let path = dataset.calibrations("white").join(format!("{}.json", trace.sidecar.whisker.name));
    let faces = CalibrationFile::read(&path).unwrap().calibrated(&path, None).unwrap();
    let face = faces.iter().find(|face| face.face == trace.sidecar.face).unwrap();
    let first = trace.truth.instants.iter().position(|truth| truth.contact.is_some()).unwrap();
    // The bound before and after a gap of some rows.
    let around = |gap: usize, base_noise: &BaseNoise| {
        let mut trace = trace.clone();
        let at = first + 100;
        trace.truth.instants[at..at + gap].fill(TruthInstant { touching: Some(false), ..TruthInstant::default() });
        let bound = TraceBound::new(&trace, face, 1e-7, base_noise).unwrap();
        assert!(bound.at(at).is_none());
        (bound.at(at - 1).unwrap(), bound.at(at + gap).unwrap())
    };
    let exact = BaseNoise::default();
    let (before, after) = around(2, &exact);
    assert!(after.sd_m <= before.sd_m && after.since_touch_s > before.since_touch_s, "{before:?} {after:?}");
    let (before, after) = around(15, &exact);
    assert!(after.sd_m > 2.0 * before.sd_m && after.since_touch_s == 0.0, "{before:?} {after:?}");
    let noisy = BaseNoise(Matrix3::from_diagonal_element(1e-8));
    assert!(around(2, &noisy).0.sd_m > before.sd_m);
    assert!(TraceBound::new(&trace, face, 0.0, &exact).is_none());
    assert!(TraceBound::new(&trace, face, 0.0, &noisy).is_some());
}
