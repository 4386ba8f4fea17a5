//! Every filter under every model of the contact's motion, and model averaging.

mod world;

use serde_json::{Value, json};
use whisker::estimators::{self, Estimate, Estimator, Sample};

use world::{base, configured, contact, estimator, knowledge, samples};

const NOISE_N_M: f64 = 3e-7;

/// The filters, each with the path of the motion among its settings.
const FILTERS: [(&str, &str); 8] = [
    ("ekf", "/motion"),
    ("iekf", "/motion"),
    ("ukf", "/motion"),
    ("particle", "/motion"),
    ("smoother", "/motion"),
    ("smoother-sliding", "/motion"),
    ("batch", "/guess/motion"),
    ("batch-sliding", "/guess/motion"),
];

fn motions() -> [Value; 2] {
    [json!({"kind": "resting"}), json!({"kind": "round", "radius_m": 1e-3, "radius_sd_m": 1e-3, "radius_parts": 2})]
}

fn run(mut estimator: Estimator, samples: &[(f64, Sample)]) -> Vec<Option<Estimate>> {
    estimator.run(&samples.iter().map(|(_, sample)| *sample).collect::<Vec<_>>())
}

#[test]
fn verif_every_filter_takes_every_motion() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 6.0, |_| true);
    let (end_s, _) = samples[samples.len() - 1];
    for (name, place) in FILTERS {
        let row = estimators::estimator(name).unwrap();
        for motion in motions() {
            let mut settings = (row.defaults)();
            *settings.pointer_mut(place).unwrap() = motion.clone();
            let estimates = run(configured(row, &settings, &knowledge, 1), &samples);
            let last = estimates.last().copied().flatten().expect("the contact is followed to the end");
            let error_m = base(end_s).apply(last.contact).distance(&contact());
            assert!(error_m < 0.5e-3, "{name}, {motion}: {} mm", 1e3 * error_m);
            assert_eq!(last.radius.is_some(), motion["kind"] == "round", "{name}, {motion}");
        }
    }
}

#[test]
fn verif_a_contact_at_rest_is_most_probably_static() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 6.0, |_| true);
    // `round`, `rubbing`, `installed` and `batch-sliding` contain thin objects as well.
    let winners: [(&str, &[&str]); 3] = [
        ("recommended", &["ukf", "round", "rubbing", "installed"]),
        ("imm", &["static"]),
        ("batch-recommended", &["batch", "batch-sliding"]),
    ];
    for (name, winners) in winners {
        let row = estimators::estimator(name).unwrap();
        let estimates = run(estimator(row, &knowledge, 1), &samples);
        let models = estimates.last().copied().flatten().and_then(|last| last.models).expect("models");
        // The probability of an inexact calibration hardly depends on the readings.
        let (leading, _) = models.iter().find(|(model, _)| !model.ends_with("installed")).unwrap();
        assert_eq!(leading, winners[0], "{name}: {models}");
        let of = |counts: &dyn Fn(&str) -> bool| -> f64 {
            models.iter().filter(|(model, _)| counts(model)).map(|(_, share)| share).sum()
        };
        let right = of(&|model| winners.contains(&model));
        let possible = if name == "batch-recommended" { of(&|model| model != "smoother-installed") } else { 1.0 };
        assert!(right > 0.8 * possible, "{name}: {models}");
        assert!((models.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-9, "{name}: {models}");
    }
}

/// Readings that are larger than calibrated displace the contact by more than the noise does.
#[test]
fn val_covariances_in_hindsight_allow_for_a_wrong_gain() {
    let knowledge = knowledge(NOISE_N_M);
    let larger = |(t_s, sample): (f64, Sample)| (t_s, Sample { reading_n_m: 1.02 * sample.reading_n_m, ..sample });
    let samples: Vec<_> = samples(&knowledge, 3.0, |_| true).into_iter().map(larger).collect();
    let covered = |name: &str| {
        let estimates = run(estimator(estimators::estimator(name).unwrap(), &knowledge, 1), &samples);
        let is_covered = |((t_s, _), estimate): (&(f64, Sample), &Option<Estimate>)| {
            let estimate = estimate.as_ref()?;
            let error = base(*t_s).inverse().apply(contact()).vector() - estimate.contact.vector();
            Some(error.dot(&estimate.covariance_m2?.cholesky()?.solve(&error)) < 5.99)
        };
        let known: Vec<bool> = samples.iter().zip(&estimates).filter_map(is_covered).collect();
        known.iter().filter(|covered| **covered).count() as f64 / known.len() as f64
    };
    assert!(covered("batch-recommended") > 0.9, "{}", covered("batch-recommended"));
    assert!(covered("batch-sliding") < 0.5, "{}", covered("batch-sliding"));
}

#[test]
fn verif_the_average_of_one_candidate_is_that_candidate() {
    let knowledge = knowledge(NOISE_N_M);
    let samples = samples(&knowledge, 2.0, |_| true);
    let [average, ekf] = ["recommended", "ekf"].map(|name| estimators::estimator(name).unwrap());
    let alone = json!({"candidates": [{"name": "ekf", "weight": 1.0}], "block": {"samples": 1}});
    let chosen = run(configured(average, &alone, &knowledge, 1), &samples);
    for (chosen, own) in chosen.iter().zip(run(estimator(ekf, &knowledge, 1), &samples)) {
        assert_eq!(chosen.map(|estimate| Estimate { models: None, ..estimate }), own);
    }
}

#[test]
fn robust_invalid_candidates_are_named() {
    let knowledge = knowledge(NOISE_N_M);
    for (average, names, expected) in [
        ("recommended", vec!["ekfs"], "`ekfs` is unknown, expected one of: recommended, "),
        ("recommended", vec!["batch-recommended"], "`batch-recommended` is a model average itself"),
        ("recommended", vec!["paper-ekf"], "`paper-ekf` is bound to its own sensor model"),
        ("recommended", vec!["ekf", "batch"], "`batch` is a hindsight method"),
        ("batch-recommended", vec!["batch", "ekf"], "`ekf` is a recursive method"),
        ("batch-recommended", vec!["euler-bernoulli"], "`euler-bernoulli` is a recursive method"),
        ("recommended", vec!["ekf", "ekf"], "`ekf` is named twice"),
        ("recommended", vec![], "`candidates`: found 0, expected 1 to 8"),
    ] {
        let row = estimators::estimator(average).unwrap();
        let candidates: Vec<Value> = names.iter().map(|name| json!({"name": name, "weight": 1.0})).collect();
        let error = (row.build)(&json!({ "candidates": candidates }), &knowledge).err().expect(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    for (average, alternative, expected) in [
        ("recommended", json!({"name": "ekfs"}), "`alternative`: `ekfs` is unknown, expected one of: recommended, "),
        ("recommended", json!({"name": "batch"}), "`alternative`: `batch` is a hindsight method"),
        ("recommended", json!({"log_odds": 0.0}), "`alternative.log_odds`"),
        ("batch-recommended", json!({}), "`alternative`: found a method, expected none"),
    ] {
        let row = estimators::estimator(average).unwrap();
        let error = (row.build)(&json!({ "alternative": alternative }), &knowledge).err().expect(expected).to_string();
        assert!(error.contains(expected), "{error}");
    }
    for average in ["recommended", "batch-recommended"] {
        let row = estimators::estimator(average).unwrap();
        assert!((row.build)(&json!({ "alternative": null }), &knowledge).is_ok(), "{average}");
    }
}

/// The motion is that of the method, so that one of the filter would have no effect.
#[test]
fn robust_a_motion_without_effect_is_refused() {
    let knowledge = knowledge(NOISE_N_M);
    let average = estimators::estimator("recommended").unwrap();
    for name in ["rubbing", "drifting", "installed", "pushed"] {
        let row = estimators::estimator(name).unwrap();
        assert!((row.defaults)()["filter"].get("motion").is_none(), "{name}");
        for motion in motions() {
            let settings = json!({"filter": {"motion": motion}});
            let candidates = json!([{"name": name, "weight": 1.0, "settings": settings}]);
            let alone = (row.build)(&settings, &knowledge).err();
            let averaged = (average.build)(&json!({ "candidates": candidates }), &knowledge).err();
            for error in [alone, averaged] {
                let error = error.expect(name).to_string();
                assert!(error.starts_with("`filter.motion`: found a model of motion"), "{name}: {error}");
            }
        }
        assert!((row.build)(&json!({"filter": {"gate_sds": 4.0}}), &knowledge).is_ok(), "{name}");
    }
}
