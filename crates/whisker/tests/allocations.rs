//! Memory allocation of the estimators' steps.

mod world;

use allocation_counter::measure;
use whisker::estimators::{ESTIMATORS, estimator};

const NOISE_N_M: f64 = 3e-7;

/// Samples after which every touch has begun.
const BEGUN: usize = 150;

/// The estimators whose steps allocate, with the reason. All others must not.
const ALLOCATING: &[(&str, &str)] = &[
    ("recommended", "the number of its candidates is free, and `outline` is one of them"),
    ("imm", "the number of modes, and of transition probabilities, is free"),
    ("smoother", "keeps every step of the touch for smoothing"),
    ("batch", "keeps every step of the touch for smoothing"),
    ("smoother-sliding", "keeps every step of the touch for smoothing"),
    ("batch-sliding", "keeps every step of the touch for smoothing"),
    ("smoother-installed", "keeps every step of the touch for smoothing"),
    ("batch-recommended", "its candidates keep every step of the touch for smoothing"),
    ("outline", "keeps the readings since the first touch"),
    ("outline-batch", "keeps the readings since the first touch"),
];

/// The estimators that allocate only if they search for a contact that has left its place.
const SEARCHING: [&str; 4] = ["round", "rubbing", "drifting", "installed"];

#[test]
fn verif_only_listed_estimators_allocate() {
    let knowledge = world::knowledge(NOISE_N_M);
    let samples = world::samples(&knowledge, 2.0, |_| true);
    for row in ESTIMATORS {
        let reason = ALLOCATING.iter().find(|(name, _)| *name == row.name).map(|(_, reason)| *reason);
        let method = (row.build)(&(row.defaults)(), &knowledge).unwrap();
        let may_search = SEARCHING.contains(&row.name);
        assert_eq!(method.is_of_fixed_size(), reason.is_none() && !may_search, "{}: {reason:?}", row.name);
        let mut estimator = world::estimator(row, &knowledge, 1);
        for (_, sample) in &samples[..BEGUN] {
            estimator.step(sample);
        }
        let mut known = 0;
        let allocated = measure(|| {
            known = samples[BEGUN..].iter().filter(|(_, sample)| estimator.step(sample).is_some()).count();
        });
        assert!(known > 300, "{}: {known} estimates", row.name);
        assert_eq!(allocated.count_total == 0, reason.is_none(), "{}: {} bytes", row.name, allocated.bytes_total);
    }
}

#[test]
fn verif_listed_estimators_are_registered() {
    assert!(ALLOCATING.iter().all(|(name, _)| estimator(name).is_some()));
}
