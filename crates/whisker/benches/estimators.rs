//! Time of one step of each registered estimator.

#[path = "../tests/world/mod.rs"]
mod world;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use whisker::estimators::{ESTIMATORS, estimator};

/// Standard deviation of the measurement noise given to the estimators.
const NOISE_N_M: f64 = 3e-7;

/// Simulated time per round.
const DURATION_S: f64 = 2.0;

fn main() {
    divan::main();
}

/// Names of all registered estimators.
fn names() -> Vec<&'static str> {
    ESTIMATORS.iter().map(|row| row.name).collect()
}

#[divan::bench(args = names())]
fn step(bencher: Bencher, name: &str) {
    let row = estimator(name).expect("a registered name");
    let knowledge = world::knowledge(NOISE_N_M);
    let samples = world::samples(&knowledge, DURATION_S, |_| true);
    bencher.counter(ItemsCount::new(samples.len())).with_inputs(|| world::estimator(row, &knowledge, 1)).bench_refs(
        |estimator| {
            for (_, sample) in &samples {
                black_box(estimator.step(sample));
            }
        },
    );
}
