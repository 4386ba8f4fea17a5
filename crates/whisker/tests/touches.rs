//! The belief of an object, kept from touch to touch by filters of the contact.

mod world;

use std::f64::consts::TAU;

use serde_json::Value;
use whisker::estimators::{ESTIMATORS, Estimator, Sample, estimator as row};
use whisker::frames::{Base, Pose};

use world::{RATE_HZ, base, configured, contact, estimator, knowledge, samples};

const NOISE_N_M: f64 = 3e-7;

/// Instants between which the whisker is lifted off.
const LIFTED_S: std::ops::Range<f64> = 2.0..2.3;

/// Distance by which the whisker is lifted, more than it was pressed.
const LIFT_M: f64 = 0.02;

/// Errors after a lift-off, in which the object is displaced along the whisker by `shift_m`.
fn errors_after_lift_off_m(estimator: &mut Estimator, shift_m: f64) -> Vec<f64> {
    let mut errors_m = Vec::new();
    let mut is_lifted = false;
    for (t_s, mut sample) in samples(&knowledge(NOISE_N_M), 4.0, |_| true) {
        if LIFTED_S.contains(&t_s) != is_lifted {
            // The object is on the left of the whisker, which is lifted to the right.
            let leap = if is_lifted { (shift_m, -LIFT_M) } else { (0.0, LIFT_M) };
            let leap = Pose::<Base, Base>::new(leap.0, leap.1, 0.0);
            sample = Sample { motion: sample.motion.then(&leap), ..sample };
            is_lifted = !is_lifted;
        }
        if is_lifted {
            sample.reading_n_m = 0.0;
        }
        let found = estimator.step(&sample).filter(|_| t_s >= LIFTED_S.end);
        errors_m.extend(found.map(|found| base(t_s).apply(found.contact).distance(&contact())));
    }
    errors_m
}

/// Mean error over the first tenth of a second.
fn first_m(errors_m: &[f64]) -> f64 {
    let count = (0.1 * RATE_HZ) as usize;
    errors_m[..count].iter().sum::<f64>() / count as f64
}

fn with_kept_share(name: &str, share: f64) -> Estimator {
    let mut settings = (row(name).unwrap().defaults)();
    settings["kept_share"] = Value::from(share);
    configured(row(name).unwrap(), &settings, &knowledge(NOISE_N_M), 1)
}

#[test]
fn verif_a_touch_of_the_same_object_begins_with_its_belief() {
    for name in ["ukf", "round", "sliding"] {
        let anew = first_m(&errors_after_lift_off_m(&mut with_kept_share(name, 0.0), 0.0));
        let kept = first_m(&errors_after_lift_off_m(&mut with_kept_share(name, 0.8), 0.0));
        assert!(kept < 0.5 * anew, "{name}: {kept} {anew}");
    }
}

#[test]
fn robust_a_touch_of_another_object_is_recognised() {
    for name in ["round", "rubbing", "installed", "recommended"] {
        let mut estimator = estimator(row(name).unwrap(), &knowledge(NOISE_N_M), 1);
        let errors_m = errors_after_lift_off_m(&mut estimator, 12e-3);
        assert!(errors_m[errors_m.len() - 1] < 0.5e-3, "{name}: {:?}", errors_m.last());
    }
}

/// Poses from a robot may jump by a turn of the yaw while the whisker touches.
#[test]
fn robust_a_wrapped_yaw_does_not_change_the_estimates() {
    let knowledge = knowledge(NOISE_N_M);
    let recording: Vec<Sample> = samples(&knowledge, 2.0, |_| true).into_iter().map(|(_, sample)| sample).collect();
    let wrapped: Vec<Sample> = (recording.iter().enumerate())
        .map(|(i, sample)| {
            let turn_rad = if i == recording.len() / 2 { TAU } else { 0.0 };
            let (to, yaw_rad) = (sample.motion.origin(), sample.motion.yaw_rad() + turn_rad);
            Sample { motion: Pose::new(to.x(), to.y(), yaw_rad), ..*sample }
        })
        .collect();
    for row in ESTIMATORS {
        let [kept, jumped] = [&recording, &wrapped].map(|samples| estimator(row, &knowledge, 1).run(samples));
        let differ = kept.iter().zip(&jumped).filter(|pair| match pair {
            (Some(one), Some(other)) => one.contact.distance(&other.contact) > 1e-8,
            (one, other) => one.is_some() != other.is_some(),
        });
        assert_eq!(differ.count(), 0, "{}", row.name);
    }
}

/// Readings that are disturbed until the release contradict the models of that touch.
#[test]
fn robust_doubt_of_one_touch_is_none_of_the_next() {
    /// Time in which every other reading is an outlier, long enough for their limited mean.
    const DOUBTED_S: f64 = 1.0;
    let mut estimator = estimator(row("recommended").unwrap(), &knowledge(NOISE_N_M), 1);
    let mut doubted = [false; 2];
    for (i, (t_s, mut sample)) in samples(&knowledge(NOISE_N_M), 4.0, |_| true).into_iter().enumerate() {
        if (LIFTED_S.start - DOUBTED_S..LIFTED_S.start).contains(&t_s) && i % 2 == 0 {
            sample.reading_n_m *= 1.5;
        }
        if LIFTED_S.contains(&t_s) {
            sample.reading_n_m = 0.0;
        }
        let found = estimator.step(&sample);
        let is_next = usize::from(t_s >= LIFTED_S.end);
        doubted[is_next] |= found.is_some_and(|found| found.model_doubtful);
    }
    assert_eq!(doubted, [true, false]);
}
