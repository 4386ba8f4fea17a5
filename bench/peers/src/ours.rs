//! Filters of this project.

use filters::{Gaussian, ParticleSet, extended, unscented};
use nalgebra::{Vector1, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use crate::filter::{Estimate, Estimates};
use crate::problem::{Motion, Problem};

pub(crate) fn extended(problem: &Problem) -> Estimates {
    let mut belief = problem.start();
    let steps = problem.steps.iter().map(|step| {
        extended::predict(&mut belief, &Motion { step, wander_m2: problem.wander_m2 });
        extended::update(&mut belief, &problem, &Vector1::new(step.reading_n_m)).expect("a positive variance");
        estimate(&belief)
    });
    steps.collect()
}

pub(crate) fn unscented(problem: &Problem) -> Estimates {
    let (mut belief, spread) = (problem.start(), problem.spread());
    let steps = problem.steps.iter().map(|step| {
        let moving = Motion { step, wander_m2: problem.wander_m2 };
        unscented::predict(&mut belief, &moving, &spread).expect("a positive definite covariance");
        let z = Vector1::new(step.reading_n_m);
        unscented::update(&mut belief, &problem, &spread, &z).expect("a positive variance");
        estimate(&belief)
    });
    steps.collect()
}

pub(crate) fn particle(problem: &Problem, seed: u64) -> Estimates {
    let mut rng = Pcg64::seed_from_u64(seed);
    let start_sd_m = problem.start_m2.sqrt();
    let draw = |_| problem.start_m + Vector2::from_fn(|_, _| start_sd_m * rng.sample::<f64, _>(StandardNormal));
    let mut particles = ParticleSet::new((0..problem.particles).map(draw).collect());
    let fewest = problem.resample_share * problem.particles as f64;
    let steps = problem.steps.iter().map(|step| {
        particles.predict(&Motion { step, wander_m2: problem.wander_m2 }, &mut rng);
        particles.update(&problem, &Vector1::new(step.reading_n_m)).expect("a positive variance");
        let estimate = estimate(&particles.moments());
        if particles.effective_size() < fewest {
            particles.resample(0.0, &mut rng);
        }
        estimate
    });
    steps.collect()
}

fn estimate(belief: &Gaussian<2>) -> Estimate {
    Estimate::of(&belief.mean, &belief.covariance)
}
