//! The files of a run under `results/<run>/`: the only thing that report and readers know of an evaluation.
//!
//! ```text
//! run.json                              watermark, settings, inputs
//! trials.csv                            [`TrialRow`], one a trace, estimator, noise level and seed
//! summary.csv                           [`SummaryRow`], one a group, whisker, estimator and noise level
//! failures.csv                          [`FailureRow`], one a trial that could not be scored
//! error_over_time.csv                   [`ErrorBandRow`], spread of the error over trials against time since the touch
//! estimates/<trace>.<estimator>.csv     [`EstimateRow`], one an instant, for the first noise level and seed
//! outlines/<trace>.csv                  true outline of the object, `x_m,y_m`
//! models/<whisker>_<face>.surface.csv   [`SurfaceRow`], the sensor model on a grid over its domain
//! models/<whisker>_<face>.residuals.csv [`ResidualRow`], held-out residuals of the calibration
//! ```

use std::path::Path;

use anyhow::{Context, bail};
use csv::{ReaderBuilder, StringRecord};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use whisker::touch::TouchConfig;

/// Scores of one trial under one estimator. Lengths are distances from the truth, unaligned; absent means that the
/// estimator gave nothing to score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialRow {
    /// Name of the trace.
    pub trace: String,
    /// Group of the trace.
    pub group: String,
    /// Whisker of the trace.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Standard deviation of the measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Instant of the true first touch.
    pub touch_s: f64,
    /// Samples in contact, start-up apart.
    pub samples: usize,
    /// Of those, samples without an estimate.
    pub missing: usize,
    /// Root mean square contact error after the first two seconds of contact.
    pub rmse_m: Option<f64>,
    /// Median contact error after the first two seconds of contact.
    pub median_m: Option<f64>,
    /// 95th percentile of the contact error after the first two seconds of contact.
    pub p95_m: Option<f64>,
    /// Largest contact error after the first two seconds of contact.
    pub worst_m: Option<f64>,
    /// Root mean square contact error within the first two seconds of contact.
    pub start_rmse_m: Option<f64>,
    /// Time from the touch until the error stays below 1 mm to the end.
    pub time_to_1mm_s: Option<f64>,
    /// Time from the touch until the error stays below 0.3 mm to the end.
    pub time_to_0p3mm_s: Option<f64>,
    /// Median distance of the estimated surface points to the true outline, after two seconds of contact.
    pub outline_median_m: Option<f64>,
    /// 95th percentile of that distance.
    pub outline_p95_m: Option<f64>,
}

/// Scores of one estimator over all trials of one group with one whisker at one noise level: medians over trials,
/// except `worst_m` (the largest) and `never_1mm` (a share).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SummaryRow {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Number of trials.
    pub trials: usize,
    /// Median over trials of the steady root mean square error.
    pub rmse_m: Option<f64>,
    /// Median over trials of the steady median error.
    pub median_m: Option<f64>,
    /// Median over trials of the steady 95th percentile.
    pub p95_m: Option<f64>,
    /// Largest steady error of any trial.
    pub worst_m: Option<f64>,
    /// Median time to stay below 1 mm; absent where most trials never do.
    pub time_to_1mm_s: Option<f64>,
    /// Median time to stay below 0.3 mm; absent where most trials never do.
    pub time_to_0p3mm_s: Option<f64>,
    /// Share of the trials that never stay below 1 mm.
    pub never_1mm: f64,
    /// Mean wall-clock time of one estimator step.
    pub step_ns: f64,
}

/// A trial that could not be scored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureRow {
    /// Name of the trace.
    pub trace: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Why.
    pub reason: String,
}

impl FailureRow {
    /// The table, with its header even where nothing failed.
    ///
    /// # Errors
    /// If a row does not serialise.
    pub fn csv(rows: &[Self]) -> anyhow::Result<Vec<u8>> {
        if rows.is_empty() {
            return Ok(b"trace,noise,seed,reason\n".to_vec());
        }
        csv_bytes(rows)
    }
}

/// Spread of the contact error over the trials of a set at one time since the touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorBandRow {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Time since the true first touch.
    pub t_contact_s: f64,
    /// Trials that have an estimate at that time.
    pub trials: usize,
    /// 10th percentile of the error.
    pub p10_m: f64,
    /// Median of the error.
    pub median_m: f64,
    /// 90th percentile of the error.
    pub p90_m: f64,
}

/// One instant of one replayed trial: what the robot knew, what the estimator said and what was true. Points in World.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimateRow {
    /// Time since the start of the trace.
    pub t_s: f64,
    /// Position of the base.
    pub base_x_m: f64,
    /// Position of the base.
    pub base_y_m: f64,
    /// Yaw of the base.
    pub base_yaw_rad: f64,
    /// Reading with measurement noise, as the estimator saw it.
    pub reading_n_m: f64,
    /// Estimated contact.
    pub contact_x_m: Option<f64>,
    /// Estimated contact.
    pub contact_y_m: Option<f64>,
    /// Estimated point of the object's surface.
    pub surface_x_m: Option<f64>,
    /// Estimated point of the object's surface.
    pub surface_y_m: Option<f64>,
    /// Covariance of the contact.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the contact.
    pub cov_xy_m2: Option<f64>,
    /// Covariance of the contact.
    pub cov_yy_m2: Option<f64>,
    /// Whether the sensor model could predict the reading at the estimated contact.
    pub calibrated: Option<bool>,
    /// True contact.
    pub truth_contact_x_m: Option<f64>,
    /// True contact.
    pub truth_contact_y_m: Option<f64>,
    /// True point of the object's surface.
    pub truth_surface_x_m: Option<f64>,
    /// True point of the object's surface.
    pub truth_surface_y_m: Option<f64>,
}

/// The sensor model at one node of a grid over its domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceRow {
    /// Arc length of the nearest point of the undeflected whisker.
    pub arc_m: f64,
    /// Distance from the undeflected whisker, positive away from the object.
    pub distance_m: f64,
    /// Contact in Base.
    pub x_m: f64,
    /// Contact in Base.
    pub y_m: f64,
    /// Expected reading.
    pub reading_n_m: f64,
}

/// Residual of one calibration sample under the model fitted to the other traces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualRow {
    /// Name of the calibration trace.
    pub trace: String,
    /// Contact in Base.
    pub x_m: f64,
    /// Contact in Base.
    pub y_m: f64,
    /// Reading without measurement noise.
    pub reading_n_m: f64,
    /// Predicted less true reading.
    pub residual_n_m: f64,
}

/// `run.json`: what was run, on what, by what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Version of the format, 1.
    pub format: u32,
    /// `"run"`.
    pub kind: String,
    /// Name of the run.
    pub name: String,
    /// What wrote the run.
    pub watermark: trace::Watermark,
    /// Noise levels, as fractions of each set's largest reading.
    pub noise: Vec<f64>,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// Settings of the touch detection.
    pub touch: TouchConfig,
    /// Estimators with their settings.
    pub estimators: Vec<RunEstimator>,
    /// Sets of trials: one a group and whisker.
    pub sets: Vec<RunSet>,
    /// Calibrations used.
    pub calibrations: Vec<RunCalibration>,
}

impl Run {
    /// Reads and checks `run.json`.
    ///
    /// # Errors
    /// If it is missing, does not parse, or is not the description of a run.
    pub fn read(path: &Path) -> Result<Self, trace::Error> {
        let run: Self = trace::read_json(path)?;
        if run.format != trace::FORMAT {
            return Err(trace::Error::value(path, "format", run.format, trace::FORMAT));
        }
        if run.kind != "run" {
            return Err(trace::Error::value(path, "kind", &run.kind, "run"));
        }
        for (key, is_empty) in [("noise", run.noise.is_empty()), ("estimators", run.estimators.is_empty())] {
            if is_empty {
                return Err(trace::Error::value(path, key, "an empty list", "at least one entry"));
            }
        }
        Ok(run)
    }
}

/// One estimator of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunEstimator {
    /// Name in the registry.
    pub name: String,
    /// One line about it.
    pub about: String,
    /// Whether it is a baseline, there to be beaten.
    pub is_baseline: bool,
    /// Its settings.
    pub config: serde_json::Value,
}

/// Trials that are scored together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunSet {
    /// Group.
    pub group: String,
    /// Whisker.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Names of the traces.
    pub traces: Vec<String>,
    /// Largest absolute reading of the set without noise; noise is a fraction of it.
    pub largest_reading_n_m: f64,
}

/// One calibration of a run and how well it fits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCalibration {
    /// Whisker.
    pub whisker: String,
    /// Face.
    pub face: String,
    /// One line about the sensor model.
    pub model: String,
    /// Hash of the calibration file.
    pub sha256: String,
    /// Root mean square residual on held-out traces.
    pub heldout_rms_n_m: f64,
    /// Largest residual on held-out traces.
    pub heldout_worst_n_m: f64,
    /// Largest absolute reading of the calibration.
    pub largest_reading_n_m: f64,
}

/// Rows as the bytes of a CSV with a header.
///
/// # Errors
/// If a row does not serialise.
pub fn csv_bytes<Row: Serialize>(rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner()?)
}

/// Reads a table whose columns are the fields of `T`.
///
/// # Errors
/// If the file cannot be read; for a damaged one, file, line and column, what was found and what was expected.
pub fn read_rows<T: DeserializeOwned>(path: &Path) -> anyhow::Result<Vec<T>> {
    let at = path.display();
    let mut reader = ReaderBuilder::new().from_path(path).with_context(|| format!("{at}: cannot be read"))?;
    let header = reader.headers().with_context(|| format!("{at}:1: cannot be read"))?.clone();
    let mut rows = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let record = record.with_context(|| format!("{at}: row {}", index + 1))?;
        let line = record.position().map_or(0, csv::Position::line);
        for (column, field) in header.iter().zip(&record) {
            if field.parse::<f64>().is_ok_and(|value| !value.is_finite()) {
                bail!("{at}:{line}: column `{column}`: found {field}, expected a finite number");
            }
        }
        rows.push(parse_row(&record, &header).map_err(|problem| anyhow::anyhow!("{at}:{line}: {problem}"))?);
    }
    Ok(rows)
}

/// Parses a row, or says in which column what was found.
fn parse_row<T: DeserializeOwned>(record: &StringRecord, header: &StringRecord) -> Result<T, String> {
    record.deserialize(Some(header)).map_err(|error| {
        let csv::ErrorKind::Deserialize { err, .. } = error.kind() else {
            return error.to_string();
        };
        match err.field().and_then(|field| usize::try_from(field).ok()) {
            Some(field) => format!(
                "column `{}`: found `{}`, expected another kind of value: {}",
                header.get(field).unwrap_or_default(),
                record.get(field).unwrap_or_default(),
                err.kind()
            ),
            None => err.kind().to_string(),
        }
    })
}
