//! Times of an estimator in Rust on a trace with 1 % noise: `step_times TRACE CALIBRATION ESTIMATOR [SETTINGS]`, for comparison
//! with Python. `SETTINGS` are JSON, over the default ones.
//!
//! Prints times per sample in nanoseconds, each the least of several runs: sample by sample, and as a replay of arrays of
//! times, poses and readings; and the 99th percentile and the largest over the samples of the least time of each.
//! `python/bench/overhead.py` runs it.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde_json::json;
use testbed::front_end::{FrontEnd, FrontEndConfig, Mounting, SensorInput};
use testbed::replay::{Steps, estimator, knowledge, samples};
use testbed::settings::merged;
use trace::{CalibrationFile, Trace};
use whisker::estimators;
use whisker::events::TouchConfig;
use whisker::frames::Pose;

const RUNS: usize = 30;
/// Standard deviation of the noise, as a fraction of the largest reading.
const NOISE: f64 = 0.01;
const SEED: u64 = 1;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (trace, calibration, name, settings) = match arguments.as_slice() {
        [trace, calibration, name] => (trace, calibration, name, json!({})),
        [trace, calibration, name, settings] => (trace, calibration, name, serde_json::from_str(settings)?),
        _ => anyhow::bail!("expected TRACE CALIBRATION ESTIMATOR [SETTINGS]"),
    };
    let trace = Trace::read(Path::new(trace))?;
    let path = Path::new(calibration);
    let row = estimators::estimator(name).context("unknown estimator")?;
    let faces = CalibrationFile::read(path)?.calibrated(path, row.sensor_model)?;
    let instants = &trace.recording.instants;
    let noise_sd_n_m = NOISE * instants.iter().map(|now| now.moment_z_n_m.abs()).fold(0.0, f64::max);
    let knowledge = knowledge(&trace.sidecar, &faces, noise_sd_n_m);
    let mounting = Mounting::alone(&trace.sidecar);
    let front_end = FrontEnd::new(&FrontEndConfig::default())?;
    let readings_n_m = front_end.readings_n_m(&SensorInput::new(&trace, &mounting, noise_sd_n_m, SEED))?;
    let config = merged((row.defaults)(), &settings)?;
    let fresh = || estimator(row, &config, TouchConfig::default(), &knowledge, &trace.sidecar.name, 1);
    let samples = samples(&trace.recording, &readings_n_m);
    let bases = instants.iter().map(|now| [now.base.origin().x(), now.base.origin().y(), now.base.yaw_rad()]);
    let (times_s, bases): (Vec<f64>, Vec<[f64; 3]>) = instants.iter().map(|now| now.t_s).zip(bases).unzip();
    let (mut step_ns, mut replay_ns) = (f64::INFINITY, f64::INFINITY);
    let mut steps_ns = vec![u128::MAX; samples.len()];
    for _ in 0..RUNS {
        let mut running = fresh()?;
        let start = Instant::now();
        let found = samples.iter().filter(|sample| running.step(sample).is_some()).count();
        step_ns = step_ns.min(start.elapsed().as_nanos() as f64 / samples.len() as f64);
        anyhow::ensure!(found > 0, "no estimate");

        let mut running = fresh()?;
        for (sample, least_ns) in samples.iter().zip(&mut steps_ns) {
            let start = Instant::now();
            running.step(sample);
            *least_ns = start.elapsed().as_nanos().min(*least_ns);
        }

        let start = Instant::now();
        let mut running = fresh()?;
        let mut steps = Steps::default();
        let mut estimates = Vec::with_capacity(times_s.len());
        for ((&t_s, &[x_m, y_m, yaw_rad]), &reading_n_m) in times_s.iter().zip(&bases).zip(&readings_n_m) {
            let base = Pose::new(x_m, y_m, yaw_rad);
            let now = trace::Instant { t_s, base, twist: None, moment_z_n_m: reading_n_m, rotation_z_rad: None };
            running.push(&steps.sample(&now, reading_n_m), &mut estimates);
        }
        running.end(&mut estimates);
        replay_ns = replay_ns.min(start.elapsed().as_nanos() as f64 / estimates.len() as f64);
    }
    steps_ns.sort_unstable();
    let (p99_ns, largest_ns) = (steps_ns[steps_ns.len() * 99 / 100], steps_ns[steps_ns.len() - 1]);
    println!("{step_ns:.1} {replay_ns:.1} {p99_ns} {largest_ns}");
    Ok(())
}
