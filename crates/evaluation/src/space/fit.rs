//! Fit of sensor models in space: calibration traces to calibration files of format 2.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::{Watermark, write_json};
use indicatif::ProgressBar;
use nalgebra::Vector2;
use serde_json::Value;
use testbed::dataset::Dataset;
use testbed::front_end::{FrontEndConfig, SpatialFrontEnd, SpatialInput};
use testbed::settings::merged;
use testbed::space::{largest_reading_n_m, to_base};
use trace::{
    BendingSensor, FittedData, Role, SPATIAL_FORMAT, SpatialCalibrationFile, SpatialRecorded, SpatialSensor,
    SpatialTrace, data_sha256,
};
use whisker::space::frames::Point;
use whisker::space::sensor::{
    self, Across, SPATIAL_MODELS, Screening, SpatialFitData, SpatialModelRow, SpatialSample, SpatialWhisker,
};

use crate::fit::{Models, are_recordings, check_replaces_calibration, determined, rms_noise_n_m};
use crate::provenance::calibration_watermark;

/// Settings of a fit in space.
#[derive(Clone, Debug)]
pub struct SpatialFitSettings {
    /// Sensor models.
    pub models: Models,
    /// White noise that is added to the readings, as a fraction of the largest bending moment of a whisker's calibration.
    pub noise: f64,
    /// Seed of that noise and of the front end.
    pub seed: u64,
    /// Front end through which the traces are read.
    pub front_end: FrontEndConfig,
}

/// Calibration of one whisker and its file.
#[derive(Clone, Debug)]
pub struct SpatialFitted {
    /// The calibration.
    pub calibration: SpatialCalibrationFile,
    /// Path of its file.
    pub path: PathBuf,
    /// Whether it was computed. `false` if an up-to-date file was found.
    pub is_new: bool,
    /// Contacts that cannot be fitted and candidates that the data do not determine, with the reasons. Empty if an up-to-date file
    /// was found.
    pub left_out: Vec<String>,
    /// Reason why the calibration of recordings has no sensor. `None` if it has one, or an up-to-date file was found.
    pub no_sensor: Option<String>,
}

/// A sensor model to be fitted.
struct Candidate {
    row: &'static SpatialModelRow,
    /// Settings as given, over the defaults.
    own: Value,
    /// All settings.
    config: Value,
}

/// The sensor models to be fitted, given whether the sensor is a real one.
fn candidates(models: &Models, real_sensor: bool) -> anyhow::Result<Vec<Candidate>> {
    let candidate = |row: &'static SpatialModelRow, own: Value| -> anyhow::Result<Candidate> {
        Ok(Candidate { row, config: merged((row.defaults)(), &own)?, own })
    };
    match models {
        Models::Auto => {
            let of_row =
                |row: &'static SpatialModelRow| (row.candidates)(real_sensor).into_iter().map(move |own| (row, own));
            SPATIAL_MODELS.iter().flat_map(of_row).map(|(row, own)| candidate(row, own)).collect()
        }
        Models::One { kind, config } => Ok(vec![candidate(sensor::spatial_model(kind)?, config.clone())?]),
    }
}

/// Fits every whisker with calibration traces in the dataset and writes its calibration, unless an up-to-date one is there.
/// The unit of progress is one candidate for one whisker.
///
/// # Errors
/// If traces cannot be read, contradict one another, or do not determine the model.
pub fn fit(
    dataset: &Dataset,
    settings: &SpatialFitSettings,
    out: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<SpatialFitted>> {
    let front_end = SpatialFrontEnd::new(&settings.front_end)?;
    let mut whiskers: BTreeMap<String, Subject> = BTreeMap::new();
    for path in dataset.of_role(Role::Calibration)? {
        let trace = SpatialTrace::read(path)?;
        let sidecar = &trace.sidecar;
        let subject = match whiskers.entry(sidecar.whisker.name.clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let candidates = candidates(&settings.models, sidecar.recorded.is_some())?;
                new.insert(Subject { candidates, traces: Vec::new() })
            }
        };
        subject.traces.push(trace);
    }
    progress.set_length(whiskers.values().map(|subject| subject.candidates.len() as u64).sum());
    let fit = WhiskerFit { front_end: &front_end, settings, out, progress };
    whiskers.values().map(|subject| fit.run(subject)).collect()
}

/// Calibration traces of a whisker, and the sensor models to be fitted to them.
struct Subject {
    candidates: Vec<Candidate>,
    traces: Vec<SpatialTrace>,
}

impl Subject {
    /// The whisker of all traces.
    ///
    /// # Errors
    /// If two traces of the name have other parameters.
    fn whisker(&self) -> anyhow::Result<SpatialWhisker> {
        let first = &self.traces[0].sidecar;
        let whisker = first.spatial_whisker();
        let Some(other) = self.traces.iter().find(|trace| trace.sidecar.spatial_whisker() != whisker) else {
            return Ok(whisker);
        };
        let reference = format!("those of {}, whose whisker has the same name", first.name);
        let different = other.sidecar.whisker.difference(&first.whisker);
        let reason = different.map_or_else(
            || format!("suspension, poisson_ratio: found other values than {reference}"),
            |difference| format!("whisker.{difference}; the parameters must be {reference}"),
        );
        bail!("{}: {reason}", other.sidecar.name);
    }

    /// Root mean square, over the traces, of the standard deviations of their noise (N m).
    fn noise_sd_n_m(&self) -> f64 {
        rms_noise_n_m(self.traces.iter().map(|trace| trace.sidecar.own_noise_sd_n_m()))
    }
}

/// Fit of a whisker: front end and settings, which are the same for all whiskers of a dataset.
struct WhiskerFit<'a> {
    front_end: &'a SpatialFrontEnd,
    settings: &'a SpatialFitSettings,
    /// Folder of the calibrations.
    out: &'a Path,
    progress: &'a ProgressBar,
}

impl WhiskerFit<'_> {
    /// Fits the whisker of some traces, unless an up-to-date calibration is there.
    fn run(&self, subject: &Subject) -> anyhow::Result<SpatialFitted> {
        let Self { front_end, settings, out, progress } = *self;
        let Subject { candidates, traces } = subject;
        let whisker = subject.whisker()?;
        let data_sha256 = data_sha256(traces.iter().map(|trace| trace.sidecar.data_sha256()));
        let watermark = self.watermark(candidates, &data_sha256)?;
        let path = out.join(format!("{}.json", whisker.whisker.name));
        check_replaces_calibration(&path, SPATIAL_FORMAT)?;
        if let Some(calibration) = up_to_date(&path, &watermark) {
            progress.inc(candidates.len() as u64);
            return Ok(SpatialFitted { calibration, path, is_new: false, left_out: Vec::new(), no_sensor: None });
        }
        let place = || format!("whisker `{}`", whisker.whisker.name);
        let is_recorded =
            are_recordings(traces.iter().map(|trace| (&*trace.sidecar.name, trace.sidecar.recorded.is_some())))?;
        // The readings of a recording already contain noise.
        let noise_fraction = if is_recorded { 0.0 } else { settings.noise };
        let (sensor, mut lines) = self.read(traces, noise_fraction, place)?;
        let screening = is_recorded.then(|| sensor::screen(&whisker.whisker, &mut lines));
        if let Some(screening) = &screening {
            check_fitted(screening, &lines).with_context(place)?;
        }
        let data = SpatialFitData {
            whisker: &whisker,
            lines: &lines,
            reference_noise_sd_n_m: subject.noise_sd_n_m(),
            across: screening.map_or(Across::Normal, |screening| screening.across),
            real_sensor: is_recorded,
        };
        let fit = |candidate: &Candidate| sensor::fit(candidate.row, &candidate.config, &data);
        let name = |candidate: &Candidate| format!("{} {}", candidate.row.kind, candidate.own);
        let (fits, left_out) = determined(candidates, fit, name, progress).with_context(place)?;
        let data = FittedData {
            noise_fraction,
            seed: settings.seed,
            data_sha256,
            traces: traces.iter().map(|trace| trace.sidecar.name.clone()).collect(),
            ..FittedData::default()
        };
        let calibration = SpatialCalibrationFile::new(&fits, data, watermark).expect("there is a fit");
        let front_end = front_end.describe(sensor.into_iter().collect());
        let (sensor, no_sensor) = match is_recorded.then(|| recorded_sensor(subject)).transpose() {
            Ok(sensor) => (sensor, None),
            Err(reason) => (None, Some(format!("{}: {reason}", place()))),
        };
        let calibration = SpatialCalibrationFile { front_end, sensor, ..calibration };
        write_json(&path, &calibration)?;
        let contacts = screening.map(|screening| not_fitted(&screening, &lines)).unwrap_or_default();
        let left_out = contacts.into_iter().chain(left_out).map(|reason| format!("{}: {reason}", place())).collect();
        Ok(SpatialFitted { calibration, path, is_new: true, left_out, no_sensor })
    }

    /// Watermark of the calibration from everything that determines it.
    fn watermark(&self, candidates: &[Candidate], data_sha256: &str) -> anyhow::Result<Watermark> {
        let Self { front_end, settings, .. } = self;
        let mut inputs = vec![data_sha256.to_owned(), settings.noise.to_string(), settings.seed.to_string()];
        inputs.push(serde_json::to_string(&front_end.describe(Vec::new()))?);
        inputs.extend(candidates.iter().map(|candidate| format!("{} {}", candidate.row.kind, candidate.config)));
        Ok(calibration_watermark(inputs.iter().map(String::as_str)))
    }

    /// Calibrates the sensor and reads the lines of contacts of all traces through it. Noise is relative to the largest reading;
    /// `place` names the whisker in errors.
    fn read(
        &self,
        traces: &[SpatialTrace],
        noise_fraction: f64,
        place: impl Fn() -> String,
    ) -> anyhow::Result<(Option<SpatialSensor>, Vec<Vec<SpatialSample>>)> {
        let Self { front_end, settings, .. } = self;
        for trace in traces {
            front_end.check_trace(&trace.sidecar)?;
        }
        let noise_sd_n_m = noise_fraction * largest_reading_n_m(traces);
        let inputs: Vec<SpatialInput<'_>> =
            traces.iter().map(|trace| SpatialInput::new(trace, noise_sd_n_m, settings.seed)).collect();
        let sensor = front_end.calibrate(&inputs).with_context(place)?;
        let mut all = Vec::new();
        for trace in traces {
            let readings_n_m = front_end.bending_n_m(trace, noise_sd_n_m, settings.seed, sensor.as_ref())?;
            all.extend(lines(trace, readings_n_m.into_iter().zip(front_end.exact_n_m(trace))));
        }
        Ok((sensor, all))
    }
}

/// The calibration in a file, if it has this watermark and its sensor model can be loaded.
fn up_to_date(path: &Path, watermark: &Watermark) -> Option<SpatialCalibrationFile> {
    SpatialCalibrationFile::read(path).ok().filter(|known| {
        known.watermark.inputs_sha256 == watermark.inputs_sha256 && known.calibrated(path, None).is_ok()
    })
}

/// The sensor of recordings, with the root mean square of their noise.
///
/// # Errors
/// If the recordings do not state one and the same response. Their moments can be fitted all the same.
fn recorded_sensor(subject: &Subject) -> Result<BendingSensor, String> {
    let traces = subject.traces.iter();
    let mut stated = traces.filter_map(|trace| Some((&trace.sidecar.name, trace.sidecar.recorded.as_ref()?)));
    let (first, SpatialRecorded { counts_per_n_m, .. }) = stated.next().ok_or("found no recording")?;
    if let Some((name, other)) = stated.find(|(_, other)| other.counts_per_n_m != *counts_per_n_m) {
        return Err(format!(
            "{name}: recorded.counts_per_n_m: found {:?}, expected {:?}, as in {first}; import all recordings by one mapping",
            other.counts_per_n_m.counts_per_n_m, counts_per_n_m.counts_per_n_m
        ));
    }
    Ok(BendingSensor { counts_per_n_m: *counts_per_n_m, noise_sd_n_m: subject.noise_sd_n_m() })
}

/// Checks that the screening left at least half of the contacts. `lines` are the remaining lines.
fn check_fitted(screening: &Screening, lines: &[Vec<SpatialSample>]) -> anyhow::Result<()> {
    let left_out = screening.ambiguous + screening.contradicted;
    let left: usize = lines.iter().map(Vec::len).sum();
    if left_out > left {
        bail!(
            "found {left_out} of {} contacts that cannot be fitted ({}), expected at most half of them; the contacts or the \
            poses may be in another unit or frame, or have the wrong sign: see `whisker check`",
            left_out + left,
            not_fitted(screening, lines).join("; ")
        );
    }
    Ok(())
}

/// Contacts that the screening left out, one message per reason. `lines` are the remaining lines.
fn not_fitted(screening: &Screening, lines: &[Vec<SpatialSample>]) -> Vec<String> {
    let &Screening { ambiguous, contradicted, .. } = screening;
    let of = ambiguous + contradicted + lines.iter().map(Vec::len).sum::<usize>();
    let reasons = [
        (ambiguous, "coordinates about the undeflected whisker not unique"),
        (contradicted, "readings contradict those of all others, for example because the pin slipped off"),
    ];
    let stated = reasons.into_iter().filter(|(count, _)| *count > 0);
    stated.map(|(count, reason)| format!("{count} of {of} contacts: {reason}")).collect()
}

/// Smallest interval between two rows that ends a line of contacts, in sampling periods.
const GAP: f64 = 1.5;

/// Lines of known single contacts on the side of the whisker, each from touch to release or to a gap of the recording, with the
/// readings of the sensor and those without its errors (N m), one pair per row.
fn lines(
    trace: &SpatialTrace,
    readings: impl Iterator<Item = (Vector2<f64>, Vector2<f64>)>,
) -> Vec<Vec<SpatialSample>> {
    let mut lines: Vec<Vec<SpatialSample>> = Vec::new();
    let mut is_open = false;
    let mut last_s = f64::NEG_INFINITY;
    let rows = trace.recording.instants.iter().zip(&trace.truth.instants).zip(readings);
    for ((known, truth), (reading_n_m, reference_n_m)) in rows {
        is_open &= (known.t_s - last_s) * trace.sidecar.rate_hz < GAP;
        last_s = known.t_s;
        let Some(contact_m) = truth.contact_m() else {
            is_open = false;
            continue;
        };
        if !truth.is_single() {
            continue;
        }
        if !is_open {
            lines.push(Vec::new());
            is_open = true;
        }
        let contact = to_base(&known.base).apply(Point::from_vector(contact_m));
        let sample = SpatialSample { contact, reading_n_m, reference_n_m, count: 1.0 };
        lines.last_mut().expect("a line is open").push(sample);
    }
    lines
}
