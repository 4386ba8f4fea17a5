//! Benchmarks of the stages of the command `whisker` on a small set: readings through each registered front end, a
//! whole evaluation, and its report.

use std::path::Path;
use std::slice;

use divan::Bencher;
use divan::counter::ItemsCount;
use evaluation::evaluate::{EvaluateSettings, Evaluated, evaluate};
use evaluation::fit::{FitSettings, Models, fit};
use files::sha256;
use indicatif::ProgressBar;
use report::report;
use serde_json::json;
use tempfile::TempDir;
use testbed::dataset::Dataset;
use testbed::front_end::{FRONT_ENDS, FrontEnd, FrontEndConfig, Mounting, SensorInput};
use trace::{Role, Trace};

/// Measurement noise, as a fraction of the largest reading, and in N m.
const NOISE: f64 = 0.01;
const NOISE_N_M: f64 = 3e-7;

fn main() {
    divan::main();
}

/// A golden trace.
fn golden(name: &str) -> Trace {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    Trace::read(&folder.join(format!("{name}.csv"))).expect("a golden trace")
}

/// Names of all registered front ends.
fn front_ends() -> Vec<&'static str> {
    FRONT_ENDS.iter().map(|row| row.name).collect()
}

#[divan::bench(args = front_ends(), max_time = 2)]
fn readings(bencher: Bencher, name: &str) {
    let front_end = FrontEnd::new(&FrontEndConfig { name: name.into(), config: json!({}) }).expect("a registered name");
    let (pin, circle) = (golden("golden_pin"), golden("golden_circle"));
    let mounting = Mounting::alone(&pin.sidecar);
    let recordings = [&pin, &circle].map(|trace| SensorInput::new(trace, &mounting, NOISE_N_M, 1));
    let calibrated =
        front_end.calibrate(slice::from_ref(&mounting), &recordings).expect("recordings that determine the sensor");
    let sensor = calibrated.as_ref().and_then(|file| file.sensors.first());
    let played = SensorInput { sensor, ..SensorInput::new(&pin, &mounting, NOISE_N_M, 1) };
    let counter = ItemsCount::new(pin.recording.instants.len());
    bencher.counter(counter).bench_local(|| front_end.readings_n_m(&played).expect("a calibrated sensor"));
}

/// Calibrated set with the golden pin as its only trial.
fn set(folder: &Path) -> Dataset {
    for (of, name, role) in [
        ("golden_pin", "pin", Role::Trial),
        ("golden_pin", "grid_0", Role::Calibration),
        ("golden_circle", "grid_1", Role::Calibration),
    ] {
        let mut trace = golden(of);
        (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), role, None);
        trace.sidecar.csv_sha256 = sha256(trace.to_csv());
        trace.write(folder).expect("a folder that can be written");
    }
    let set = Dataset::open(folder, None).expect("the traces just written");
    let models = Models::One { kind: "elastica".into(), config: json!({}) };
    let settings =
        FitSettings { models, noise: NOISE, seed: 1, front_end: FrontEndConfig::default(), sensors: Vec::new() };
    fit(&set, &settings, &set.calibrations("white"), &ProgressBar::hidden()).expect("calibration traces");
    set
}

/// Evaluates every registered estimator on the trial with five seeds.
fn evaluated(set: &Dataset, results: &Path) -> Evaluated {
    let settings = EvaluateSettings {
        name: "golden".into(),
        noise: vec![NOISE],
        seeds: (1..=5).collect(),
        results: results.into(),
        ..Default::default()
    };
    evaluate(slice::from_ref(set), &settings, &ProgressBar::hidden()).expect("a valid set")
}

#[divan::bench(max_time = 5)]
fn whole_evaluation(bencher: Bencher) {
    let folder = TempDir::new().expect("a temporary folder");
    let set = set(folder.path());
    let results = || TempDir::new().expect("a temporary folder");
    bencher.with_inputs(results).bench_local_refs(|results| evaluated(&set, results.path()));
}

#[divan::bench(max_time = 5)]
fn whole_report(bencher: Bencher) {
    let folder = TempDir::new().expect("a temporary folder");
    let run = evaluated(&set(folder.path()), &folder.path().join("results")).folder;
    bencher.bench_local(|| report(&run, &ProgressBar::hidden()).expect("results just written"));
}
