//! Interactive replay of one trial of each group: whisker, solid, true and estimated contact, and error over time.

use std::cmp::Ordering;

use anyhow::{Context, Result};
use maud::{Markup, html};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use testbed::results::RECOMMENDED;
use testbed::space::SpatialEstimateRow;
use testbed::space::run::SweptSolid;
use testbed::space::solid::Solid;
use testbed::space::surface::SurfaceMesh;
use testbed::space::wire::SpatialWire;
use testbed::statistics::CHI2_3_95;

use super::{Data, surfaces};
use crate::color::{Rgb, viridis};
use crate::replay::{Whole, micrometres, player};
use crate::style::plain;

/// Most instants of a trial that are kept.
const FRAMES: usize = 160;

/// Points along the whisker.
const WIRE_POINTS: usize = 24;

/// Number of estimators of a trial: the recommended one, and the most accurate ones.
const ESTIMATORS: usize = 4;

/// Number of colours of a surface.
const COLOURS: usize = 16;

/// Colour of a surface whose true solid is unknown.
const PLAIN: Rgb = Rgb(158, 202, 225);

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
    /// Vertices of the surface that all sweeps over the solid determine.
    vertices_um: Vec<Spot>,
    /// Its triangles.
    surface: Vec<Patch>,
    /// The matrix of the 95 % ellipsoid: xx, xy, xz, yy, yz, zz in square micrometres.
    spread_um2: Vec<Option<[Whole; 6]>>,
    error_um: Vec<Option<Whole>>,
}

/// Triangles of a surface with the same colour.
#[derive(Serialize)]
struct Patch {
    colour: String,
    /// Indices of three vertices each.
    triangles: Vec<[u32; 3]>,
}

/// The content of the section. `None` if no trial was scored.
///
/// # Errors
/// When a file of the run is damaged.
pub(super) fn section(data: &Data) -> Result<Option<Markup>> {
    let (solids, mut trials) = (data.run.solids(), Vec::new());
    for whisker in data.whiskers() {
        for group in data.groups() {
            trials.extend(trial(data, &solids, group, whisker)?);
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
            span.key.found {} " estimated contacts so far. Surface: estimated from all sweeps over the solid. Its colour is the distance "
            "from the true solid, " span.scale style=(scale()) {} " from 1 µm to 1 mm (logarithmic), or light blue if the true solid is "
            "a mesh or unknown. "
            "Below: contact error; in grey that of the other estimators of the list."
        }
        (player(&trials, "Whisker and solid", include_str!("replay_space.js"))?)
    }))
}

fn trial(data: &Data, solids: &[SweptSolid<'_>], group: &str, whisker: &str) -> Result<Option<Trial>> {
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
    let is_of = |swept: &&SweptSolid<'_>| swept.trials.iter().any(|other| other.trace == trial.trace);
    let swept = solids.iter().find(is_of).context("a trial without a solid")?;
    let solid = Solid::of_scene(swept.solid);
    let mut runs = Vec::new();
    for (name, rows) in &replayed {
        runs.push(Replayed::new(name, rows, &data.surface(swept, name)?, solid.as_ref()));
    }
    let wire = SpatialWire::new(&trial.whisker).context("space_run.json")?;
    // The true contact, or the estimated one if that is unknown.
    let shape = |row: &SpatialEstimateRow| {
        let points = wire.points_m(row, row.truth_contact_m().or(row.contact_m()), WIRE_POINTS)?;
        Some(points.into_iter().map(spot).collect())
    };
    let curves = solid.map_or_else(Vec::new, |solid| solid.curves_m());
    Ok(Some(Trial {
        name: format!("{}, {whisker} whisker", plain(group)),
        trace: trial.trace.clone(),
        t_s: rows.iter().map(|row| row.t_s).collect(),
        base_um: rows.iter().map(|row| spot(row.base_m())).collect(),
        wire_um: rows.iter().map(shape).collect(),
        truth_um: rows.iter().map(|row| row.truth_contact_m().map(spot)).collect(),
        solid_um: curves.into_iter().map(|curve| curve.into_iter().map(spot).collect()).collect(),
        runs,
    }))
}

impl Replayed {
    fn new(name: &str, rows: &[SpatialEstimateRow], mesh: &SurfaceMesh, solid: Option<&Solid>) -> Self {
        Self {
            name: name.into(),
            contact_um: rows.iter().map(|row| row.contact_m().map(spot)).collect(),
            vertices_um: mesh.vertices.iter().map(|vertex| spot(vertex.on.at.vector())).collect(),
            surface: patches(mesh, solid),
            spread_um2: rows.iter().map(|row| row.covariance_m2().map(spread)).collect(),
            error_um: rows.iter().map(|row| Some(micrometres(row.contact_error_m()?))).collect(),
        }
    }
}

/// The triangles of a surface by colour.
fn patches(mesh: &SurfaceMesh, solid: Option<&Solid>) -> Vec<Patch> {
    let Some(solid) = solid else {
        return vec![Patch { colour: hexadecimal(PLAIN), triangles: mesh.triangles.clone() }];
    };
    let mut of_colour = vec![Vec::new(); COLOURS];
    for (corners, distance_m) in mesh.triangles.iter().zip(surfaces::distances_m(mesh, solid)) {
        of_colour[(surfaces::share(distance_m) * COLOURS as f64).min(COLOURS as f64 - 1.0) as usize].push(*corners);
    }
    let patch = |(index, triangles): (usize, Vec<[u32; 3]>)| Patch {
        colour: hexadecimal(viridis((index as f64 + 0.5) / COLOURS as f64)),
        triangles,
    };
    of_colour.into_iter().enumerate().filter(|(_, triangles)| !triangles.is_empty()).map(patch).collect()
}

fn hexadecimal(Rgb(red, green, blue): Rgb) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// Style of an element that shows the colour scale.
fn scale() -> String {
    let colours: Vec<String> =
        (0..COLOURS).map(|step| hexadecimal(viridis(step as f64 / (COLOURS - 1) as f64))).collect();
    format!("background: linear-gradient(to right, {})", colours.join(", "))
}

/// Covariance of which the ellipsoid of one standard deviation contains the contact with a probability of 95 %.
fn spread(covariance_m2: Matrix3<f64>) -> [Whole; 6] {
    let of = covariance_m2 * CHI2_3_95;
    [of.m11, of.m12, of.m13, of.m22, of.m23, of.m33].map(|value_m2| (1e12 * value_m2).round() as Whole)
}

fn spot(point_m: Vector3<f64>) -> Spot {
    [point_m.x, point_m.y, point_m.z].map(micrometres)
}
