//! Whiskers on a robot arm: whether an arm is as good as a stage, and how true the map is that they make together.
//!
//! **Arm and stage** are compared like with like: the same whisker carried along the same path past the same cylinder, under the same measurement noise. On the arm
//! it is one of six whiskers, in space and among objects that stand free, and the estimator has the poses of the base from the joints; on the stage it is alone in the plane, the
//! cylinder held fast and the whisker bent as the exact elastica has it. The arm does not shake, as a stage does not.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use trace::{ArrayRecording, CalibrationFile, Outline, Role, Trace};
use whisker::elastica::{Circle, Elastica, Regime};
use whisker::estimators;
use whisker::frames::{Base, Point};
use whisker::sensor::CalibratedFace;

use super::{Claim, Context, RECOMMENDED};
use crate::dataset::Dataset;
use crate::front_end::{FRONT_ENDS, derived_seed};
use crate::map::true_circle;
use crate::replay::{estimator, knowledge, replay, samples};
use crate::results::{MapObjectRow, MapRow};
use crate::statistics::rms;

/// Suite and run.
pub(crate) const RUN: &str = "arm";

/// The recording of an arm that does not shake.
const STILL: &str = "passage_still";

/// Cylinders of the scene, by the names of the objects.
const CYLINDERS: [&str; 2] = ["cylinder_90", "cylinder_72"];

/// A contact counts from so many rows after the touch on, and a window begins so many before it, where the whisker is free: a second of each.
const ROWS: usize = 250;

/// A point that is nearer to an outline than this is on it.
const ON_M: f64 = 1e-4;

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = vec![
        map(
            "arm_points_mean",
            "arm, contact points of both arrays from the true outlines, unaligned: mean distance, worst map",
            0.7,
            "mm",
            |row| row.points_mean_m.map(|mean_m| 1e3 * mean_m),
        ),
        map(
            "arm_points_p95",
            "arm, contact points of both arrays from the true outlines, unaligned: 95th percentile, worst map",
            2.0,
            "mm",
            |row| row.points_p95_m.map(|p95_m| 1e3 * p95_m),
        ),
        map(
            "arm_objects",
            "arm, objects that are found too many, too few, in pieces or as one: of the worst map",
            0.0,
            "objects",
            |row| {
                let off = row.objects_found.abs_diff(row.objects_touched) + row.objects_split + row.objects_merged;
                Some(off as f64)
            },
        ),
    ];
    for cylinder in CYLINDERS {
        let name = cylinder.replace('_', " ");
        claims.push(object(
            format!("arm_radius_{cylinder}"),
            format!("arm, {name} mm: fitted radius off by, worst map"),
            cylinder,
            |row| row.radius_error_m.map(f64::abs),
        ));
        claims.push(object(
            format!("arm_center_{cylinder}"),
            format!("arm, {name} mm: middle of the fitted circle off by, worst map"),
            cylinder,
            |row| row.center_error_m,
        ));
    }
    claims.push(Claim::at_most(
        "arm_over_stage".into(),
        format!("arm, perfect encoders, {RECOMMENDED}: contact error on the cylinders, how far off that on a stage"),
        10.0,
        "%",
        |context| Ok(arm_over_stage(context)?.map(|ratio| 100.0 * (ratio - 1.0).abs())),
    ));
    claims
}

/// The largest value over the maps of the recommended estimator at the run's first noise level; nothing where one has none.
fn map(
    id: &'static str,
    claim: &'static str,
    bound: f64,
    unit: &'static str,
    value: fn(&MapRow) -> Option<f64>,
) -> Claim {
    Claim::at_most(id.into(), claim.into(), bound, unit, move |context| {
        let run = context.run(RUN);
        let is_meant = |row: &&MapRow| row.estimator == RECOMMENDED && row.noise == run.run.noise[0];
        Ok(worst(run.maps.iter().filter(is_meant).map(value)))
    })
}

/// The largest value over the maps, of the true object that is meant, in mm; nothing where a map does not have it.
fn object(id: String, claim: String, name: &'static str, value: fn(&MapObjectRow) -> Option<f64>) -> Claim {
    Claim::at_most(id, claim, 1.0, "mm", move |context| {
        let run = context.run(RUN);
        let is_meant = |row: &&MapRow| row.estimator == RECOMMENDED && row.noise == run.run.noise[0];
        let of_map = |map: &MapRow| {
            let is_it = |row: &&MapObjectRow| {
                row.recording == map.recording
                    && row.estimator == map.estimator
                    && row.noise == map.noise
                    && row.seed == map.seed
                    && row.matched.as_deref() == Some(name)
            };
            value(run.map_objects.iter().find(is_it)?)
        };
        Ok(worst(run.maps.iter().filter(is_meant).map(of_map)).map(|value_m| 1e3 * value_m))
    })
}

/// The largest of some values; nothing where one lacks, or where there is none.
fn worst(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    values.collect::<Option<Vec<f64>>>()?.into_iter().reduce(f64::max)
}

/// A stretch of a trace in which one cylinder is touched, as readings and true contacts in Base, row by row.
struct Sweep {
    readings_n_m: Vec<f64>,
    contacts: Vec<Option<Point<Base>>>,
}

/// Root mean square contact error over all whiskers and seeds on the arm, over that on the stage.
fn arm_over_stage(context: &Context) -> anyhow::Result<Option<f64>> {
    let suite = Path::new("scenes/suites").join(RUN).with_extension("json");
    let dataset = Dataset::open(&suite, None)?;
    let array = ArrayRecording::read(&dataset.folder.join(STILL).with_extension("json"))?;
    let traces = dataset.read(Role::Trial)?;
    let run = &context.run(RUN).run;
    let mut errors_m = [Vec::new(), Vec::new()];
    for trace in traces.iter().filter(|trace| trace.sidecar.recording.as_deref() == Some(STILL)) {
        let sidecar = &trace.sidecar;
        let set = run.sets.iter().find(|set| set.traces.contains(&sidecar.name)).context("the trace is of the run")?;
        let noise_sd_n_m = run.noise[0] * set.largest_reading_n_m;
        let path = dataset.calibrations(FRONT_ENDS[0].name).join(format!("{}.json", sidecar.whisker.name));
        let faces = CalibrationFile::read(&path)?.calibrated(&path, None)?;
        let cylinders = array.sidecar.objects.iter().zip(&array.outlines);
        for (_, outline) in cylinders.filter(|(object, _)| CYLINDERS.contains(&object.name.as_str())) {
            let Some((rows, touch)) = longest_touch(trace, outline) else { continue };
            let window = Trace {
                recording: trace::Recording { instants: trace.recording.instants[rows.clone()].to_vec() },
                truth: trace::Truth { instants: trace.truth.instants[rows].to_vec() },
                sidecar: sidecar.clone(),
            };
            let sweeps = [on_arm(&window), on_stage(&window, outline)?];
            let jobs: Vec<(usize, u64)> = run.seeds.iter().flat_map(|&seed| [(0, seed), (1, seed)]).collect();
            let found: Vec<Vec<f64>> = jobs
                .par_iter()
                .map(|&(place, seed)| contact_errors_m(&window, &sweeps[place], &faces, noise_sd_n_m, seed, touch))
                .collect::<anyhow::Result<_>>()?;
            for ((place, _), found) in jobs.iter().zip(found) {
                errors_m[*place].extend(found);
            }
        }
    }
    let [arm, stage] = errors_m;
    Ok(rms(&arm).zip(rms(&stage)).map(|(arm_m, stage_m)| arm_m / stage_m))
}

/// The rows of the longest touch of an object with as many free rows before it as there are up to [`ROWS`], and the place of the touch among them.
fn longest_touch(trace: &Trace, outline: &Outline) -> Option<(Range<usize>, usize)> {
    let truths = &trace.truth.instants;
    let is_on = |row: usize| truths[row].surface.is_some_and(|surface| outline.distance_m(surface) <= ON_M);
    let rows: Vec<usize> = (0..truths.len()).filter(|&row| is_on(row)).collect();
    let touch = rows.chunk_by(|a, b| a + 1 == *b).max_by_key(|touch| touch.len())?;
    let (first, last) = (touch[0], touch[touch.len() - 1]);
    let free = (0..first).rev().take(ROWS).take_while(|&row| truths[row].surface.is_none()).count();
    (touch.len() > ROWS).then_some((first - free..last + 1, free))
}

fn on_arm(window: &Trace) -> Sweep {
    let instants = window.recording.instants.iter().zip(&window.truth.instants);
    let seen = |(known, truth): (&trace::Instant, &trace::TruthInstant)| {
        let is_one = truth.split != Some(true) && truth.tip != Some(true);
        truth.contact.filter(|_| is_one).map(|contact| known.base.inverse().apply(contact))
    };
    Sweep {
        readings_n_m: window.recording.instants.iter().map(|known| known.moment_z_n_m).collect(),
        contacts: instants.map(seen).collect(),
    }
}

fn on_stage(window: &Trace, outline: &Outline) -> anyhow::Result<Sweep> {
    let circle = true_circle(outline).context("a cylinder is round")?;
    let cylinder = Circle { center: circle.center, radius_m: circle.radius_m };
    let elastica = Elastica::new(&window.sidecar.whisker)?;
    let mut sweep = Sweep { readings_n_m: Vec::new(), contacts: Vec::new() };
    let mut last = None;
    for known in &window.recording.instants {
        let touch = match &last {
            Some(near) => elastica.against_near(&cylinder, &known.base, window.sidecar.face, near),
            None => elastica.against(&cylinder, &known.base, window.sidecar.face),
        };
        last = touch.with_context(|| format!("{} on a stage at {} s", window.sidecar.name, known.t_s))?;
        sweep.readings_n_m.push(last.map_or(0.0, |touch| touch.deflection.moment_n_m));
        let side = last.filter(|touch| touch.regime == Regime::Side);
        sweep.contacts.push(side.map(|touch| touch.deflection.point));
    }
    Ok(sweep)
}

/// Contact errors from a second after the touch on.
fn contact_errors_m(
    window: &Trace,
    sweep: &Sweep,
    faces: &[Arc<CalibratedFace>],
    noise_sd_n_m: f64,
    seed: u64,
    touch: usize,
) -> anyhow::Result<Vec<f64>> {
    let sidecar = &window.sidecar;
    let mut rng = Pcg64::seed_from_u64(derived_seed(seed, &["arm and stage", &sidecar.name]));
    let noisy = |reading_n_m: &f64| reading_n_m + noise_sd_n_m * rng.sample::<f64, _>(StandardNormal);
    let readings_n_m: Vec<f64> = sweep.readings_n_m.iter().map(noisy).collect();
    let row = estimators::estimator(RECOMMENDED).context("a registered estimator")?;
    let knowledge = knowledge(sidecar, faces, noise_sd_n_m);
    let mut estimator = estimator(row, &(row.defaults)(), Default::default(), &knowledge, &sidecar.name, seed)?;
    let estimates = replay(&mut estimator, &samples(&window.recording, &readings_n_m)).estimates;
    let pairs = estimates.iter().zip(&sweep.contacts).skip(touch + ROWS);
    let errors: Vec<Vector2<f64>> =
        pairs.filter_map(|(estimate, truth)| Some(estimate.as_ref()?.contact.vector() - (*truth)?.vector())).collect();
    ensure!(!errors.is_empty(), "{}: the estimator says nothing of the contact", sidecar.name);
    Ok(errors.iter().map(Vector2::norm).collect())
}
