//! Time of one step of each registered estimator, and of one evaluation of the sensor model.

#[path = "../tests/world/mod.rs"]
mod world;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use whisker::estimators::{ESTIMATORS, estimator};
use whisker::frames::Point;

/// Measurement noise that the estimators are told of.
const NOISE_N_M: f64 = 3e-7;

/// Simulated time a round.
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

#[divan::bench]
fn sensor_model(bencher: Bencher) {
    let knowledge = world::knowledge(NOISE_N_M);
    let face = &knowledge.faces[0];
    let contact = Point::new(0.05, -0.008);
    bencher.bench(|| face.predict(black_box(contact)));
}

/// A cloud's worth of contacts at once.
#[divan::bench]
fn sensor_model_each(bencher: Bencher) {
    const CONTACTS: usize = 1000;
    let knowledge = world::knowledge(NOISE_N_M);
    let face = &knowledge.faces[0];
    let x_m: Vec<f64> = (0..CONTACTS).map(|i| 0.03 + 4e-5 * i as f64).collect();
    let y_m = vec![-0.008; CONTACTS];
    let mut readings_n_m = vec![0.0; CONTACTS];
    bencher.counter(ItemsCount::new(CONTACTS)).bench_local(|| {
        face.model.readings_n_m(black_box(&x_m), black_box(&y_m), &mut readings_n_m);
        black_box(&readings_n_m);
    });
}
