//! What the documentation claims, and how each claim is measured.
//!
//! To add a claim: one entry in the file of its topic; to add a topic: one file, and one row in [`TOPICS`].

mod contours;
mod determinism;
mod noiseless;
mod pins;
mod sensor_model;

use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use trace::write_atomically;

use whisker::estimators::ESTIMATORS;

use crate::dataset::Dataset;
use crate::results::{ErrorBandRow, Run, SummaryRow, TrialRow, csv_bytes, read_rows};

/// Whether a figure has to stay below its bound or above it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// At most the bound.
    AtMost,
    /// At least the bound.
    AtLeast,
}

/// How a claim is measured; nothing where there is nothing to measure.
type Measure = Box<dyn Fn(&Context) -> anyhow::Result<Option<f64>>>;

/// A figure that the documentation claims.
pub struct Claim {
    /// Short name, unique.
    pub id: String,
    /// What is claimed.
    pub claim: String,
    /// Unit of figure and bound.
    pub unit: &'static str,
    /// On which side of the bound the figure has to lie.
    pub relation: Relation,
    /// The bound.
    pub bound: f64,
    measure: Measure,
}

/// The registry of topics: each lists its claims.
pub const TOPICS: &[fn() -> Vec<Claim>] =
    &[sensor_model::claims, pins::claims, noiseless::claims, contours::claims, determinism::claims];

/// Every claim.
pub fn claims() -> Vec<Claim> {
    TOPICS.iter().flat_map(|topic| topic()).collect()
}

/// A claim that was measured: a row of `claims.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredClaim {
    /// Short name.
    pub id: String,
    /// What is claimed.
    pub claim: String,
    /// The figure.
    pub measured: Option<f64>,
    /// `<=` or `>=`.
    pub relation: String,
    /// The bound.
    pub bound: f64,
    /// Unit of both.
    pub unit: String,
    /// Whether the claim holds.
    pub holds: bool,
}

/// What claims are measured on: the evaluated standard suite.
pub struct Context {
    /// The run.
    pub run: Run,
    /// Folder of the run.
    pub folder: PathBuf,
    /// Its traces.
    pub dataset: Dataset,
    /// Its summary.
    pub summary: Vec<SummaryRow>,
    /// Its trials.
    pub trials: Vec<TrialRow>,
    /// Spread of the error over time.
    pub bands: Vec<ErrorBandRow>,
}

impl Context {
    /// Opens an evaluated run and its suite.
    ///
    /// # Errors
    /// If a file is missing or does not parse.
    pub fn open(folder: &Path, suite: &Path) -> anyhow::Result<Self> {
        Ok(Self {
            run: Run::read(&folder.join("run.json"))?,
            folder: folder.into(),
            dataset: Dataset::open(suite, None)?,
            summary: read_rows(&folder.join("summary.csv"))?,
            trials: read_rows(&folder.join("trials.csv"))?,
            bands: read_rows(&folder.join("error_over_time.csv"))?,
        })
    }

    /// The summary of one set at the run's first noise level.
    fn summary(&self, group: &str, whisker: &str, estimator: &str) -> Option<&SummaryRow> {
        self.summary.iter().find(|row| {
            row.group == group && row.whisker == whisker && row.estimator == estimator && row.noise == self.run.noise[0]
        })
    }

    /// Trials of one set at the run's first noise level.
    fn trials<'a>(
        &'a self,
        group: &'a str,
        whisker: &'a str,
        estimator: &'a str,
    ) -> impl Iterator<Item = &'a TrialRow> {
        self.trials.iter().filter(move |row| {
            row.group == group && row.whisker == whisker && row.estimator == estimator && row.noise == self.run.noise[0]
        })
    }
}

/// Measures every claim and writes the table.
///
/// # Errors
/// If a measurement fails or the table cannot be written.
pub fn measure(context: &Context, out: &Path, progress: &ProgressBar) -> anyhow::Result<Vec<MeasuredClaim>> {
    let mut measured = Vec::new();
    let claims = claims();
    progress.set_length(claims.len() as u64);
    for claim in claims {
        let value = (claim.measure)(context)?;
        let (relation, holds) = match claim.relation {
            Relation::AtMost => ("<=", value.is_some_and(|value| value <= claim.bound)),
            Relation::AtLeast => (">=", value.is_some_and(|value| value >= claim.bound)),
        };
        let Claim { id, claim, unit, bound, .. } = claim;
        progress.inc(1);
        measured.push(MeasuredClaim {
            id,
            claim,
            measured: value,
            relation: relation.into(),
            bound,
            unit: unit.into(),
            holds,
        });
    }
    write_atomically(out, &csv_bytes(&measured)?)?;
    Ok(measured)
}

/// The filters under test, as opposed to the baselines.
fn filters() -> impl Iterator<Item = &'static str> {
    ESTIMATORS.iter().filter(|row| !row.is_baseline).map(|row| row.name)
}

/// The whiskers of the standard suite.
const WHISKERS: [&str; 2] = ["straight", "curved"];
