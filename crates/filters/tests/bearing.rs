//! Nonlinear model: Jacobians, convergence on noise-free readings, and failed updates.

use filters::unscented::Spread;
use filters::{Gaussian, Measurement, Process, UpdateError, extended, unscented};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2, vector};
use std::f64::consts::{PI, TAU};

/// Landmark at rest whose bearing is measured by a moving observer. The bearing is undefined within 0.1 of the observer.
struct Bearing {
    observer: Vector2<f64>,
    variance: f64,
}

impl Process<2> for Bearing {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        *x
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::zeros()
    }
}

impl Measurement<2, 1> for Bearing {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        let sight = x - self.observer;
        (sight.norm() > 0.1).then(|| Vector1::new(sight.y.atan2(sight.x)))
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(self.variance)
    }
    fn residual(&self, z: &Vector1<f64>, expected: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new((z[0] - expected[0] + PI).rem_euclid(TAU) - PI)
    }
}

const SPREAD: Spread = Spread { alpha: 1.0, beta: 2.0, kappa: 1.0 };

#[test]
fn val_the_numeric_jacobian_equals_the_analytic_one() {
    let model = Bearing { observer: vector![0.2, -0.4], variance: 1e-4 };
    let x = vector![1.5, 0.7];
    let sight = x - model.observer;
    let analytic = RowVector2::new(-sight.y, sight.x) / sight.norm_squared();
    assert!((Measurement::jacobian(&model, &x).unwrap() - analytic).norm() < 1e-9);
    assert!((Process::jacobian(&model, &x) - Matrix2::identity()).norm() < 1e-9);
}

#[test]
fn verif_the_error_converges_to_zero_on_noise_free_readings() {
    // The landmark is behind the observer, where the bearing wraps.
    let landmark = vector![-2.0, 0.05];
    let start = Gaussian::new(vector![-1.7, 0.3], Matrix2::identity() * 0.1);
    let (mut ekf, mut ukf) = (start, start);
    for i in 0..400 {
        let angle = f64::from(i) * 0.05;
        let model = Bearing { observer: vector![angle.cos(), angle.sin()] * 0.5, variance: 1e-6 };
        let z = Measurement::predict(&model, &landmark).unwrap();
        // Fading memory discounts the first updates, which were linearised far from the landmark.
        ekf.fade(1.05);
        ukf.fade(1.05);
        extended::predict(&mut ekf, &model);
        extended::update(&mut ekf, &model, &z).unwrap();
        unscented::predict(&mut ukf, &model, &SPREAD).unwrap();
        unscented::update(&mut ukf, &model, &SPREAD, &z).unwrap();
    }
    assert!((ekf.mean - landmark).norm() < 1e-4, "{}", ekf.mean);
    assert!((ukf.mean - landmark).norm() < 1e-4, "{}", ukf.mean);
}

#[test]
fn robust_an_update_without_prediction_leaves_the_belief_unchanged() {
    let model = Bearing { observer: vector![1.0, 1.0], variance: 1e-4 };
    let mut belief = Gaussian::new(vector![1.0, 1.0], Matrix2::identity());
    let before = belief;
    let z = Vector1::new(0.0);
    assert_eq!(extended::update(&mut belief, &model, &z), Err(UpdateError::NoPrediction));
    assert_eq!(unscented::update(&mut belief, &model, &SPREAD, &z), Err(UpdateError::NoPrediction));
    assert_eq!(belief, before);
}
