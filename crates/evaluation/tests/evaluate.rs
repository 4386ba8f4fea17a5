//! Evaluation of the golden traces: files written, failures, reuse of up-to-date runs.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::slice;
use std::sync::Arc;
use std::time::Duration;

use evaluation::evaluate::{EvaluateSettings, Evaluated, evaluate};
use evaluation::fit::{FitSettings, Models, fit};
use evaluation::participant::Program;
use files::sha256;
use indicatif::ProgressBar;
use nalgebra::{Matrix3, Vector2};
use serde_json::json;
use testbed::bound::{Deviations, TraceBound};
use testbed::dataset::Dataset;
use testbed::front_end::FrontEndConfig;
use testbed::metrics::{Scores, consistency, error};
use testbed::noise::NoiseUnit;
use testbed::results::files::{ESTIMATES, QUANTITIES, Writer, run_file};
use testbed::results::{EstimateRow, QuantityRow, RUN_FILES, Run, TrialRow, read_rows, read_scores};
use trace::{CalibrationFile, Miscalibration, ReplayEffects, Role, Sidecar, Trace, TruthInstant};
use whisker::estimators::BaseNoise;
use whisker::frames::{Point, Pose};
use whisker::sensor::CalibratedFace;

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
    fit(dataset, &settings, out, &ProgressBar::hidden()).unwrap();
}

fn evaluated(dataset: &Dataset, results: &Path, programs: &[&str]) -> Evaluated {
    fitted(dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let program = |command: &&str| Program::new(command, Duration::from_secs(60)).unwrap();
    let settings = EvaluateSettings { programs: programs.iter().map(program).collect(), ..settings(results) };
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
    let first = evaluated(&dataset, results.path(), &[]);
    assert!(first.is_new);
    let reason = "the whisker never touches, so that the trial cannot be scored";
    assert_eq!((first.failures.len(), first.failures[0].reason.as_str()), (1, reason));
    let again = evaluated(&dataset, results.path(), &[]);
    assert!(!again.is_new);
    // An unreadable table is rewritten.
    let table = results.path().join("golden/failures.csv");
    fs::write(&table, fs::read_to_string(&table).unwrap() + "torn").unwrap();
    let rewritten = evaluated(&dataset, results.path(), &[]);
    assert!(rewritten.is_new && rewritten.failures == first.failures);
    assert_eq!((again.failures, again.summary), (first.failures, first.summary));
}

#[test]
fn robust_a_program_that_failed_is_recorded_and_evaluated_again() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    let first = evaluated(&dataset, results.path(), &["mute=true"]);
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
    let again = evaluated(&dataset, results.path(), &["mute=true"]);
    assert!(again.is_new && again.failures == first.failures, "it may have been mended");
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
            let file = run_file(RUN_FILES, &path).unwrap_or_else(|| panic!("{}: not in RUN_FILES", path.display()));
            assert_eq!(file.writer, Writer::Evaluate, "{}", path.display());
            if let Some(rows) = file.rows {
                rows.counted(&path).unwrap();
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

/// The calibrated face that a trace touches.
fn touched_face(dataset: &Dataset, trace: &Trace) -> Arc<CalibratedFace> {
    let path = dataset.calibrations("white").join(format!("{}.json", trace.sidecar.whisker.name));
    let faces = CalibrationFile::read(&path).unwrap().calibrated(&path, None).unwrap();
    faces.into_iter().find(|face| face.face == trace.sidecar.face).unwrap()
}

/// An object and a whisker that move along together: the readings, and what is known about the size, are those at rest.
#[test]
fn verif_an_unknown_size_scales_the_displacement_over_a_moving_object_alone() {
    const VELOCITY_M_S: [f64; 2] = [1.5e-3, -1e-3];
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    fitted(&dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let resting = Trace::read(&folder.path().join("grid_1.csv")).unwrap();
    let face = touched_face(&dataset, &resting);
    let mut moving = resting.clone();
    moving.sidecar.scene["object_velocity_m_s"] = json!(VELOCITY_M_S);
    for (known, truth) in moving.recording.instants.iter_mut().zip(&mut moving.truth.instants) {
        let way_m = Vector2::from(VELOCITY_M_S) * known.t_s;
        let origin = known.base.origin().shifted(way_m);
        known.base = Pose::new(origin.x(), origin.y(), known.base.yaw_rad());
        truth.contact = truth.contact.map(|contact| contact.shifted(way_m));
    }
    let exact = Miscalibration::default();
    let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m: face.largest_reading_n_m };
    let bound = |trace: &Trace| {
        let none = BaseNoise::default();
        let bound = TraceBound::new(trace, &face, 1e-7, &none).unwrap();
        bound.with_deviations(trace, &face, 1e-7, &none, &deviations)
    };
    let (at_rest, moves) = (bound(&resting), bound(&moving));
    let rows = (0..resting.truth.instants.len()).filter_map(|row| Some((at_rest.at(row)?, moves.at(row)?)));
    let (mut sized, mut moved) = (0.0_f64, 0.0_f64);
    for (at_rest, moves) in rows {
        assert!((moves.unsized_sd_m / at_rest.unsized_sd_m - 1.0).abs() < 1e-6, "{at_rest:?} {moves:?}");
        assert_eq!(at_rest.moving_sd_m, at_rest.unsized_sd_m);
        sized = sized.max(at_rest.unsized_sd_m / at_rest.deviating_sd_m);
        moved = moved.max(moves.moving_sd_m / moves.unsized_sd_m);
    }
    assert!(sized > 1.01 && moved > 1.01, "{sized} {moved}");
}

#[test]
fn verif_the_bound_continues_through_chatter_and_restarts_after_a_lift_off() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    fitted(&dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let trace = Trace::read(&folder.path().join("pin.csv")).unwrap();
    let face = &touched_face(&dataset, &trace);
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

/// Scores of a trial of a run.
fn scores_of(results: &Path, trace: &str) -> Vec<Scores> {
    let rows: Vec<TrialRow> = read_scores(&results.join("golden/trials.csv")).unwrap();
    rows.into_iter().filter(|row| row.head.trace == trace).map(|row| row.scores).collect()
}

/// Trials with a miscalibration stand beside the exact one, whose scores stay the same; a deviation that the trace
/// states is applied without the option.
#[test]
fn verif_miscalibrations_are_trials_of_their_own() {
    let [traces, alone, with] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    fitted(&dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let dataset = dataset.only(&["pin".into()]);
    let run = |settings: EvaluateSettings| evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden());
    run(settings(alone.path())).unwrap();
    let exact = scores_of(alone.path(), "pin");
    let gain = Miscalibration { gain: 0.05, ..Miscalibration::default() };
    let mount = Miscalibration { mount_x_m: 1e-3, stiffness: -0.02, latency_s: 2e-3, ..Miscalibration::default() };
    let miscalibrations = vec![Miscalibration::default(), gain, mount];
    let evaluated = run(EvaluateSettings { miscalibrations, ..settings(with.path()) }).unwrap();
    assert_eq!(scores_of(with.path(), "pin"), exact);
    let groups: Vec<&str> = evaluated.summary.iter().map(|row| row.head.group.as_str()).collect();
    assert_eq!(groups, ["pin", "pin, gain 5e-2", "pin, stiffness -2e-2 mount x m 1e-3 latency s 2e-3"]);
    let rmse = |row: usize| evaluated.summary[row].get(&error::START_RMSE).unwrap();
    assert!(rmse(1) > rmse(0) && rmse(2) > 0.5e-3, "{} {} {}", rmse(0), rmse(1), rmse(2));
    let run_json: Run = files::read_json(&evaluated.folder.join("run.json")).unwrap();
    assert_eq!(
        run_json.sets.iter().map(|set| set.miscalibration).collect::<Vec<_>>(),
        [Miscalibration::default(), gain, mount]
    );

    let path = traces.path().join("pin.json");
    let mut sidecar: Sidecar = files::read_json(&path).unwrap();
    sidecar.replay = Some(ReplayEffects { noise: 0.02, miscalibration: gain });
    files::write_json(&path, &sidecar).unwrap();
    let stated = EvaluateSettings { noise: vec![0.5], noise_unit: NoiseUnit::Stated, ..settings(alone.path()) };
    run(EvaluateSettings { force: true, ..stated }).unwrap();
    let stated = scores_of(alone.path(), "pin");
    assert_eq!(stated, scores_of(with.path(), "pin_gain_5e-2"), "half of the stated noise of 2 % is 1 %");
    assert_eq!(stated.len(), 1);
}

/// The quantities of the last estimate stand beside the deviations with which a trial was replayed, with their bounds.
#[test]
fn verif_stated_quantities_are_compared_with_the_deviations() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    fitted(&dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let dataset = dataset.only(&["pin".into()]);
    let deviation = Miscalibration { gain: 0.02, mount_y_m: -1e-4, ..Miscalibration::default() };
    let settings = EvaluateSettings {
        estimators: Some(["installed", "drifting", "ekf"].map(String::from).into()),
        miscalibrations: vec![deviation],
        ..settings(results.path())
    };
    let evaluated = evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden()).unwrap();
    let rows: Vec<QuantityRow> = read_rows(&QUANTITIES.path(&evaluated.folder)).unwrap();
    let found: Vec<_> = rows.iter().map(|row| (row.estimator.as_str(), row.quantity.as_str(), row.truth)).collect();
    let expected = [
        ("installed", "gain", 0.02),
        ("installed", "mount_rad", 0.0),
        ("installed", "mount_x_m", 0.0),
        ("installed", "mount_y_m", -1e-4),
        ("drifting", "object_vx_m_s", 0.0),
        ("drifting", "object_vy_m_s", 0.0),
    ];
    assert_eq!(found, expected);
    assert!(rows.iter().all(|row| (row.error - (row.estimate - row.truth)).abs() < 1e-15 && row.sd > 0.0), "{rows:?}");
    assert!(rows.iter().all(|row| row.error.abs() < 4.0 * row.sd), "{rows:?}");
    // The object rests, so that its velocity has no bound; the stated deviation is no more certain than the bound allows.
    assert!(rows.iter().all(|row| row.bound.is_none() == row.quantity.starts_with("object_") && row.contact_s > 0.5));
    assert!(rows.iter().all(|row| row.bound.is_none_or(|bound| bound < 1.1 * row.sd)), "{rows:?}");
    let estimates: Vec<EstimateRow> =
        read_rows(&ESTIMATES.path_of(&evaluated.folder, &[&rows[0].trace, "installed"])).unwrap();
    let last = estimates.iter().rev().find(|row| row.gain.is_some()).unwrap();
    assert_eq!((last.gain, last.gain_sd), (Some(rows[0].estimate), Some(rows[0].sd)));
    assert_eq!((last.mount_y_m, last.mount_y_sd_m), (Some(rows[3].estimate), Some(rows[3].sd)));
}

/// A filter places its contacts where they explain the readings, also those of a sensor with another gain, which the true contacts
/// do not explain.
#[test]
fn verif_residuals_at_the_estimates_are_compared_with_those_at_the_truth() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    fitted(&dataset(traces.path()), &FrontEndConfig::default(), &traces.path().join("calibrations"));
    let mut trace = Trace::read(&traces.path().join("pin.csv")).unwrap();
    // Slower, so that the contact lasts longer than the two seconds that are not counted.
    const SLOWER: f64 = 4.0;
    trace.sidecar.rate_hz /= SLOWER;
    trace.recording.instants.iter_mut().for_each(|instant| instant.t_s *= SLOWER);
    trace.sidecar.csv_sha256 = sha256(trace.to_csv());
    trace.write(traces.path()).unwrap();
    let dataset = Dataset::open(traces.path(), None).unwrap().only(&["pin".into()]);
    let gain = Miscalibration { gain: 0.01, ..Miscalibration::default() };
    let settings =
        EvaluateSettings { miscalibrations: vec![Miscalibration::default(), gain], ..settings(results.path()) };
    let evaluated = evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden()).unwrap();
    let ratio = |row: usize| evaluated.summary[row].get(&consistency::RESIDUAL_RATIO).unwrap();
    assert!((0.9..1.1).contains(&ratio(0)) && ratio(1) < 0.8, "{} {}", ratio(0), ratio(1));
}

/// The same noise in each unit gives the same scores.
#[test]
fn verif_noise_units() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    fitted(&dataset, &FrontEndConfig::default(), &dataset.calibrations("white"));
    let dataset = dataset.only(&["pin".into()]);
    let run = |level: f64, noise_unit: NoiseUnit| {
        let settings = EvaluateSettings { noise: vec![level], noise_unit, force: true, ..settings(results.path()) };
        evaluate(slice::from_ref(&dataset), &settings, &ProgressBar::hidden())
    };
    let evaluated = run(0.01, NoiseUnit::Set).unwrap();
    let rmse = evaluated.summary[0].get(&error::START_RMSE).unwrap();
    let run_json: Run = files::read_json(&evaluated.folder.join("run.json")).unwrap();
    let largest_n_m = run_json.sets[0].largest_reading_n_m;
    let calibrated_n_m = run_json.calibrations[0].largest_reading_n_m;
    for (level, unit) in
        [(0.01 * largest_n_m, NoiseUnit::NewtonMetre), (0.01 * largest_n_m / calibrated_n_m, NoiseUnit::Range)]
    {
        let same = run(level, unit).unwrap().summary[0].get(&error::START_RMSE).unwrap();
        assert!((same / rmse - 1.0).abs() < 1e-9, "{unit:?}: {same} {rmse}");
    }
    let error = run(1.0, NoiseUnit::Stated).unwrap_err().to_string();
    assert!(error.contains("pin.json: replay: found no stated noise"), "{error}");
}

#[test]
fn robust_files_beside_a_calibration_are_required_before_the_start() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    let calibrations = dataset.calibrations("white");
    fitted(&dataset, &FrontEndConfig::default(), &calibrations);
    for name in ["straight_left.surface.csv", "straight_left.residuals.csv"] {
        let moved = calibrations.join("moved");
        fs::rename(calibrations.join(name), &moved).unwrap();
        let announced = EvaluateSettings { on_start: Some(|_| panic!("it starts")), ..settings(results.path()) };
        let error = evaluate(slice::from_ref(&dataset), &announced, &ProgressBar::hidden()).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("no such file beside its calibration"), "{error}");
        fs::rename(&moved, calibrations.join(name)).unwrap();
    }
    assert!(fs::read_dir(results.path()).unwrap().next().is_none());
}

#[test]
fn robust_a_set_with_contacts_outside_of_the_calibrated_domain_is_remarked() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    assert_eq!(evaluated(&dataset, results.path(), &[]).remarks.lines(), [""; 0]);
    // True contacts on the first fifth of the way to the calibrated ones.
    let mut trace = Trace::read(&traces.path().join("pin.csv")).unwrap();
    for (known, truth) in trace.recording.instants.iter().zip(&mut trace.truth.instants) {
        truth.contact = truth.contact.map(|contact| {
            let at = known.base.inverse().apply(contact);
            known.base.apply(Point::new(0.2 * at.x(), 0.2 * at.y()))
        });
    }
    trace.sidecar.csv_sha256 = sha256(trace.to_csv());
    trace.write(traces.path()).unwrap();
    let remarks = evaluated(&dataset, results.path(), &[]).remarks.lines();
    let [remark] = &remarks[..] else { panic!("{remarks:?}") };
    assert!(remark.starts_with("many true contacts lie outside the calibrated domain: "), "{remark}");
}

#[test]
fn robust_a_set_that_touches_with_a_face_without_calibration_is_remarked() {
    let remarks = |factor: f64| {
        let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let dataset = dataset(traces.path());
        let mut trace = Trace::read(&traces.path().join("pin.csv")).unwrap();
        trace.recording.instants.iter_mut().for_each(|instant| {
            instant.moment_z_n_m *= factor;
            instant.rotation_z_rad = None;
        });
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace.write(traces.path()).unwrap();
        evaluated(&dataset, results.path(), &[]).remarks.lines()
    };
    let expected = "contacts with a face that is not calibrated have no estimate: the sign of the moment is that of `right` in 1 trace of `pin` \
                    with `straight`; calibrate that face, or correct `face` or the sign of the moment";
    assert_eq!(remarks(-1.0), [expected]);
    // A free whisker that vibrates touches with no face.
    assert_eq!(remarks(-1e-3), [""; 0]);
}
