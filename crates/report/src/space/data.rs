//! The run in space behind a report.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use testbed::results::read_rows;
use testbed::space::SpatialEstimateRow;
use testbed::space::files::{MAP_SURFACE, SUMMARY, TRIALS};
use testbed::space::rows::{SpatialSummaryRow, SpatialTrialRow};
use testbed::space::run::{SpatialRun, SpatialRunTrial, SweptSolid};
use testbed::space::surface::SurfaceMesh;

use crate::run_data::scored;

/// Tables of a run in space.
pub(crate) struct Data {
    folder: PathBuf,
    pub(crate) run: SpatialRun,
    pub(crate) summary: Vec<SpatialSummaryRow>,
    trials: Vec<SpatialTrialRow>,
}

impl Data {
    /// Reads the run in a folder. `None` if the folder holds no run in space.
    ///
    /// # Errors
    /// When a table is missing or damaged or has no rows.
    pub(crate) fn read(folder: &Path) -> Result<Option<Self>> {
        let Some(run) = SpatialRun::read(folder)? else { return Ok(None) };
        let summary = scored(&SUMMARY.path(folder), read_rows)?;
        let trials = scored(&TRIALS.path(folder), read_rows)?;
        Ok(Some(Self { folder: folder.into(), run, summary, trials }))
    }

    /// Names of the whiskers, in the order of the summary.
    pub(crate) fn whiskers(&self) -> Vec<&str> {
        distinct(self.summary.iter().map(|row| row.whisker.as_str()))
    }

    /// Names of the groups, in the order of the summary.
    pub(crate) fn groups(&self) -> Vec<&str> {
        distinct(self.summary.iter().map(|row| row.group.as_str()))
    }

    /// Names of the estimators, in the order of the summary.
    pub(crate) fn estimators(&self) -> Vec<&str> {
        distinct(self.summary.iter().map(|row| row.estimator.as_str()))
    }

    /// Scores of the trials of one group with one whisker.
    pub(crate) fn scores<'a>(
        &'a self,
        group: &'a str,
        whisker: &'a str,
    ) -> impl Iterator<Item = &'a SpatialSummaryRow> + Clone {
        self.summary.iter().filter(move |row| row.group == group && row.whisker == whisker)
    }

    /// The trial of a group with one whisker whose error with an estimator is the median.
    pub(crate) fn typical(&self, group: &str, whisker: &str, estimator: &str) -> Option<&SpatialRunTrial> {
        let is_of = |row: &&SpatialTrialRow| {
            (row.group.as_str(), row.whisker.as_str(), row.estimator.as_str()) == (group, whisker, estimator)
                && Some(&row.seed) == self.run.seeds.first()
        };
        let mut errors: Vec<(f64, &str)> =
            self.trials.iter().filter(is_of).filter_map(|row| Some((row.rmse_m?, row.trace.as_str()))).collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (_, name) = errors.get(errors.len() / 2)?;
        self.run.trials.iter().find(|trial| trial.trace == *name)
    }

    /// Surface of a solid by one estimator, from all sweeps over the solid.
    ///
    /// # Errors
    /// When the file is missing or damaged.
    pub(crate) fn surface(&self, swept: &SweptSolid<'_>, estimator: &str) -> Result<SurfaceMesh> {
        let path = MAP_SURFACE.path_of(&self.folder, &[&swept.traces(), estimator]);
        SurfaceMesh::read_ply(&path).context("the surface of a solid; evaluate again")
    }

    /// Estimates of one estimator on one trace with the first seed.
    ///
    /// # Errors
    /// When the table is missing or damaged.
    pub(crate) fn estimates(&self, trace: &str, estimator: &str) -> Result<Vec<SpatialEstimateRow>> {
        SpatialRun::estimates(&self.folder, trace, estimator).context("estimates; evaluate again")
    }
}

fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut found: Vec<&str> = Vec::new();
    for name in names {
        if !found.contains(&name) {
            found.push(name);
        }
    }
    found
}
