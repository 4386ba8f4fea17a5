//! Estimators with a noisy base pose: the error of each pose is independent.

mod world;

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde_json::json;
use whisker::estimators::{self, BaseNoise, Knowledge, Sample};
use whisker::frames::{Base, Pose, World};

use world::{RATE_HZ, base, configured, contact, estimator, knowledge, samples};

const NOISE_N_M: f64 = 1e-7;

/// Standard deviations of x, y and yaw, as given by encoders with 1e-4 rad.
const BASE_SD: [f64; 3] = [8e-5, 5e-5, 2e-4];

const ESTIMATORS: [&str; 6] = ["ekf", "ukf", "sliding", "imm", "outline", "recommended"];

/// Samples whose motion is that between noisy poses, with the noisy poses.
fn shaken(knowledge: &Knowledge, duration_s: f64, seed: u64) -> Vec<(Pose<Base, World>, Sample)> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut normal = || rng.sample::<f64, _>(StandardNormal);
    let mut last: Option<Pose<Base, World>> = None;
    let shake = |(t_s, exact): (f64, Sample)| {
        let error: Pose<Base, Base> = Pose::new(BASE_SD[0] * normal(), BASE_SD[1] * normal(), BASE_SD[2] * normal());
        let known = error.then(&base(t_s));
        let before = last.replace(known).unwrap_or(known);
        let reading_n_m = exact.reading_n_m + NOISE_N_M * normal();
        (known, Sample { motion: before.then(&known.inverse()), reading_n_m, ..exact })
    };
    samples(knowledge, duration_s, |_| true).into_iter().map(shake).collect()
}

/// Means of NIS and NEES over some trials, after two seconds. `recommended` takes single samples: in the means of blocks the error
/// of the sensor model, which these readings do not have, would outweigh the noise.
fn means(name: &str, knowledge: &Arc<Knowledge>) -> (f64, f64) {
    let row = estimators::estimator(name).unwrap();
    let (mut nis, mut nees) = (Vec::new(), Vec::new());
    for seed in 1..=6 {
        let samples = shaken(knowledge, 6.0, seed);
        let mut built = match name {
            "recommended" => configured(row, &json!({"block": {"samples": 1}}), knowledge, seed),
            _ => estimator(row, knowledge, seed),
        };
        let estimates = built.run(&samples.iter().map(|(_, sample)| *sample).collect::<Vec<_>>());
        let settled = samples.iter().zip(estimates).skip((2.0 * RATE_HZ) as usize);
        for ((known, _), estimate) in settled {
            let estimate = estimate.expect("the contact is tracked");
            let error = estimate.contact.vector() - known.inverse().apply(contact()).vector();
            nees.push(error.dot(&estimate.covariance_m2.unwrap().cholesky().unwrap().solve(&error)));
            nis.extend(estimate.innovation.map(|innovation| innovation.nis));
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    (mean(&nis), mean(&nees))
}

/// With the covariance of the base's noise estimators are consistent; without it the NIS is too large.
#[test]
fn verif_estimators_with_the_noise_of_their_base_are_consistent() {
    let covariance = Matrix3::from_diagonal(&Vector3::from(BASE_SD).map(|sd| sd * sd));
    let exact = knowledge(NOISE_N_M);
    let noisy = Arc::new(Knowledge { base_noise: BaseNoise(covariance), ..(*exact).clone() });
    for name in ESTIMATORS {
        let ((nis, nees), (exact_nis, _)) = (means(name, &noisy), means(name, &exact));
        assert!((0.7..1.25).contains(&nis) && nees < 3.0, "{name}: NIS {nis}, NEES {nees}");
        assert!(exact_nis > 1.25, "{name}: without the covariance, NIS {exact_nis}");
    }
}
