//! Times of an estimator in Rust on a trace: `step_times TRACE CALIBRATION ESTIMATOR`, for comparison with Python.
//!
//! Prints the least time of several runs per sample, in nanoseconds: sample by sample, and as a replay of the recorded
//! poses. `python/bench/overhead.py` runs it.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde_json::json;
use testbed::replay::{Steps, estimator, knowledge, samples};
use testbed::settings::merged;
use trace::{CalibrationFile, Trace};
use whisker::estimators;
use whisker::events::TouchConfig;

const RUNS: usize = 30;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [trace, calibration, name] = arguments.as_slice() else {
        anyhow::bail!("expected TRACE CALIBRATION ESTIMATOR");
    };
    let trace = Trace::read(Path::new(trace))?;
    let path = Path::new(calibration);
    let row = estimators::estimator(name).context("unknown estimator")?;
    let faces = CalibrationFile::read(path)?.calibrated(path, row.sensor_model)?;
    let knowledge = knowledge(&trace.sidecar, &faces, 1e-7);
    let config = merged((row.defaults)(), &json!({}))?;
    let fresh = || estimator(row, &config, TouchConfig::default(), &knowledge, &trace.sidecar.name, 1);
    let instants = &trace.recording.instants;
    let readings_n_m: Vec<f64> = instants.iter().map(|now| now.moment_z_n_m).collect();
    let samples = samples(&trace.recording, &readings_n_m);
    let (mut step_ns, mut replay_ns) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..RUNS {
        let mut running = fresh()?;
        let start = Instant::now();
        let found = samples.iter().filter(|sample| running.step(sample).is_some()).count();
        step_ns = step_ns.min(start.elapsed().as_nanos() as f64 / samples.len() as f64);
        anyhow::ensure!(found > 0, "no estimate");

        let start = Instant::now();
        let mut running = fresh()?;
        let mut steps = Steps::default();
        let mut estimates = Vec::with_capacity(instants.len());
        for (now, &reading_n_m) in instants.iter().zip(&readings_n_m) {
            running.push(&steps.sample(now, reading_n_m), &mut estimates);
        }
        running.end(&mut estimates);
        replay_ns = replay_ns.min(start.elapsed().as_nanos() as f64 / estimates.len() as f64);
    }
    println!("{step_ns:.1} {replay_ns:.1}");
    Ok(())
}
