//! Without noise, with readings from the fitted sensor model itself and a contact that truly rests, a filter has nothing left to be wrong
//! about: its error must vanish.

use std::sync::Arc;

use anyhow::Context as _;
use trace::{CalibrationFile, Role, Trace};
use whisker::estimators::{self, Estimator, Knowledge, Sample};
use whisker::frames::{Point, World};
use whisker::sensor::CalibratedFace;
use whisker::touch::TouchConfig;

use super::{Claim, Context, FILTERS, Relation, WHISKERS};
use crate::replay::{replay, samples};
use crate::statistics::quantile;

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for whisker in WHISKERS {
        for filter in FILTERS {
            // A particle filter is left with the Monte-Carlo error of its cloud, which must not exceed the spread that it states.
            let is_particle = filter == "particle";
            claims.push(Claim {
                id: format!("noiseless_{whisker}_{filter}"),
                claim: format!(
                    "pin at rest, readings from the model itself, no noise, {whisker} whisker, {filter}: final error, median"
                ),
                unit: if is_particle { "stated sd" } else { "um" },
                relation: Relation::AtMost,
                bound: 1.0,
                measure: Box::new(move |context| {
                    let finals = finals(context, whisker, filter)?;
                    let errors: Vec<f64> = finals
                        .iter()
                        .map(|end| if is_particle { end.error_m / end.stated_sd_m } else { end.error_m * 1e6 })
                        .collect();
                    Ok(quantile(&errors, 0.5))
                }),
            });
        }
    }
    claims
}

/// How a replay ended.
struct Final {
    error_m: f64,
    /// Root of the trace of the stated covariance.
    stated_sd_m: f64,
}

fn finals(context: &Context, whisker: &str, filter: &str) -> anyhow::Result<Vec<Final>> {
    let path = context.dataset.calibrations().join(format!("{whisker}.json"));
    let calibration = CalibrationFile::read(&path)?;
    let faces = calibration.calibrated(&path)?;
    let mut finals = Vec::new();
    for trace in context.dataset.read(Role::Trial)? {
        let sidecar = &trace.sidecar;
        if sidecar.whisker.name != whisker || sidecar.group != "pin" {
            continue;
        }
        let face = faces.iter().find(|face| face.face == sidecar.face).context("the pin's face is calibrated")?;
        let knowledge = Arc::new(Knowledge {
            whisker: sidecar.whisker.clone(),
            rest: sidecar.whisker.rest_shape(),
            faces: vec![face.clone()],
            noise_sd_n_m: 0.0,
        });
        let Some((contact, samples)) = ideal(&trace, &knowledge.faces[0]) else { continue };
        let row = estimators::estimator(filter).context("a registered estimator")?;
        let method = (row.build)(&(row.defaults)(), &knowledge)?;
        let mut estimator = Estimator::new(method, knowledge.clone(), TouchConfig::default(), 1);
        let estimates = replay(&mut estimator, &samples).estimates;
        let last = estimates.last().copied().flatten().context("an ideal contact is followed to the end")?;
        let base = trace.recording.instants[samples.len() - 1].base;
        finals.push(Final {
            error_m: base.apply(last.contact).distance(&contact),
            stated_sd_m: last.covariance_m2.context("a filter states its covariance")?.trace().sqrt(),
        });
    }
    Ok(finals)
}

/// The trace's base motion past a contact that rests where the true one was in the middle of the touch, with the model's readings while that
/// contact is calibrated and zero before; nothing where it leaves the calibrated region later.
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
