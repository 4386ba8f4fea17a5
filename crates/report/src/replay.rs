//! Interactive replay of one trial of each set: whisker, true and estimated contact, estimated outline and error over time.
//!
//! The page carries the numbers as whole micrometres in JSON; `replay_plane.js` draws the scene and `replay.js` plays it.

use anyhow::{Context, Result};
use maud::{Markup, PreEscaped, html};
use nalgebra::{Matrix2, SymmetricEigen};
use serde::Serialize;
use testbed::metrics::error;
use testbed::results::{EstimateRow, RECOMMENDED, RunEstimator, RunSet};
use testbed::statistics::CHI2_2_95;
use whisker::Whisker;
use whisker::elastica::{Elastica, Load};
use whisker::estimators::MethodClass;
use whisker::frames::{Base, Point, Pose, World};

use super::run_data::{RunData, smallest};
use super::style::plain;

/// Most instants of a trial that are kept.
const FRAMES: usize = 200;

/// Points along the whisker.
const WIRE_POINTS: usize = 12;

/// Whole micrometres, or tenths of a degree.
pub(crate) type Whole = i64;

/// A point in World, in micrometres.
type Spot = [Whole; 2];

/// One trial of the replay.
#[derive(Serialize)]
struct Trial {
    name: String,
    trace: String,
    t_s: Vec<f64>,
    base_um: Vec<Spot>,
    /// The whisker according to the elastica, from root to tip. `None` if the elastica has no equilibrium.
    wire_um: Vec<Option<Vec<Spot>>>,
    /// True contacts.
    truth_um: Vec<Option<Spot>>,
    outline_um: Vec<Spot>,
    runs: Vec<Replayed>,
}

/// One estimator on the trial.
#[derive(Serialize)]
struct Replayed {
    name: String,
    contact_um: Vec<Option<Spot>>,
    /// Semi-axes of the 95 % ellipse in micrometres, and the direction of the first in tenths of a degree.
    ellipse: Vec<Option<[Whole; 3]>>,
    surface_um: Vec<Option<Spot>>,
    error_um: Vec<Option<Whole>>,
}

/// The content of the section. `None` if the run keeps no estimates.
///
/// # Errors
/// When a file of the run is damaged.
pub(crate) fn section(data: &RunData) -> Result<Option<Markup>> {
    let mut trials = Vec::new();
    for set in &data.run.sets {
        trials.extend(trial(data, set)?);
    }
    if trials.is_empty() {
        return Ok(None);
    }
    Ok(Some(html! {
        p {
            "One trial of each set: that with the median error. Left: the whisker (black) on its base (square), "
            "deflected according to the quasi-static elastica, and the object. Right: detail around the true contact. "
            span.key.truth {} " true contact, "
            span.key.estimate {} " estimated contact with its 95 % ellipse, "
            span.key.found {} " estimated outline so far. "
            "Below: contact error; in grey that of the other estimators of the list."
        }
        (player(&trials, "Whisker and object, seen from above", include_str!("replay_plane.js"))?)
    }))
}

/// The player of some trials: choices, two views, controls and the error over time. `stage` is the script that draws the views.
///
/// # Errors
/// When the trials do not serialise.
pub(crate) fn player(trials: &impl Serialize, overview: &str, stage: &str) -> Result<Markup> {
    // Only `<` could end the script element.
    let json = serde_json::to_string(trials).context("replays")?.replace('<', "\\u003c");
    Ok(html! {
        div.replay {
            div.choices {
                label { "Trial " select data-part="trial" {} }
                label { "Estimator " select data-part="estimator" {} }
                label { "Detail " select data-part="zoom" {
                    option value="20" { "20 mm wide" }
                    option value="5" selected { "5 mm wide" }
                    option value="1" { "1 mm wide" }
                } }
            }
            div.views {
                svg data-part="overview" role="img" aria-label=(overview) {}
                svg data-part="closeup" role="img" aria-label="Detail around the contact" {}
            }
            div.controls {
                button type="button" data-part="play" { "Play" }
                input type="range" data-part="time" min="0" value="0" step="1" aria-label="Time";
                output data-part="now" {}
            }
            svg data-part="error" role="img" aria-label="Contact error over time, with a cursor" {}
            script type="application/json" data-part="trials" { (PreEscaped(json)) }
        }
        noscript { p.absent { "The replay needs JavaScript." } }
        script { (PreEscaped(stage)) }
        script { (PreEscaped(include_str!("replay.js"))) }
    })
}

fn trial(data: &RunData, set: &RunSet) -> Result<Option<Trial>> {
    let estimators = leading(data, set);
    let typical = estimators.first().and_then(|best| data.typical_trial(set, &best.name, &error::RMSE));
    let Some(trace) = typical.map(|trial| &trial.head.trace).or(set.traces.first()) else { return Ok(None) };
    let mut replayed = Vec::new();
    for estimator in estimators {
        let Some(rows) = data.estimates(trace, &estimator.name)? else { continue };
        let every = rows.len().div_ceil(FRAMES);
        replayed.push((estimator.label(), rows.into_iter().step_by(every).collect::<Vec<EstimateRow>>()));
    }
    let Some((_, rows)) = replayed.first() else { return Ok(None) };
    let whisker = data.run.whiskers.iter().find(|whisker| whisker.name == set.whisker);
    let wire = whisker.map(Wire::new).transpose()?;
    let outline = data.outline(trace)?.unwrap_or_default();
    Ok(Some(Trial {
        name: format!("{}, {} whisker", plain(&set.group), set.whisker),
        trace: trace.clone(),
        t_s: rows.iter().map(|row| row.t_s).collect(),
        base_um: rows.iter().map(|row| spot(row.base_x_m, row.base_y_m)).collect(),
        wire_um: rows.iter().map(|row| wire.as_ref()?.spots(row)).collect(),
        truth_um: rows.iter().map(|row| Some(spot(row.truth_contact_x_m?, row.truth_contact_y_m?))).collect(),
        outline_um: outline.iter().map(|&(x_m, y_m)| spot(x_m, y_m)).collect(),
        runs: replayed.iter().map(|(name, rows)| Replayed::new(name, rows)).collect(),
    }))
}

/// The estimators in the replay of a set: the recommended one first, the most accurate filter, the most accurate with
/// hindsight and of the baselines, and the programs given by `--exec`.
fn leading<'a>(data: &'a RunData, set: &RunSet) -> Vec<&'a RunEstimator> {
    let all = &data.run.estimators;
    let best = |class: MethodClass| {
        let names = all.iter().filter(|estimator| estimator.class == class).map(|estimator| estimator.name.as_str());
        smallest(names, |name| data.summary_of(set, name)?.get(&error::RMSE))
    };
    let [filter, hindsight, baseline] =
        [MethodClass::Recursive, MethodClass::Hindsight, MethodClass::Baseline].map(best);
    let chosen = [Some(RECOMMENDED), filter, hindsight, baseline];
    let mut leading: Vec<&RunEstimator> =
        chosen.iter().flatten().filter_map(|name| all.iter().find(|estimator| estimator.name == *name)).collect();
    leading.extend(all.iter().filter(|estimator| estimator.is_program()));
    if leading.is_empty() {
        leading.extend(all.first());
    }
    let names: Vec<&str> = leading.iter().map(|estimator| estimator.name.as_str()).collect();
    let is_first = |index: usize| !names[..index].contains(&names[index]);
    let firsts = leading.iter().enumerate().filter(|(index, _)| is_first(*index));
    firsts.map(|(_, estimator)| *estimator).collect()
}

/// A whisker with its elastica.
struct Wire {
    elastica: Elastica,
    length_m: f64,
}

impl Wire {
    fn new(whisker: &Whisker) -> Result<Self> {
        let elastica = Elastica::new(whisker).context("run.json")?;
        Ok(Self { elastica, length_m: whisker.length_m })
    }

    /// The whisker through the true contact, or through the estimated one if that is unknown; undeflected while it is
    /// free. `None` if the contact is out of its reach, as in a contact of the tip.
    fn spots(&self, row: &EstimateRow) -> Option<Vec<Spot>> {
        let base: Pose<Base, World> = Pose::new(row.base_x_m, row.base_y_m, row.base_yaw_rad);
        let truth = row.truth_contact_x_m.zip(row.truth_contact_y_m);
        let load = match truth.or(row.contact_x_m.zip(row.contact_y_m)) {
            None => Load { arc_m: self.length_m, along_n: 0.0, left_n: 0.0, couple_n_m: 0.0 },
            Some((x_m, y_m)) => self.elastica.at_point(base.inverse().apply(Point::new(x_m, y_m))).ok()?.load,
        };
        let line = self.elastica.line(load).ok()?;
        let arcs = (0..WIRE_POINTS).map(|i| self.length_m * i as f64 / (WIRE_POINTS - 1) as f64);
        let points = arcs.map(|arc_m| base.apply(line.at(arc_m).0));
        Some(points.map(|point| spot(point.x(), point.y())).collect())
    }
}

impl Replayed {
    fn new(name: &str, rows: &[EstimateRow]) -> Self {
        Self {
            name: name.into(),
            contact_um: rows.iter().map(|row| Some(spot(row.contact_x_m?, row.contact_y_m?))).collect(),
            ellipse: rows.iter().map(ellipse).collect(),
            surface_um: rows.iter().map(|row| Some(spot(row.surface_x_m?, row.surface_y_m?))).collect(),
            error_um: rows.iter().map(|row| Some(micrometres(row.contact_error_m()?))).collect(),
        }
    }
}

fn ellipse(row: &EstimateRow) -> Option<[Whole; 3]> {
    let covariance = Matrix2::new(row.cov_xx_m2?, row.cov_xy_m2?, row.cov_xy_m2?, row.cov_yy_m2?);
    let SymmetricEigen { eigenvectors, eigenvalues } = covariance.symmetric_eigen();
    let [first, second] = [eigenvalues[0], eigenvalues[1]].map(|variance| (CHI2_2_95 * variance.max(0.0)).sqrt());
    let degrees = eigenvectors[(1, 0)].atan2(eigenvectors[(0, 0)]).to_degrees();
    Some([micrometres(first), micrometres(second), (10.0 * degrees).round() as Whole])
}

fn spot(x_m: f64, y_m: f64) -> Spot {
    [micrometres(x_m), micrometres(y_m)]
}

pub(crate) fn micrometres(value_m: f64) -> Whole {
    (1e6 * value_m).round() as Whole
}

#[cfg(test)]
mod tests {

    use super::*;

    fn row(contact: Option<(f64, f64)>) -> EstimateRow {
        EstimateRow {
            base_x_m: 0.1,
            base_yaw_rad: std::f64::consts::FRAC_PI_2,
            cov_xx_m2: Some(4e-8),
            cov_xy_m2: Some(0.0),
            cov_yy_m2: Some(1e-8),
            truth_contact_x_m: contact.map(|contact| contact.0),
            truth_contact_y_m: contact.map(|contact| contact.1),
            ..EstimateRow::default()
        }
    }

    #[test]
    fn verif_the_wire_runs_from_the_base_through_the_contact() {
        let wire = Wire::new(&Whisker { damping_s: 0.0, ..Whisker::straight() }).unwrap();
        let free = wire.spots(&row(None)).unwrap();
        assert_eq!((free[0], free[WIRE_POINTS - 1]), ([100_000, 0], [100_000, 80_000]));
        let bent = wire.spots(&row(Some((0.11, 0.05)))).unwrap();
        let nearest = bent.windows(2).map(|ends| {
            let [[ax, ay], [bx, by]] = [ends[0], ends[1]].map(|spot| spot.map(|um| um as f64));
            let share = ((110e3 - ax) * (bx - ax) + (50e3 - ay) * (by - ay)) / ((bx - ax).powi(2) + (by - ay).powi(2));
            let share = share.clamp(0.0, 1.0);
            (110e3 - ax - share * (bx - ax)).hypot(50e3 - ay - share * (by - ay))
        });
        assert!(nearest.fold(f64::INFINITY, f64::min) < 100.0, "chords of the drawn whisker pass within 0.1 mm");
        assert!(wire.spots(&row(Some((0.3, 0.05)))).is_none(), "out of reach");
    }

    #[test]
    fn verif_the_ellipse_holds_95_percent() {
        let [first, second, tenths] = ellipse(&row(None)).unwrap();
        assert_eq!((first.max(second), first.min(second)), (490, 245));
        assert_eq!(tenths % 900, 0);
    }
}
