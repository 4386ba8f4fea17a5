//! Every filter against the Kalman filter on a linear model.

use filters::bound::{self, Bound};
use filters::unscented::Spread;
use filters::{Gaussian, Measurement, ParticleSet, Process, extended, unscented};
use nalgebra::{Matrix1, Matrix2, RowVector2, SVector, Vector1, Vector2, matrix, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

const DT: f64 = 0.1;
const Q: f64 = 0.02;
const R: f64 = 0.3;

/// Constant velocity, position measured.
struct Cart;

fn transition() -> Matrix2<f64> {
    matrix![1.0, DT; 0.0, 1.0]
}

impl Process<2> for Cart {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        transition() * x
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        matrix![Q * DT.powi(3) / 3.0, Q * DT * DT / 2.0; Q * DT * DT / 2.0, Q * DT]
    }
}

impl Measurement<2, 1> for Cart {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(x[0]))
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(R)
    }
}

/// Textbook Kalman filter, independent of the code under test.
fn kalman(x: &mut Vector2<f64>, p: &mut Matrix2<f64>, z: f64) {
    let f = transition();
    *x = f * *x;
    *p = f * *p * f.transpose() + Process::noise(&Cart, x);
    let h = RowVector2::new(1.0, 0.0);
    let s = (h * *p * h.transpose())[0] + R;
    let k = *p * h.transpose() / s;
    *x += k * (z - x[0]);
    *p = (Matrix2::identity() - k * h) * *p;
}

fn readings(count: usize) -> Vec<f64> {
    let mut rng = Pcg64::seed_from_u64(7);
    (0..count).map(|i| 0.4 * i as f64 * DT + R.sqrt() * rng.sample::<f64, _>(StandardNormal)).collect()
}

fn start() -> Gaussian<2> {
    Gaussian::new(vector![0.0, 0.0], Matrix2::identity())
}

#[test]
fn val_extended_and_unscented_equal_the_kalman_filter() {
    let (mut x, mut p) = (start().mean, start().covariance);
    let (mut ekf, mut ukf) = (start(), start());
    for spread in [Spread { alpha: 1.0, beta: 2.0, kappa: 1.0 }, Spread { alpha: 0.1, beta: 2.0, kappa: 0.0 }] {
        for z in readings(200) {
            kalman(&mut x, &mut p, z);
            extended::predict(&mut ekf, &Cart);
            let first = extended::update(&mut ekf, &Cart, &Vector1::new(z)).unwrap();
            unscented::predict(&mut ukf, &Cart, &spread).unwrap();
            let second = unscented::update(&mut ukf, &Cart, &spread, &Vector1::new(z)).unwrap();
            for belief in [&ekf, &ukf] {
                assert!((belief.mean - x).norm() < 1e-9);
                assert!((belief.covariance - p).norm() < 1e-9);
            }
            assert!((first.nis - second.nis).abs() < 1e-7);
        }
    }
}

#[test]
fn val_particles_equal_the_kalman_filter_within_their_monte_carlo_error() {
    let (mut x, mut p) = (start().mean, start().covariance);
    let mut rng = Pcg64::seed_from_u64(3);
    let count = 20_000;
    let normal = |rng: &mut Pcg64| SVector::<f64, 2>::from_fn(|_, _| rng.sample(StandardNormal));
    let mut particles = ParticleSet::new((0..count).map(|_| normal(&mut rng)).collect());
    for z in readings(100) {
        kalman(&mut x, &mut p, z);
        particles.predict(&Cart, &mut rng);
        particles.update(&Cart, &Vector1::new(z)).unwrap();
        if particles.effective_size() < 0.5 * count as f64 {
            particles.resample(0.05, &mut rng);
        }
    }
    let moments = particles.moments();
    // Resampling correlates the particles, so the Monte-Carlo error is several times that of independent draws.
    let error = (p.diagonal() / count as f64).map(f64::sqrt) * 10.0;
    assert!((moments.mean - x).abs() < error, "{} against {x}", moments.mean);
    assert!((moments.covariance - p).norm() < 0.1 * p.norm());
}

#[test]
fn verif_innovations_are_chi_square_distributed_for_the_true_model() {
    let mut rng = Pcg64::seed_from_u64(11);
    let noise = Process::noise(&Cart, &Vector2::zeros()).cholesky().unwrap().l();
    let mut truth = vector![rng.sample(StandardNormal), rng.sample(StandardNormal)];
    let mut belief = start();
    let steps = 4000;
    let mut sum = 0.0;
    for _ in 0..steps {
        truth = transition() * truth + noise * vector![rng.sample(StandardNormal), rng.sample(StandardNormal)];
        extended::predict(&mut belief, &Cart);
        let z = truth[0] + R.sqrt() * rng.sample::<f64, _>(StandardNormal);
        sum += extended::update(&mut belief, &Cart, &Vector1::new(z)).unwrap().nis;
    }
    // The mean of n chi-square variables of one degree of freedom has the standard deviation sqrt(2 / n).
    let mean = sum / f64::from(steps);
    assert!((mean - 1.0).abs() < 4.0 * (2.0 / f64::from(steps)).sqrt(), "mean NIS {mean}");
}

#[test]
fn verif_fading_scales_the_covariance_of_every_belief() {
    let mut rng = Pcg64::seed_from_u64(5);
    let mut gaussian = start();
    gaussian.fade(1.5);
    assert_eq!(gaussian.covariance, Matrix2::identity() * 1.5);
    let mut particles = ParticleSet::new((0..500).map(|_| vector![rng.random::<f64>(), rng.random::<f64>()]).collect());
    let before = particles.moments();
    particles.fade(1.5);
    let after = particles.moments();
    assert!((after.mean - before.mean).norm() < 1e-12);
    assert!((after.covariance - before.covariance * 1.5).norm() < 1e-12);
}

#[test]
fn verif_resampling_preserves_mean_and_covariance() {
    let mut rng = Pcg64::seed_from_u64(9);
    let mut particles = ParticleSet::new((0..50_000).map(|i| vector![i as f64 / 5e4, rng.random::<f64>()]).collect());
    particles.update(&Cart, &Vector1::new(0.3)).unwrap();
    let before = particles.moments();
    particles.resample(0.3, &mut rng);
    let after = particles.moments();
    assert!((after.mean - before.mean).norm() < 0.01);
    assert!((after.covariance - before.covariance).norm() < 0.05 * before.covariance.norm());
    assert!((particles.weights().iter().sum::<f64>() - 1.0).abs() < 1e-12);
}

/// Recursion as published: `D22 - D21 (J + D11)^-1 D12` with `D11 = F' Q^-1 F`, `D12 = -F' Q^-1` and `D22 = Q^-1 + H' R^-1 H`
/// (Tichavsky et al. 1998).
#[test]
fn val_the_cramer_rao_bound_equals_the_published_recursion() {
    let x = vector![0.0, 0.0];
    let (f, q) = (transition(), Process::noise(&Cart, &x));
    let q_inverse = q.try_inverse().unwrap();
    let h = RowVector2::new(1.0, 0.0);
    let mut published = Matrix2::identity();
    let mut bound = Bound::new(&Matrix2::identity()).unwrap();
    for _ in 0..200 {
        let d11 = f.transpose() * q_inverse * f;
        let d12 = -f.transpose() * q_inverse;
        let d22 = q_inverse + h.transpose() * h / R;
        published = d22 - d12.transpose() * (published + d11).try_inverse().unwrap() * d12;
        bound.predict(&Cart, &x);
        bound.update(bound::information(&Cart, &x).unwrap());
        assert!((bound.information() - published).norm() < 1e-9 * published.norm());
    }
}
