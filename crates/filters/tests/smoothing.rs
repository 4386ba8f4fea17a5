//! Smoother and batch solution against dense least squares.

use filters::batch::{self, Instant};
use filters::iterated::Search;
use filters::smoother::{Step, smooth};
use filters::{Gaussian, Measurement, Process, extended};
use nalgebra::{DMatrix, DVector, Matrix1, Matrix2, SMatrix, Vector1, Vector2, matrix, vector};

const DT: f64 = 0.1;
const STEPS: usize = 40;

/// Constant velocity, with a cubic measurement of the position.
#[derive(Clone, Copy)]
struct Cart {
    /// Cubic coefficient of the measurement; zero for a linear model.
    bend: f64,
}

impl Process<2> for Cart {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        vector![x[0] + DT * x[1], x[1]]
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        matrix![1e-3, 2e-4; 2e-4, 2e-3]
    }
}

impl Measurement<2, 1> for Cart {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(x[0] + self.bend * x[0].powi(3)))
    }
    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(0.04)
    }
}

fn prior() -> Gaussian<2> {
    Gaussian::new(vector![0.3, -0.2], Matrix2::identity() * 0.5)
}

fn readings(cart: Cart) -> Vec<f64> {
    (0..STEPS)
        .map(|k| {
            let x = 0.5 + 0.3 * k as f64 * DT;
            x + cart.bend * x.powi(3) + 0.2 * (3.7 * k as f64).sin()
        })
        .collect()
}

fn instants(cart: Cart) -> Vec<Instant<Cart, Cart, 1>> {
    let instant = |z| Instant { process: cart, measurement: cart, reading: Vector1::new(z) };
    readings(cart).into_iter().map(instant).collect()
}

fn smoothed(cart: Cart) -> Vec<Gaussian<2>> {
    let mut belief = prior();
    let mut steps = Vec::new();
    for z in readings(cart) {
        let jacobian = Process::jacobian(&cart, &belief.mean);
        extended::predict(&mut belief, &cart);
        let predicted = belief;
        extended::update(&mut belief, &cart, &Vector1::new(z)).unwrap();
        steps.push(Step { jacobian, predicted, filtered: belief });
    }
    smooth(&steps)
}

/// All states by dense linear least squares on whitened residuals: solution and covariance.
fn dense(cart: Cart) -> (DVector<f64>, DMatrix<f64>) {
    let f = Process::jacobian(&cart, &Vector2::zeros());
    let whiten = |p: Matrix2<f64>| p.cholesky().unwrap().l().try_inverse().unwrap();
    let first = whiten(f * prior().covariance * f.transpose() + Process::noise(&cart, &Vector2::zeros()));
    let later = whiten(Process::noise(&cart, &Vector2::zeros()));
    let mut a = DMatrix::zeros(3 * STEPS, 2 * STEPS);
    let mut b = DVector::zeros(3 * STEPS);
    for (k, z) in readings(cart).into_iter().enumerate() {
        let w = if k == 0 { first } else { later };
        a.view_mut((3 * k, 2 * k), (2, 2)).copy_from(&w);
        if k == 0 {
            b.rows_mut(0, 2).copy_from(&(w * f * prior().mean));
        } else {
            a.view_mut((3 * k, 2 * k - 2), (2, 2)).copy_from(&(-w * f));
        }
        a[(3 * k + 2, 2 * k)] = 5.0;
        b[3 * k + 2] = 5.0 * z;
    }
    let covariance = (a.transpose() * &a).try_inverse().unwrap();
    (&covariance * a.transpose() * b, covariance)
}

#[test]
fn val_smoother_and_batch_equal_dense_least_squares_on_a_linear_model() {
    let cart = Cart { bend: 0.0 };
    let (states, covariance) = dense(cart);
    let search = Search { iterations: 10, tolerance_sds: 1e-9 };
    let guess = vec![Vector2::zeros(); STEPS];
    let solved = batch::solve(&prior(), &instants(cart), guess, &search).unwrap();
    for found in [smoothed(cart), solved] {
        for (k, belief) in found.iter().enumerate() {
            assert!((belief.mean - states.fixed_rows::<2>(2 * k)).norm() < 1e-7, "{k}");
            let expected: SMatrix<f64, 2, 2> = covariance.fixed_view::<2, 2>(2 * k, 2 * k).into();
            assert!((belief.covariance - expected).norm() < 1e-8, "{k}");
        }
    }
}

#[test]
fn val_batch_solutions_from_different_starts_agree_on_a_nonlinear_model() {
    let cart = Cart { bend: 0.8 };
    let search = Search { iterations: 50, tolerance_sds: 1e-9 };
    let solve = |guess| batch::solve(&prior(), &instants(cart), guess, &search).unwrap();
    let means = |beliefs: &[Gaussian<2>]| beliefs.iter().map(|belief| belief.mean).collect::<Vec<_>>();
    let near = solve(means(&smoothed(cart)));
    let far = solve(vec![vector![1.5, 0.0]; STEPS]);
    for (near, far) in near.iter().zip(&far) {
        assert!((near.mean - far.mean).norm() < 1e-6);
    }
}

#[test]
fn verif_smoothed_covariances_do_not_exceed_filtered_ones() {
    let cart = Cart { bend: 0.0 };
    let mut belief = prior();
    for (z, smoothed) in readings(cart).into_iter().zip(smoothed(cart)) {
        extended::predict(&mut belief, &cart);
        extended::update(&mut belief, &cart, &Vector1::new(z)).unwrap();
        assert!((belief.covariance - smoothed.covariance).symmetric_eigenvalues().min() > -1e-12);
    }
}
