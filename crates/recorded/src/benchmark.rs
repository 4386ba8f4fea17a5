//! Benchmark on recordings in space: sensor models on left-out lines, left-out lines and trials as pins, sweeps over objects.

use std::f64::consts::PI;
use std::path::Path;

use anyhow::Context;
use files::{write_atomically, write_json};
use importers::{SpatialRecordings, SpatialSweep, Triangle, stanford_in_space};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::calibration::Calibrated;
use crate::fixed::{Reading, Settings};
use crate::kernel::Kernel;
use crate::mesh::{distance_m, nearest};
use crate::paper;
use crate::pins::{Method, Mounting, PinScore, TOUCH, line, replay, score, touch};
use crate::process::{HeldOut, Process};
use crate::sweep::{SweepSettings, contacts};

/// Name of the estimator of fixed contacts.
pub const FIXED: &str = "fixed-point-batch";
/// Name of the published filter.
pub const PAPER: &str = "paper-ukf-3d";

/// Error of a sensor model on left-out lines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapScore {
    /// Name of the calibration.
    pub calibration: String,
    /// Name of the model.
    pub model: String,
    /// Number of samples.
    pub samples: usize,
    /// Number of samples left out as outliers.
    pub outliers: usize,
    /// Largest reading of a channel (counts).
    pub largest_counts: f64,
    /// Root mean square error of a channel on left-out lines, whose neighbours are left out too, over the largest reading.
    pub heldout_rms: f64,
    /// Largest such error.
    pub heldout_worst: f64,
    /// Mean normalised squared error.
    pub nees: f64,
}

/// Scores of one sweep over an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SweepScore {
    /// Name of the sweep.
    pub name: String,
    /// Name of the object.
    pub object: String,
    /// Number of rows in contact.
    pub rows: usize,
    /// Share of these rows with a contact within the calibrated domain.
    pub reach: f64,
    /// Length of the way of the contacts (m).
    pub extent_m: f64,
    /// Mean distance of the contacts from the mesh, as recorded (m). `None` without a mesh.
    pub mean_m: Option<f64>,
    /// 95th percentile of this distance (m).
    pub p95_m: Option<f64>,
    /// Mean distance after one shift of the object, without rotation (m).
    pub shifted_mean_m: Option<f64>,
    /// 95th percentile after this shift (m).
    pub shifted_p95_m: Option<f64>,
    /// Length of the shift (m).
    pub shift_m: Option<f64>,
}

/// Scores of an estimator on a group of pins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PinSummary {
    /// Group of the pins.
    pub group: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Number of pins.
    pub pins: usize,
    /// Share of the scored rows with an estimate within the calibrated domain.
    pub answered: f64,
    /// Mean over the pins of their mean errors (m).
    pub mean_m: f64,
    /// Median over the pins of their mean errors (m).
    pub median_m: f64,
    /// Largest error of a row (m).
    pub worst_m: f64,
    /// Mean over the pins of the normalised squared error per degree of freedom.
    pub nees: f64,
    /// Mean over the pins of the coverage of the 95 % ellipsoids.
    pub coverage: f64,
}

impl Benchmark {
    /// Scores by group and estimator, in order of their first pin.
    pub fn summary(&self) -> Vec<PinSummary> {
        let mut keys: Vec<(&str, &str)> = Vec::new();
        for pin in &self.pins {
            let key = (pin.group.as_str(), pin.estimator.as_str());
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let of_key = |(group, estimator): (&str, &str)| {
            let of = |pin: &&PinScore| pin.group == group && pin.estimator == estimator;
            let pins: Vec<&PinScore> = self.pins.iter().filter(of).collect();
            let mean = |value: fn(&PinScore) -> f64| pins.iter().map(|pin| value(pin)).sum::<f64>() / pins.len() as f64;
            let mut means: Vec<f64> = pins.iter().map(|pin| pin.mean_m).collect();
            means.sort_by(f64::total_cmp);
            let (rows, all): (usize, usize) =
                (pins.iter().map(|pin| pin.rows).sum(), pins.iter().map(|pin| pin.all_rows).sum());
            PinSummary {
                group: group.into(),
                estimator: estimator.into(),
                pins: pins.len(),
                answered: rows as f64 / all as f64,
                mean_m: mean(|pin| pin.mean_m),
                median_m: 0.5 * (means[(means.len() - 1) / 2] + means[means.len() / 2]),
                worst_m: pins.iter().map(|pin| pin.worst_m).fold(0.0, f64::max),
                nees: mean(|pin| pin.nees),
                coverage: mean(|pin| pin.coverage),
            }
        };
        keys.into_iter().map(of_key).collect()
    }
}

/// Results of the benchmark.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Benchmark {
    /// Sensor models.
    pub maps: Vec<MapScore>,
    /// Pins.
    pub pins: Vec<PinScore>,
    /// Sweeps.
    pub sweeps: Vec<SweepScore>,
    /// Calibrations and tests that could not be evaluated.
    pub failures: Vec<String>,
}

/// Settings that the results depend on.
#[derive(Serialize)]
struct Stated {
    settings: Settings,
    sweep: SweepSettings,
    kernels: Vec<(String, [Kernel; 2])>,
}

/// Evaluates the recordings of a clone and writes `space_maps.csv`, `space_pins.csv`, `space_pins_summary.csv`,
/// `space_sweeps.csv` and `space_settings.json` into `out`. The result does not depend on the number of threads.
///
/// # Errors
/// If the recordings cannot be read, or a table cannot be written.
pub fn run(folder: &Path, out: &Path, progress: &dyn Fn(&str)) -> anyhow::Result<Benchmark> {
    let recordings = stanford_in_space(folder)?;
    let mut benchmark =
        Benchmark { failures: recordings.failures.iter().map(ToString::to_string).collect(), ..Benchmark::default() };
    let mut kernels = Vec::new();
    for (index, calibration) in recordings.calibrations.iter().enumerate() {
        progress(&calibration.name);
        match Calibrated::new(calibration) {
            Ok(calibrated) => {
                kernels.push((calibrated.name.clone(), calibrated.process.kernels));
                evaluate(&recordings, index, &calibrated, &mut benchmark)?;
            }
            Err(error) => benchmark.failures.push(format!("{error:#}")),
        }
    }
    let stated = Stated { settings: Settings::default(), sweep: SweepSettings::default(), kernels };
    write_json(&out.join("space_settings.json"), &stated)?;
    write_atomically(&out.join("space_maps.csv"), &table(&benchmark.maps)?)?;
    write_atomically(&out.join("space_pins.csv"), &table(&benchmark.pins)?)?;
    write_atomically(&out.join("space_pins_summary.csv"), &table(&benchmark.summary())?)?;
    write_atomically(&out.join("space_sweeps.csv"), &table(&benchmark.sweeps)?)?;
    Ok(benchmark)
}

fn table<Row: Serialize>(rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner()?)
}

fn map_score(calibrated: &Calibrated, model: &str, process: &Process) -> MapScore {
    let held: Vec<HeldOut> = process.held_out(&calibrated.neighbours);
    let count = (2 * held.len()) as f64;
    let square: f64 = held.iter().map(|one| one.error.norm_squared()).sum();
    MapScore {
        calibration: calibrated.name.clone(),
        model: model.into(),
        samples: calibrated.samples.len(),
        outliers: calibrated.samples.len() - held.len(),
        largest_counts: process.largest_counts,
        heldout_rms: (square / count).sqrt() / process.largest_counts,
        heldout_worst: held.iter().map(|one| one.error.amax()).fold(0.0, f64::max) / process.largest_counts,
        nees: held.iter().map(|one| one.error.component_div(&one.sd).norm_squared()).sum::<f64>() / count,
    }
}

fn evaluate(
    recordings: &SpatialRecordings,
    index: usize,
    calibrated: &Calibrated,
    benchmark: &mut Benchmark,
) -> anyhow::Result<()> {
    let published = Process::new(&calibrated.process.samples, [paper::kernel(); 2]).context("singular covariance")?;
    benchmark.maps.push(map_score(calibrated, "gaussian-process", &calibrated.process));
    benchmark.maps.push(map_score(calibrated, "gaussian-process of paper-ukf-3d", &published));
    let least_counts = TOUCH * calibrated.process.largest_counts;
    let lines: Vec<Vec<PinScore>> = (0..calibrated.neighbours.len())
        .into_par_iter()
        .map(|index| {
            let Some(touch) = touch(&line(calibrated, index), least_counts) else { return Vec::new() };
            let [ours, theirs] =
                [&calibrated.process, &published].map(|process| process.without(&calibrated.neighbours[index]));
            // The sensor did not move between a line and the others.
            let settings = Settings { place_sd_m: 0.0, ..Settings::default() };
            let (group, name) = (format!("left-out lines, {}", calibrated.name), format!("line {index}"));
            let methods = [(FIXED, Method::Fixed(&ours, settings)), (PAPER, Method::Paper(&theirs, index as u64))];
            methods.into_iter().filter_map(|(method, how)| score(&group, &name, method, &replay(how, &touch))).collect()
        })
        .collect();
    benchmark.pins.extend(lines.into_iter().flatten());
    let [ours, theirs] = [&calibrated.process, &published].map(|process| process.without(&[]));
    let trials: Vec<(&str, &str, Vec<Reading>)> = recordings
        .pins
        .iter()
        .filter(|trial| trial.calibration == index)
        .filter_map(|trial| Some((trial.session.as_str(), trial.name.as_str(), touch(&trial.rows, least_counts)?)))
        .collect();
    let scored: Vec<Vec<PinScore>> = trials
        .par_iter()
        .enumerate()
        .map(|(i, (session, name, touch))| {
            let fixed = Method::Fixed(&ours, Settings::default());
            let group = format!("pins, {session}");
            let mut scores: Vec<PinScore> = [(FIXED, fixed), (PAPER, Method::Paper(&theirs, i as u64))]
                .into_iter()
                .filter_map(|(method, how)| score(&group, name, method, &replay(how, touch)))
                .collect();
            // The first trial of a session is the touch at a known place.
            let first = trials.iter().find(|(other, ..)| other == session);
            if let Some((.., readings)) = first.filter(|(_, known, _)| known != name) {
                let mounting = Mounting::learnt(&ours, readings, &Vector3::zeros());
                let corrected: Vec<Reading> = touch.iter().map(|reading| mounting.corrected(reading)).collect();
                let group = format!("{group}, mounting learnt");
                scores.extend(score(&group, name, FIXED, &replay(fixed, &corrected)));
            }
            scores
        })
        .collect();
    benchmark.pins.extend(scored.into_iter().flatten());
    let sweeps: Vec<&SpatialSweep> = recordings.sweeps.iter().filter(|sweep| sweep.calibration == index).collect();
    let swept = sweeps.par_iter().filter_map(|sweep| sweep_score(calibrated, sweep, least_counts));
    benchmark.sweeps.extend(swept.collect::<Vec<_>>());
    Ok(())
}

fn sweep_score(calibrated: &Calibrated, sweep: &SpatialSweep, least_counts: f64) -> Option<SweepScore> {
    let first = sweep.rows.iter().position(|(_, counts)| counts.norm() > least_counts)?;
    let held = sweep.rows[first..].iter().position(|(_, counts)| counts.norm() <= least_counts);
    let last = held.map_or(sweep.rows.len(), |held| first + held);
    let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), PI);
    let reading = |(origin_m, counts): &(Vector3<f64>, _)| Reading { rotation, origin_m: *origin_m, counts: *counts };
    let readings: Vec<Reading> = sweep.rows[first.saturating_sub(1)..last].iter().map(reading).collect();
    let predictor = calibrated.process.without(&[]);
    let all = contacts(&predictor, &calibrated.root_m, &readings, &SweepSettings::default());
    let found: Vec<Vector3<f64>> = all.iter().flatten().copied().collect();
    if found.is_empty() {
        return None;
    }
    let shifted = sweep.mesh.as_ref().map(|mesh| shift(&found, mesh));
    let distances = |shift_m: Vector3<f64>| {
        let mesh = sweep.mesh.as_ref()?;
        let mut distances: Vec<f64> = found.iter().map(|contact| distance_m(&(contact + shift_m), mesh)).collect();
        distances.sort_by(f64::total_cmp);
        let mean = distances.iter().sum::<f64>() / distances.len() as f64;
        Some((mean, distances[(distances.len() * 95 / 100).min(distances.len() - 1)]))
    };
    let (recorded, moved) = (distances(Vector3::zeros()), shifted.and_then(distances));
    Some(SweepScore {
        name: sweep.name.clone(),
        object: sweep.object.clone(),
        rows: all.len(),
        reach: found.len() as f64 / all.len() as f64,
        extent_m: found.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum(),
        mean_m: recorded.map(|(mean, _)| mean),
        p95_m: recorded.map(|(_, p95)| p95),
        shifted_mean_m: moved.map(|(mean, _)| mean),
        shifted_p95_m: moved.map(|(_, p95)| p95),
        shift_m: shifted.map(|shift| shift.norm()),
    })
}

/// The shift of the contacts with the least mean squared distance from a mesh: iterative closest points, translation only.
fn shift(contacts: &[Vector3<f64>], mesh: &[Triangle]) -> Vector3<f64> {
    const ITERATIONS: usize = 40;
    let mut shift = Vector3::zeros();
    for _ in 0..ITERATIONS {
        let off: Vector3<f64> =
            contacts.iter().map(|contact| nearest(&(contact + shift), mesh) - (contact + shift)).sum();
        let step = off / contacts.len() as f64;
        shift += step;
        if step.norm() < 1e-7 {
            break;
        }
    }
    shift
}
