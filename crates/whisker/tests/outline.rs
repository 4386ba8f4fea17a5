//! The outline that is remembered from touch to touch.

mod world;

use whisker::estimators::{Sample, estimator as row};
use whisker::frames::{Base, Point, Pose};

use world::{RATE_HZ, base, contact, estimator, knowledge, samples};

const NOISE_N_M: f64 = 3e-7;

/// Instants between which the whisker is lifted off.
const LIFTED_S: std::ops::Range<f64> = 2.0..2.5;

/// The world's samples with a lift-off; the base is then elsewhere by a `shift`, with the object or without it.
fn lifted(shift_m: f64) -> Vec<(f64, Sample)> {
    let knowledge = knowledge(NOISE_N_M);
    let mut samples = samples(&knowledge, 5.0, |_| true);
    let leap = Pose::<Base, Base>::new(shift_m, 0.0, 0.0);
    let mut is_shifted = false;
    for (t_s, sample) in &mut samples {
        if LIFTED_S.contains(t_s) {
            sample.reading_n_m = 0.0;
            if !is_shifted {
                sample.motion = sample.motion.then(&leap);
                is_shifted = true;
            }
        }
    }
    samples
}

fn errors_m(samples: &[(f64, Sample)]) -> Vec<Option<f64>> {
    let mut estimator = estimator(row("outline").unwrap(), &knowledge(NOISE_N_M), 1);
    samples
        .iter()
        .map(|(t_s, sample)| estimator.step(sample).map(|found| base(*t_s).apply(found.contact).distance(&contact())))
        .collect()
}

#[test]
fn verif_a_known_object_is_found_at_once() {
    let samples = lifted(0.0);
    let errors = errors_m(&samples);
    let first = errors.iter().skip((LIFTED_S.end * RATE_HZ) as usize).flatten().next().unwrap();
    assert!(*first < 0.3e-3, "{first}");
}

#[test]
fn verif_another_object_is_told_from_it() {
    let samples = lifted(12e-3);
    let last = errors_m(&samples).last().copied().flatten().unwrap();
    assert!(last < 0.3e-3, "{last}");
}

#[test]
fn verif_the_outline_lies_where_the_contact_is() {
    let samples = lifted(0.0);
    let mut estimator = estimator(row("outline").unwrap(), &knowledge(NOISE_N_M), 1);
    assert!(estimator.outline().is_none());
    for (_, sample) in &samples {
        estimator.step(sample);
    }
    let start = base(0.0).inverse();
    let seen: Point<Base> = start.apply(contact());
    let outline = estimator.outline().unwrap();
    assert!(!outline.is_empty());
    for point in outline {
        // The contact is that of the centre line: the surface lies the wire's radius off, towards the object.
        let off = seen.vector() - point.surface.vector();
        assert!(
            off.norm() < 0.6e-3
                && (point.normal.norm() - 1.0).abs() < 1e-12
                && point.covariance_m2.cholesky().is_some(),
            "{point:?}"
        );
    }
}
