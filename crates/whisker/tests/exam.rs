//! The exam that every registered estimator has to pass, on a world whose sensor model is exact.
//!
//! The world: a straight whisker pressed from the left; the reading is that of a polynomial fitted to a stiffness that falls along the
//! whisker, and the contact rests in the world while the base moves.

use std::sync::Arc;

use whisker::estimators::{ESTIMATORS, Estimate, Estimator, EstimatorRow, Knowledge, Sample};
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::{self, CalibratedFace, Face};
use whisker::touch::TouchConfig;
use whisker::{Curvature, Whisker};

const RATE_HZ: f64 = 250.0;

fn straight() -> Whisker {
    Whisker {
        name: "exam".into(),
        length_m: 0.08,
        root_diameter_m: 0.25e-3,
        tip_diameter_m: 0.25e-3,
        youngs_modulus_pa: 60e9,
        density_kg_m3: 6450.0,
        curvature: vec![Curvature { length_m: 0.08, curvature_per_m: 0.0 }],
        root_stiffness_n_m_rad: 0.17e-3,
        segments: 40,
        damping_s: 0.0,
    }
}

/// A calibrated left face: moment of a small deflection on the compliant root.
fn knowledge(noise_sd_n_m: f64) -> Arc<Knowledge> {
    let whisker = straight();
    let (stiffness, root) = (whisker.bending_stiffness_n_m2(0.0), whisker.root_stiffness_n_m_rad);
    let traces: Vec<Vec<sensor::Sample>> = [0.0, 0.5]
        .iter()
        .map(|phase| {
            let grid = (0..40).flat_map(|i| (0..25).map(move |j| (f64::from(i) + phase, f64::from(j) + phase)));
            grid.map(|(i, j)| {
                let x = 0.018 + 0.058 * i / 40.0;
                let away = 0.45 * x * j / 25.0;
                let reading_n_m = -away / (x * x / (3.0 * stiffness) + x / root);
                sensor::Sample { contact: Point::new(x, -away), reading_n_m }
            })
            .collect()
        })
        .collect();
    let row = sensor::model("polynomial").unwrap();
    let fit = sensor::fit(row, &(row.defaults)(), &whisker, Face::Left, &traces, &traces).unwrap();
    let face: CalibratedFace = fit.face;
    Arc::new(Knowledge { rest: whisker.rest_shape(), whisker, faces: vec![Arc::new(face)], noise_sd_n_m })
}

/// The base's pose: at rest and free for 0.2 s, then into touch and about.
fn base(t_s: f64) -> Pose<Base, World> {
    let touch = ((t_s - 0.2) / 0.3).clamp(0.0, 1.0);
    let roam = ((t_s - 0.5) / 0.5).clamp(0.0, 1.0);
    let x = 3e-3 * roam * (5.0 * t_s).sin();
    let y = 8e-3 * touch * touch * (3.0 - 2.0 * touch) - 1e-3 + 2.5e-3 * roam * (7.0 * t_s).sin();
    Pose::new(x, y, 0.04 * roam * (4.0 * t_s).sin())
}

fn contact() -> Point<World> {
    Point::new(0.05, 0.0)
}

/// Samples of the world over `duration_s`, without noise, at the instants that `keep` selects.
fn samples(knowledge: &Knowledge, duration_s: f64, keep: impl Fn(usize) -> bool) -> Vec<(f64, Sample)> {
    let face = &knowledge.faces[0];
    let mut last: Option<f64> = None;
    (0..(duration_s * RATE_HZ) as usize)
        .filter(|&i| keep(i))
        .map(|i| {
            let t_s = i as f64 / RATE_HZ;
            let before = last.replace(t_s).unwrap_or(t_s);
            let reading_n_m = face.predict(base(t_s).inverse().apply(contact())).map_or(0.0, |p| p.reading_n_m);
            (t_s, Sample { motion: base(before).then(&base(t_s).inverse()), dt_s: t_s - before, reading_n_m })
        })
        .collect()
}

fn run(row: &EstimatorRow, knowledge: &Arc<Knowledge>, samples: &[(f64, Sample)], seed: u64) -> Vec<Option<Estimate>> {
    let method = (row.build)(&(row.defaults)(), knowledge).unwrap();
    let mut estimator = Estimator::new(method, knowledge.clone(), TouchConfig::default(), seed);
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
fn verif_names_are_unique() {
    for (i, row) in ESTIMATORS.iter().enumerate() {
        assert!(ESTIMATORS[i + 1..].iter().all(|other| other.name != row.name), "{}", row.name);
    }
}
