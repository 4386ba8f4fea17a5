//! Steps that allocate no memory.

mod world;

use allocation_counter::measure;
use whisker::estimators::{ESTIMATORS, Kind};

const NOISE_N_M: f64 = 3e-7;

/// Samples after which every touch has begun.
const BEGUN: usize = 150;

#[test]
fn verif_steps_of_methods_of_fixed_size_allocate_nothing() {
    let knowledge = world::knowledge(NOISE_N_M);
    let samples = world::samples(&knowledge, 2.0, |_| true);
    for row in ESTIMATORS {
        let method = (row.build)(&(row.defaults)(), &knowledge).unwrap();
        if !method.is_of_fixed_size() {
            continue;
        }
        assert_ne!(row.kind, Kind::Hindsight, "{}: who looks back keeps what was", row.name);
        let mut estimator = world::estimator(row, &knowledge, 1);
        for (_, sample) in &samples[..BEGUN] {
            estimator.step(sample);
        }
        let mut known = 0;
        let allocated = measure(|| {
            known = samples[BEGUN..].iter().filter(|(_, sample)| estimator.step(sample).is_some()).count();
        });
        assert!(known > 300, "{}: {known} estimates", row.name);
        assert_eq!(allocated.count_total, 0, "{}: {} bytes", row.name, allocated.bytes_total);
    }
}

#[test]
fn verif_the_filters_on_line_are_of_fixed_size() {
    let knowledge = world::knowledge(NOISE_N_M);
    let is_fixed = |name: &str| {
        let row = whisker::estimators::estimator(name).unwrap();
        (row.build)(&(row.defaults)(), &knowledge).unwrap().is_of_fixed_size()
    };
    assert!(["ekf", "iekf", "ukf", "sliding", "particle", "paper-particle"].into_iter().all(is_fixed));
}
