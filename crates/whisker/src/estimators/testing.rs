//! Fixtures shared by the unit tests of estimators.

use std::sync::Arc;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::{Estimate, Knowledge, Runner, Sample, estimator};
use crate::elastica::{Circle, Elastica, Load, Touch};
use crate::frames::{Base, Pose, World};
use crate::rest::direction;
use crate::sensor::{self, Face, FitData};
use crate::{Curvature, Whisker};

/// A curved whisker, its left face calibrated by the elastica.
pub(crate) fn knowledge() -> Knowledge {
    knowledge_of(-6.0)
}

/// A whisker of this pre-curvature, its left face calibrated by the elastica and modelled by a polynomial.
pub(crate) fn knowledge_of(curvature_per_m: f64) -> Knowledge {
    knowledge_with(curvature_per_m, "polynomial")
}

/// As [`knowledge_of`], with this sensor model.
pub(crate) fn knowledge_with(curvature_per_m: f64, model: &str) -> Knowledge {
    let whisker =
        Whisker { damping_s: 0.0, ..Whisker::curved() }.with_curvature([Curvature::new(0.08, curvature_per_m)]);
    let elastica = Elastica::new(&whisker).unwrap();
    let lines: Vec<Vec<sensor::Sample>> = (0..24)
        .map(|i| {
            let arc_m = 0.03 + 0.002 * f64::from(i);
            let pressed = (0..24).map(|j| {
                let left_n = -8e-5 * f64::from(j) * (0.03 / arc_m).powi(2);
                let pressed = elastica.deflect(Load { arc_m, along_n: 0.0, left_n, couple_n_m: 0.0 }).unwrap();
                sensor::Sample { contact: pressed.point, reading_n_m: pressed.moment_n_m }
            });
            pressed.collect()
        })
        .collect();
    let material = FitData {
        whisker: &whisker,
        face: Face::Left,
        measured: &lines,
        reference: &lines,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    let row = sensor::model(model).unwrap();
    let face = sensor::fit(row, &(row.defaults)(), &material).unwrap().face;
    let rest = whisker.rest_shape();
    Knowledge {
        whisker,
        rest,
        faces: vec![Arc::new(face)],
        noise_sd_n_m: 1e-7,
        base_noise: Default::default(),
        rate_hz: 250.0,
        contact_prior: None,
    }
}

/// Quasi-static contacts with Coulomb friction of the coefficient `most` on a circle on the left, for successive poses of the
/// base; with the ratio of friction to normal force. Of the ratios within the cone, each is the one without slip or, if there
/// is none, the nearest.
pub(crate) fn swept(
    elastica: &Elastica,
    circle: &Circle,
    most: f64,
    bases: impl IntoIterator<Item = Pose<Base, World>>,
) -> Vec<(Touch, f64)> {
    let mut found: Vec<(Touch, f64)> = Vec::new();
    let mut last_yaw_rad = 0.0;
    for base in bases {
        let touch = |ratio| elastica.against_with_friction(circle, &base, Face::Left, ratio).unwrap().unwrap();
        let ratio = found.last().map_or(-most, |(last, _)| {
            let slip_m = |ratio| {
                let next = touch(ratio);
                let turned_rad = base.yaw_rad() + next.normal_rad - last_yaw_rad - last.normal_rad;
                circle.radius_m * turned_rad - (next.load.arc_m - last.load.arc_m)
            };
            // The slip increases with the ratio.
            let (mut low, mut high) = (-most, most);
            if slip_m(low) >= 0.0 {
                return low;
            }
            if slip_m(high) <= 0.0 {
                return high;
            }
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if slip_m(middle) < 0.0 { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        });
        last_yaw_rad = base.yaw_rad();
        found.push((touch(ratio), ratio));
    }
    found
}

/// Quasi-static contacts without friction on a circle on the left that stands freely, for successive poses of the base; with its
/// displacement. It moves against the force on the whisker by as much as keeps the force at the limit.
pub(crate) fn pushed(
    elastica: &Elastica,
    circle: &Circle,
    limit_n: f64,
    bases: impl IntoIterator<Item = Pose<Base, World>>,
) -> Vec<(Touch, f64)> {
    let mut center = circle.center;
    let push = |base: Pose<Base, World>| {
        let touch = |center| elastica.against(&Circle { center, ..*circle }, &base, Face::Left).unwrap().unwrap();
        let pressed = touch(center);
        if pressed.force_n > limit_n {
            let along = -direction(base.yaw_rad() + pressed.normal_rad);
            let (mut low_m, mut high_m) = (0.0, 1e-3);
            for _ in 0..30 {
                let middle_m = 0.5 * (low_m + high_m);
                let is_above = touch(center.shifted(along * middle_m)).force_n > limit_n;
                if is_above { low_m = middle_m } else { high_m = middle_m }
            }
            center = center.shifted(along * high_m);
        }
        (touch(center), center.distance(&circle.center))
    };
    bases.into_iter().map(push).collect()
}

/// Estimates of a registered estimator with its default settings along contacts on the left face, with noise of the sensor from
/// this seed. Each step has the pose of the base and the moment at the root.
pub(crate) fn followed(
    name: &str,
    knowledge: &Arc<Knowledge>,
    dt_s: f64,
    steps: impl IntoIterator<Item = (Pose<Base, World>, f64)>,
    seed: u64,
) -> Vec<Option<Estimate>> {
    let row = estimator(name).unwrap();
    let mut runner = Runner::new((row.build)(&(row.defaults)(), knowledge).unwrap(), knowledge.clone(), 1);
    let mut noise = Pcg64::seed_from_u64(seed);
    let mut last = None;
    let follow = |(base, moment_n_m): (Pose<Base, World>, f64)| {
        let drawn: f64 = StandardNormal.sample(&mut noise);
        let motion = last.replace(base).unwrap_or(base).then(&base.inverse());
        let reading_n_m = moment_n_m + knowledge.noise_sd_n_m * drawn;
        runner.step(&Sample { motion, dt_s, reading_n_m }, Some(Face::Left))
    };
    steps.into_iter().map(follow).collect()
}
