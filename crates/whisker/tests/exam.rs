//! The exam that every registered estimator has to pass.

mod world;

use std::sync::Arc;

use whisker::estimators::{ESTIMATORS, Estimate, EstimatorRow, Knowledge, Sample};

use world::{RATE_HZ, base, contact, estimator, knowledge, samples};

fn run(row: &EstimatorRow, knowledge: &Arc<Knowledge>, samples: &[(f64, Sample)], seed: u64) -> Vec<Option<Estimate>> {
    let mut estimator = estimator(row, knowledge, seed);
    samples.iter().map(|(_, sample)| estimator.step(sample)).collect()
}

fn error_m(samples: &[(f64, Sample)], estimates: &[Option<Estimate>]) -> f64 {
    let (t_s, _) = samples[samples.len() - 1];
    let estimate = estimates[estimates.len() - 1].expect("the contact is followed to the end");
    base(t_s).apply(estimate.contact).distance(&contact())
}

const NOISE_N_M: f64 = 3e-7;

/// Error that an estimator may end with: the beam-theory baselines keep what they got wrong at the start.
fn allowed_m(row: &EstimatorRow) -> f64 {
    if row.is_baseline { 6e-3 } else { 0.3e-3 }
}

#[test]
fn verif_finds_the_contact() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 6.0, |_| true);
    for row in ESTIMATORS {
        let error = error_m(&samples, &run(row, &knowledge, &samples, 1));
        assert!(error < allowed_m(row), "{}: {} mm", row.name, error * 1e3);
    }
}

#[test]
fn verif_same_seed_same_estimates() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 2.0, |_| true);
    for row in ESTIMATORS {
        assert_eq!(run(row, &knowledge, &samples, 7), run(row, &knowledge, &samples, 7), "{}", row.name);
    }
}

#[test]
fn verif_free_stays_free() {
    let knowledge = knowledge(NOISE_N_M);
    let free: Vec<_> = samples(&knowledge, 2.0, |_| true)
        .into_iter()
        .map(|(t_s, sample)| (t_s, Sample { reading_n_m: 4e-7 * (40.0 * t_s).sin(), ..sample }))
        .collect();
    for row in ESTIMATORS {
        assert!(run(row, &knowledge, &free, 1).iter().all(Option::is_none), "{}", row.name);
    }
}

#[test]
fn verif_lets_go_and_starts_again() {
    let knowledge = knowledge(NOISE_N_M);
    let mut samples = samples(&knowledge, 6.0, |_| true);
    for (t_s, sample) in &mut samples {
        if (2.0..2.5).contains(t_s) {
            sample.reading_n_m = 0.0;
        }
    }
    for row in ESTIMATORS {
        let estimates = run(row, &knowledge, &samples, 1);
        let at = |t_s: f64| estimates[(t_s * RATE_HZ) as usize];
        assert!(at(1.9).is_some() && at(2.4).is_none() && at(5.9).is_some(), "{}", row.name);
    }
}

#[test]
fn robust_dropped_samples_and_spikes_leave_a_number() {
    let knowledge = knowledge(NOISE_N_M);
    let mut samples = samples(&knowledge, 6.0, |i| i % 7 != 3 && !(600..640).contains(&i));
    for (i, (_, sample)) in samples.iter_mut().enumerate() {
        match i % 211 {
            100 => sample.reading_n_m *= 30.0,
            150 => sample.reading_n_m *= -30.0,
            _ => {}
        }
    }
    for row in ESTIMATORS {
        for (estimate, (t_s, _)) in run(row, &knowledge, &samples, 1).iter().zip(&samples) {
            let Some(estimate) = estimate else { continue };
            assert!(estimate.contact.vector().iter().all(|v| v.is_finite()), "{} at {t_s} s", row.name);
            if let Some(covariance) = estimate.covariance_m2 {
                // A cloud of which one particle outweighs all others has no spread, but for rounding.
                let least = covariance.symmetric_eigenvalues().min();
                assert!(least > -1e-15, "{} at {t_s} s: {least}", row.name);
            }
        }
    }
}

#[test]
fn robust_unknown_settings_are_refused_by_name() {
    let knowledge = knowledge(NOISE_N_M);
    for row in ESTIMATORS {
        let settings = serde_json::json!({ "fadign": 1.0 });
        let error = (row.build)(&settings, &knowledge).err().expect("an unknown key");
        assert!(error.to_string().contains("fadign"), "{}: {error}", row.name);
    }
}

#[test]
fn robust_settings_out_of_range_are_refused_by_name() {
    let knowledge = knowledge(NOISE_N_M);
    for row in ESTIMATORS {
        let defaults = (row.defaults)();
        for key in defaults.as_object().expect("settings are an object").keys() {
            for absurd in [serde_json::json!(-1e300), serde_json::json!(1e300), serde_json::json!(null)] {
                let mut settings = defaults.clone();
                settings[key] = absurd.clone();
                let error = (row.build)(&settings, &knowledge).err();
                assert!(error.is_some(), "{}: {key} = {absurd} is taken", row.name);
            }
        }
    }
}

#[test]
fn verif_names_are_unique() {
    for (i, row) in ESTIMATORS.iter().enumerate() {
        assert!(ESTIMATORS[i + 1..].iter().all(|other| other.name != row.name), "{}", row.name);
    }
}
