//! Fit of sensor models: calibration traces to calibration files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::{Watermark, check_replaces_own, read_json, write_atomically, write_json};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::Value;
use testbed::contour::true_circle;
use testbed::dataset::Dataset;
use testbed::front_end::{FrontEnd, FrontEndConfig, Mounting, SensorInput};
use testbed::results::{ResidualRow, SurfaceRow, csv_bytes, face_stem};
use testbed::settings::merged;
use testbed::statistics::mean;
use trace::{
    CalibrationFile, Characteristic, FaceFile, FittedData, FrontEndFile, Recorded, Role, SensorFile, Sidecar, Trace,
    TruthInstant, data_sha256,
};
use whisker::Whisker;
use whisker::sensor::{self, AlongAway, CalibratedFace, Face, Fit, FitData, ModelError, PinFriction, Sample};

use crate::glitches;
use crate::provenance::calibration_watermark;

/// Numbers of nodes, along and away from the undeflected whisker, of the grid on which a fitted model is tabulated for the report.
const SURFACE_NODES: (usize, usize) = (81, 41);

/// Largest number of residuals per face that are written for the report. More are thinned evenly.
const MOST_RESIDUALS: usize = 3000;

/// Tables about a face beside its calibration, for the report.
const REPORT_TABLES: [&str; 2] = ["surface", "residuals"];

/// Sensor models to fit.
#[derive(Clone, Debug)]
pub enum Models {
    /// Every candidate of the registry, chosen from by cross-validation.
    Auto,
    /// One model.
    One {
        /// Name of the model in the registry.
        kind: String,
        /// Settings of the model, over its defaults.
        config: Value,
    },
}

/// A sensor model to be fitted.
struct Candidate {
    row: &'static sensor::ModelRow,
    /// Settings as given, over the defaults.
    own: Value,
    /// All settings.
    config: Value,
}

impl Candidate {
    fn new(row: &'static sensor::ModelRow, own: Value) -> anyhow::Result<Self> {
        Ok(Self { row, config: merged((row.defaults)(), &own)?, own })
    }
}

impl Models {
    fn candidates(&self) -> anyhow::Result<Vec<Candidate>> {
        match self {
            Self::Auto => sensor::MODELS
                .iter()
                .flat_map(|row| (row.candidates)().into_iter().map(move |own| Candidate::new(row, own)))
                .collect(),
            Self::One { kind, config } => Ok(vec![Candidate::new(sensor::model(kind)?, config.clone())?]),
        }
    }
}

/// Settings of a fit.
#[derive(Clone, Debug)]
pub struct FitSettings {
    /// Sensor models.
    pub models: Models,
    /// Measurement noise that is added to simulated traces, as a fraction of the largest reading of a whisker's calibration.
    pub noise: f64,
    /// Seed of that noise and of the noise of the front end.
    pub seed: u64,
    /// The front end through which the traces are read.
    pub front_end: FrontEndConfig,
    /// Sensors to calibrate beside those of the dataset's traces.
    pub sensors: Vec<Mounting>,
}

/// Calibration of one whisker and its file.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The calibration.
    pub calibration: CalibrationFile,
    /// Path of its file.
    pub path: PathBuf,
    /// Whether it was computed. `false` if an up-to-date file was found.
    pub is_new: bool,
    /// Candidates that the data do not determine, with the reasons. Empty if an up-to-date file was found.
    pub left_out: Vec<String>,
    /// Traces from which glitches were left out, single readings far above all others: name, number of these readings and of all
    /// rows.
    pub gated: Vec<(String, usize, usize)>,
    /// Reason why the calibration of recordings has no sensor. `None` if it has one, or an up-to-date file was found.
    pub no_sensor: Option<String>,
}

/// Fits every whisker with calibration traces in the dataset and writes its calibration, unless an up-to-date one is there.
/// The unit of progress is one candidate for one face.
///
/// # Errors
/// If traces cannot be read, contradict one another, or do not determine the model.
pub fn fit(
    dataset: &Dataset,
    settings: &FitSettings,
    out: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<Fitted>> {
    let candidates = settings.models.candidates()?;
    let front_end = FrontEnd::new(&settings.front_end)?;
    let mut whiskers: BTreeMap<String, Vec<Trace>> = BTreeMap::new();
    let mut gated: BTreeMap<String, Vec<(String, usize, usize)>> = BTreeMap::new();
    for mut trace in dataset.read(Role::Calibration)? {
        front_end.check_trace(&trace.sidecar)?;
        if !trace.sidecar.is_object_at_rest() {
            bail!(
                "{}: scene: found an object that moves or gives way, expected one at rest in a calibration",
                trace.sidecar.name
            );
        }
        let (whisker, name, rows) =
            (trace.sidecar.whisker.name.clone(), trace.sidecar.name.clone(), trace.sidecar.rows);
        match leave_out_glitches(&mut trace) {
            0 => {}
            glitches => gated.entry(whisker.clone()).or_default().push((name, glitches, rows)),
        }
        whiskers.entry(whisker).or_default().push(trace);
    }
    progress
        .set_length(whiskers.values().map(|traces| faces_of(traces).count() * candidates.len()).sum::<usize>() as u64);
    whiskers
        .iter()
        .map(|(whisker, traces)| {
            let mountings = mountings(dataset, whisker, settings)?;
            let (candidates, front_end, mountings) = (&candidates, &front_end, &mountings);
            let (folder, gated) = (&dataset.folder, gated.remove(whisker).unwrap_or_default());
            let whisker = &traces[0].sidecar.whisker;
            let fit = WhiskerFit { whisker, candidates, traces, front_end, mountings, settings, folder, out, progress };
            Ok(Fitted { gated, ..fit.run()? })
        })
        .collect()
}

/// Removes the rows with glitches, which no contact explains. Returns their number.
fn leave_out_glitches(trace: &mut Trace) -> usize {
    let glitches = glitches::rows(&trace.moments_n_m());
    for row in glitches.iter().rev() {
        trace.recording.instants.remove(*row);
        trace.truth.instants.remove(*row);
    }
    glitches.len()
}

/// Faces that the traces touch.
fn faces_of(traces: &[Trace]) -> impl Iterator<Item = Face> {
    [Face::Left, Face::Right].into_iter().filter(|face| traces.iter().any(|trace| trace.sidecar.face == *face))
}

/// The sensors with a whisker, each once.
fn mountings(dataset: &Dataset, whisker: &str, settings: &FitSettings) -> anyhow::Result<Vec<Mounting>> {
    let mut mountings = Vec::new();
    for path in &dataset.paths {
        let sidecar: Sidecar = read_json(&path.with_extension("json"))?;
        if sidecar.whisker.name == whisker {
            mountings.push(Mounting::of(&dataset.folder, &sidecar)?);
        }
    }
    mountings.extend(settings.sensors.iter().cloned());
    let mut seen = BTreeSet::new();
    mountings.retain(|mounting| seen.insert((mounting.array.clone(), mounting.sensor.clone())));
    Ok(mountings)
}

/// The fit of one whisker.
struct WhiskerFit<'a> {
    whisker: &'a Whisker,
    candidates: &'a [Candidate],
    /// Calibration traces, at least one.
    traces: &'a [Trace],
    front_end: &'a FrontEnd,
    /// Sensors with this whisker.
    mountings: &'a [Mounting],
    settings: &'a FitSettings,
    /// Folder of the traces.
    folder: &'a Path,
    /// Folder of the calibrations.
    out: &'a Path,
    progress: &'a ProgressBar,
}

impl WhiskerFit<'_> {
    /// Fits the whisker, unless an up-to-date calibration is there.
    fn run(&self) -> anyhow::Result<Fitted> {
        let whisker = self.whisker;
        let difference = |trace: &Trace| Some((trace.sidecar.name.clone(), trace.sidecar.whisker.difference(whisker)?));
        if let Some((other, difference)) = self.traces.iter().find_map(difference) {
            bail!(
                "{other}: whisker.{difference}, as in {}, whose whisker has the same name",
                self.traces[0].sidecar.name
            );
        }
        let data_sha256 = data_sha256(self.traces.iter().map(|trace| trace.sidecar.data_sha256()));
        let watermark = self.watermark(&data_sha256)?;
        let path = self.out.join(format!("{}.json", whisker.name));
        check_replaces_calibration(&path, files::FORMAT)?;
        if let Some(calibration) = self.up_to_date(&path, &watermark) {
            self.progress.inc((faces_of(self.traces).count() * self.candidates.len()) as u64);
            let (left_out, gated, no_sensor) = (Vec::new(), Vec::new(), None);
            return Ok(Fitted { calibration, path, is_new: false, left_out, gated, no_sensor });
        }
        let is_recorded =
            are_recordings(self.traces.iter().map(|trace| (&*trace.sidecar.name, trace.sidecar.recorded.is_some())))?;
        // The readings of a recording already contain noise.
        let noise = if is_recorded { 0.0 } else { self.settings.noise };
        let (front_end, readings_n_m) = self.read(noise)?;
        let (faces, left_out) = self.faces(&readings_n_m)?;
        let traces = self.traces.iter().map(|trace| trace.sidecar.name.clone()).collect();
        let (sensor, no_sensor) = match is_recorded.then(|| self.recorded_sensor()).transpose() {
            Ok(sensor) => (sensor, None),
            Err(reason) => (None, Some(format!("whisker `{}`: {reason}", whisker.name))),
        };
        let data =
            FittedData { noise_fraction: noise, seed: self.settings.seed, front_end, sensor, data_sha256, traces };
        let calibration = CalibrationFile::new(whisker.clone(), data, faces, watermark);
        write_json(&path, &calibration)?;
        Ok(Fitted { calibration, path, is_new: true, left_out, gated: Vec::new(), no_sensor })
    }

    /// The sensor of the recordings, with the root mean square of their noise.
    ///
    /// # Errors
    /// If the recordings do not state one and the same characteristic. Their moments can be fitted all the same.
    fn recorded_sensor(&self) -> Result<SensorFile, String> {
        let stated = |trace: &Trace| {
            trace.sidecar.recorded.as_ref().and_then(Recorded::characteristic).ok_or_else(|| {
                let name = &trace.sidecar.name;
                format!(
                    "{name}: recorded.range_n_m: found none, expected the range of the characteristic; import the \
                    recording again"
                )
            })
        };
        let first = &self.traces[0];
        let characteristic = stated(first)?;
        for trace in &self.traces[1..] {
            let found = stated(trace)?;
            if found != characteristic {
                return Err(format!(
                    "{}: recorded.characteristic: found {}, expected {}, as in {}; import all recordings by one mapping",
                    trace.sidecar.name,
                    described(&found),
                    described(&characteristic),
                    first.sidecar.name
                ));
            }
        }
        let noise_sd_n_m = rms_noise_n_m(self.traces.iter().map(|trace| trace.sidecar.own_noise_sd_n_m()));
        Ok(SensorFile::recorded(&self.whisker.name, characteristic, noise_sd_n_m))
    }

    /// Watermark of the calibration from everything that determines it.
    fn watermark(&self, data_sha256: &str) -> anyhow::Result<Watermark> {
        let mut inputs = vec![data_sha256.to_owned(), serde_json::to_string(self.whisker)?];
        inputs.extend(self.candidates.iter().map(|it| format!("{} {}", it.row.kind, it.config)));
        inputs.extend([self.settings.noise.to_string(), self.settings.seed.to_string()]);
        inputs.push(serde_json::to_string(&self.front_end.describe(Vec::new()))?);
        inputs.extend(self.mountings.iter().map(|mounting| {
            let board: Vec<_> = mounting.board.iter().map(|slot| (&slot.sensor, slot.base.to_homogeneous())).collect();
            format!("{}/{} on {board:?}", mounting.array, mounting.sensor)
        }));
        Ok(calibration_watermark(inputs.iter().map(String::as_str)))
    }

    /// The calibration in the file, if it has this watermark and the tables of the report lie beside it.
    fn up_to_date(&self, path: &Path, watermark: &Watermark) -> Option<CalibrationFile> {
        let has_tables = |face: &FaceFile| {
            let stem = face_stem(&self.whisker.name, face.face);
            REPORT_TABLES.iter().all(|table| self.out.join(format!("{stem}.{table}.csv")).is_file())
        };
        CalibrationFile::read(path).ok().filter(|calibration| {
            calibration.watermark.inputs_sha256 == watermark.inputs_sha256 && calibration.faces.iter().all(has_tables)
        })
    }

    /// Calibrates the sensors and reads every trace through them. Noise is relative to the largest reading.
    fn read(&self, noise: f64) -> anyhow::Result<(Option<FrontEndFile>, Vec<Vec<f64>>)> {
        let instants = self.traces.iter().flat_map(|trace| &trace.recording.instants);
        let largest_n_m = instants.map(|instant| instant.moment_z_n_m.abs()).fold(0.0, f64::max);
        let own: Vec<Mounting> = self.traces.iter().map(|trace| Mounting::alone(&trace.sidecar)).collect();
        let input = |(trace, mounting)| SensorInput::new(trace, mounting, noise * largest_n_m, self.settings.seed);
        let mut inputs: Vec<SensorInput> = self.traces.iter().zip(&own).map(input).collect();
        let place = || format!("whisker `{}`", self.whisker.name);
        let sensors = self.front_end.calibrate(self.mountings, &inputs).with_context(place)?;
        let mut readings_n_m = Vec::new();
        for input in &mut inputs {
            let Mounting { array, sensor, .. } = input.mounting;
            input.sensor = sensors.as_ref().and_then(|file| file.sensor(array, sensor));
            readings_n_m.push(self.front_end.readings_n_m(input)?);
        }
        Ok((sensors, readings_n_m))
    }

    /// Fits every face with traces and writes the tables of the report. Returns the reasons of failed candidates too.
    fn faces(&self, readings_n_m: &[Vec<f64>]) -> anyhow::Result<(Vec<FaceFile>, Vec<String>)> {
        let (mut faces, mut left_out) = (Vec::new(), Vec::new());
        for face in faces_of(self.traces) {
            let read = self.traces.iter().zip(readings_n_m).filter(|(trace, _)| trace.sidecar.face == face);
            let read: Vec<Read> = read.map(|(trace, readings_n_m)| Read { trace, readings_n_m }).collect();
            let of_face: Vec<&Trace> = read.iter().map(|read| read.trace).collect();
            let place = || format!("whisker `{}`, face {}", self.whisker.name, face.name());
            let fitted = fit_face(self.candidates, self.whisker, face, &read, self.folder, self.progress);
            let FaceFits { fits, friction, reference, failed } = fitted.with_context(place)?;
            left_out.extend(failed.iter().map(|reason| format!("{}: {reason}", place())));
            let file = FaceFile::new(&fits, friction).expect("there is a fit");
            let chosen = fits.iter().find(|fit| fit.face.label == file.chosen);
            let chosen = chosen.expect("the chosen one is among the fits");
            write_for_report(chosen, self.whisker, &of_face, &reference, self.out)?;
            faces.push(file);
        }
        Ok((faces, left_out))
    }
}

/// Coefficients and range of a characteristic, for messages.
fn described(characteristic: &Characteristic) -> String {
    let Characteristic { coefficients, range_n_m: [least, most] } = characteristic;
    format!("{coefficients:?} from {least:e} to {most:e} N m")
}

/// Checks that a calibration of a format replaces nothing but a calibration of this format or an empty file. A link is
/// replaced itself.
///
/// # Errors
/// If there is another file.
pub(crate) fn check_replaces_calibration(path: &Path, format: u32) -> Result<(), files::Error> {
    if path.is_symlink() {
        return Ok(());
    }
    check_replaces_own(path, &format!("a calibration of format {format}"), |path| {
        read_json::<Value>(path).is_ok_and(|file| file["kind"] == "calibration" && file["format"] == format)
    })
}

/// A calibration trace as the sensor read it.
struct Read<'a> {
    trace: &'a Trace,
    readings_n_m: &'a [f64],
}

/// Fits to the readings of one face.
struct FaceFits {
    /// Those of the candidates that the readings determine, at least one.
    fits: Vec<Fit>,
    /// Friction that was removed from the readings.
    friction: Option<PinFriction>,
    /// Samples of each trace that the fits were compared with.
    reference: Vec<Vec<Sample>>,
    /// Reasons why other candidates were left out.
    failed: Vec<String>,
}

fn fit_face(
    candidates: &[Candidate],
    whisker: &Whisker,
    face: Face,
    read: &[Read],
    folder: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<FaceFits> {
    let measured: Vec<Vec<Sample>> = read.iter().map(|read| contacts(read.trace, read.readings_n_m)).collect();
    let reference: Vec<Vec<Sample>> = read.iter().map(|read| clean_contacts(read.trace)).collect();
    let material = FitData {
        whisker,
        face,
        measured: &measured,
        reference: &reference,
        reference_noise_sd_n_m: rms_noise_n_m(read.iter().map(|read| read.trace.sidecar.own_noise_sd_n_m())),
        pin_radius_m: pin_radius_m(read.iter().map(|read| read.trace), folder)?,
    };
    let without_friction = sensor::without_friction(&material);
    let material = without_friction.as_ref().map_or(material, |without| without.applied_to(material));
    let fit = |candidate: &Candidate| sensor::fit(candidate.row, &candidate.config, &material);
    let name = |candidate: &Candidate| format!("{} {}", candidate.row.kind, candidate.own);
    let (fits, failed) = determined(candidates, fit, name, progress)?;
    let reference = material.reference.to_vec();
    Ok(FaceFits { fits, friction: without_friction.map(|without| without.friction), reference, failed })
}

/// Fits the candidates in parallel. Returns the fits of those that the data determine, at least one, and the reasons why others
/// were left out; the only candidate is never left out.
///
/// # Errors
/// If settings are invalid, or the data determine no candidate.
pub(crate) fn determined<C: Sync, F: Send>(
    candidates: &[C],
    fit: impl Fn(&C) -> Result<F, ModelError> + Sync,
    name: impl Fn(&C) -> String,
    progress: &ProgressBar,
) -> anyhow::Result<(Vec<F>, Vec<String>)> {
    let counted = |candidate: &C| {
        let fitted = fit(candidate);
        progress.inc(1);
        fitted
    };
    let fitted: Vec<Result<F, ModelError>> = candidates.par_iter().map(counted).collect();
    let (mut fits, mut failed) = (Vec::new(), Vec::new());
    for (candidate, fitted) in candidates.iter().zip(fitted) {
        match fitted {
            Ok(fit) => fits.push(fit),
            Err(ModelError::Data(reason)) if candidates.len() > 1 => {
                failed.push(format!("{}: {reason}", name(candidate)))
            }
            Err(error) => return Err(error.into()),
        }
    }
    if fits.is_empty() {
        bail!("no sensor model can be fitted; the first: {}", failed[0]);
    }
    Ok((fits, failed))
}

/// Whether the calibration traces of a whisker, by name, are recordings.
///
/// # Errors
/// If only some of them are: simulated readings are without noise, unlike recorded ones.
pub(crate) fn are_recordings<'a>(traces: impl IntoIterator<Item = (&'a str, bool)>) -> anyhow::Result<bool> {
    let mut traces = traces.into_iter();
    let Some((first, are_recorded)) = traces.next() else { return Ok(false) };
    if let Some((other, is_recorded)) = traces.find(|(_, is_recorded)| *is_recorded != are_recorded) {
        let kind = |is_recorded| if is_recorded { "a recording" } else { "a simulated trace" };
        bail!("{other}: found {}, expected {}, as {first}", kind(is_recorded), kind(are_recorded));
    }
    Ok(are_recorded)
}

/// Root mean square, over traces, of the standard deviations of their noise (N m).
pub(crate) fn rms_noise_n_m(sds_n_m: impl Iterator<Item = f64>) -> f64 {
    mean(sds_n_m.map(|sd_n_m| sd_n_m * sd_n_m)).unwrap_or_default().sqrt()
}

/// Whether a contact, if there is one, is single and on the side of the whisker.
fn is_single(truth: &TruthInstant) -> bool {
    truth.tip != Some(true) && truth.split != Some(true)
}

fn clean_contacts(trace: &Trace) -> Vec<Sample> {
    contacts(trace, &trace.moments_n_m())
}

/// Known single contacts of a calibration trace on the side of the whisker. The mechanics of other contacts differ.
fn contacts(trace: &Trace, readings_n_m: &[f64]) -> Vec<Sample> {
    trace
        .recording
        .instants
        .iter()
        .zip(&trace.truth.instants)
        .zip(readings_n_m)
        .filter(|((_, truth), _)| is_single(truth))
        .filter_map(|((known, truth), &reading_n_m)| {
            Some(Sample { contact: known.base.inverse().apply(truth.contact?), reading_n_m })
        })
        .collect()
}

/// Sum of the radii of the pin and of the wire: mean distance of the known single contacts on the side of the whisker
/// from the centre of the pin. 0 if the outline is unknown or not round.
fn pin_radius_m<'a>(traces: impl Iterator<Item = &'a Trace>, folder: &Path) -> anyhow::Result<f64> {
    let mut distances_m = Vec::new();
    for trace in traces {
        let Some(pin) = trace.outline(folder)?.as_ref().and_then(true_circle) else { return Ok(0.0) };
        let truths = trace.truth.instants.iter().filter(|truth| is_single(truth));
        distances_m.extend(truths.filter_map(|truth| truth.contact).map(|contact| contact.distance(&pin.center)));
    }
    Ok(mean(distances_m).unwrap_or_default())
}

fn write_for_report(
    fit: &Fit,
    whisker: &Whisker,
    traces: &[&Trace],
    reference: &[Vec<Sample>],
    out: &Path,
) -> anyhow::Result<()> {
    let stem = face_stem(&whisker.name, fit.face.face);
    let path = out.join(format!("{stem}.surface.csv"));
    write_atomically(&path, &csv_bytes(&surface(&fit.face))?)?;

    // The largest residuals are always kept.
    let stride = fit.samples.div_ceil(MOST_RESIDUALS);
    let is_extreme = |residual: f64| residual.abs() > 0.8 * fit.face.heldout_worst_n_m;
    let mut rows = Vec::new();
    for ((trace, samples), residuals) in traces.iter().zip(reference).zip(&fit.residuals_n_m) {
        for (i, (sample, residual_n_m)) in samples.iter().zip(residuals).enumerate() {
            if i % stride != 0 && !is_extreme(*residual_n_m) {
                continue;
            }
            rows.push(ResidualRow {
                trace: trace.sidecar.name.clone(),
                x_m: sample.contact.x(),
                y_m: sample.contact.y(),
                reading_n_m: sample.reading_n_m,
                residual_n_m: *residual_n_m,
            });
        }
    }
    write_atomically(&out.join(format!("{stem}.residuals.csv")), &csv_bytes(&rows)?)?;
    Ok(())
}

fn surface(face: &CalibratedFace) -> Vec<SurfaceRow> {
    let (along, across) = SURFACE_NODES;
    let (low, high) = face.domain.arc_range_m();
    let mut rows = Vec::with_capacity(along * across);
    for i in 0..along {
        let arc_m = low + (high - low) * i as f64 / (along - 1) as f64;
        let (lower, upper) = face.domain.away_range_m(arc_m);
        for j in 0..across {
            let distance_m = lower + (upper - lower) * j as f64 / (across - 1) as f64;
            let contact = face.contact_at(AlongAway::new(arc_m, distance_m));
            rows.push(SurfaceRow {
                arc_m,
                distance_m,
                x_m: contact.x(),
                y_m: contact.y(),
                reading_n_m: face.model.reading_n_m(contact),
            });
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_recordings_and_simulated_traces_are_not_fitted_together() {
        assert!(!are_recordings([("one", false), ("two", false)]).unwrap());
        assert!(are_recordings([("one", true), ("two", true)]).unwrap());
        let refused = are_recordings([("one", false), ("two", false), ("three", true)]).unwrap_err().to_string();
        assert_eq!(refused, "three: found a recording, expected a simulated trace, as one");
    }
}
