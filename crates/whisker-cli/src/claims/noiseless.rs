//! Noise-free readings of the fitted sensor model itself and a static contact: the error of a filter must vanish.
//!
//! Filters with a motion model are configured for a static contact. Gaussian filters use fading memory, so that
//! information from the start, where the linearisation was poor, decays. The readings are those of a whisker without
//! inertia: a filter that corrects readings for it is configured not to. The estimates of a particle filter scatter
//! over its seeds by the Monte-Carlo error but must be unbiased; it is configured without process noise and without
//! fading.
//!
//! On a curved whisker the belief follows a curved line. Its mean, which is the estimate, lies off this line, towards the
//! centre of curvature. This displacement is no error of the filter and is subtracted.
//!
//! Only filters with these settings are included. `imm` models the sliding due to the thickness of the wire, `outline`
//! assumes a curve with a radius everywhere, and `recommended` keeps the defaults of its candidates: for them the
//! readings are not ideal.

use anyhow::{Context as _, ensure};
use nalgebra::Vector2;
use rayon::prelude::*;
use serde_json::{Value, json};
use testbed::front_end::FRONT_ENDS;
use testbed::replay::{detect_contact, knowledge, replay, runner, samples};
use testbed::settings::merged;
use testbed::statistics::quantile;
use trace::{CalibrationFile, Role, Trace};
use whisker::Foot;
use whisker::estimators::{self, Estimate, Sample};
use whisker::events::TouchConfig;
use whisker::frames::{Point, World};
use whisker::sensor::CalibratedFace;

use super::{Claim, Context, WHISKERS, filters};

/// Number of seeds of a particle filter per trace.
const SEEDS: u64 = 8;

/// Largest mean offset over the seeds relative to their scatter that is compatible with no bias: four standard
/// deviations of the mean.
const MOST_OFFSET: f64 = 1.4;

/// Least number of traces on which the contact stays within the calibrated domain.
const LEAST_TRACES: usize = 8;

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for whisker in WHISKERS {
        for filter in filters().filter(|filter| has_setting(filter, "motion")) {
            let is_random = has_setting(filter, "particles");
            let score = if is_random {
                "mean final offset over its seeds, relative to their scatter, worst trace"
            } else {
                "final error without the displacement of the mean of a bent belief, worst trace"
            };
            let (bound, unit) = if is_random { (MOST_OFFSET, "Monte-Carlo sd") } else { (1.0, "um") };
            claims.push(Claim::at_most(
                format!("noiseless_{whisker}_{filter}"),
                format!(
                    "pin at rest, readings of the model itself, no noise, no inertia, {whisker} whisker, {filter}: {score}"
                ),
                bound,
                unit,
                move |context| {
                    let (seeds, at_rest) = if is_random {
                        let motion = json!({"kind": "resting", "wander_m_sqrt_s": 1e-9});
                        (SEEDS, json!({"fading": 1.0, "motion": motion}))
                    } else {
                        let mut settings = json!({"fading": 1.004, "motion": {"kind": "resting"}});
                        if has_setting(filter, "corrected") {
                            settings["corrected"] = json!(false);
                        }
                        (1, settings)
                    };
                    let offsets = final_offsets(context, whisker, filter, &at_rest, seeds)?;
                    let score = |of_trace: &Vec<Vector2<f64>>| {
                        let mean = of_trace.iter().sum::<Vector2<f64>>() / of_trace.len() as f64;
                        let scatter = of_trace.iter().map(|offset| (offset - mean).norm_squared()).sum::<f64>();
                        let sd = (scatter / (of_trace.len() as f64 - 1.0)).sqrt();
                        if is_random { mean.norm() / sd } else { mean.norm() * 1e6 }
                    };
                    Ok(quantile(&offsets.iter().map(score).collect::<Vec<_>>(), 1.0))
                },
            ));
        }
    }
    claims
}

fn has_setting(filter: &str, key: &str) -> bool {
    estimators::estimator(filter).is_some_and(|row| (row.defaults)().get(key).is_some())
}

/// Offsets of the last estimate from the truth (m), by trace and seed.
fn final_offsets(
    context: &Context,
    whisker: &str,
    filter: &str,
    settings: &Value,
    seeds: u64,
) -> anyhow::Result<Vec<Vec<Vector2<f64>>>> {
    let path = context.dataset().calibrations(FRONT_ENDS[0].name).join(format!("{whisker}.json"));
    let faces = CalibrationFile::read(&path)?.calibrated(&path, None)?;
    let row = estimators::estimator(filter).context("a registered estimator")?;
    let config = merged((row.defaults)(), settings)?;
    let mut ideals = Vec::new();
    for trace in context.dataset().read(Role::Trial)? {
        if trace.sidecar.whisker.name == whisker && trace.sidecar.group == "pin" {
            let face = faces.iter().find(|face| face.face == trace.sidecar.face);
            let face = face.context("the pin's face is calibrated")?;
            ideals.extend(ideal(&trace, face).map(|(contact, samples)| (trace, face, contact, samples)));
        }
    }
    let found = ideals.len();
    ensure!(found >= LEAST_TRACES, "{found} pins stay within the calibrated domain, expected at least {LEAST_TRACES}");
    ideals
        .par_iter()
        .map(|(trace, face, contact, samples)| {
            let sidecar = &trace.sidecar;
            let knowledge = knowledge(sidecar, &faces, 0.0);
            let mut samples = samples.clone();
            let touched = detect_contact(TouchConfig::default(), &knowledge, &mut samples);
            let last_base = trace.recording.instants[samples.len() - 1].base;
            let offset = |seed| {
                let mut runner = runner(row, &config, &knowledge, &sidecar.name, seed)?;
                let estimates = replay(&mut runner, &samples, &touched).estimates;
                let last = estimates.last().copied().flatten().context("an ideal contact is followed to the end")?;
                Ok(last_base.apply(last.contact.shifted(-off_the_wire(&last, face))).vector() - contact.vector())
            };
            (1..=seeds).map(offset).collect()
        })
        .collect()
}

/// Displacement (m) in Base of the mean of a belief that follows the curved wire, to second order: with the covariance `P`, the
/// wire's curvature `k`, tangent `t` and left normal `n`, and the contact at `l` to the left of it,
/// `(n t'P t / 2 - t t'P n) k / (1 - k l)`. Zero without a covariance.
fn off_the_wire(estimate: &Estimate, face: &CalibratedFace) -> Vector2<f64> {
    let covariance_m2 = estimate.covariance_m2.unwrap_or_default();
    let Foot { arc_m, left_m } = face.rest.foot(estimate.contact);
    let (sin, cos) = face.rest.tangent_rad(arc_m).sin_cos();
    let (tangent, normal) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
    let (along_m2, mixed_m2) = (tangent.dot(&(covariance_m2 * tangent)), tangent.dot(&(covariance_m2 * normal)));
    let curvature_per_m = face.rest.curvature_per_m(arc_m);
    (normal * (0.5 * along_m2) - tangent * mixed_m2) * (curvature_per_m / (1.0 - curvature_per_m * left_m))
}

/// The base motion of the trace past a static contact at the true contact in the middle of the touch, with readings of
/// the model while that contact lies in the calibrated domain and zero before. `None` if the contact leaves the domain
/// later.
fn ideal(trace: &Trace, face: &CalibratedFace) -> Option<(Point<World>, Vec<Sample>)> {
    let contacts: Vec<Point<World>> = trace.truth.instants.iter().filter_map(|truth| truth.contact).collect();
    let contact = *contacts.get(contacts.len() / 2)?;
    let mut touched = false;
    let mut readings = Vec::new();
    for instant in &trace.recording.instants {
        match face.predict(instant.base.inverse().apply(contact)) {
            Some(expected) => {
                touched = true;
                readings.push(expected.reading_n_m);
            }
            None if touched => return None,
            None => readings.push(0.0),
        }
    }
    Some((contact, samples(&trace.recording, &readings)))
}
