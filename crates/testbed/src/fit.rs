//! Fitting: calibration traces to calibration files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::Value;
use trace::{CalibrationFile, Digest, FaceFile, Role, Trace, write_atomically, write_json};
use whisker::Whisker;
use whisker::sensor::{self, CalibratedFace, Face, Fit, Sample};

use crate::dataset::Dataset;
use crate::front_end::FrontEnd;
use crate::provenance::watermark;
use crate::results::{ResidualRow, SurfaceRow, csv_bytes};
use crate::settings::merged;

/// Nodes of the grid on which a fitted model is written for the report: along and away from the undeflected whisker.
const SURFACE_NODES: (usize, usize) = (81, 41);

/// Most residuals a face that are written for the report; more are thinned evenly.
const MOST_RESIDUALS: usize = 3000;

/// Tables about a face that stand beside its calibration, for the report.
pub const REPORT_TABLES: [&str; 2] = ["surface", "residuals"];

/// What to fit and how.
#[derive(Clone, Debug)]
pub struct FitSettings {
    /// Sensor model, by its name in the registry.
    pub model: String,
    /// Its settings; what is missing takes its default.
    pub config: Value,
    /// Measurement noise, as a fraction of the largest reading of a whisker's calibration.
    pub noise: f64,
    /// Seed of that noise.
    pub seed: u64,
}

/// A fitted whisker and where it was written.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The calibration.
    pub calibration: CalibrationFile,
    /// Its file.
    pub path: PathBuf,
    /// Whether it had to be made anew.
    pub is_new: bool,
}

/// Fits every whisker that the dataset calibrates and writes one calibration each, unless it is there already.
///
/// # Errors
/// If traces cannot be read, contradict one another, or do not determine the model.
pub fn fit(dataset: &Dataset, settings: &FitSettings, out: &Path) -> anyhow::Result<Vec<Fitted>> {
    let row = sensor::model(&settings.model)?;
    let mut whiskers: BTreeMap<String, Vec<Trace>> = BTreeMap::new();
    for trace in dataset.read(Role::Calibration)? {
        whiskers.entry(trace.sidecar.whisker.name.clone()).or_default().push(trace);
    }
    whiskers.values().map(|traces| fit_whisker(row, traces, settings, out)).collect()
}

fn fit_whisker(row: &sensor::ModelRow, traces: &[Trace], settings: &FitSettings, out: &Path) -> anyhow::Result<Fitted> {
    let config = merged((row.defaults)(), &settings.config)?;
    let whisker = &traces[0].sidecar.whisker;
    if let Some(other) = traces.iter().find(|trace| trace.sidecar.whisker != *whisker) {
        bail!(
            "{}: its whisker `{}` has other parameters than that of {}",
            other.sidecar.name,
            whisker.name,
            traces[0].sidecar.name
        );
    }
    let mut data = Digest::default();
    for trace in traces {
        data.add(&trace.sidecar.name).add(&trace.sidecar.csv_sha256).add(trace.sidecar.face.name());
    }
    let data_sha256 = data.finish();
    let watermark = watermark([
        data_sha256.as_str(),
        &serde_json::to_string(whisker)?,
        row.kind,
        &config.to_string(),
        &settings.noise.to_string(),
        &settings.seed.to_string(),
    ]);
    let path = out.join(format!("{}.json", whisker.name));
    let for_report = |face: &FaceFile| {
        REPORT_TABLES
            .iter()
            .all(|table| out.join(format!("{}.{table}.csv", face_stem(&whisker.name, face.face))).is_file())
    };
    if let Ok(calibration) = CalibrationFile::read(&path)
        && calibration.watermark.inputs_sha256 == watermark.inputs_sha256
        && calibration.faces.iter().all(for_report)
    {
        return Ok(Fitted { calibration, path, is_new: false });
    }

    let largest = traces
        .iter()
        .flat_map(|trace| &trace.recording.instants)
        .map(|instant| instant.moment_z_n_m.abs())
        .fold(0.0, f64::max);
    let front_end = FrontEnd { noise_sd_n_m: settings.noise * largest, seed: settings.seed };
    let mut faces = Vec::new();
    for face in [Face::Left, Face::Right] {
        let of_face: Vec<&Trace> = traces.iter().filter(|trace| trace.sidecar.face == face).collect();
        if !of_face.is_empty() {
            let fit = fit_face(row, &config, whisker, face, &of_face, &front_end)
                .with_context(|| format!("whisker `{}`, face {}", whisker.name, face.name()))?;
            write_for_report(&fit, whisker, &of_face, out)?;
            faces.push(FaceFile::new(&fit));
        }
    }
    let names = traces.iter().map(|trace| trace.sidecar.name.clone()).collect();
    let (noise, seed) = (settings.noise, settings.seed);
    let calibration = CalibrationFile::new(whisker.clone(), noise, seed, data_sha256, names, faces, watermark);
    write_json(&path, &calibration)?;
    Ok(Fitted { calibration, path, is_new: true })
}

fn fit_face(
    row: &sensor::ModelRow,
    config: &Value,
    whisker: &Whisker,
    face: Face,
    traces: &[&Trace],
    front_end: &FrontEnd,
) -> anyhow::Result<Fit> {
    let noisy: Vec<Vec<Sample>> = traces
        .iter()
        .map(|trace| contacts(trace, &front_end.readings_n_m(&trace.sidecar.name, &trace.recording)))
        .collect();
    let clean: Vec<Vec<Sample>> = traces.iter().map(|trace| clean_contacts(trace)).collect();
    Ok(sensor::fit(row, config, whisker, face, &noisy, &clean)?)
}

fn clean_contacts(trace: &Trace) -> Vec<Sample> {
    contacts(trace, &trace.recording.instants.iter().map(|instant| instant.moment_z_n_m).collect::<Vec<_>>())
}

/// The known contacts of a calibration trace, single ones on the side of the whisker: elsewhere the mechanics differ.
fn contacts(trace: &Trace, readings_n_m: &[f64]) -> Vec<Sample> {
    trace
        .recording
        .instants
        .iter()
        .zip(&trace.truth.instants)
        .zip(readings_n_m)
        .filter(|((_, truth), _)| truth.tip != Some(true) && truth.split != Some(true))
        .filter_map(|((known, truth), &reading_n_m)| {
            Some(Sample { contact: known.base.inverse().apply(truth.contact?), reading_n_m })
        })
        .collect()
}

/// Stem of the files about one face, beside a calibration or in a run.
pub fn face_stem(whisker: &str, face: Face) -> String {
    format!("{whisker}_{}", face.name())
}

fn write_for_report(fit: &Fit, whisker: &Whisker, traces: &[&Trace], out: &Path) -> anyhow::Result<()> {
    let stem = face_stem(&whisker.name, fit.face.face);
    let path = out.join(format!("{stem}.surface.csv"));
    write_atomically(&path, &csv_bytes(&surface(&fit.face))?)?;

    // The largest are always kept: they are what a reader looks for.
    let stride = fit.samples.div_ceil(MOST_RESIDUALS);
    let is_extreme = |residual: f64| residual.abs() > 0.8 * fit.heldout_worst_n_m;
    let mut rows = Vec::new();
    for (trace, residuals) in traces.iter().zip(&fit.residuals_n_m) {
        for (i, (sample, residual_n_m)) in clean_contacts(trace).iter().zip(residuals).enumerate() {
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
            let contact = face.contact_at(arc_m, distance_m);
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
