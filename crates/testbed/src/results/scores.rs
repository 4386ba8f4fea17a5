//! Scores of trials and of sets of trials, and failed trials.

use std::io::Write;
use std::path::Path;

use csv::StringRecord;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::table::{Table, columns, parse_row, read_table, refusal, table_bytes};
use crate::metrics::{METRICS, Metric, Scores};

/// Row whose first columns are the fields of `Head`, followed by the metrics in the order of [`METRICS`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScoreRow<Head> {
    /// Identity of the scored trials.
    pub head: Head,
    /// Values of the metrics.
    pub scores: Scores,
}

/// Scores of one estimator on one trial.
pub type TrialRow = ScoreRow<TrialHead>;

/// Scores of one estimator over all trials of one group with one whisker at one noise level, combined as each metric specifies.
pub type SummaryRow = ScoreRow<SummaryHead>;

/// First columns of `trials.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialHead {
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
    /// Number of samples in contact after start-up.
    pub samples: usize,
    /// Number of those samples in the calibrated domain without an estimate.
    pub missing: usize,
    /// Mean probabilities over the contact of the models that the estimator averages, as `sliding=0.970 ekf=0.030`.
    /// `None` for other estimators.
    pub models: Option<String>,
}

/// First columns of `summary.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SummaryHead {
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
    /// Number of trials, each counted once for every noise seed.
    pub trials: usize,
    /// Mean wall-clock time of one estimator step.
    pub step_ns: f64,
    /// Mean over the trials of the probabilities of the models that the estimator averages. `None` for other estimators.
    pub models: Option<String>,
    /// Consistency of the estimator by its errors: NEES and coverage. `None` if it states no covariance.
    pub verdict: Option<String>,
    /// Consistency of the estimator by its innovations (NIS), which require no truth. `None` if it states none.
    pub nis_verdict: Option<String>,
    /// Mean over the trials of the RMS contact error after the first two seconds of contact. `None` if a trial has none.
    pub rmse_mean_m: Option<f64>,
    /// 90th percentile of these errors; a trial without one counts as worse than any other.
    pub rmse_p90_m: Option<f64>,
    /// Share of the trials with such an error above 0.5 mm, or without one.
    pub above_0p5mm: f64,
}

impl<Head> ScoreRow<Head> {
    /// The value of one metric.
    pub fn get(&self, metric: &Metric) -> Option<f64> {
        self.scores.get(metric)
    }
}

/// Trial that could not be scored, or on which one estimator failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureRow {
    /// Name of the trace.
    pub trace: String,
    /// Name of the estimator that failed. `None` if the trial could not be scored for any.
    pub estimator: Option<String>,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Reason.
    pub reason: String,
}

/// Rows of scores as the bytes of a CSV with its header.
///
/// # Errors
/// If a row does not serialise.
pub fn score_bytes<Head: Serialize + DeserializeOwned>(rows: &[ScoreRow<Head>]) -> anyhow::Result<Vec<u8>> {
    table_bytes(&score_columns::<Head>(), rows.iter().map(|row| (&row.head, row.scores.values())))
}

impl<Head: Serialize + DeserializeOwned, To: Write> Table<ScoreRow<Head>, To> {
    /// Starts a table of scores.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn of_scores(to: To) -> anyhow::Result<Self> {
        Self::with_columns(to, &score_columns::<Head>())
    }

    /// Appends a row of scores.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn push_scores(&mut self, row: &ScoreRow<Head>) -> anyhow::Result<()> {
        self.writer.serialize((&row.head, row.scores.values())).map_err(refusal)
    }
}

/// Columns of a table of scores.
fn score_columns<Head: DeserializeOwned>() -> Vec<&'static str> {
    columns::<Head>().iter().copied().chain(METRICS.iter().map(|metric| metric.name)).collect()
}

/// Reads a table of scores.
///
/// # Errors
/// As [`super::read_rows`], and if the columns are not those of [`METRICS`].
pub fn read_scores<Head: DeserializeOwned>(path: &Path) -> anyhow::Result<Vec<ScoreRow<Head>>> {
    read_table(path, parse_scores)
}

/// Parses a row of scores. The error names the column and the value found.
fn parse_scores<Head: DeserializeOwned>(
    record: &StringRecord,
    header: &StringRecord,
) -> Result<ScoreRow<Head>, String> {
    let expected = score_columns::<Head>();
    for place in 0..expected.len().max(header.len()) {
        let name = |name: Option<&str>| name.map_or("no more columns".into(), |name| format!("`{name}`"));
        let (found, expected) = (name(header.get(place)), name(expected.get(place).copied()));
        if found != expected {
            let place = place + 1;
            return Err(format!(
                "column {place}: found {found}, expected {expected}; evaluate again with this version"
            ));
        }
    }
    let metrics = |row: &StringRecord| row.iter().skip(expected.len() - METRICS.len()).collect::<StringRecord>();
    let values: Vec<Option<f64>> = parse_row(&metrics(record), &metrics(header))?;
    let mut values = values.into_iter();
    Ok(ScoreRow { head: parse_row(record, header)?, scores: Scores::from_fn(|_| values.next().flatten()) })
}

#[cfg(test)]
mod tests {
    use super::super::csv_bytes;
    use super::*;

    fn row() -> SummaryRow {
        let head = SummaryHead {
            group: "pin".into(),
            whisker: "straight".into(),
            object: "pin".into(),
            estimator: "ekf".into(),
            noise: 0.01,
            trials: 50,
            step_ns: 500.0,
            models: None,
            verdict: None,
            nis_verdict: None,
            rmse_mean_m: Some(2e-4),
            rmse_p90_m: None,
            above_0p5mm: 0.2,
        };
        let mut next = 0.0;
        let scores = Scores::from_fn(|_| {
            next += 0.5;
            (next != 1.5).then_some(next)
        });
        ScoreRow { head, scores }
    }

    fn read(bytes: &[u8]) -> anyhow::Result<Vec<SummaryRow>> {
        let file = tempfile::NamedTempFile::new()?;
        std::fs::write(file.path(), bytes)?;
        read_scores(file.path())
    }

    #[test]
    fn verif_scores_survive_writing_and_reading() {
        let bytes = score_bytes(&[row(), row()]).unwrap();
        assert!(
            bytes.starts_with(
                b"group,whisker,object,estimator,noise,trials,step_ns,models,verdict,nis_verdict,rmse_mean_m,rmse_p90_m,above_0p5mm,rmse_m,median_m,"
            )
        );
        assert_eq!(read(&bytes).unwrap(), [row(), row()]);
        assert_eq!(csv_bytes::<FailureRow>(&[]).unwrap(), b"trace,estimator,noise,seed,reason\n");
    }

    #[test]
    fn robust_an_error_names_other_metrics_and_damaged_scores() {
        let text = String::from_utf8(score_bytes(&[row()]).unwrap()).unwrap();
        for (from, to, expected) in [
            (",rmse_m,", ",rmse_mm,", "column 14: found `rmse_mm`, expected `rmse_m`"),
            (",rmse_m,median_m", ",median_m,rmse_m", "column 14: found `median_m`, expected `rmse_m`"),
            (",0.2,0.5", ",0.2,half", "column `rmse_m`: found `half`"),
            (",50,", ",many,", "column `trials`: found `many`"),
        ] {
            let message = read(text.replacen(from, to, 1).as_bytes()).expect_err(expected).to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
