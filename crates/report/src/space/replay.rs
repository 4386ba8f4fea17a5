//! Interactive replay of one trial of each group: whisker, solid, true and estimated contact, and error over time.

use std::cmp::Ordering;

use anyhow::{Context, Result};
use maud::{Markup, html};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use testbed::results::RECOMMENDED;
use testbed::space::SpatialEstimateRow;
use testbed::space::solid::Solid;
use testbed::space::wire::SpatialWire;
use testbed::statistics::CHI2_3_95;

use super::Data;
use crate::replay::{Whole, micrometres, player};
use crate::style::plain;

/// Most instants of a trial that are kept.
const FRAMES: usize = 160;

/// Points along the whisker.
const WIRE_POINTS: usize = 24;

/// Number of estimators of a trial: the recommended one, and the most accurate ones.
const ESTIMATORS: usize = 4;

/// A point in World, in micrometres.
type Spot = [Whole; 3];

/// One trial of the replay.
#[derive(Serialize)]
struct Trial {
    name: String,
    trace: String,
    t_s: Vec<f64>,
    base_um: Vec<Spot>,
    /// The whisker according to the rod, from root to tip. `None` if the rod has no equilibrium.
    wire_um: Vec<Option<Vec<Spot>>>,
    /// True contacts.
    truth_um: Vec<Option<Spot>>,
    /// Curves of the solid.
    solid_um: Vec<Vec<Spot>>,
    runs: Vec<Replayed>,
}

/// One estimator on the trial.
#[derive(Serialize)]
struct Replayed {
    name: String,
    contact_um: Vec<Option<Spot>>,
    /// The matrix of the 95 % ellipsoid: xx, xy, xz, yy, yz, zz in square micrometres.
    spread_um2: Vec<Option<[Whole; 6]>>,
    error_um: Vec<Option<Whole>>,
}

/// The content of the section. `None` if no trial was scored.
///
/// # Errors
/// When a file of the run is damaged.
pub(super) fn section(data: &Data) -> Result<Option<Markup>> {
    let mut trials = Vec::new();
    for whisker in data.whiskers() {
        for group in data.groups() {
            trials.extend(trial(data, group, whisker)?);
        }
    }
    if trials.is_empty() {
        return Ok(None);
    }
    Ok(Some(html! {
        p {
            "One trial of each group: that with the median error of the first estimator. Left: the whisker (black) on its base "
            "(square), in equilibrium according to the Kirchhoff rod, and the solid (grey). Right: detail around the true contact. "
            "Drag a view to turn both. "
            span.key.truth {} " true contact, "
            span.key.estimate {} " estimated contact with its 95 % ellipsoid, "
            span.key.found {} " estimated contacts so far. "
            "Below: contact error; in grey that of the other estimators of the list."
        }
        (player(&trials, "Whisker and solid", include_str!("replay_space.js"))?)
    }))
}

fn trial(data: &Data, group: &str, whisker: &str) -> Result<Option<Trial>> {
    let mut scores: Vec<_> =
        data.scores(group, whisker).filter_map(|row| Some((row.rmse_m?, row.estimator.as_str()))).collect();
    let rank = |(rmse_m, name): &(f64, &str)| (*name != RECOMMENDED, *rmse_m);
    scores.sort_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(Ordering::Equal));
    let Some(&(_, best)) = scores.first() else { return Ok(None) };
    let Some(trial) = data.typical(group, whisker, best) else { return Ok(None) };
    let mut replayed = Vec::new();
    for (_, estimator) in scores.into_iter().take(ESTIMATORS) {
        let rows = data.estimates(&trial.trace, estimator)?;
        let every = rows.len().div_ceil(FRAMES).max(1);
        replayed.push((estimator, rows.into_iter().step_by(every).collect::<Vec<_>>()));
    }
    let Some((_, rows)) = replayed.first() else { return Ok(None) };
    let wire = SpatialWire::new(&trial.whisker).context("space_run.json")?;
    // The true contact, or the estimated one if that is unknown.
    let shape = |row: &SpatialEstimateRow| {
        let points = wire.points_m(row, row.truth_contact_m().or(row.contact_m()), WIRE_POINTS)?;
        Some(points.into_iter().map(spot).collect())
    };
    let curves = Solid::of_scene(&trial.solid).map_or_else(Vec::new, |solid| solid.curves_m());
    Ok(Some(Trial {
        name: format!("{}, {whisker} whisker", plain(group)),
        trace: trial.trace.clone(),
        t_s: rows.iter().map(|row| row.t_s).collect(),
        base_um: rows.iter().map(|row| spot(row.base_m())).collect(),
        wire_um: rows.iter().map(shape).collect(),
        truth_um: rows.iter().map(|row| row.truth_contact_m().map(spot)).collect(),
        solid_um: curves.into_iter().map(|curve| curve.into_iter().map(spot).collect()).collect(),
        runs: replayed.iter().map(|(name, rows)| Replayed::new(name, rows)).collect(),
    }))
}

impl Replayed {
    fn new(name: &str, rows: &[SpatialEstimateRow]) -> Self {
        Self {
            name: name.into(),
            contact_um: rows.iter().map(|row| row.contact_m().map(spot)).collect(),
            spread_um2: rows.iter().map(|row| row.covariance_m2().map(spread)).collect(),
            error_um: rows.iter().map(|row| Some(micrometres(row.contact_error_m()?))).collect(),
        }
    }
}

/// Covariance of which the ellipsoid of one standard deviation contains the contact with a probability of 95 %.
fn spread(covariance_m2: Matrix3<f64>) -> [Whole; 6] {
    let of = covariance_m2 * CHI2_3_95;
    [of.m11, of.m12, of.m13, of.m22, of.m23, of.m33].map(|value_m2| (1e12 * value_m2).round() as Whole)
}

fn spot(point_m: Vector3<f64>) -> Spot {
    [point_m.x, point_m.y, point_m.z].map(micrometres)
}
