//! The outline, kept from touch to touch.

mod world;

use whisker::estimators::{Estimate, Sample, estimator as row};
use whisker::frames::{Base, Point, Pose};

use world::{RATE_HZ, base, contact, estimator, knowledge, samples};

const NOISE_N_M: f64 = 3e-7;

/// Instants between which the whisker is lifted off.
const LIFTED_S: std::ops::Range<f64> = 2.0..2.5;

/// The world's samples with a lift-off, after which the base is displaced by `shift`, with the object or without it.
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
fn verif_a_known_object_is_identified_immediately() {
    let samples = lifted(0.0);
    let errors = errors_m(&samples);
    let first = errors.iter().skip((LIFTED_S.end * RATE_HZ) as usize).flatten().next().unwrap();
    assert!(*first < 0.3e-3, "{first}");
}

#[test]
fn verif_another_object_is_distinguished_from_it() {
    let samples = lifted(12e-3);
    let last = errors_m(&samples).last().copied().flatten().unwrap();
    assert!(last < 0.3e-3, "{last}");
}

/// Estimates of a second touch that ends before the object is identified: at each sample, and smoothed.
fn brief_estimates(shift_m: f64) -> (Vec<Estimate>, Vec<Estimate>) {
    const BRIEF: usize = 15;
    let (row, knowledge) = (row("outline-batch").unwrap(), knowledge(NOISE_N_M));
    let samples: Vec<Sample> = lifted(shift_m).into_iter().map(|(_, sample)| sample).collect();
    let mut stepping = estimator(row, &knowledge, 1);
    let at_once: Vec<_> = samples.iter().map(|sample| stepping.step(sample)).collect();
    let lifted = (LIFTED_S.end * RATE_HZ) as usize;
    let first = lifted + at_once[lifted..].iter().position(Option::is_some).unwrap();
    let brief = first..first + BRIEF;
    let smoothed = estimator(row, &knowledge, 1).run(&samples[..brief.end]);
    let estimates = |all: &[Option<Estimate>]| all[brief.clone()].iter().map(|estimate| estimate.unwrap()).collect();
    (estimates(&at_once), estimates(&smoothed))
}

#[test]
fn verif_hindsight_estimates_a_brief_touch_of_the_known_object() {
    let (at_once, smoothed) = brief_estimates(0.0);
    for (at_once, smoothed) in at_once.iter().zip(&smoothed) {
        let moved_m = smoothed.contact.distance(&at_once.contact);
        assert!(smoothed.innovation.is_none() && moved_m < 0.3e-3, "{moved_m}");
    }
}

#[test]
fn verif_hindsight_does_not_revise_a_brief_touch_of_another_object() {
    let (at_once, smoothed) = brief_estimates(12e-3);
    // The first reading is predicted by the known object, which was revised at the end of the touch before.
    assert_eq!(at_once[1..], smoothed[1..]);
}

#[test]
fn verif_hindsight_revises_its_own_touch_only() {
    let samples: Vec<Sample> = lifted(0.0).into_iter().map(|(_, sample)| sample).collect();
    let (first, second) = samples.split_at((0.5 * (LIFTED_S.start + LIFTED_S.end) * RATE_HZ) as usize);
    let mut estimator = estimator(row("outline-batch").unwrap(), &knowledge(NOISE_N_M), 1);
    first.iter().for_each(|sample| {
        estimator.step(sample);
    });
    let smoothed = estimator.run(second);
    assert!(smoothed[0].is_none() && smoothed[second.len() - 1].is_some());
}

#[test]
fn verif_the_outline_passes_through_the_contact() {
    let samples = lifted(0.0);
    let mut estimator = estimator(row("outline").unwrap(), &knowledge(NOISE_N_M), 1);
    assert!(estimator.outline().is_none());
    for (_, sample) in &samples {
        estimator.step(sample);
    }
    let start = base(0.0).inverse();
    let seen: Point<Base> = start.apply(contact());
    let outline = estimator.outline().unwrap();
    assert!(outline.leads && !outline.points.is_empty());
    for point in outline.points {
        // The contact is on the centre line, the wire's radius away from the surface.
        let off = seen.vector() - point.surface.vector();
        assert!(
            off.norm() < 0.6e-3
                && (point.normal.norm() - 1.0).abs() < 1e-12
                && point.covariance_m2.cholesky().is_some(),
            "{point:?}"
        );
    }
}
