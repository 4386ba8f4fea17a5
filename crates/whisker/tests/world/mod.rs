//! A world with an exact sensor model, for tests and benchmarks: a straight whisker pressed from the left; the reading
//! is that of a polynomial fitted to a stiffness that decreases along the whisker, and the contact rests in the world
//! while the base moves.

use std::sync::Arc;

use serde_json::Value;
use whisker::Whisker;
use whisker::estimators::{Estimator, EstimatorRow, Knowledge, Runner, Sample};
use whisker::events::TouchConfig;
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::{self, CalibratedFace, Face};

/// Sampling rate (Hz).
pub(crate) const RATE_HZ: f64 = 250.0;

fn straight() -> Whisker {
    Whisker { damping_s: 0.0, ..Whisker::straight().named("exam") }
}

/// A left face calibrated with a registered sensor model: moment of a small deflection on the compliant root.
pub(crate) fn face(model: &str) -> CalibratedFace {
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
    let row = sensor::model(model).unwrap();
    let material = sensor::FitData {
        whisker: &whisker,
        face: Face::Left,
        measured: &traces,
        reference: &traces,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    sensor::fit(row, &(row.defaults)(), &material).unwrap().face
}

/// The whisker with that face, modelled by the polynomial.
pub(crate) fn knowledge(noise_sd_n_m: f64) -> Arc<Knowledge> {
    let whisker = straight();
    Arc::new(Knowledge {
        rest: whisker.rest_shape(),
        whisker,
        faces: vec![Arc::new(face("polynomial"))],
        noise_sd_n_m,
        base_noise: Default::default(),
        rate_hz: RATE_HZ,
        contact_prior: None,
    })
}

/// Pose of the base: at rest and free for 0.2 s, then moving into contact and about.
pub(crate) fn base(t_s: f64) -> Pose<Base, World> {
    let touch = ((t_s - 0.2) / 0.3).clamp(0.0, 1.0);
    let roam = ((t_s - 0.5) / 0.5).clamp(0.0, 1.0);
    let x = 3e-3 * roam * (5.0 * t_s).sin();
    let y = 8e-3 * touch * touch * (3.0 - 2.0 * touch) - 1e-3 + 2.5e-3 * roam * (7.0 * t_s).sin();
    Pose::new(x, y, 0.04 * roam * (4.0 * t_s).sin())
}

pub(crate) fn contact() -> Point<World> {
    Point::new(0.05, 0.0)
}

/// Samples of the world over `duration_s`, without noise, at the instants selected by `keep`.
pub(crate) fn samples(knowledge: &Knowledge, duration_s: f64, keep: impl Fn(usize) -> bool) -> Vec<(f64, Sample)> {
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

/// A registered estimator with its default settings.
pub(crate) fn estimator(row: &EstimatorRow, knowledge: &Arc<Knowledge>, seed: u64) -> Estimator {
    configured(row, &(row.defaults)(), knowledge, seed)
}

/// A registered estimator with these settings.
pub(crate) fn configured(row: &EstimatorRow, settings: &Value, knowledge: &Arc<Knowledge>, seed: u64) -> Estimator {
    let method = (row.build)(settings, knowledge).unwrap_or_else(|error| panic!("{}: {error}", row.name));
    Estimator::new(Runner::new(method, knowledge.clone(), seed), TouchConfig::default())
}
