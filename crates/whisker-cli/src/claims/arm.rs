//! Whiskers on a robot arm: contact error compared with a stage, and accuracy of the joint map.
//!
//! **Arm and stage** are compared under equal conditions: the same whisker on the same path past the same cylinder with
//! the same measurement noise. On the arm it is one of six whiskers in space among free-standing objects, and the poses
//! of the base come from the joints. On the stage it is alone in the plane, the cylinder is fixed and the whisker bends
//! as the exact elastica. The arm does not vibrate. The score covers the rows in which both have one contact on the
//! same side of the whisker and in its calibrated domain, outside of which an estimate may be withheld.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use testbed::dataset::Dataset;
use testbed::front_end::FRONT_ENDS;
use testbed::map::true_circle;
use testbed::replay::{detect_contact, knowledge, replay, runner, samples};
use testbed::results::{MapObjectRow, MapRow};
use testbed::seeds::derived_seed;
use testbed::statistics::rms;
use trace::{
    ArrayRecording, CalibrationFile, Instant, MountedWhisker, Outline, Recording, Role, Sidecar, Trace, Truth,
    TruthInstant,
};
use whisker::elastica::{Circle, Elastica, Regime};
use whisker::estimators;
use whisker::events::TouchConfig;
use whisker::frames::{Base, Point};
use whisker::sensor::CalibratedFace;

use super::{Claim, Context, Evaluation, RECOMMENDED, worst};

/// Suite and run of the arm's recordings through the Hall sensors.
pub(crate) const RUN: &str = "arm";

/// Measurement noise in addition to that of the sensors.
const NOISE: f64 = 0.01;

/// Conditions of the claims on maps.
const ABOUT: &str = "arm with and without vibration, Hall sensors and 1 % noise";

/// Recordings of the arm with and without vibration.
const SHAKEN: &str = "passage";
const STILL: &str = "passage_still";

/// Cylinders of the scene, by the names of the objects.
const CYLINDERS: [&str; 2] = ["cylinder_90", "cylinder_72"];

/// Time after the first touch from which a contact is scored, and time of free motion before it that belongs to the window.
const STEADY_S: f64 = 1.0;

/// Interruptions shorter than this do not end a contact, because a soft whisker bounces.
const CHATTER_S: f64 = 0.1;

/// Largest share of scored rows without an estimate.
const MOST_SILENT: f64 = 0.01;

/// Distance within which a point lies on an outline.
const ON_M: f64 = 1e-4;

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = vec![
        map(
            "arm_points_mean",
            "accepted contact points of both arrays: mean distance to the true outlines, unaligned",
            0.7,
            "mm",
            |row| row.points_mean_m.map(|mean_m| 1e3 * mean_m),
        ),
        map(
            "arm_points_p95",
            "accepted contact points of both arrays: 95th percentile of the distance to the true outlines, unaligned",
            2.0,
            "mm",
            |row| row.points_p95_m.map(|p95_m| 1e3 * p95_m),
        ),
        map("arm_objects", "objects missed, invented, split or merged", 0.0, "objects", |row| {
            let off = row.objects_found.abs_diff(row.objects_touched) + row.objects_split + row.objects_merged;
            Some(off as f64)
        }),
    ];
    for cylinder in CYLINDERS {
        let name = cylinder.replace('_', " ");
        claims.push(object(
            format!("arm_radius_{cylinder}"),
            format!("{name} mm: error of the fitted radius"),
            cylinder,
            |row| row.radius_error_m.map(f64::abs),
        ));
        claims.push(object(
            format!("arm_center_{cylinder}"),
            format!("{name} mm: error of the fitted centre"),
            cylinder,
            |row| row.center_error_m,
        ));
    }
    claims.push(Claim::at_least(
        "arm_points_share".into(),
        format!("{ABOUT}, accepted contact points over the rows with a single contact, worst map"),
        75.0,
        "%",
        |context| {
            let shares = maps(shaken(context)?).map(|row| row.points_share.map(|share| -100.0 * share));
            Ok(worst(shares).map(|least| -least))
        },
    ));
    claims.push(Claim::at_most(
        "arm_vibration".into(),
        "arm with vibration: largest change of the moment at a root over the largest moment, worst whisker".into(),
        3.0,
        "%",
        |_| Ok(disturbance()?.map(|share| 100.0 * share)),
    ));
    claims.push(Claim::at_most(
        "arm_displaced".into(),
        "arm with and without vibration: largest displacement of any point of any object".into(),
        0.01,
        "mm",
        |_| Ok(displaced_m()?.map(|moved_m| 1e3 * moved_m)),
    ));
    claims.push(Claim::at_most(
        "arm_over_stage".into(),
        format!(
            "arm, perfect encoders, {RECOMMENDED}: relative difference of the contact error on the cylinders from \
            that on a stage"
        ),
        10.0,
        "%",
        |context| Ok(arm_over_stage(context)?.map(|ratio| 100.0 * (ratio - 1.0).abs())),
    ));
    claims
}

/// The run, checked to hold the recordings through the Hall sensors at 1 % noise, with vibration.
fn shaken(context: &Context) -> anyhow::Result<&Evaluation> {
    let evaluation = context.run(RUN);
    let run = &evaluation.run;
    ensure!(run.front_end.name == "hall", "run `{RUN}`: front end: found `{}`, expected `hall`", run.front_end.name);
    ensure!(run.noise[0] == NOISE, "run `{RUN}`: first noise level: found {}, expected {NOISE}", run.noise[0]);
    let names: Vec<&str> = run.recordings.iter().map(|recording| recording.name.as_str()).collect();
    ensure!(
        names.contains(&SHAKEN),
        "run `{RUN}`: recordings: found {}, expected `{SHAKEN}` among them",
        names.join(", ")
    );
    Ok(evaluation)
}

/// Maps of the recommended estimator at the first noise level of the run.
fn maps(evaluation: &Evaluation) -> impl Iterator<Item = &MapRow> {
    evaluation.maps.iter().filter(|row| row.estimator == RECOMMENDED && row.noise == evaluation.run.noise[0])
}

/// Largest value over the maps. `None` if a map lacks it.
fn map(
    id: &'static str,
    claim: &'static str,
    bound: f64,
    unit: &'static str,
    value: fn(&MapRow) -> Option<f64>,
) -> Claim {
    Claim::at_most(id.into(), format!("{ABOUT}, {claim}, worst map"), bound, unit, move |context| {
        Ok(worst(maps(shaken(context)?).map(value)))
    })
}

/// Largest value over the maps for one true object (mm). `None` if a map lacks the object.
fn object(id: String, claim: String, name: &'static str, value: fn(&MapObjectRow) -> Option<f64>) -> Claim {
    Claim::at_most(id, format!("{ABOUT}, {claim}, worst map"), 1.0, "mm", move |context| {
        let run = shaken(context)?;
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
        Ok(worst(maps(run).map(of_map)).map(|value_m| 1e3 * value_m))
    })
}

fn dataset() -> anyhow::Result<Dataset> {
    Dataset::open(&Path::new("scenes/suites").join(RUN).with_extension("json"), None)
}

fn recording(dataset: &Dataset, name: &str) -> anyhow::Result<ArrayRecording> {
    Ok(ArrayRecording::read(&dataset.folder.join(name).with_extension("json"))?)
}

/// Largest change of a root moment by vibration over the largest moment of the same whisker, for the worst whisker.
fn disturbance() -> anyhow::Result<Option<f64>> {
    let dataset = dataset()?;
    let traces = dataset.read(Role::Trial)?;
    let moments_n_m = |name: &str| -> Option<Vec<f64>> {
        let trace = traces.iter().find(|trace| trace.sidecar.name == name)?;
        Some(trace.recording.instants.iter().map(|instant| instant.moment_z_n_m).collect())
    };
    let [shaken, still] = [recording(&dataset, SHAKEN)?, recording(&dataset, STILL)?];
    let of_whisker = |(shaken, still): (&MountedWhisker, &MountedWhisker)| {
        let (shaken_n_m, still_n_m) = (moments_n_m(&shaken.trace)?, moments_n_m(&still.trace)?);
        let largest = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
        let largest_n_m = largest(&mut still_n_m.iter().copied());
        let off_n_m = largest(&mut shaken_n_m.iter().zip(&still_n_m).map(|(shaken, still)| shaken - still));
        (shaken_n_m.len() == still_n_m.len() && largest_n_m > 0.0).then(|| off_n_m / largest_n_m)
    };
    Ok(worst(shaken.sidecar.whiskers.iter().zip(&still.sidecar.whiskers).map(of_whisker)))
}

/// Largest displacement of any object in any recording (m).
fn displaced_m() -> anyhow::Result<Option<f64>> {
    let dataset = dataset()?;
    let mut moved_m = Vec::new();
    for name in [SHAKEN, STILL] {
        moved_m.extend(recording(&dataset, name)?.moved_m.into_iter().map(Some));
    }
    Ok(worst(moved_m.into_iter()))
}

/// Readings and true contacts in Base during the contact with one cylinder, row by row.
struct Sweep {
    readings_n_m: Vec<f64>,
    contacts: Vec<Option<Point<Base>>>,
}

/// Rows of a trace in contact with one cylinder, with free rows before them.
struct Window {
    trace: Trace,
    /// First row of the touch.
    touch: usize,
}

/// RMS contact error over all whiskers and seeds on the arm, over that on the stage, in the same rows. `None` if the
/// contact of a whisker is too short, the stage has no contact, or estimates are missing.
fn arm_over_stage(context: &Context) -> anyhow::Result<Option<f64>> {
    let dataset = dataset()?;
    let array = recording(&dataset, STILL)?;
    let traces = dataset.read(Role::Trial)?;
    let run = &context.run(RUN).run;
    let mut errors_m = [Vec::new(), Vec::new()];
    for whisker in &array.sidecar.whiskers {
        let trace = traces.iter().find(|trace| trace.sidecar.name == whisker.trace).context("a trace of the suite")?;
        let sidecar = &trace.sidecar;
        let set = run.sets.iter().find(|set| set.traces.contains(&sidecar.name)).context("the trace is of the run")?;
        let noise_sd_n_m = run.noise[0] * set.largest_reading_n_m;
        let path = dataset.calibrations(FRONT_ENDS[0].name).join(format!("{}.json", sidecar.whisker.name));
        let faces = CalibrationFile::read(&path)?.calibrated(&path, None)?;
        let objects = array.sidecar.objects.iter().zip(&array.outlines);
        let cylinders = objects.filter(|(object, _)| CYLINDERS.contains(&object.name.as_str()));
        let windows = cylinders.filter_map(|(_, outline)| Some((Window::longest(trace, outline)?, outline)));
        // Each array passes one of the cylinders.
        let Some((window, outline)) = windows.max_by_key(|(window, _)| window.len()) else { return Ok(None) };
        let Some(stage) = on_stage(&window.trace, outline)? else { return Ok(None) };
        let sweeps = [on_arm(&window.trace), stage];
        let steady = window.touch + rows_in(STEADY_S, sidecar)..window.len();
        let face = faces.iter().find(|face| face.face == sidecar.face).context("a calibrated face")?;
        let is_calibrated = |contact: Point<Base>| face.domain.contains(face.along_and_away(contact));
        let is_scored = |row: &usize| sweeps.iter().all(|sweep| sweep.contacts[*row].is_some_and(is_calibrated));
        let scored: Vec<usize> = steady.filter(is_scored).collect();
        let found: Vec<[Option<Vec<f64>>; 2]> = run
            .seeds
            .par_iter()
            .map(|&seed| {
                let [arm, stage] = sweeps
                    .each_ref()
                    .map(|sweep| contact_errors_m(&window, sweep, &scored, &faces, noise_sd_n_m, seed));
                Ok([arm?, stage?])
            })
            .collect::<anyhow::Result<_>>()?;
        for (place, found) in found.into_iter().flat_map(|of_seed| of_seed.into_iter().enumerate()) {
            let Some(found) = found else { return Ok(None) };
            errors_m[place].extend(found);
        }
    }
    let [arm, stage] = errors_m;
    Ok(rms(&arm).zip(rms(&stage)).map(|(arm_m, stage_m)| arm_m / stage_m))
}

/// Number of rows in a duration.
fn rows_in(time_s: f64, sidecar: &Sidecar) -> usize {
    (time_s * sidecar.rate_hz).round() as usize
}

impl Window {
    /// The longest contact with an object, with up to a second of free motion before it. Interruptions shorter than
    /// [`CHATTER_S`] are bridged. `None` if no contact is longer than the part that is not scored.
    fn longest(trace: &Trace, outline: &Outline) -> Option<Self> {
        let truths = &trace.truth.instants;
        let is_on = |row: usize| truths[row].surface.is_some_and(|surface| outline.distance_m(surface) <= ON_M);
        let rows: Vec<usize> = (0..truths.len()).filter(|&row| is_on(row)).collect();
        let chatter = rows_in(CHATTER_S, &trace.sidecar);
        let touch = rows.chunk_by(|a, b| b - a <= chatter).max_by_key(|touch| touch.len())?;
        let (first, last) = (touch[0], touch[touch.len() - 1]);
        let before = rows_in(STEADY_S, &trace.sidecar);
        let free = (0..first).rev().take(before).take_while(|&row| truths[row].surface.is_none()).count();
        let rows = first - free..last + 1;
        let cut = Trace {
            recording: Recording { instants: trace.recording.instants[rows.clone()].to_vec() },
            truth: Truth { instants: truths[rows].to_vec() },
            sidecar: trace.sidecar.clone(),
        };
        (last - first > before).then_some(Self { trace: cut, touch: free })
    }

    fn len(&self) -> usize {
        self.trace.recording.instants.len()
    }
}

fn on_arm(window: &Trace) -> Sweep {
    let instants = window.recording.instants.iter().zip(&window.truth.instants);
    let seen = |(known, truth): (&Instant, &TruthInstant)| {
        let is_one = truth.split != Some(true) && truth.tip != Some(true);
        truth.contact.filter(|_| is_one).map(|contact| known.base.inverse().apply(contact))
    };
    Sweep {
        readings_n_m: window.recording.instants.iter().map(|known| known.moment_z_n_m).collect(),
        contacts: instants.map(seen).collect(),
    }
}

/// `None` where the elastica has no solution.
fn on_stage(window: &Trace, outline: &Outline) -> anyhow::Result<Option<Sweep>> {
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
        let Ok(touch) = touch else { return Ok(None) };
        last = touch;
        sweep.readings_n_m.push(last.map_or(0.0, |touch| touch.deflection.moment_n_m));
        let side = last.filter(|touch| touch.regime == Regime::Side);
        sweep.contacts.push(side.map(|touch| touch.deflection.point));
    }
    Ok(Some(sweep))
}

/// Contact errors in the scored rows (m). `None` if estimates are missing in more than [`MOST_SILENT`] of them.
fn contact_errors_m(
    window: &Window,
    sweep: &Sweep,
    scored: &[usize],
    faces: &[Arc<CalibratedFace>],
    noise_sd_n_m: f64,
    seed: u64,
) -> anyhow::Result<Option<Vec<f64>>> {
    let sidecar = &window.trace.sidecar;
    let mut rng = Pcg64::seed_from_u64(derived_seed(seed, &["arm and stage", &sidecar.name]));
    let noisy = |reading_n_m: &f64| reading_n_m + noise_sd_n_m * rng.sample::<f64, _>(StandardNormal);
    let readings_n_m: Vec<f64> = sweep.readings_n_m.iter().map(noisy).collect();
    let row = estimators::estimator(RECOMMENDED).context("a registered estimator")?;
    let knowledge = knowledge(sidecar, faces, noise_sd_n_m);
    let mut samples = samples(&window.trace.recording, &readings_n_m);
    let touched = detect_contact(TouchConfig::default(), &knowledge, &mut samples);
    let mut runner = runner(row, &(row.defaults)(), &knowledge, &sidecar.name, seed)?;
    let estimates = replay(&mut runner, &samples, &touched).estimates;
    let error_m = |&row: &usize| Some(estimates[row].as_ref()?.contact.distance(&sweep.contacts[row]?));
    let errors_m: Vec<f64> = scored.iter().filter_map(error_m).collect();
    let most_silent = (MOST_SILENT * scored.len() as f64) as usize;
    Ok((!scored.is_empty() && scored.len() - errors_m.len() <= most_silent).then_some(errors_m))
}
