//! Evaluation of the golden traces: what is written, and what is kept.
#![cfg(unix)]

use std::path::Path;
use std::slice;
use std::time::Duration;

use indicatif::ProgressBar;
use serde_json::json;
use testbed::dataset::Dataset;
use testbed::entrant::Program;
use testbed::evaluate::{EvaluateSettings, Evaluated, evaluate};
use testbed::fit::{FitSettings, Models, fit};
use trace::{Role, Trace, TruthInstant, sha256};

/// The golden pin, as a trial and as a calibration, and without its pin: nothing is touched.
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

fn evaluated(dataset: &Dataset, results: &Path) -> Evaluated {
    let models = Models::One { kind: "elastica".into(), config: json!({}) };
    fit(dataset, &FitSettings { models, noise: 0.01, seed: 1 }, &dataset.calibrations()).unwrap();
    let settings = EvaluateSettings {
        name: "golden".into(),
        estimators: Some(vec!["ekf".into()]),
        programs: vec![Program::new("mute=true", Duration::from_secs(60)).unwrap()],
        config: Default::default(),
        touch: Default::default(),
        noise: vec![0.01],
        seeds: vec![1],
        starts: Default::default(),
        encoders: Vec::new(),
        map: Default::default(),
        calibrations: None,
        results: results.into(),
    };
    evaluate(slice::from_ref(dataset), &settings, &ProgressBar::hidden()).unwrap()
}

#[test]
fn robust_a_trial_without_a_touch_is_a_failure_beside_the_others_and_is_not_redone() {
    let [traces, results] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let dataset = dataset(traces.path());
    let first = evaluated(&dataset, results.path());
    assert!(first.is_new);
    let failures: Vec<_> =
        first.failures.iter().map(|row| (row.trace.as_str(), row.estimator.as_deref(), row.reason.as_str())).collect();
    let silence = "ended (exit status: 0) before its answer to row 1 of 301";
    assert_eq!(
        failures,
        [
            ("nothing", None, "the whisker never touches; there is nothing to score"),
            ("nothing", Some("mute"), silence),
            ("pin", Some("mute"), silence),
        ]
    );
    assert!(first.summary.iter().all(|row| row.head.trials == 1));
    let again = evaluated(&dataset, results.path());
    assert!(!again.is_new);
    assert_eq!((again.failures, again.summary), (first.failures, first.summary));
}
