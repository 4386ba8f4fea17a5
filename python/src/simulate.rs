//! Quasi-static simulation of a sweep by the exact elastica.

use std::f64::consts::TAU;
use std::path::Path;

use ::trace::{Generator, Instant, Outline, Recording, Role, Sidecar, Trace as Simulated, Truth, TruthInstant};
use ::whisker::elastica::{Elastica, Load, Regime, Touch};
use ::whisker::frames::{Base, Point, Pose, World};
use ::whisker::sensor::Face;
use anyhow::{Context, ensure};
use files::{FORMAT, sha256};
use nalgebra::Vector2;
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::arrays::{Numbers, numbers, same_length};
use crate::convert::{check_rate, face as face_of, poses};
use crate::error::{raised, refused};
use crate::interrupt;
use crate::shape::Shape;
use crate::trace::Trace;
use crate::whisker::Whisker;

/// Number of points of a simulated object's outline.
const OUTLINE_POINTS: u32 = 2880;

/// Number of directions in which the distance of a point from an object is measured, and distance between the points of the
/// undeflected whisker.
const DIRECTIONS: u32 = 720;
const SPACING_M: f64 = 0.2e-3;

/// Overlap of the undeflected whisker and the object beyond which they touch, and distance beyond which they do not. The distance
/// is computed from points of the undeflected whisker, and is too large by less than this.
const CLEARANCE_M: f64 = 0.2e-3;

/// Simulates a sweep of a whisker against an object, quasi-statically, without friction and without measurement noise.
///
/// `t_s` (n) are the times at a constant rate, `base` (n, 3) the poses of the whisker's base in World: x (m), y (m) and yaw
/// (rad). `face` is the side of the whisker on which the object lies. The readings are those of the exact elastica, so there
/// is neither inertia nor ringing; for those, simulate a scene by `whisker simulate`.
///
/// A row without an equilibrium, such as a whisker that slips off the object, raises `ValueError`, and so does an object that the
/// whisker does not meet on this side or meets with its tip.
#[pyfunction]
#[pyo3(signature = (whisker, shape, t_s, base, face, name="sweep"))]
pub(crate) fn simulate(
    py: Python<'_>,
    whisker: &Whisker,
    shape: &Shape,
    t_s: Numbers<'_>,
    base: Numbers<'_>,
    face: &str,
    name: &str,
) -> PyResult<Trace> {
    let (times_s, poses) = (numbers("t_s", &t_s)?, poses(&base)?);
    same_length("base", poses.len(), "t_s", times_s.len())?;
    let (rate_hz, face) = (rate_hz(&times_s)?, face_of(face)?);
    let bases: Vec<Pose<Base, World>> = poses.iter().map(|&[x_m, y_m, yaw_rad]| Pose::new(x_m, y_m, yaw_rad)).collect();
    let elastica = whisker.elastica()?;
    let (rest, sides) = (rest(&elastica).map_err(raised)?, sides(shape));
    let mut touches: Vec<Option<Touch>> = Vec::with_capacity(bases.len());
    interrupt::each(py, bases.len(), |row| {
        let (base, last) = (&bases[row], touches.last().copied().flatten());
        let found = touch(&elastica, shape, base, face, last).with_context(|| format!("base[{row}]"))?;
        if last.is_none() {
            let overlap_m = -clearance_m(&rest, &sides, base);
            ensure!(
                found.is_some() || overlap_m < CLEARANCE_M,
                "base[{row}]: found the undeflected whisker in the object by {:.1} mm and no contact on its {} side, expected a \
                 contact there",
                1e3 * overlap_m,
                face.name()
            );
            ensure!(
                found.is_none() || overlap_m > -CLEARANCE_M,
                "base[{row}]: found the object {:.1} mm from the undeflected whisker, expected it to meet the whisker's {} side first",
                -1e3 * overlap_m,
                face.name()
            );
        }
        touches.push(found);
        Ok(())
    })?;
    let moment_n_m = |touch: &Option<Touch>| touch.map_or(0.0, |touch| touch.deflection.moment_n_m);
    let instant = |((&t_s, &base), touch)| Instant {
        t_s,
        base,
        twist: None,
        moment_z_n_m: moment_n_m(touch),
        rotation_z_rad: Some(touch.map_or(0.0, |touch: Touch| touch.deflection.rotation_rad)),
    };
    let instants = times_s.iter().zip(&bases).zip(&touches).map(instant).collect();
    let truths = bases.iter().zip(&touches).map(|(base, touch)| truth(base, touch.as_ref())).collect();
    let sidecar = sidecar(whisker, shape, name, face, rate_hz, times_s.len()).map_err(raised)?;
    let mut simulated = Simulated { sidecar, recording: Recording { instants }, truth: Truth { instants: truths } };
    simulated.sidecar.csv_sha256 = sha256(simulated.to_csv());
    simulated.sidecar.inputs_sha256 = simulated.sidecar.csv_sha256.clone();
    Ok(Trace::new(simulated, outline(shape)))
}

/// Contact at one instant, near the last one if there is one.
fn touch(
    elastica: &Elastica,
    shape: &Shape,
    base: &Pose<Base, World>,
    face: Face,
    last: Option<Touch>,
) -> Result<Option<Touch>, ::whisker::elastica::Failure> {
    match last {
        Some(last) => elastica.against_near(shape.outline.as_ref(), base, face, &last),
        None => elastica.against(shape.outline.as_ref(), base, face),
    }
}

/// Points of the undeflected whisker's centre line, with the radius of the wire.
fn rest(elastica: &Elastica) -> Result<Vec<(Point<Base>, f64)>, ::whisker::elastica::Failure> {
    let length_m = elastica.length_m();
    let line = elastica.line(Load { arc_m: length_m, along_n: 0.0, left_n: 0.0, couple_n_m: 0.0 })?;
    let intervals = (length_m / SPACING_M).ceil() as u32;
    let point = |i: u32| {
        let arc_m = length_m * f64::from(i) / f64::from(intervals);
        (line.at(arc_m).0, elastica.radius_m(arc_m))
    };
    Ok((0..=intervals).map(point).collect())
}

/// Outward normals of an object's sides in [`DIRECTIONS`], with the distances of the sides from the origin of World.
fn sides(shape: &Shape) -> Vec<(Vector2<f64>, f64)> {
    let side = |i: u32| {
        let normal_rad = TAU * f64::from(i) / f64::from(DIRECTIONS);
        let normal = Vector2::new(normal_rad.cos(), normal_rad.sin());
        (normal, shape.outline.support(normal_rad).point.vector().dot(&normal))
    };
    (0..DIRECTIONS).map(side).collect()
}

/// Least distance of the undeflected whisker's surface from a convex object with these sides, negative within it.
fn clearance_m(rest: &[(Point<Base>, f64)], sides: &[(Vector2<f64>, f64)], base: &Pose<Base, World>) -> f64 {
    let beyond_m = |(point, radius_m): &(Point<Base>, f64)| {
        let at = base.apply(*point).vector();
        sides.iter().map(|(normal, reach_m)| at.dot(normal) - reach_m).fold(f64::NEG_INFINITY, f64::max) - radius_m
    };
    rest.iter().map(beyond_m).fold(f64::INFINITY, f64::min)
}

fn truth(base: &Pose<Base, World>, touch: Option<&Touch>) -> TruthInstant {
    TruthInstant {
        touching: Some(touch.is_some()),
        tip: Some(touch.is_some_and(|touch| touch.regime == Regime::Tip)),
        split: Some(false),
        contact: touch.map(|touch| base.apply(touch.deflection.point)),
        surface: touch.map(|touch| base.apply(touch.surface)),
        arc_m: touch.map(|touch| touch.load.arc_m),
        force_n: touch.map(|touch| touch.force_n),
        tangent_rad: touch.map(|touch| base.yaw_rad() + touch.deflection.tangent_rad),
        friction: None,
        second: None,
        yielding: None,
    }
}

/// Rate of times that ascend in equal steps.
fn rate_hz(times_s: &[f64]) -> PyResult<f64> {
    let [first_s, .., last_s] = times_s else {
        return Err(refused("t_s", format!("{} times", times_s.len()), "at least 2"));
    };
    let step_s = (last_s - first_s) / (times_s.len() - 1) as f64;
    match times_s.windows(2).position(|pair| (pair[1] - pair[0] - step_s).abs() > 1e-3 * step_s || step_s <= 0.0) {
        Some(row) => {
            let found = times_s[row + 1] - times_s[row];
            Err(refused(
                &format!("t_s[{}]", row + 1),
                format!("a step of {found} s"),
                "times that ascend in equal steps",
            ))
        }
        None => {
            check_rate(1.0 / step_s)?;
            Ok(1.0 / step_s)
        }
    }
}

fn outline(shape: &Shape) -> Option<Outline> {
    let vertex = |i: u32| shape.outline.support(TAU * f64::from(i) / f64::from(OUTLINE_POINTS)).point;
    let mut vertices: Vec<Point<World>> = (0..OUTLINE_POINTS).map(vertex).collect();
    vertices.dedup();
    vertices.push(vertices[0]);
    Outline::new(vertices)
}

fn sidecar(
    whisker: &Whisker,
    shape: &Shape,
    name: &str,
    face: Face,
    rate_hz: f64,
    rows: usize,
) -> Result<Sidecar, files::Error> {
    if !::trace::is_plain_name(name) {
        return Err(files::Error::value(Path::new(name), "name", format!("`{name}`"), "a plain file name"));
    }
    let scene: Value = json!({"simulation": "elastica", "object": shape.name});
    Ok(Sidecar {
        format: FORMAT,
        kind: "trace".into(),
        name: name.into(),
        role: Role::Trial,
        group: shape.name.into(),
        object: shape.name.into(),
        face,
        seed: 0,
        rate_hz,
        rows,
        whisker: whisker.whisker.clone(),
        scene,
        generator: Generator {
            name: "whisker_contact".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            mujoco: None,
            git_commit: None,
            source_sha256: String::new(),
        },
        inputs_sha256: String::new(),
        csv_sha256: String::new(),
        contour: None,
        certificate: None,
        recorded: None,
        recording: None,
        replay: None,
    })
}
