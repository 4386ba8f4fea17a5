//! Particle filter with readings far more precise than the spacing of the particles.

use filters::particle::Renewal;
use filters::{Gaussian, Measurement, ParticleSet, Process, UpdateError, extended};
use nalgebra::{Matrix1, Matrix2, RowVector2, SVector, Vector1, Vector2, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

const SD: f64 = 1e-3;

/// Linear measurement of a position at rest.
struct Linear(RowVector2<f64>);

impl Measurement<2, 1> for Linear {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(self.0 * x)
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(SD * SD)
    }
}

fn standard_normal(rng: &mut Pcg64) -> ParticleSet<2> {
    ParticleSet::new((0..2000).map(|_| SVector::from_fn(|_, _| rng.sample(StandardNormal))).collect())
}

/// A state at rest with noise of this covariance.
struct Noisy(Matrix2<f64>);

impl Process<2> for Noisy {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        *x
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        self.0
    }
}

#[test]
fn verif_noise_with_a_singular_covariance_is_added() {
    for covariance in
        [Matrix2::new(4.0, 0.0, 0.0, 0.0), Matrix2::new(0.0, 0.0, 0.0, 4.0), Matrix2::new(4.0, 2.0, 2.0, 1.0)]
    {
        let mut rng = Pcg64::seed_from_u64(5);
        let mut particles = ParticleSet::new((0..20_000).map(|_| Vector2::zeros()).collect());
        particles.predict(&Noisy(covariance), &mut rng);
        let found = particles.moments().covariance;
        assert!((found - covariance).norm() < 0.05 * covariance.norm(), "{found} {covariance}");
    }
}

#[test]
fn verif_drawn_particles_have_the_moments_of_the_mixture() {
    let mut rng = Pcg64::seed_from_u64(6);
    // The second Gaussian has no extent along the second axis.
    let parts = [
        (Gaussian::new(vector![0.0, 0.0], Matrix2::identity()), 3.0),
        (Gaussian::new(vector![4.0, 8.0], Matrix2::new(1.0, 0.0, 0.0, 0.0)), 1.0),
    ];
    let found = ParticleSet::drawn(&parts, 40_000, &mut rng).unwrap().moments();
    assert!((found.mean - vector![1.0, 2.0]).norm() < 0.03, "{}", found.mean);
    let expected = Matrix2::new(4.0, 6.0, 6.0, 12.75);
    assert!((found.covariance - expected).norm() < 0.02 * expected.norm(), "{}", found.covariance);
    assert!(ParticleSet::<2>::drawn(&[], 10, &mut rng).is_none());
}

#[test]
fn val_renewed_particles_equal_the_kalman_filter_when_reweighting_alone_degenerates() {
    let mut rng = Pcg64::seed_from_u64(3);
    let renewal = Renewal { share: 0.5, bandwidth: 0.3, gate_sds: 1e3 };
    let mut kalman = Gaussian::new(vector![0.0, 0.0], Matrix2::identity());
    let (mut renewed, mut reweighted) = (standard_normal(&mut rng), standard_normal(&mut rng));
    for i in 0..40 {
        let angle = 0.3 * f64::from(i);
        let linear = Linear(RowVector2::new(angle.cos(), angle.sin()));
        let z = Vector1::new((linear.0 * vector![0.7, -0.4])[0] + SD * (2.3 * f64::from(i)).sin());
        extended::update(&mut kalman, &linear, &z).unwrap();
        renewed.update_or_renew(&linear, &z, &renewal, &mut rng).unwrap();
        reweighted.update(&linear, &z).unwrap();
    }
    let sd = kalman.covariance.diagonal().map(f64::sqrt);
    let apart = (renewed.mean() - kalman.mean).component_div(&sd);
    assert!(apart.norm() < 0.5, "{apart}");
    let spread = renewed.moments().covariance.diagonal().component_div(&kalman.covariance.diagonal());
    assert!(spread.min() > 0.7 && spread.max() < 1.4, "{spread}");
    assert!(renewed.effective_size() > 500.0 && reweighted.effective_size() < 5.0);
}

#[test]
fn robust_an_outlier_hardly_moves_the_particles() {
    let mut rng = Pcg64::seed_from_u64(4);
    let renewal = Renewal { share: 0.5, bandwidth: 0.3, gate_sds: 5.0 };
    let mut particles = standard_normal(&mut rng);
    let before = particles.moments();
    particles.update_or_renew(&Linear(RowVector2::new(1.0, 0.0)), &Vector1::new(1e4), &renewal, &mut rng).unwrap();
    let after = particles.moments();
    assert!((after.mean - before.mean).norm() < 0.1 && (after.covariance - before.covariance).norm() < 0.1);
}

/// Direct measurement of a position, undefined but at given places.
struct AtPlaces(Vec<f64>);

impl Measurement<1, 1> for AtPlaces {
    fn predict(&self, x: &Vector1<f64>) -> Option<Vector1<f64>> {
        self.0.iter().any(|place| (place - x[0]).abs() < 1e-12).then_some(*x)
    }
    fn jacobian(&self, x: &Vector1<f64>) -> Option<Matrix1<f64>> {
        self.predict(x).map(|_| Matrix1::new(1.0))
    }
    fn noise(&self, _: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(SD * SD)
    }
}

#[test]
fn robust_a_renewal_without_a_prediction_at_any_new_particle_leaves_the_set_unchanged() {
    let renewal = Renewal { share: 0.9, bandwidth: 0.6, gate_sds: 1e6 };
    let particles: Vec<f64> = (0..40).map(|i| (1.7 * f64::from(i)).sin()).collect();
    let mean = particles.iter().sum::<f64>() / particles.len() as f64;
    let centres = particles.iter().map(|particle| mean + 0.8 * (particle - mean));
    let model = AtPlaces(particles.iter().copied().chain(centres).collect());
    let mut set = ParticleSet::new(particles.iter().map(|particle| Vector1::new(*particle)).collect());
    let (before, weights, mut rng) = (set.clone(), set.weights().to_vec(), Pcg64::seed_from_u64(7));
    let refused = set.update_or_renew(&model, &Vector1::new(0.5), &renewal, &mut rng);
    assert_eq!(refused, Err(UpdateError::NoPrediction));
    assert_eq!((set.particles(), set.weights()), (before.particles(), &weights[..]));
    assert_eq!(set.effective_size(), before.effective_size());
    // The next reading finds the set as if there had been none.
    let mut untouched = before;
    let everywhere = StateDependentNoise;
    assert_eq!(set.update(&everywhere, &Vector1::new(0.5)), untouched.update(&everywhere, &Vector1::new(0.5)));
    assert_eq!(set.weights(), untouched.weights());
}

/// Direct measurement of a position whose noise grows with the position.
struct StateDependentNoise;

impl StateDependentNoise {
    fn sd(x: f64) -> f64 {
        0.1 * x.exp()
    }
}

impl Measurement<1, 1> for StateDependentNoise {
    fn predict(&self, x: &Vector1<f64>) -> Option<Vector1<f64>> {
        Some(*x)
    }
    fn noise(&self, x: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(Self::sd(x[0]).powi(2))
    }
}

#[test]
fn val_state_dependent_noise_shifts_the_particles_as_it_shifts_the_exact_posterior() {
    const READINGS: i32 = 50;
    let log_posterior = |x: f64| {
        -0.5 * x * x
            - f64::from(READINGS) * (0.5 * (x / StateDependentNoise::sd(x)).powi(2) + StateDependentNoise::sd(x).ln())
    };
    let grid: Vec<f64> = (-2000..=2000).map(|i| 1e-4 * f64::from(i)).collect();
    let weights: Vec<f64> = grid.iter().map(|&x| (log_posterior(x) - log_posterior(0.0)).exp()).collect();
    let moment =
        |power| grid.iter().zip(&weights).map(|(x, w)| x.powi(power) * w).sum::<f64>() / weights.iter().sum::<f64>();
    let (mean, sd) = (moment(1), (moment(2) - moment(1).powi(2)).sqrt());

    let mut rng = Pcg64::seed_from_u64(5);
    let renewal = Renewal { share: 0.5, bandwidth: 0.3, gate_sds: 1e3 };
    let mut particles =
        ParticleSet::new((0..4000).map(|_| SVector::from_fn(|_, _| rng.sample(StandardNormal))).collect());
    for _ in 0..READINGS {
        particles.update_or_renew(&StateDependentNoise, &Vector1::new(0.0), &renewal, &mut rng).unwrap();
    }
    assert!(mean < -0.5 * sd && (particles.mean()[0] - mean).abs() < 0.15 * sd, "{} {mean} {sd}", particles.mean());
}
