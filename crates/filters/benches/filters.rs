//! Time of the operations of a particle filter with a thousand particles of two components and models of negligible cost.

use divan::{Bencher, black_box};
use filters::{Measurement, ParticleSet, Process, StateArray};
use nalgebra::{Matrix1, Matrix2, SVector, Vector1, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

const PARTICLES: usize = 1000;

fn main() {
    divan::main();
}

/// Random walk.
struct RandomWalk;

impl Process<2> for RandomWalk {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        *x
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * 1e-9
    }

    fn predict_each(&self, _: &mut StateArray<2>) {}
}

/// Measurement of the first component.
struct First;

impl Measurement<2, 1> for First {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(x[0]))
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(0.1)
    }

    fn predict_each(&self, states: &StateArray<2>, expected: &mut StateArray<1>) {
        expected.columns_mut()[0].copy_from_slice(states.column(0));
    }

    fn constant_noise(&self) -> Option<Matrix1<f64>> {
        Some(Matrix1::new(0.1))
    }
}

fn particles() -> (ParticleSet<2>, Pcg64) {
    let mut rng = Pcg64::seed_from_u64(1);
    let draw = |_| SVector::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
    (ParticleSet::new((0..PARTICLES).map(draw).collect()), rng)
}

#[divan::bench]
fn predict(bencher: Bencher) {
    let (mut particles, mut rng) = particles();
    bencher.bench_local(|| particles.predict(&RandomWalk, &mut rng));
}

#[divan::bench]
fn update(bencher: Bencher) {
    let (particles, _) = particles();
    bencher
        .with_inputs(|| particles.clone())
        .bench_local_refs(|particles| particles.update(&First, &Vector1::new(0.1)));
}

#[divan::bench]
fn moments(bencher: Bencher) {
    let (particles, _) = particles();
    bencher.bench_local(|| black_box(&particles).moments());
}

#[divan::bench]
fn resample(bencher: Bencher) {
    let (mut particles, mut rng) = particles();
    particles.update(&First, &Vector1::new(0.1)).expect("a positive variance");
    bencher.with_inputs(|| particles.clone()).bench_local_refs(|particles| particles.resample(0.0, &mut rng));
}
