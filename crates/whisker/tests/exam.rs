//! The exam that every registered estimator has to pass.

mod world;

use std::sync::Arc;

use whisker::estimators::{ContactPrior, ESTIMATORS, Estimate, EstimatorRow, Knowledge, MethodClass, Sample};
use whisker::frames::Point;

use world::{RATE_HZ, base, contact, estimator, knowledge, samples};

fn run(row: &EstimatorRow, knowledge: &Arc<Knowledge>, samples: &[(f64, Sample)], seed: u64) -> Vec<Option<Estimate>> {
    let mut estimator = estimator(row, knowledge, seed);
    estimator.run(&samples.iter().map(|(_, sample)| *sample).collect::<Vec<_>>())
}

fn error_m(samples: &[(f64, Sample)], estimates: &[Option<Estimate>]) -> f64 {
    let (t_s, _) = samples[samples.len() - 1];
    let estimate = estimates[estimates.len() - 1].expect("the contact is followed to the end");
    base(t_s).apply(estimate.contact).distance(&contact())
}

const NOISE_N_M: f64 = 3e-7;

/// Filters that estimate the object's radius as well as the contact, whose errors are correlated.
const FIND_THE_RADIUS: [&str; 7] =
    ["round", "rubbing", "installed", "pushed", "sliding", "smoother-sliding", "smoother-installed"];

/// Largest final error with noise-free readings: the beam-theory baselines keep their initial error, and the published
/// filters have a fading memory.
fn allowed_m(row: &EstimatorRow) -> f64 {
    match row.class {
        MethodClass::Baseline => 6e-3,
        MethodClass::Published => 0.3e-3,
        _ if FIND_THE_RADIUS.contains(&row.name) => 0.1e-3,
        _ => 0.05e-3,
    }
}

#[test]
fn verif_estimates_the_contact() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 6.0, |_| true);
    for row in ESTIMATORS {
        let error = error_m(&samples, &run(row, &knowledge, &samples, 1));
        assert!(error < allowed_m(row), "{}: {} mm", row.name, error * 1e3);
    }
}

#[test]
fn verif_only_hindsight_differs_from_stepping() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 2.0, |_| true);
    for row in ESTIMATORS {
        let mut estimator = estimator(row, &knowledge, 1);
        let stepped: Vec<_> = samples.iter().map(|(_, sample)| estimator.step(sample)).collect();
        let is_same = run(row, &knowledge, &samples, 1) == stepped;
        assert_eq!(is_same, row.class != MethodClass::Hindsight, "{}", row.name);
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
fn verif_a_free_whisker_has_no_estimate() {
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
fn verif_a_release_ends_the_contact_and_a_new_touch_starts() {
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
fn robust_dropped_samples_and_outliers_give_finite_estimates() {
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
        let estimates = run(row, &knowledge, &samples, 1);
        // The published filters do not bound the influence of a reading.
        if matches!(row.class, MethodClass::Recursive | MethodClass::Hindsight) {
            let error = error_m(&samples, &estimates);
            assert!(error < 0.1e-3, "{}: {} mm", row.name, error * 1e3);
        }
        for (estimate, (t_s, _)) in estimates.iter().zip(&samples) {
            let Some(estimate) = estimate else { continue };
            assert!(estimate.contact.vector().iter().all(|v| v.is_finite()), "{} at {t_s} s", row.name);
            if let Some(covariance) = estimate.covariance_m2 {
                // A particle set dominated by one particle has no spread, except for rounding.
                let least = covariance.symmetric_eigenvalues().min();
                assert!(least > -1e-15, "{} at {t_s} s: {least}", row.name);
            }
        }
    }
}

#[test]
fn verif_a_wrong_contact_prior_is_corrected() {
    let noise_free = knowledge(NOISE_N_M);
    let samples = samples(&noise_free, 6.0, |_| true);
    for offset_m in [-5e-3, 5e-3] {
        let contact_prior = ContactPrior { contact: Point::new(0.05 + offset_m, 0.0), sd_m: 5e-3 };
        let contact_prior = Arc::new(Knowledge { contact_prior: Some(contact_prior), ..(*noise_free).clone() });
        for row in ESTIMATORS.iter().filter(|row| row.class != MethodClass::Baseline) {
            let error = error_m(&samples, &run(row, &contact_prior, &samples, 1));
            assert!(error < allowed_m(row), "{}: {} mm", row.name, error * 1e3);
        }
    }
}

#[test]
fn verif_order_of_the_registry_is_irrelevant() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 1.0, |_| true);
    let forwards: Vec<_> = ESTIMATORS.iter().map(|row| run(row, &knowledge, &samples, 3)).collect();
    let backwards = ESTIMATORS.iter().rev().map(|row| run(row, &knowledge, &samples, 3));
    for (one, other) in forwards.iter().rev().zip(backwards) {
        assert_eq!(*one, other);
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
                // Without an alternative.
                if key == "alternative" && absurd.is_null() {
                    continue;
                }
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
