//! The files of a run, read and checked.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use testbed::consistency::{Average, ErrorConsistency, NEES_FREEDOM, NIS_TEST, TrialErrors};
use testbed::metrics::{Metric, error};
use testbed::results::{
    BoundRow, ConsistencyRow, ContourScoreRow, ContourTrialRow, ErrorBandRow, EstimateRow, EventRow, MapObjectRow,
    MapRow, RECOMMENDED, ResidualRow, Run, RunCalibration, RunSet, SummaryRow, SurfaceRow, TransferRow, TrialRow,
    TurnRow, VertexRow, read_rows, read_scores,
};
use trace::{ObjectClass, SensorFile};
use whisker::estimators::MethodClass;

/// A run: its description and the tables that several figures share. Larger tables are read on request.
pub(crate) struct RunData {
    folder: PathBuf,
    /// Description of the run.
    pub(crate) run: Run,
    /// One row per trial, estimator, noise level and seed.
    pub(crate) trials: Vec<TrialRow>,
    /// One row a group, whisker, estimator and noise level.
    pub(crate) summary: Vec<SummaryRow>,
    pub(crate) bands: Vec<ErrorBandRow>,
    consistency: Vec<ConsistencyRow>,
    /// One row a group, whisker, estimator and noise level.
    pub(crate) contours: Vec<ContourScoreRow>,
    /// One row per trace, estimator, noise level and seed.
    contour_trials: Vec<ContourTrialRow>,
}

impl RunData {
    /// Reads the run in a folder.
    ///
    /// # Errors
    /// When a file is missing, is not of the format that [`testbed::results`] describes, or has no scores; the
    /// error names file, line and column.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let run_file = folder.join("run.json");
        ensure!(
            run_file.is_file(),
            "{}: no such file, expected the folder of a run, which `whisker evaluate` writes",
            run_file.display()
        );
        let mut run = Run::read(&run_file)?;
        let summary: Vec<SummaryRow> = scored(&folder.join("summary.csv"), read_scores)?;
        // The summary is in the order of the suite, which puts like things side by side.
        run.sets.sort_by_key(|set| {
            let of_set = |row: &SummaryRow| row.head.group == set.group && row.head.whisker == set.whisker;
            summary.iter().position(of_set)
        });
        Ok(Self {
            trials: scored(&folder.join("trials.csv"), read_scores)?,
            bands: read_rows(&folder.join("error_over_time.csv"))?,
            consistency: read_rows(&folder.join("consistency.csv"))?,
            contours: read_rows(&folder.join("contours.csv"))?,
            contour_trials: read_rows(&folder.join("contour_trials.csv"))?,
            folder: folder.to_owned(),
            run,
            summary,
        })
    }

    /// The noise level that figures show: the first of the run.
    pub(crate) fn noise(&self) -> f64 {
        self.run.noise[0]
    }

    /// Names of the filters: the estimators without hindsight, baselines apart.
    pub(crate) fn filters(&self) -> impl Iterator<Item = &str> {
        let recursive = self
            .run
            .estimators
            .iter()
            .filter(|estimator| matches!(estimator.class, MethodClass::Recursive | MethodClass::Published));
        recursive.map(|estimator| estimator.name.as_str())
    }

    /// Names of the estimators of one class.
    pub(crate) fn of_class(&self, class: MethodClass) -> impl Iterator<Item = &str> {
        let of_class = self.run.estimators.iter().filter(move |estimator| estimator.class == class);
        of_class.map(|estimator| estimator.name.as_str())
    }

    /// The sets on which the error is followed over time, one per whisker: those whose contact is at rest or, in a run without such,
    /// those of the first group. Sets whose true contacts are not known are left out, if those of another set of the group are known.
    pub(crate) fn leading_sets(&self) -> Vec<&RunSet> {
        let first = self.run.sets.iter().find(|set| set.class() == ObjectClass::Pin);
        let Some(leading) = first.or(self.run.sets.first()) else {
            return Vec::new();
        };
        let sets: Vec<&RunSet> = self.run.sets.iter().filter(|set| set.group == leading.group).collect();
        let is_any_scored = sets.iter().any(|set| self.is_scored(set));
        sets.into_iter().filter(|set| !is_any_scored || self.is_scored(set)).collect()
    }

    /// The sets whose true contacts are known.
    pub(crate) fn scored_sets(&self) -> Vec<&RunSet> {
        self.run.sets.iter().filter(|set| self.is_scored(set)).collect()
    }

    fn is_scored(&self, set: &RunSet) -> bool {
        self.summary.iter().any(|row| row.head.group == set.group && row.head.whisker == set.whisker)
    }

    /// The sets on objects that have an outline to be traced.
    pub(crate) fn outline_sets(&self) -> Vec<&RunSet> {
        self.run.sets.iter().filter(|set| set.class().has_outline()).collect()
    }

    /// The scores of an estimator on a set at the level of [`Self::noise`].
    pub(crate) fn summary_of(&self, set: &RunSet, estimator: &str) -> Option<&SummaryRow> {
        self.summary_at(set, estimator, self.noise())
    }

    /// The scores of an estimator on a set at a noise level.
    pub(crate) fn summary_at(&self, set: &RunSet, estimator: &str, noise: f64) -> Option<&SummaryRow> {
        self.summary.iter().find(|SummaryRow { head, .. }| {
            head.group == set.group && head.whisker == set.whisker && head.estimator == estimator && head.noise == noise
        })
    }

    /// The trials of an estimator on a set at the level of [`Self::noise`].
    pub(crate) fn trials_of(&self, set: &RunSet, estimator: &str) -> Vec<&TrialRow> {
        self.trials_at(set, estimator, self.noise()).collect()
    }

    fn trials_at(&self, set: &RunSet, estimator: &str, noise: f64) -> impl Iterator<Item = &TrialRow> {
        self.trials.iter().filter(move |TrialRow { head, .. }| {
            head.group == set.group && head.whisker == set.whisker && head.estimator == estimator && head.noise == noise
        })
    }

    /// Share of the samples in steady contact for which an estimator gave no estimate, over the trials of a set at a noise
    /// level.
    pub(crate) fn silent_share(&self, set: &RunSet, estimator: &str, noise: f64) -> f64 {
        let (missing, samples) = self
            .trials_at(set, estimator, noise)
            .fold((0, 0), |(missing, samples), row| (missing + row.head.missing, samples + row.head.samples));
        if samples == 0 { 0.0 } else { missing as f64 / samples as f64 }
    }

    /// Spread of the error of an estimator on a set over the time since the touch.
    pub(crate) fn bands_of(&self, set: &RunSet, estimator: &str) -> Vec<&ErrorBandRow> {
        let matches = |row: &&ErrorBandRow| {
            row.group == set.group
                && row.whisker == set.whisker
                && row.estimator == estimator
                && row.noise == self.noise()
        };
        self.bands.iter().filter(matches).collect()
    }

    /// Consistency of an estimator on a set over the time since the touch, at the times at which at least half of the
    /// trials have an estimate.
    pub(crate) fn consistency_of(&self, set: &RunSet, estimator: &str) -> Vec<&ConsistencyRow> {
        let trials = self.summary_of(set, estimator).map_or(0, |row| row.head.trials);
        let matches = |row: &&ConsistencyRow| {
            row.group == set.group
                && row.whisker == set.whisker
                && row.estimator == estimator
                && row.noise == self.noise()
                && 2 * row.trials >= trials
        };
        self.consistency.iter().filter(matches).collect()
    }

    /// The sets on objects without known contacts: they have outlines but no scores.
    pub(crate) fn unscored_sets(&self) -> Vec<&RunSet> {
        self.outline_sets().into_iter().filter(|set| !self.is_scored(set)).collect()
    }

    /// The outlines estimated from a trace under the first noise level and seed, in the order of the run.
    pub(crate) fn contours_of(&self, trace: &str) -> impl Iterator<Item = &ContourTrialRow> {
        let is_kept = move |row: &&ContourTrialRow| {
            row.trace == trace && row.noise == self.noise() && Some(&row.seed) == self.run.seeds.first()
        };
        self.contour_trials.iter().filter(is_kept)
    }

    /// Consistency of an estimator on a set by its errors. `None` if it states no covariance.
    pub(crate) fn errors_of(&self, set: &RunSet, estimator: &str) -> Option<ErrorConsistency> {
        let errors: Vec<TrialErrors> = self.trials_of(set, estimator).into_iter().filter_map(TrialErrors::of).collect();
        ErrorConsistency::of_trials(NEES_FREEDOM, &errors)
    }

    /// Average NIS of an estimator over the trials of a set, with its interval. `None` if it states no innovation.
    pub(crate) fn nis_of(&self, set: &RunSet, estimator: &str) -> Option<Average> {
        NIS_TEST.average(self.trials_of(set, estimator))
    }

    /// The estimator with the smallest median error in steady state, summed over the [`Self::leading_sets`].
    pub(crate) fn steadiest<'a>(&self, estimators: impl Iterator<Item = &'a str>) -> Option<&'a str> {
        let sets = self.leading_sets();
        smallest(estimators, |name| sets.iter().map(|set| self.summary_of(set, name)?.get(&error::MEDIAN)).sum())
    }

    /// The results of `make` for each of the [`Self::leading_sets`] with the recommended filter or else that of the
    /// smallest median error. Empty without a filter.
    pub(crate) fn of_leading_sets<T>(
        &self,
        make: impl Fn(&Self, &RunSet, &str) -> Result<Option<T>>,
    ) -> Result<Vec<T>> {
        let recommended = self.filters().find(|name| *name == RECOMMENDED);
        let Some(filter) = recommended.or_else(|| self.steadiest(self.filters())) else {
            return Ok(Vec::new());
        };
        self.leading_sets().into_iter().filter_map(|set| make(self, set, filter).transpose()).collect()
    }

    /// The trial of a set whose score under an estimator is the median one, with the seed whose estimates the run keeps.
    pub(crate) fn typical_trial(&self, set: &RunSet, estimator: &str, metric: &Metric) -> Option<&TrialRow> {
        let mut trials = self.trials_of(set, estimator);
        trials.retain(|trial| Some(&trial.head.seed) == self.run.seeds.first());
        let score = |trial: &TrialRow| trial.get(metric).unwrap_or(f64::INFINITY);
        trials.sort_by(|a, b| score(a).total_cmp(&score(b)));
        trials.get(trials.len().saturating_sub(1) / 2).copied()
    }

    /// Number of trials and noise seeds of a set, in words.
    pub(crate) fn trials_in_words(&self, set: &RunSet) -> String {
        let (traces, seeds) = (set.traces.len(), self.run.seeds.len());
        format!("{} × {}", counted(traces, "trial"), counted(seeds, "noise seed"))
    }

    /// The estimates of an estimator on a trace, if the run kept them.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn estimates(&self, trace: &str, estimator: &str) -> Result<Option<Vec<EstimateRow>>> {
        self.optional_table(&format!("estimates/{trace}.{estimator}.csv"))
    }

    /// The error bound of a trace over time, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn bound(&self, trace: &str) -> Result<Option<Vec<BoundRow>>> {
        self.optional_table(&format!("bounds/{trace}.csv"))
    }

    /// The signals and detections of a contact detector on a trace, if the run kept them.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn events(&self, trace: &str, detector: &str) -> Result<Option<Vec<EventRow>>> {
        self.optional_table(&format!("events/{trace}.{detector}.csv"))
    }

    /// The outline estimated from a trace, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn contour(&self, trace: &str, estimator: &str) -> Result<Option<Vec<VertexRow>>> {
        self.optional_table(&format!("contours/{trace}.{estimator}.csv"))
    }

    /// Outline of the object of a trace in metres, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn outline(&self, trace: &str) -> Result<Option<Vec<(f64, f64)>>> {
        let rows: Option<Vec<OutlineRow>> = self.optional_table(&format!("outlines/{trace}.csv"))?;
        Ok(rows.map(|rows| rows.iter().map(|row| (row.x_m, row.y_m)).collect()))
    }

    /// The maps of the run, if it has any.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn maps(&self) -> Result<Vec<MapRow>> {
        Ok(self.optional_table("maps.csv")?.unwrap_or_default())
    }

    /// The objects on the maps of the run, if it has any.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn map_objects(&self) -> Result<Vec<MapObjectRow>> {
        Ok(self.optional_table("map_objects.csv")?.unwrap_or_default())
    }

    /// A table of the map that an estimator made of a recording, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn map_table<T: DeserializeOwned>(
        &self,
        recording: &str,
        estimator: &str,
        table: &str,
    ) -> Result<Option<Vec<T>>> {
        self.optional_table(&format!("maps/{recording}.{estimator}.{table}.csv"))
    }

    /// The sensor model of a calibration on a grid, if the run kept it.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn surface(&self, calibration: &RunCalibration) -> Result<Option<Vec<SurfaceRow>>> {
        self.optional_table(&model_file(calibration, "surface"))
    }

    /// The held-out residuals of a calibration, if the run kept them.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn residuals(&self, calibration: &RunCalibration) -> Result<Option<Vec<ResidualRow>>> {
        self.optional_table(&model_file(calibration, "residuals"))
    }

    /// Counts of a sensor while it is turned, if the run kept them.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn turn(&self, sensor: &SensorFile) -> Result<Option<Vec<TurnRow>>> {
        self.optional_table(&format!("sensors/{}.turn.csv", sensor.label()))
    }

    /// Counts of a sensor over the rotation of the root, if the run kept them.
    ///
    /// # Errors
    /// When the file is damaged.
    pub(crate) fn transfer(&self, sensor: &SensorFile) -> Result<Option<Vec<TransferRow>>> {
        self.optional_table(&format!("sensors/{}.transfer.csv", sensor.label()))
    }

    /// A table of the run. `None` if there is no file or no row in it.
    fn optional_table<T: DeserializeOwned>(&self, name: &str) -> Result<Option<Vec<T>>> {
        let path = self.folder.join(name);
        if !path.exists() {
            return Ok(None);
        }
        let rows = read_rows(&path)?;
        Ok((!rows.is_empty()).then_some(rows))
    }
}

/// Rows of a table of scores.
///
/// # Errors
/// When the table is missing or damaged, or has no rows.
pub(crate) fn scored<Row>(path: &Path, read: impl FnOnce(&Path) -> Result<Vec<Row>>) -> Result<Vec<Row>> {
    let rows = read(path)?;
    ensure!(
        !rows.is_empty(),
        "{}: found no rows, expected at least one: no trial of the run was scored",
        path.display()
    );
    Ok(rows)
}

/// The estimator with the smallest score. `None` if none has a score.
pub(crate) fn smallest<'a>(
    estimators: impl Iterator<Item = &'a str>,
    score: impl Fn(&str) -> Option<f64>,
) -> Option<&'a str> {
    let scored = estimators.filter_map(|name| Some((name, score(name)?)));
    scored.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(name, _)| name)
}

/// Times from the first to the last row of each run of rows that meet a condition.
pub(crate) fn spans<T>(rows: &[T], t_s: impl Fn(&T) -> f64, condition: impl Fn(&T) -> bool) -> Vec<(f64, f64)> {
    let ends = |group: &[T]| (t_s(&group[0]), t_s(&group[group.len() - 1]));
    let groups = rows.chunk_by(|a, b| condition(a) == condition(b));
    groups.filter(|group| condition(&group[0])).map(ends).collect()
}

/// A number of things, in the singular if it is one.
pub(crate) fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read_text(text: &str) -> Result<Vec<OutlineRow>> {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("outline.csv");
        fs::write(&path, text).expect("written");
        read_rows(&path)
    }

    #[test]
    fn verif_an_estimator_without_a_score_is_never_the_smallest() {
        let score = |name: &str| [("ekf", 2.0), ("ukf", 1.0)].iter().find(|row| row.0 == name).map(|row| row.1);
        assert_eq!(smallest(["particle", "ekf", "ukf"].into_iter(), score), Some("ukf"));
        assert_eq!(smallest(["particle"].into_iter(), score), None);
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
        assert!(message.contains("run.json: no such file, expected the folder of a run"), "{message}");
    }
}
