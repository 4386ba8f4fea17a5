//! Gaussian-sum filter, iterated filter and robust updates.

use filters::iterated::{self, Search};
use filters::robust::{self, InflatedNoise};
use filters::{Bank, Gaussian, Innovation, Measurement, Update, UpdateError, extended};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2, matrix, vector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const SEARCH: Search = Search { iterations: 20, tolerance_sds: 1e-9 };

/// Linear measurement of a position.
struct Linear {
    row: RowVector2<f64>,
    variance: f64,
}

impl Measurement<2, 1> for Linear {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(self.row * x)
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(self.variance)
    }
}

/// Measurement of the squared distance from the origin.
struct Squared;

impl Measurement<2, 1> for Squared {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(x.norm_squared()))
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(1e-2)
    }
}

fn with_likelihood(innovation: Innovation<1>) -> Update<1> {
    Update { innovation, log_evidence: innovation.log_likelihood() }
}

fn readings() -> impl Iterator<Item = (Linear, f64)> {
    (0..30).map(|i| {
        let angle = 0.4 * f64::from(i);
        (Linear { row: RowVector2::new(angle.cos(), angle.sin()), variance: 0.05 }, 0.3 * (1.7 * f64::from(i)).sin())
    })
}

#[test]
fn val_a_bank_of_one_and_the_iterated_filter_equal_the_kalman_filter_on_a_linear_model() {
    let mut kalman = Gaussian::new(vector![1.0, -1.0], Matrix2::identity());
    let mut iterated = kalman;
    let mut bank = Bank::new([(kalman, 0.0)]);
    for (linear, z) in readings() {
        let z = Vector1::new(z);
        let expected = extended::update(&mut kalman, &linear, &z).unwrap();
        let found = iterated::update(&mut iterated, &linear, &SEARCH, &z).unwrap();
        let of_bank = bank.update(|belief| extended::update(belief, &linear, &z).map(with_likelihood)).unwrap();
        for (belief, innovation) in [(iterated, found), (bank.moments().unwrap(), of_bank)] {
            assert!((belief.mean - kalman.mean).norm() < 1e-9);
            assert!((belief.covariance - kalman.covariance).norm() < 1e-9);
            assert!((innovation.nis - expected.nis).abs() < 1e-9);
        }
    }
}

#[test]
fn val_a_bank_of_a_split_prior_equals_the_kalman_filter() {
    // Two hypotheses with the same belief, whose weights stay equal.
    let start = Gaussian::new(vector![1.0, -1.0], Matrix2::identity());
    let (mut kalman, mut bank) = (start, Bank::new([(start, 3.0), (start, 3.0)]));
    for (linear, z) in readings() {
        let z = Vector1::new(z);
        extended::update(&mut kalman, &linear, &z).unwrap();
        bank.update(|belief| extended::update(belief, &linear, &z).map(with_likelihood)).unwrap();
    }
    assert_eq!(bank.hypotheses().len(), 2);
    bank.merge(1e-9);
    assert_eq!(bank.hypotheses().len(), 1);
    let moments = bank.moments().unwrap();
    assert!((moments.mean - kalman.mean).norm() < 1e-9 && (moments.covariance - kalman.covariance).norm() < 1e-9);
}

#[test]
fn verif_the_true_hypothesis_becomes_the_most_probable_and_survives_pruning() {
    let at = |x: f64| (Gaussian::new(vector![x, 0.0], Matrix2::identity() * 0.1), 0.0);
    let mut bank = Bank::new([at(-4.0), at(0.0), at(4.0)]);
    for _ in 0..10 {
        let linear = Linear { row: RowVector2::new(1.0, 0.0), variance: 1.0 };
        bank.update(|belief| extended::update(belief, &linear, &Vector1::new(4.2)).map(with_likelihood)).unwrap();
        bank.prune(1e-3);
    }
    assert_eq!(bank.hypotheses().len(), 1);
    assert!((bank.hypotheses()[0].weight() - 1.0).abs() < 1e-12);
    assert!((bank.most_probable().unwrap().belief.mean[0] - 4.1).abs() < 0.1);
}

#[test]
fn verif_merging_preserves_mean_and_covariance() {
    let part = |x: f64, y: f64, s: f64| Gaussian::new(vector![x, y], Matrix2::new(s, 0.1, 0.1, 1.0));
    let mut bank = Bank::new([(part(0.0, 0.0, 1.0), 0.0), (part(1.0, 0.5, 2.0), -1.0), (part(-1.0, 2.0, 0.5), -0.3)]);
    let before = bank.moments().unwrap();
    bank.merge(f64::INFINITY);
    assert_eq!(bank.hypotheses().len(), 1);
    let after = bank.moments().unwrap();
    assert!((after.mean - before.mean).norm() < 1e-12 && (after.covariance - before.covariance).norm() < 1e-12);
}

/// Merging compares bounds of the losses and keeps those that have not changed; the sequence is that of the least losses.
#[test]
fn val_pairs_are_merged_in_the_order_of_least_loss() {
    const MOST: f64 = 0.05;
    let mut random = Pcg64::seed_from_u64(1);
    let mut merged = 0;
    for count in [2, 3, 10, 40] {
        let mut part = || {
            let mean = Vector2::from_fn(|_, _| random.random_range(-3.0..3.0));
            let root = Matrix2::from_fn(|_, _| random.random_range(-1.0..1.0));
            (Gaussian::new(mean, root * root.transpose() + Matrix2::identity() * 0.05), random.random_range(-6.0..0.0))
        };
        let mut bank = Bank::new((0..count).map(|_| part()));
        let mut expected: Vec<_> = bank.hypotheses().iter().map(|one| (one.belief, one.weight())).collect();
        let width = |(belief, weight): &(Gaussian<2>, f64)| weight * belief.covariance.determinant().ln();
        let joined = |one: &(Gaussian<2>, f64), other: &(Gaussian<2>, f64)| {
            (Gaussian::of_mixture([*one, *other]).unwrap(), one.1 + other.1)
        };
        loop {
            let pairs = (0..expected.len()).flat_map(|i| (i + 1..expected.len()).map(move |j| (i, j)));
            let loss = |(i, j): (usize, usize)| {
                let (one, other) = (&expected[i], &expected[j]);
                0.5 * (width(&joined(one, other)) - width(one) - width(other))
            };
            let least = pairs.map(|pair| (pair, loss(pair))).min_by(|a, b| a.1.total_cmp(&b.1));
            let Some(((i, j), _)) = least.filter(|(_, loss)| *loss < MOST) else { break };
            let other = expected.swap_remove(j);
            expected[i] = joined(&expected[i], &other);
            merged += 1;
        }
        bank.merge(MOST);
        assert_eq!(bank.hypotheses().len(), expected.len());
        for (found, (belief, weight)) in bank.hypotheses().iter().zip(&expected) {
            assert!((found.weight() - weight).abs() < 1e-12 && (found.belief.mean - belief.mean).norm() < 1e-9);
        }
    }
    assert!(merged > 20, "{merged}");
}

#[test]
fn robust_a_hypothesis_without_prediction_is_dropped_unless_it_is_the_last() {
    let start = Gaussian::new(vector![1.0, -1.0], Matrix2::identity());
    let other = Gaussian::new(vector![2.0, -1.0], Matrix2::identity());
    let mut bank = Bank::new([(start, 0.0), (other, 0.0)]);
    let linear = Linear { row: RowVector2::new(1.0, 0.0), variance: 1.0 };
    let known = |belief: &mut Gaussian<2>| {
        if belief.mean[0] > 1.5 {
            return Err(UpdateError::NoPrediction);
        }
        extended::update(belief, &linear, &Vector1::new(0.0)).map(with_likelihood)
    };
    bank.update(known).unwrap();
    assert_eq!(bank.hypotheses().len(), 1);
    let before = bank.clone();
    let refused = bank.update(|_| Err::<Update<1>, _>(UpdateError::NoPrediction));
    assert_eq!(refused, Err(UpdateError::NoPrediction));
    assert_eq!(bank.moments(), before.moments());
    bank.predict(|_| Err(UpdateError::NotPositiveDefinite));
    assert_eq!(bank.moments(), None);
}

#[test]
fn robust_a_failed_update_leaves_the_bank_unchanged() {
    let at = |x: f64| Gaussian::new(vector![x, -1.0], Matrix2::identity());
    let linear = Linear { row: RowVector2::new(1.0, 0.0), variance: 1.0 };
    let update = |belief: &mut Gaussian<2>| extended::update(belief, &linear, &Vector1::new(0.0)).map(with_likelihood);
    let state = |bank: &Bank<2>| bank.hypotheses().to_vec();

    // The only hypothesis that can be updated has a weight that underflows.
    let mut bank = Bank::new([(at(1.0), 0.0), (at(2.0), -1e4)]);
    let before = state(&bank);
    let only_improbable = |belief: &mut Gaussian<2>| {
        if belief.mean[0] < 1.5 { Err(UpdateError::NotPositiveDefinite) } else { update(belief) }
    };
    assert_eq!(bank.update(only_improbable), Err(UpdateError::NotPositiveDefinite));
    assert_eq!(state(&bank), before);

    // Innovations whose mixture is not positive definite, of beliefs that have changed.
    let mut bank = Bank::new([(at(1.0), 0.0), (at(2.0), 0.0)]);
    let before = state(&bank);
    let negative = |belief: &mut Gaussian<2>| {
        let mut found = update(belief)?;
        found.innovation.covariance[0] = -1.0;
        Ok(found)
    };
    assert_eq!(bank.update(negative), Err(UpdateError::NoPrediction));
    assert_eq!(state(&bank), before);

    // Beliefs that are not finite.
    let not_finite = |belief: &mut Gaussian<2>| {
        let found = update(belief)?;
        belief.mean[0] = f64::NAN;
        Ok(found)
    };
    assert_eq!(bank.update(not_finite), Err(UpdateError::NoPrediction));
    assert_eq!(state(&bank), before);
    assert!(bank.update(update).is_ok() && state(&bank) != before);
}

#[test]
fn val_the_iterated_update_finds_the_maximum_a_posteriori_state() {
    let prior = Gaussian::new(vector![0.6, 0.2], Matrix2::new(0.5, 0.1, 0.1, 0.3));
    let z = Vector1::new(4.0);
    let mut belief = prior;
    iterated::update(&mut belief, &Squared, &SEARCH, &z).unwrap();
    let inverse = prior.covariance.try_inverse().unwrap();
    let cost = |x: Vector2<f64>| {
        let (residual, apart) = (4.0 - x.norm_squared(), x - prior.mean);
        residual * residual / 1e-2 + apart.dot(&(inverse * apart))
    };
    // No nearby state has a higher posterior density.
    for i in 0..100 {
        let angle = f64::from(i) * 0.0628;
        assert!(cost(belief.mean) <= cost(belief.mean + vector![angle.cos(), angle.sin()] * 1e-3));
    }
}

#[test]
fn verif_the_robust_update_is_continuous_at_the_gate_and_bounds_the_influence_of_an_outlier() {
    let prior = Gaussian::new(vector![0.0, 0.0], Matrix2::identity());
    let linear = Linear { row: RowVector2::new(1.0, 0.0), variance: 0.25 };
    let moved = |z: f64| {
        let mut belief = prior;
        let update = |belief: &mut Gaussian<2>, model: &InflatedNoise<'_, Linear>, z: &Vector1<f64>| {
            extended::update(belief, model, z)
        };
        let updated = robust::update(&mut belief, &linear, 3.0, &Vector1::new(z), update).unwrap();
        // The innovation is the one with the nominal noise.
        assert!((updated.innovation.nis - z * z / 1.25).abs() < 1e-12);
        (belief.mean[0], updated.log_evidence)
    };
    let gate = 3.0 * 1.25_f64.sqrt();
    let (below, above) = (moved(gate - 1e-9), moved(gate + 1e-9));
    assert!((below.0 - above.0).abs() < 1e-8 && (below.1 - above.1).abs() < 1e-8);
    assert!((moved(1.0).0 - 1.0 / 1.25).abs() < 1e-12);
    assert!(moved(1e3).0 < 0.01 && moved(1e3).1 < moved(10.0).1);
}

/// Position in the plane with independent noise on both coordinates.
struct Plane;

impl Measurement<2, 2> for Plane {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector2<f64>> {
        Some(*x)
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::from_diagonal(&vector![0.5, 2.0])
    }
}

#[test]
fn verif_the_robust_update_of_a_vector_is_plain_within_the_gate_and_at_the_gate_beyond() {
    let prior = Gaussian::new(vector![1.0, -2.0], matrix![1.0, 0.3; 0.3, 0.8]);
    let update = |belief: &mut Gaussian<2>, reading: &InflatedNoise<'_, Plane>, z: &Vector2<f64>| {
        extended::update(belief, reading, z)
    };
    let (mut plain, mut gated) = (prior, prior);
    let near = vector![1.5, -1.0];
    extended::update(&mut plain, &Plane, &near).unwrap();
    robust::update_vector(&mut gated, &Plane, 3.0, &near, update).unwrap();
    assert_eq!(plain, gated);

    let mut moved = Vec::new();
    for far in [10.0, 100.0, 1000.0] {
        let mut belief = prior;
        let z = prior.mean + vector![0.6, -0.8] * far;
        let updated = robust::update_vector(&mut belief, &Plane, 3.0, &z, update).unwrap();
        assert!(updated.innovation.nis > 9.0);
        // With the inflated noise the reading lies at three standard deviations.
        let inflated = (updated.log_evidence + (2.0 * std::f64::consts::PI).ln()) * -2.0;
        assert!(inflated > 9.0, "{inflated}");
        moved.push((belief.mean - prior.mean).norm());
    }
    assert!(moved[0] > moved[1] && moved[1] > moved[2], "{moved:?}");
}
