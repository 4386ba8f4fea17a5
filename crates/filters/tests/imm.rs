//! Interacting-multiple-model estimator against cycles computed by hand, and on a manoeuvring target.

use filters::bank::Belief;
use filters::imm::{Imm, Modes, Transition};
use filters::{Bank, Gaussian, Measurement, Process, Update, UpdateError, extended};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2, matrix, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

/// Random walk of a scalar that is measured directly.
#[derive(Clone, Copy)]
struct Level {
    process_variance: f64,
}

impl Process<1> for Level {
    fn predict(&self, x: &Vector1<f64>) -> Vector1<f64> {
        *x
    }
    fn noise(&self, _: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(self.process_variance)
    }
}

impl Measurement<1, 1> for Level {
    fn predict(&self, x: &Vector1<f64>) -> Option<Vector1<f64>> {
        Some(*x)
    }
    fn noise(&self, _: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(1.0)
    }
}

fn updated<const N: usize>(
    belief: &mut Gaussian<N>,
    model: &impl Measurement<N, 1>,
    z: f64,
) -> Result<Update<1>, UpdateError> {
    let innovation = extended::update(belief, model, &Vector1::new(z))?;
    Ok(Update { innovation, log_evidence: innovation.log_likelihood() })
}

fn level(mean: f64, variance: f64) -> Gaussian<1> {
    Gaussian::new(Vector1::new(mean), Matrix1::new(variance))
}

fn density(y: f64, s: f64) -> f64 {
    (-0.5 * y * y / s).exp() / (std::f64::consts::TAU * s).sqrt()
}

/// One cycle of Bar-Shalom, Li and Kirubarajan 2001, equations 11.6.6-6 to 11.6.6-17, written out for two scalar modes.
#[test]
fn val_a_cycle_equals_the_textbooks() {
    let transition = Transition::new(&[&[0.95, 0.05], &[0.1, 0.9]]);
    let (quiet, lively) = (Level { process_variance: 0.1 }, Level { process_variance: 4.0 });
    let mut imm = Imm::new([(level(0.0, 1.0), 0.7), (level(2.0, 3.0), 0.3)]);
    imm.mix(&transition, |_, _, belief| *belief);
    imm.predict(|mode, belief| {
        extended::predict(belief, if mode == 0 { &quiet } else { &lively });
        Ok(())
    })
    .unwrap();
    let found = imm.update(|_, belief| updated(belief, &quiet, 2.5)).unwrap();

    let c = [0.7 * 0.95 + 0.3 * 0.1, 0.7 * 0.05 + 0.3 * 0.9];
    let second = [0.3 * 0.1 / c[0], 0.3 * 0.9 / c[1]];
    let mean: [f64; 2] = second.map(|share| share * 2.0);
    let spread = |i: usize| (1.0 - second[i]) * (1.0 + mean[i].powi(2)) + second[i] * (3.0 + (2.0 - mean[i]).powi(2));
    let predicted = [spread(0) + 0.1, spread(1) + 4.0];
    let likelihood = [0, 1].map(|i| density(2.5 - mean[i], predicted[i] + 1.0));
    let total = c[0] * likelihood[0] + c[1] * likelihood[1];
    for i in 0..2 {
        let gain = predicted[i] / (predicted[i] + 1.0);
        assert!((imm.probabilities()[i] - c[i] * likelihood[i] / total).abs() < 1e-12, "{i}");
        assert!((imm.beliefs()[i].mean[0] - (mean[i] + gain * (2.5 - mean[i]))).abs() < 1e-12, "{i}");
        assert!((imm.beliefs()[i].covariance[0] - (1.0 - gain) * predicted[i]).abs() < 1e-12, "{i}");
    }
    assert!((found.log_evidence - total.ln()).abs() < 1e-12);
    let innovation = c[0] * (2.5 - mean[0]) + c[1] * (2.5 - mean[1]);
    assert!((found.innovation.residual[0] - innovation).abs() < 1e-12);
}

#[test]
fn verif_identical_modes_equal_one_kalman_filter() {
    let model = Level { process_variance: 0.3 };
    let transition = Transition::from_sojourns(0.1, &[1.0, 2.0, 0.5], &[1.0, 1.0, 3.0]);
    let mut imm = Imm::new([0.2, 0.5, 0.3].map(|weight| (level(1.0, 2.0), weight)));
    let mut single = level(1.0, 2.0);
    for z in [0.3, 1.9, -0.4, 2.2] {
        extended::predict(&mut single, &model);
        let alone = updated(&mut single, &model, z).unwrap();
        imm.mix(&transition, |_, _, belief| *belief);
        imm.predict(|_, belief| {
            extended::predict(belief, &model);
            Ok(())
        })
        .unwrap();
        let together = imm.update(|_, belief| updated(belief, &model, z)).unwrap();
        assert!((imm.moments().mean - single.mean).norm() < 1e-12);
        assert!((imm.moments().covariance - single.covariance).norm() < 1e-12);
        assert!((together.log_evidence - alone.log_evidence).abs() < 1e-12);
    }
}

/// Position and velocity along a line, with the position measured.
struct Target {
    acceleration_variance: f64,
}

impl Process<2> for Target {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        vector![x[0] + x[1], x[1]]
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        let push = vector![0.5, 1.0];
        push * push.transpose() * self.acceleration_variance + Matrix2::identity() * 1e-9
    }
}

impl Measurement<2, 1> for Target {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(RowVector2::new(1.0, 0.0) * x)
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(1.0)
    }
}

/// Constant velocity with a manoeuvre of ten steps. The probability of the manoeuvre mode must rise and fall with it,
/// and the error must be below that of either filter alone.
#[test]
fn val_a_manoeuvre_is_detected_and_tracked() {
    let modes = [Target { acceleration_variance: 1e-4 }, Target { acceleration_variance: 4.0 }];
    let transition = Transition::new(&[&[0.97, 0.03], &[0.1, 0.9]]);
    let mut rng = Pcg64::seed_from_u64(7);
    let (mut squares, mut during, mut after) = ([0.0; 3], 0.0, 0.0);
    const RUNS: usize = 100;
    for _ in 0..RUNS {
        let start = Gaussian::new(vector![0.0, 1.0], matrix![1.0, 0.0; 0.0, 0.1]);
        let mut imm = Imm::new([(start, 0.9), (start, 0.1)]);
        let mut alone = [start; 2];
        let (mut x, mut v) = (0.0, 1.0);
        for k in 0..100 {
            let push = if (50..60).contains(&k) { 3.0 } else { 0.0 };
            (x, v) = (x + v + 0.5 * push, v + push);
            let z = x + rng.sample::<f64, _>(StandardNormal);
            imm.mix(&transition, |_, _, belief| *belief);
            imm.predict(|mode, belief| {
                extended::predict(belief, &modes[mode]);
                Ok(())
            })
            .unwrap();
            imm.update(|mode, belief| updated(belief, &modes[mode], z)).unwrap();
            for (belief, mode) in alone.iter_mut().zip(&modes) {
                extended::predict(belief, mode);
                updated(belief, mode, z).unwrap();
            }
            for (total, mean) in squares.iter_mut().zip([imm.moments().mean, alone[0].mean, alone[1].mean]) {
                *total += (mean[0] - x).powi(2);
            }
            match k {
                53..60 => during += imm.probabilities()[1] / 7.0 / RUNS as f64,
                75..100 => after += imm.probabilities()[1] / 25.0 / RUNS as f64,
                _ => {}
            }
        }
    }
    assert!(during > 0.8 && after < 0.2, "{during} {after}");
    assert!(squares[0] < 0.8 * squares[1].min(squares[2]), "{squares:?}");
}

#[test]
fn verif_a_belief_that_enters_a_mode_is_converted() {
    let transition = Transition::new(&[&[0.5, 0.5], &[0.0, 1.0]]);
    let mut imm = Imm::new([(level(1.0, 1.0), 1.0), (level(9.0, 1.0), 0.0)]);
    imm.mix(&transition, |from, to, belief| {
        assert_eq!((from, to), (0, 1));
        level(belief.mean[0] + 3.0, 5.0)
    });
    assert_eq!(imm.beliefs(), [level(1.0, 1.0), level(4.0, 5.0)]);
    assert_eq!(imm.probabilities(), [0.5, 0.5]);
}

#[test]
fn verif_modes_without_likelihood_get_probability_zero_unless_all_lack_it() {
    let mut modes = Modes::new([1.0, 3.0]);
    assert_eq!(modes.reweight(&[None, None]), None);
    assert_eq!(modes.probabilities(), [0.25, 0.75]);
    let total = modes.reweight(&[Some(0.5f64.ln()), None]).unwrap();
    assert!((total - 0.125f64.ln()).abs() < 1e-12);
    assert_eq!(modes.probabilities(), [1.0, 0.0]);
}

#[test]
fn verif_transitions_have_the_given_sojourn_times() {
    let mut modes = Modes::new([1.0, 0.0, 0.0]);
    modes.predict(&Transition::from_sojourns(0.5, &[2.0, 1.0, 1.0], &[9.0, 1.0, 3.0]));
    let left = 1.0 - (-0.25f64).exp();
    let expected = [1.0 - left, 0.25 * left, 0.75 * left];
    assert!(modes.probabilities().iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12));
}

#[test]
fn verif_hypotheses_of_a_bank_of_imms_merge_mode_by_mode() {
    let one = Imm::new([(level(0.0, 1.0), 0.5), (level(5.0, 1.0), 0.5)]);
    let other = Imm::new([(level(0.001, 1.0), 0.5), (level(5.001, 1.0), 0.5)]);
    let mut bank = Bank::<1, Imm<1>>::new([(one, 0.0), (other, 0.0)]);
    let before = bank.moments().unwrap();
    bank.merge(1e-3);
    let [merged] = bank.hypotheses() else { panic!("expected one hypothesis") };
    assert!((merged.belief.beliefs()[1].mean[0] - 5.0005).abs() < 1e-12);
    assert!((merged.belief.moments().mean - before.mean).norm() < 1e-12);
}

#[test]
#[should_panic(expected = "a transition matrix must be square")]
fn robust_a_transition_matrix_that_is_not_square_panics() {
    Transition::new(&[&[0.5, 0.5], &[1.0]]);
}

#[test]
fn robust_a_small_weight_beside_a_large_one_keeps_probabilities() {
    let weights = [1e9, 1e-9];
    let mut modes = Modes::new(weights);
    modes.predict(&Transition::from_sojourns(4e-3, &[1e3; 2], &weights));
    assert!(modes.probabilities().iter().all(|probability| probability.is_finite()));
    assert!((modes.probabilities().iter().sum::<f64>() - 1.0).abs() < 1e-12);
    // With a weight of zero beside it, a mode does not change.
    let mut alone = Modes::new([1.0, 0.0]);
    alone.predict(&Transition::from_sojourns(4e-3, &[1e3; 2], &[1.0, 0.0]));
    assert_eq!(alone.probabilities(), [1.0, 0.0]);
}
