//! The files of a run, read and checked: all that the report knows.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::results::{
    ErrorBandRow, EstimateRow, ResidualRow, Run, RunCalibration, RunSet, SummaryRow, SurfaceRow, TrialRow, read_rows,
};

/// Version of `run.json` that this program reads.
const FORMAT: u32 = 1;

/// A run: its description and the tables that every figure shares. Larger tables are read when asked for.
pub(super) struct RunData {
    folder: PathBuf,
    /// What was run, on what, by what.
    pub(super) run: Run,
    /// One row a trial, estimator, noise level and seed.
    pub(super) trials: Vec<TrialRow>,
    /// One row a group, whisker, estimator and noise level.
    pub(super) summary: Vec<SummaryRow>,
    pub(super) bands: Vec<ErrorBandRow>,
}

impl RunData {
    /// Reads the run in a folder.
    ///
    /// # Errors
    /// When a file is missing, is not of the format that [`crate::results`] describes, or holds nothing to show; the
    /// error names file, line and column.
    pub(super) fn read(folder: &Path) -> Result<Self> {
        let mut run = read_run(&folder.join("run.json"))?;
        let summary: Vec<SummaryRow> = read_rows(&folder.join("summary.csv"))?;
        ensure!(
            !summary.is_empty(),
            "{}: found no rows, expected at least one: the run scored nothing",
            folder.join("summary.csv").display()
        );
        // The summary is in the order of the suite, which puts like things side by side.
        run.sets.sort_by_key(|set| {
            let of_set = |row: &SummaryRow| row.group == set.group && row.whisker == set.whisker;
            summary.iter().position(of_set)
        });
        Ok(Self {
            trials: read_rows(&folder.join("trials.csv"))?,
            bands: read_rows(&folder.join("error_over_time.csv"))?,
            folder: folder.to_owned(),
            run,
            summary,
        })
    }

    /// The noise level that figures show: the first of the run.
    pub(super) fn noise(&self) -> f64 {
        self.run.noise[0]
    }

    /// Names of the estimators, in the order that gives each its look.
    pub(super) fn estimators(&self) -> impl Iterator<Item = &str> {
        self.run.estimators.iter().map(|estimator| estimator.name.as_str())
    }

    /// Names of the estimators that are no baselines.
    pub(super) fn filters(&self) -> impl Iterator<Item = &str> {
        self.run.estimators.iter().filter(|estimator| !estimator.is_baseline).map(|estimator| estimator.name.as_str())
    }

    /// The sets on which the error is followed over time, one a whisker: those on the pin, whose contact stands still,
    /// or, in a run without a pin, those of the first group.
    pub(super) fn leading_sets(&self) -> Vec<&RunSet> {
        let first = self.run.sets.iter().find(|set| set.object == "pin");
        let Some(leading) = first.or(self.run.sets.first()) else {
            return Vec::new();
        };
        self.run.sets.iter().filter(|set| set.group == leading.group).collect()
    }

    /// The sets on objects that have an outline to be traced.
    pub(super) fn outline_sets(&self) -> Vec<&RunSet> {
        self.run.sets.iter().filter(|set| set.object != "pin").collect()
    }

    /// The scores of an estimator on a set at the level of [`Self::noise`].
    pub(super) fn summary_of(&self, set: &RunSet, estimator: &str) -> Option<&SummaryRow> {
        self.summary.iter().find(|row| {
            row.group == set.group
                && row.whisker == set.whisker
                && row.estimator == estimator
                && row.noise == self.noise()
        })
    }

    /// The trials of an estimator on a set at the level of [`Self::noise`].
    pub(super) fn trials_of(&self, set: &RunSet, estimator: &str) -> Vec<&TrialRow> {
        let matches = |row: &&TrialRow| {
            row.group == set.group
                && row.whisker == set.whisker
                && row.estimator == estimator
                && row.noise == self.noise()
        };
        self.trials.iter().filter(matches).collect()
    }

    /// Spread of the error of an estimator on a set over the time since the touch.
    pub(super) fn bands_of(&self, set: &RunSet, estimator: &str) -> Vec<&ErrorBandRow> {
        let matches = |row: &&ErrorBandRow| {
            row.group == set.group
                && row.whisker == set.whisker
                && row.estimator == estimator
                && row.noise == self.noise()
        };
        self.bands.iter().filter(matches).collect()
    }

    /// The filter with the smallest steady error on a set.
    pub(super) fn best_filter(&self, set: &RunSet) -> Option<&SummaryRow> {
        self.filters()
            .filter_map(|name| self.summary_of(set, name))
            .filter(|row| row.rmse_m.is_some())
            .min_by(|a, b| a.rmse_m.partial_cmp(&b.rmse_m).expect("finite, checked on reading"))
    }

    /// The trial of a set whose steady error under an estimator is the median one, with the seed whose estimates the run
    /// keeps.
    pub(super) fn typical_trial(&self, set: &RunSet, estimator: &str) -> Option<&TrialRow> {
        let mut trials = self.trials_of(set, estimator);
        trials.retain(|trial| Some(&trial.seed) == self.run.seeds.first());
        let error = |trial: &TrialRow| trial.rmse_m.unwrap_or(f64::INFINITY);
        trials.sort_by(|a, b| error(a).total_cmp(&error(b)));
        trials.get(trials.len().saturating_sub(1) / 2).copied()
    }

    /// What an estimator said about a trace, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(super) fn estimates(&self, trace: &str, estimator: &str) -> Result<Option<Vec<EstimateRow>>> {
        self.optional_table(&format!("estimates/{trace}.{estimator}.csv"))
    }

    /// Outline of the object of a trace in metres, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(super) fn outline(&self, trace: &str) -> Result<Option<Vec<(f64, f64)>>> {
        let rows: Option<Vec<OutlineRow>> = self.optional_table(&format!("outlines/{trace}.csv"))?;
        Ok(rows.map(|rows| rows.iter().map(|row| (row.x_m, row.y_m)).collect()))
    }

    /// The sensor model of a calibration on a grid, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(super) fn surface(&self, calibration: &RunCalibration) -> Result<Option<Vec<SurfaceRow>>> {
        self.optional_table(&model_file(calibration, "surface"))
    }

    /// The held-out residuals of a calibration, if the run kept them.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(super) fn residuals(&self, calibration: &RunCalibration) -> Result<Option<Vec<ResidualRow>>> {
        self.optional_table(&model_file(calibration, "residuals"))
    }

    fn optional_table<T: DeserializeOwned>(&self, name: &str) -> Result<Option<Vec<T>>> {
        let path = self.folder.join(name);
        if !path.exists() {
            return Ok(None);
        }
        let rows = read_rows(&path)?;
        Ok((!rows.is_empty()).then_some(rows))
    }
}

fn model_file(calibration: &RunCalibration, table: &str) -> String {
    format!("models/{}_{}.{table}.csv", calibration.whisker, calibration.face)
}

/// One vertex of an outline.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OutlineRow {
    x_m: f64,
    y_m: f64,
}

fn read_run(path: &Path) -> Result<Run> {
    let text = fs::read_to_string(path)
        .with_context(|| format!("{}: cannot be read; is this the folder of a run?", path.display()))?;
    let run: Run = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    let at = path.display();
    ensure!(run.format == FORMAT, "{at}: key `format`: found {}, expected {FORMAT}", run.format);
    ensure!(run.kind == "run", "{at}: key `kind`: found \"{}\", expected \"run\"", run.kind);
    for (key, length) in [("noise", run.noise.len()), ("estimators", run.estimators.len())] {
        ensure!(length > 0, "{at}: key `{key}`: found an empty list, expected at least one entry");
    }
    Ok(run)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<OutlineRow>> {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("outline.csv");
        fs::write(&path, text).expect("written");
        read_rows(&path)
    }

    #[test]
    fn robust_errors_name_file_line_column_and_value() {
        for (text, expected) in [
            ("x_m,y_m\n1,2\n3,a\n", "outline.csv:3: column `y_m`: found `a`"),
            ("x_m,y_m\n1,NaN\n", "outline.csv:2: column `y_m`: found NaN, expected a finite number"),
            ("x_m\n1\n", "missing field `y_m`"),
            ("x_m,y_m,z_m\n1,2,3\n", "unknown field `z_m`"),
        ] {
            let message = read_text(text).err().expect(expected).to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn robust_a_folder_without_a_run_gives_one_error() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let message = format!("{:#}", RunData::read(folder.path()).err().expect("no run"));
        assert!(message.contains("run.json: cannot be read"), "{message}");
    }
}
