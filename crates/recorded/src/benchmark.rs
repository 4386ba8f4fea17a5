//! Benchmark on recordings in space: sensor models on held-out lines, held-out lines and trials as pins, sweeps over objects.

use std::f64::consts::PI;
use std::path::Path;

use anyhow::{Context, ensure};
use files::{write_atomically, write_json};
use filters::quantile::{NORMAL_95, quantile_of_sorted};
use importers::{SpatialRecordings, SpatialSweep, Triangle, stanford_in_space};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use whisker::space::sensor::gaussian_process::{HeldOut, Kernel, Process};

use crate::calibration::Calibrated;
use crate::fixed::{Estimate, Reading, Settings};
use crate::mesh::{Face, distance_m, extent_m, nearest, vertex_distance_m};
use crate::paper::{self, PaperUkf};
use crate::pins::{Method, Mounting, PinScore, TOUCH, line, line_touch, replay, score, touch, touch_rows, wrong};
use crate::sweep::{SweepSettings, SweptContact, contacts};

/// Name of the estimator of fixed contacts.
pub const FIXED: &str = "fixed-point-batch";
/// Name of the published filter.
pub const PAPER: &str = "paper-ukf-3d";

/// Error of lines that cannot be held out.
const SINGULAR: &str = "singular covariance of held-out lines";

/// Least share of the contacts of a sweep that lie on a face whose distances are stated.
const FACE_SHARE: f64 = 0.1;

/// Error of a sensor model on held-out lines.
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
    /// Root mean square error of a channel on held-out lines, each held out together with its neighbours, over the largest reading.
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
    pub answered: f64,
    /// Share of these rows with such a contact that the whisker can reach: at an arc length of at most that
    /// at which pins slip off its tip. `None` without trials with pins.
    pub reach: Option<f64>,
    /// Length of the part of the mesh that the contacts cover (m), see [`extent_m`]. `None` without a mesh.
    pub extent_m: Option<f64>,
    /// Mean distance of the contacts from the surface of the mesh, as recorded (m). `None` without a mesh.
    pub mean_m: Option<f64>,
    /// 95th percentile of this distance (m).
    pub p95_m: Option<f64>,
    /// Mean distance of the contacts from the nearest vertex of the mesh, as recorded (m): the score of the publication.
    pub vertex_mean_m: Option<f64>,
    /// Standard deviation of this distance (m).
    pub vertex_sd_m: Option<f64>,
    /// Mean distance from the surface after one shift of the object for all of its sweeps, without rotation (m).
    pub shifted_mean_m: Option<f64>,
    /// 95th percentile after this shift (m).
    pub shifted_p95_m: Option<f64>,
    /// Stated standard deviation of the contacts across the surface, root mean square (m).
    pub normal_sd_m: Option<f64>,
    /// Share of the contacts whose distance from the surface after the shift is at most 1.96 times this standard deviation.
    pub shifted_coverage: Option<f64>,
    /// Mean of the squared distances after the shift, relative to the stated variance: 1 if it is right.
    pub shifted_nees: Option<f64>,
    /// Length of the shift (m).
    pub shift_m: Option<f64>,
    /// Shift of the contacts along x of the object's frame (m).
    pub shift_x_m: Option<f64>,
    /// The same along y.
    pub shift_y_m: Option<f64>,
    /// The same along z.
    pub shift_z_m: Option<f64>,
}

/// Distances of the contacts of one sweep from one face of the object: a plane of its mesh that is the nearest to at least a
/// tenth of the contacts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaceScore {
    /// Name of the sweep.
    pub name: String,
    /// Name of the object.
    pub object: String,
    /// Unit normal of the face, x.
    pub normal_x: f64,
    /// The same, y.
    pub normal_y: f64,
    /// The same, z.
    pub normal_z: f64,
    /// Distance of the plane from the origin of the object's frame along the normal (m).
    pub offset_m: f64,
    /// Number of contacts to which this face is the nearest, as recorded.
    pub contacts: usize,
    /// Mean distance of these contacts from the surface of the mesh, as recorded (m).
    pub mean_m: f64,
    /// 95th percentile of this distance (m).
    pub p95_m: f64,
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
    /// Sweeps, by the batch.
    pub sweeps: Vec<SweepScore>,
    /// Faces of the objects of these sweeps.
    pub faces: Vec<FaceScore>,
    /// Sweeps, by the published filter.
    pub paper_sweeps: Vec<SweepScore>,
    /// Calibrations and tests that could not be evaluated.
    pub failures: Vec<String>,
}

impl Benchmark {
    fn extend(&mut self, other: Self) {
        self.maps.extend(other.maps);
        self.pins.extend(other.pins);
        self.sweeps.extend(other.sweeps);
        self.faces.extend(other.faces);
        self.paper_sweeps.extend(other.paper_sweeps);
        self.failures.extend(other.failures);
    }
}

/// Contents of `space_settings.json`: settings that the results depend on.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettingsUsed {
    /// Settings of the estimator of fixed contacts.
    pub settings: Settings,
    /// Settings of the estimator of contacts in sweeps.
    pub sweep: SweepSettings,
    /// Kernels of the sensor model of each calibration, one for each channel.
    pub kernels: Vec<(String, [Kernel; 2])>,
}

/// Evaluates the recordings of a clone and writes `space_maps.csv`, `space_pins.csv`, `space_pins_summary.csv`,
/// `space_sweeps.csv`, `space_faces.csv`, `space_sweeps_paper.csv` and `space_settings.json` into `out`. The result does not depend
/// on the number of threads.
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
                match evaluate(&recordings, index, &calibrated) {
                    Ok(evaluated) => benchmark.extend(evaluated),
                    Err(error) => benchmark.failures.push(format!("{}: {error:#}", calibrated.name)),
                }
            }
            Err(error) => benchmark.failures.push(format!("{error:#}")),
        }
    }
    let stated = SettingsUsed { settings: Settings::default(), sweep: SweepSettings::default(), kernels };
    write_json(&out.join("space_settings.json"), &stated)?;
    write_atomically(&out.join("space_maps.csv"), &table(&benchmark.maps)?)?;
    write_atomically(&out.join("space_pins.csv"), &table(&benchmark.pins)?)?;
    write_atomically(&out.join("space_pins_summary.csv"), &table(&benchmark.summary())?)?;
    write_atomically(&out.join("space_sweeps.csv"), &table(&benchmark.sweeps)?)?;
    write_atomically(&out.join("space_faces.csv"), &table(&benchmark.faces)?)?;
    write_atomically(&out.join("space_sweeps_paper.csv"), &table(&benchmark.paper_sweeps)?)?;
    Ok(benchmark)
}

fn table<Row: Serialize>(rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner()?)
}

fn map_score(calibrated: &Calibrated, model: &str, process: &Process) -> anyhow::Result<MapScore> {
    let held: Vec<HeldOut> = process.held_out(&calibrated.neighbours).context(SINGULAR)?;
    let count = (2 * held.len()) as f64;
    let square: f64 = held.iter().map(|one| one.error.norm_squared()).sum();
    let nees = held.iter().map(|one| one.error.component_div(&one.sd).norm_squared()).sum::<f64>() / count;
    ensure!(nees.is_finite(), SINGULAR);
    Ok(MapScore {
        calibration: calibrated.name.clone(),
        model: model.into(),
        samples: calibrated.samples.len(),
        outliers: calibrated.samples.len() - held.len(),
        largest_counts: process.largest_reading,
        heldout_rms: (square / count).sqrt() / process.largest_reading,
        heldout_worst: held.iter().map(|one| one.error.amax()).fold(0.0, f64::max) / process.largest_reading,
        nees,
    })
}

/// Results with one calibration.
fn evaluate(recordings: &SpatialRecordings, index: usize, calibrated: &Calibrated) -> anyhow::Result<Benchmark> {
    let mut benchmark = Benchmark::default();
    let published = Process::new(&calibrated.process.samples, [paper::kernel(); 2]).context("singular covariance")?;
    benchmark.maps.push(map_score(calibrated, "gaussian-process", &calibrated.process)?);
    benchmark.maps.push(map_score(calibrated, "gaussian-process of paper-ukf-3d", &published)?);
    let least_counts = TOUCH * calibrated.process.largest_reading;
    let lines: Vec<Vec<PinScore>> = (0..calibrated.neighbours.len())
        .into_par_iter()
        .map(|index| {
            let Some(touch) = line_touch(&line(calibrated, index), least_counts) else { return Ok(Vec::new()) };
            let held = &calibrated.neighbours[index];
            let ours = calibrated.process.without(held).context(SINGULAR)?;
            let theirs = published.without(held).context(SINGULAR)?;
            // The sensor did not move between a line and the others.
            let settings = Settings { place_sd_m: 0.0, ..Settings::default() };
            let (group, name) = (format!("held-out lines, {}", calibrated.name), format!("line {index}"));
            let methods = [(FIXED, Method::Fixed(&ours, settings)), (PAPER, Method::Paper(&theirs, index as u64))];
            let scored = methods.into_iter().map(|(method, how)| score(&group, &name, method, &replay(how, &touch)));
            Ok(scored.flatten().collect())
        })
        .collect::<anyhow::Result<_>>()?;
    benchmark.pins.extend(lines.into_iter().flatten());
    let [ours, theirs] = [&calibrated.process, &published].map(|process| process.predictor());
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
                let methods = [(FIXED, fixed), (PAPER, Method::Paper(&theirs, i as u64))];
                scores.extend(
                    methods
                        .into_iter()
                        .filter_map(|(method, how)| score(&group, name, method, &replay(how, &corrected))),
                );
            }
            scores
        })
        .collect();
    benchmark.pins.extend(scored.into_iter().flatten());
    let sweeps: Vec<&SpatialSweep> = recordings.sweeps.iter().filter(|sweep| sweep.calibration == index).collect();
    let swept: Vec<Swept<'_>> = sweeps
        .par_iter()
        .enumerate()
        .filter_map(|(i, sweep)| Swept::new(calibrated, &published, sweep, i as u64, least_counts))
        .collect();
    let tip_m = tip_m(calibrated, trials.iter().map(|(.., touch)| touch.as_slice()));
    benchmark.sweeps.extend(scores(calibrated, tip_m, &swept, |swept| &swept.batch));
    benchmark.faces.extend(swept.iter().flat_map(Swept::faces));
    benchmark.paper_sweeps.extend(scores(calibrated, tip_m, &swept, |swept| &swept.paper));
    Ok(benchmark)
}

/// Arc length at which pins slip off the tip (m): median over trials of the outermost contact. `None` without trials.
fn tip_m<'a>(calibrated: &Calibrated, touches: impl Iterator<Item = &'a [Reading]>) -> Option<f64> {
    let arc_m = |reading: &Reading| calibrated.wire.arc_m(&reading.to_sensor(&Vector3::zeros()));
    let mut outermost_m: Vec<f64> =
        touches.filter_map(|touch| touch.iter().filter_map(arc_m).max_by(f64::total_cmp)).collect();
    outermost_m.sort_by(f64::total_cmp);
    outermost_m.get(outermost_m.len() / 2).copied()
}

/// Contacts of a sweep, one for each row of the touch; `None` where none is stated.
struct Swept<'a> {
    sweep: &'a SpatialSweep,
    /// Readings of the touch.
    readings: Vec<Reading>,
    /// Contacts by the batch.
    batch: Vec<Option<SweptContact>>,
    /// Contacts by the published filter.
    paper: Vec<Option<SweptContact>>,
}

impl<'a> Swept<'a> {
    /// `None` if the sweep never touches, see [`touch_rows`], or the batch states no contact. The published filter starts 5 mm from
    /// the first contact of the batch, in a direction drawn from `seed`.
    fn new(
        calibrated: &Calibrated,
        published: &Process,
        sweep: &'a SpatialSweep,
        seed: u64,
        least_counts: f64,
    ) -> Option<Self> {
        let touch = touch_rows(sweep.rows.iter().map(|(_, counts)| counts.norm()), least_counts)?;
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), PI);
        let reading =
            |(origin_m, counts): &(Vector3<f64>, _)| Reading { rotation, origin_m: *origin_m, counts: *counts };
        let mut readings: Vec<Reading> = sweep.rows[touch].iter().map(reading).collect();
        let batch = contacts(&calibrated.process.predictor(), &calibrated.root_m, &readings, &SweepSettings::default());
        let start_m = batch.iter().flatten().next()?.contact_m + wrong(seed);
        let predictor = published.predictor();
        let before = readings.remove(0);
        let mut filter = PaperUkf::new(&predictor, before, start_m);
        let contact = |Estimate { contact_m, covariance_m2, .. }: Estimate| SweptContact { contact_m, covariance_m2 };
        let paper = readings.iter().map(|reading| filter.step(*reading).map(contact)).collect();
        Some(Self { sweep, readings, batch, paper })
    }

    /// Distances of the batch's contacts from the faces on which at least [`FACE_SHARE`] of them lie.
    fn faces(&self) -> Vec<FaceScore> {
        let Some(mesh) = &self.sweep.mesh else { return Vec::new() };
        let mut faces: Vec<(Face, Vec<f64>)> = Vec::new();
        for SweptContact { contact_m, .. } in self.batch.iter().flatten() {
            let Some((face, distance_m)) = Face::nearest(contact_m, mesh) else { continue };
            match faces.iter_mut().find(|(known, _)| known.is(&face)) {
                Some((_, distances)) => distances.push(distance_m),
                None => faces.push((face, vec![distance_m])),
            }
        }
        let contacts: usize = faces.iter().map(|(_, distances)| distances.len()).sum();
        let least = FACE_SHARE * contacts as f64;
        let stated = faces.into_iter().filter(|(_, distances)| distances.len() as f64 >= least);
        stated
            .map(|(face, mut distances)| {
                let (mean_m, p95_m) = mean_and_p95(&mut distances);
                FaceScore {
                    name: self.sweep.name.clone(),
                    object: self.sweep.object.clone(),
                    normal_x: face.normal.x,
                    normal_y: face.normal.y,
                    normal_z: face.normal.z,
                    offset_m: face.offset_m,
                    contacts: distances.len(),
                    mean_m,
                    p95_m,
                }
            })
            .collect()
    }
}

/// Mean and 95th percentile of distances, of which there is at least one.
fn mean_and_p95(distances: &mut [f64]) -> (f64, f64) {
    distances.sort_by(f64::total_cmp);
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    (mean, quantile_of_sorted(distances, 0.95).expect("there is one"))
}

/// Scores of an estimator's contacts. All sweeps over one object have one shift.
fn scores<'a>(
    calibrated: &Calibrated,
    tip_m: Option<f64>,
    swept: &[Swept<'a>],
    of: impl for<'b> Fn(&'b Swept<'a>) -> &'b [Option<SweptContact>] + Sync,
) -> Vec<SweepScore> {
    let shift_of = |object: &str| {
        let same = || swept.iter().filter(|other| other.sweep.object == object);
        let mesh = same().find_map(|other| other.sweep.mesh.as_ref())?;
        let found: Vec<Vector3<f64>> =
            same().flat_map(|other| of(other).iter().flatten().map(|found| found.contact_m)).collect();
        (!found.is_empty()).then(|| shift(&found, mesh))
    };
    let mut objects: Vec<&str> = swept.iter().map(|one| one.sweep.object.as_str()).collect();
    objects.sort_unstable();
    objects.dedup();
    let shifts: Vec<(&str, Option<Vector3<f64>>)> =
        objects.par_iter().map(|object| (*object, shift_of(object))).collect();
    let score = |one: &Swept<'a>| {
        let (sweep, all) = (one.sweep, of(one));
        let found: Vec<Vector3<f64>> = all.iter().flatten().map(|found| found.contact_m).collect();
        let is_within = |tip_m: f64, contact: &Option<SweptContact>, reading: &Reading| {
            let arc_m = contact.and_then(|contact| calibrated.wire.arc_m(&reading.to_sensor(&contact.contact_m)));
            arc_m.is_some_and(|arc_m| arc_m <= tip_m)
        };
        let reach = tip_m.map(|tip_m| {
            let rows = all.iter().zip(&one.readings);
            rows.filter(|(contact, reading)| is_within(tip_m, contact, reading)).count() as f64 / all.len() as f64
        });
        let mesh = sweep.mesh.as_ref().filter(|_| !found.is_empty());
        let surface = |shift_m: Vector3<f64>| {
            let mesh = mesh?;
            let mut distances: Vec<f64> = found.iter().map(|contact| distance_m(&(contact + shift_m), mesh)).collect();
            Some(mean_and_p95(&mut distances))
        };
        let vertex = mesh.map(|mesh| {
            let distances: Vec<f64> = found.iter().map(|contact| vertex_distance_m(contact, mesh)).collect();
            let mean = distances.iter().sum::<f64>() / distances.len() as f64;
            let square = distances.iter().map(|distance| (distance - mean).powi(2)).sum::<f64>();
            (mean, (square / distances.len() as f64).sqrt())
        });
        let shift_m = shifts.iter().find(|(object, _)| *object == sweep.object).and_then(|(_, shift)| *shift);
        let (recorded, moved) = (surface(Vector3::zeros()), shift_m.and_then(surface));
        let stated = shift_m.zip(mesh).and_then(|(shift_m, mesh)| Stated::of(all.iter().flatten(), shift_m, mesh));
        SweepScore {
            name: sweep.name.clone(),
            object: sweep.object.clone(),
            rows: all.len(),
            answered: found.len() as f64 / all.len() as f64,
            reach,
            extent_m: mesh.map(|mesh| extent_m(&found, mesh)),
            mean_m: recorded.map(|(mean, _)| mean),
            p95_m: recorded.map(|(_, p95)| p95),
            vertex_mean_m: vertex.map(|(mean, _)| mean),
            vertex_sd_m: vertex.map(|(_, sd)| sd),
            shifted_mean_m: moved.map(|(mean, _)| mean),
            shifted_p95_m: moved.map(|(_, p95)| p95),
            normal_sd_m: stated.map(|stated| stated.sd_m),
            shifted_coverage: stated.map(|stated| stated.coverage),
            shifted_nees: stated.map(|stated| stated.nees),
            shift_m: shift_m.map(|shift| shift.norm()),
            shift_x_m: shift_m.map(|shift| shift.x),
            shift_y_m: shift_m.map(|shift| shift.y),
            shift_z_m: shift_m.map(|shift| shift.z),
        }
    };
    swept.par_iter().map(score).collect()
}

/// Stated uncertainty of contacts across a surface, and the errors in units of it.
#[derive(Clone, Copy, Debug)]
struct Stated {
    sd_m: f64,
    coverage: f64,
    nees: f64,
}

impl Stated {
    /// That of shifted contacts across the nearest face of a mesh. `None` without contacts, or if no triangle has an area.
    fn of<'a>(
        contacts: impl Iterator<Item = &'a SweptContact>,
        shift_m: Vector3<f64>,
        mesh: &[Triangle],
    ) -> Option<Self> {
        let (mut count, mut variance_m2, mut covered, mut nees) = (0.0, 0.0, 0.0, 0.0);
        for SweptContact { contact_m, covariance_m2 } in contacts {
            let (Face { normal, .. }, distance_m) = Face::nearest(&(contact_m + shift_m), mesh)?;
            let of_contact_m2 = normal.dot(&(covariance_m2 * normal));
            let squared = distance_m.powi(2) / of_contact_m2;
            count += 1.0;
            variance_m2 += of_contact_m2;
            covered += f64::from(squared <= NORMAL_95.powi(2));
            nees += squared;
        }
        (count > 0.0).then(|| Self {
            sd_m: (variance_m2 / count).sqrt(),
            coverage: covered / count,
            nees: nees / count,
        })
    }
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

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn val_the_95th_percentile_is_interpolated() {
        let mut distances: Vec<f64> = (0..20).rev().map(f64::from).collect();
        let (mean, p95) = mean_and_p95(&mut distances);
        assert!(mean == 9.5 && (p95 - 18.05).abs() < 1e-12, "{mean} {p95}");
        assert_eq!(mean_and_p95(&mut [3.0]), (3.0, 3.0));
    }

    /// A square of 40 mm in the plane of x and z, and a triangle without area nearer to the contacts.
    const MESH: [Triangle; 3] = [
        [[0.0, 1e-3, 0.0], [0.02, 1e-3, 0.02], [0.04, 1e-3, 0.04]],
        [[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.04, 0.0, 0.04]],
        [[0.0, 0.0, 0.0], [0.04, 0.0, 0.04], [0.0, 0.0, 0.04]],
    ];

    #[test]
    fn verif_stated_uncertainty_is_that_across_the_face() {
        let covariance_m2 = Matrix3::from_diagonal(&Vector3::new(1e-4, 1e-8, 1e-4));
        let at = |y_m: f64| SweptContact { contact_m: Vector3::new(0.02, y_m, 0.02), covariance_m2 };
        let contacts = [at(0.9e-4), at(2.9e-4)];
        let shift_m = Vector3::new(0.0, 1e-5, 0.0);
        let stated = Stated::of(contacts.iter(), shift_m, &MESH).expect("a face");
        assert!((stated.sd_m - 1e-4).abs() < 1e-15 && stated.coverage == 0.5, "{stated:?}");
        assert!((stated.nees - 5.0).abs() < 1e-9, "{stated:?}");
        assert!(Stated::of(contacts.iter(), shift_m, &MESH[..1]).is_none());
        assert!(Stated::of([].iter(), shift_m, &MESH).is_none());
    }
}
