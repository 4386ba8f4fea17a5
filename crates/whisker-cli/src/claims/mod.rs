//! Claims of the documentation and their measurement.
//!
//! To add a claim: one entry in the file of its topic; to add a topic: one file, and one row in `TOPICS`.

mod arm;
mod certainty;
mod contact_events;
mod contacts;
mod contours;
mod determinism;
mod friction;
mod hall;
mod hollow;
mod live;
mod monte_carlo;
mod motion;
mod noiseless;
mod pins;
mod quantities;
mod real;
mod sensor_model;
mod sets;
mod space;
mod space_maps;
mod space_random;
mod space_recordings;
mod yielding;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use arm::RUN as ARM;

use anyhow::anyhow;
use files::write_atomically;
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use trace::SensorFile;

use whisker::estimators::{ESTIMATORS, EstimatorRow, MethodClass};

use testbed::dataset::Dataset;
use testbed::metrics::Metric;
use testbed::results::{
    ContourTrialRow, ErrorBandRow, MapObjectRow, MapRow, QuantityRow, RECOMMENDED, Run, SummaryRow, TrialRow, TurnRow,
    csv_bytes, read_rows, read_scores,
};
use testbed::space::rows::{SpatialMapRow, SpatialSummaryRow, SpatialTimesRow, SpatialTrialRow};
use testbed::space::run::SpatialRun;
use testbed::statistics::mean;

/// Side of the bound on which a figure has to lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// At most the bound.
    AtMost,
    /// At least the bound.
    AtLeast,
}

/// Measurement of a claim. `None` if the data lack the figure.
type Measure = Box<dyn Fn(&Context) -> anyhow::Result<Option<f64>>>;

/// A figure that the documentation claims.
pub struct Claim {
    /// Short name, unique.
    pub id: String,
    /// The claim in words.
    pub claim: String,
    /// Unit of figure and bound.
    pub unit: &'static str,
    /// Side of the bound on which the figure has to lie.
    pub relation: Relation,
    /// The bound.
    pub bound: f64,
    /// Whether there are the data that the claim needs: the recordings are optional.
    has_data: fn(&Context) -> bool,
    measure: Measure,
}

impl Claim {
    fn at_most(
        id: String,
        claim: String,
        bound: f64,
        unit: &'static str,
        measure: impl Fn(&Context) -> anyhow::Result<Option<f64>> + 'static,
    ) -> Self {
        Self { id, claim, unit, relation: Relation::AtMost, bound, has_data: |_| true, measure: Box::new(measure) }
    }

    fn at_least(
        id: String,
        claim: String,
        bound: f64,
        unit: &'static str,
        measure: impl Fn(&Context) -> anyhow::Result<Option<f64>> + 'static,
    ) -> Self {
        Self { relation: Relation::AtLeast, ..Self::at_most(id, claim, bound, unit, measure) }
    }

    /// The same claim on optional data: not measured if they are missing.
    fn if_there_are(self, has_data: fn(&Context) -> bool) -> Self {
        Self { has_data, ..self }
    }
}

/// Topics of the standard set.
const TOPICS: &[fn() -> Vec<Claim>] = &[
    sensor_model::claims,
    pins::claims,
    monte_carlo::claims,
    noiseless::claims,
    motion::claims,
    contours::claims,
    contact_events::claims,
    hall::claims,
    live::claims,
    arm::claims,
    real::claims,
    determinism::claims,
];

/// A set of claims that one command measures.
pub struct ClaimSet {
    /// Name.
    pub name: &'static str,
    /// Topics: each lists its claims.
    topics: &'static [fn() -> Vec<Claim>],
    /// Runs that the claims are measured on.
    runs: &'static [&'static str],
    /// Runs in space that the claims are measured on.
    spatial_runs: &'static [&'static str],
    /// Run and file of each figure that the documentation shows.
    pub figures: &'static [(&'static str, &'static str)],
}

/// The registry of sets; the first is the default.
pub const SETS: &[ClaimSet] = &[
    ClaimSet {
        name: "standard",
        topics: TOPICS,
        runs: RUNS,
        spatial_runs: &[],
        figures: &[(STANDARD, "physical_limit.svg"), (ARM, "scene_map.svg")],
    },
    ClaimSet {
        name: "certainty",
        topics: &[certainty::claims],
        runs: certainty::RUNS,
        spatial_runs: &[],
        figures: &[],
    },
    ClaimSet {
        name: "contacts",
        topics: &[contacts::claims, friction::claims, hollow::claims],
        runs: &[contacts::RUN, friction::RUN, hollow::RUN],
        spatial_runs: &[],
        figures: &[],
    },
    ClaimSet {
        name: "quantities",
        topics: &[quantities::claims],
        runs: quantities::RUNS,
        spatial_runs: &[],
        figures: &[],
    },
    ClaimSet { name: "yielding", topics: &[yielding::claims], runs: &[yielding::RUN], spatial_runs: &[], figures: &[] },
    ClaimSet {
        name: "space",
        topics: &[space::claims, space_maps::claims, space_recordings::claims, space_random::claims],
        runs: &[],
        spatial_runs: &[space::RUN, space_random::RUN],
        figures: &[(space::RUN, "space_maps.svg")],
    },
];

impl ClaimSet {
    fn claims(&self) -> Vec<Claim> {
        self.topics.iter().flat_map(|topic| topic()).collect()
    }
}

/// Runs that claims are measured on, named after their suites; the run of the pins through a front end is named after
/// the front end.
const RUNS: &[&str] = &[STANDARD, contours::RUN, monte_carlo::RUN, contact_events::RUN, hall::RUN, arm::RUN];

/// Default run of a claim.
const STANDARD: &str = "standard";

/// Every claim.
pub fn claims() -> Vec<Claim> {
    SETS.iter().flat_map(ClaimSet::claims).collect()
}

/// A measured claim: a row of `claims.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredClaim {
    /// Short name.
    pub id: String,
    /// The claim in words.
    pub claim: String,
    /// The figure.
    pub measured: Option<f64>,
    /// `<=` or `>=`.
    pub relation: String,
    /// The bound.
    pub bound: f64,
    /// Unit of both.
    pub unit: String,
    /// Whether the claim holds. `None` if it was not measured because optional data are missing.
    pub holds: Option<bool>,
}

/// Data of the measurements: evaluated runs and the traces of the standard suite.
pub struct Context {
    /// The runs of the set, by name.
    runs: BTreeMap<&'static str, Evaluation>,
    /// The runs of the set in space, by name.
    spatial_runs: BTreeMap<&'static str, SpatialEvaluation>,
    /// Run of the recordings. `None` if they are missing.
    recordings: Option<Evaluation>,
    /// The standard suite. `None` if the set has no claims on it.
    dataset: Option<Dataset>,
    /// Folder of the results.
    results: PathBuf,
}

/// An evaluated run.
struct Evaluation {
    run: Run,
    summary: Vec<SummaryRow>,
    trials: Vec<TrialRow>,
    bands: Vec<ErrorBandRow>,
    contours: Vec<ContourTrialRow>,
    quantities: Vec<QuantityRow>,
    /// Counts during a turn of each sensor, by the label of the sensor; empty if the front end has no sensors.
    turns: BTreeMap<String, Vec<TurnRow>>,
    maps: Vec<MapRow>,
    map_objects: Vec<MapObjectRow>,
}

/// An evaluated run in space.
struct SpatialEvaluation {
    run: SpatialRun,
    summary: Vec<SpatialSummaryRow>,
    trials: Vec<SpatialTrialRow>,
    times: Vec<SpatialTimesRow>,
    maps: Vec<SpatialMapRow>,
}

impl Context {
    /// Opens the evaluated runs of a set of claims in the folder of results, and the standard suite.
    ///
    /// # Errors
    /// If a file is missing or does not parse.
    pub fn open(set: &ClaimSet, results: &Path) -> anyhow::Result<Self> {
        let mut runs = BTreeMap::new();
        for name in set.runs {
            runs.insert(*name, Evaluation::open(&results.join(name))?);
        }
        let mut spatial_runs = BTreeMap::new();
        for name in set.spatial_runs {
            spatial_runs.insert(*name, SpatialEvaluation::open(&results.join(name))?);
        }
        let suite = Path::new("scenes/suites").join(STANDARD).with_extension("json");
        let dataset = set.runs.contains(&STANDARD).then(|| Dataset::open(&suite, None)).transpose()?;
        let recordings = results.join(real::RUN);
        let recordings = recordings.join("run.json").is_file().then(|| Evaluation::open(&recordings)).transpose()?;
        let recordings = recordings.filter(real::is_whole);
        Ok(Self { runs, spatial_runs, recordings, dataset, results: results.into() })
    }

    /// The run of the standard suite.
    fn standard(&self) -> &Evaluation {
        self.run(STANDARD)
    }

    /// The standard suite, on a run of which the claims of the set are measured.
    fn dataset(&self) -> &Dataset {
        self.dataset.as_ref().expect("the set has a run of the standard suite")
    }

    /// One of the set's runs.
    fn run(&self, name: &str) -> &Evaluation {
        &self.runs[name]
    }

    /// One of the set's runs in space.
    fn spatial(&self, name: &str) -> &SpatialEvaluation {
        &self.spatial_runs[name]
    }
}

impl SpatialEvaluation {
    fn open(folder: &Path) -> anyhow::Result<Self> {
        let Some(run) = SpatialRun::read(folder)? else { return Err(missing(folder)) };
        Ok(Self {
            run,
            summary: SpatialRun::summary(folder)?,
            trials: SpatialRun::trials(folder)?,
            times: SpatialRun::times(folder)?,
            maps: SpatialRun::maps(folder)?,
        })
    }
}

/// The error that a run is missing.
fn missing(folder: &Path) -> anyhow::Error {
    anyhow!(
        "{}: run not found; `cargo xtask reproduce` and `cargo xtask random` make the runs of claims",
        folder.display()
    )
}

impl Evaluation {
    fn open(folder: &Path) -> anyhow::Result<Self> {
        if !folder.join("run.json").is_file() {
            return Err(missing(folder));
        }
        let run = Run::read(&folder.join("run.json"))?;
        let mut turns = BTreeMap::new();
        for label in run.front_end.sensors.iter().map(SensorFile::label) {
            let path = folder.join("sensors").join(format!("{label}.turn.csv"));
            turns.insert(label, read_rows(&path)?);
        }
        Ok(Self {
            run,
            turns,
            summary: read_scores(&folder.join("summary.csv"))?,
            trials: read_scores(&folder.join("trials.csv"))?,
            bands: read_rows(&folder.join("error_over_time.csv"))?,
            contours: read_rows(&folder.join("contour_trials.csv"))?,
            quantities: read_rows(&folder.join("quantities.csv"))?,
            maps: read_rows(&folder.join("maps.csv"))?,
            map_objects: read_rows(&folder.join("map_objects.csv"))?,
        })
    }

    /// Counts during a turn of the sensor of a whisker that forms an array alone.
    fn turns_of(&self, whisker: &str) -> Option<&[TurnRow]> {
        let sensor = self.run.front_end.sensor(whisker, whisker)?;
        self.turns.get(&sensor.label()).map(Vec::as_slice)
    }

    /// Summary of an estimator on one set at the first noise level of the run.
    fn summary(&self, group: &str, whisker: &str, estimator: &str) -> Option<&SummaryRow> {
        self.summary_at(group, whisker, estimator, self.run.noise[0])
    }

    /// Summary of an estimator on one set at a noise level.
    fn summary_at(&self, group: &str, whisker: &str, estimator: &str, noise: f64) -> Option<&SummaryRow> {
        self.summary.iter().find(|SummaryRow { head, .. }| {
            head.group == group && head.whisker == whisker && head.estimator == estimator && head.noise == noise
        })
    }

    /// Smallest value of a metric over estimators.
    fn best<'a>(
        &self,
        group: &str,
        whisker: &str,
        estimators: impl Iterator<Item = &'a str>,
        metric: &Metric,
    ) -> Option<f64> {
        estimators.filter_map(|name| self.summary(group, whisker, name)?.get(metric)).min_by(f64::total_cmp)
    }

    /// Share of the trials of an estimator on one set that meet a condition, at the first noise level of the run.
    fn share(&self, group: &str, whisker: &str, estimator: &str, condition: impl Fn(&TrialRow) -> bool) -> Option<f64> {
        mean(self.trials_of(group, whisker, estimator).map(|trial| f64::from(condition(trial))))
    }

    /// Trials of an estimator on one set at the first noise level of the run.
    fn trials_of(&self, group: &str, whisker: &str, estimator: &str) -> impl Iterator<Item = &TrialRow> {
        self.trials_in(estimator, move |of| of == group).filter(move |trial| trial.head.whisker == whisker)
    }

    /// Trials of an estimator on the groups that meet a condition, at the first noise level of the run.
    fn trials_in(&self, estimator: &str, condition: impl Fn(&str) -> bool) -> impl Iterator<Item = &TrialRow> {
        self.trials.iter().filter(move |TrialRow { head, .. }| {
            head.estimator == estimator && condition(&head.group) && head.noise == self.run.noise[0]
        })
    }
}

/// Measures every claim of a set and writes the table.
///
/// # Errors
/// If a measurement fails or the table cannot be written.
pub fn measure(
    set: &ClaimSet,
    context: &Context,
    out: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<MeasuredClaim>> {
    let mut measured = Vec::new();
    let claims = set.claims();
    progress.set_length(claims.len() as u64);
    for claim in claims {
        let can_be_measured = (claim.has_data)(context);
        let value = if can_be_measured { (claim.measure)(context)? } else { None };
        let (relation, holds) = match claim.relation {
            Relation::AtMost => ("<=", value.is_some_and(|value| value <= claim.bound)),
            Relation::AtLeast => (">=", value.is_some_and(|value| value >= claim.bound)),
        };
        let holds = can_be_measured.then_some(holds);
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

/// Largest value. `None` if one is missing or there are none.
fn worst(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    values.collect::<Option<Vec<f64>>>()?.into_iter().reduce(f64::max)
}

/// Filters under test: neither baselines, nor hindsight methods, nor published configurations.
fn filters() -> impl Iterator<Item = &'static str> {
    let is_own = |row: &&EstimatorRow| row.class == MethodClass::Recursive;
    ESTIMATORS.iter().filter(is_own).map(|row| row.name)
}

/// Mean (%) of a metric over trials.
fn percent<'a>(trials: impl Iterator<Item = &'a TrialRow>, metric: &Metric) -> Option<f64> {
    mean(trials.filter_map(|trial| trial.get(metric))).map(|share| 100.0 * share)
}

/// An object in words, from the name of its group: `circle_15` has a radius of 15 mm, `pin_35` stands at an arc length of 35 mm.
fn in_words(group: &str) -> String {
    match group.rsplit_once('_') {
        Some(("pin", arc_mm)) => format!("pin at {arc_mm} mm"),
        Some((shape, radius_mm)) => format!("{shape} of radius {radius_mm} mm"),
        None if group == "l" => "L-shaped object".into(),
        None => group.into(),
    }
}

/// The whiskers of the standard suite.
const WHISKERS: [&str; 2] = ["straight", "curved"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_claims_describe_their_objects_in_words() {
        assert_eq!(in_words("circle_15"), "circle of radius 15 mm");
        assert_eq!(in_words("pin_35"), "pin at 35 mm");
        assert_eq!(in_words("octagon"), "octagon");
        let is_key = |word: &str| word.rsplit_once('_').is_some_and(|(_, end)| end.parse::<u32>().is_ok());
        // Groups of recordings have the names of their files.
        let simulated = SETS.iter().filter(|set| set.spatial_runs.is_empty());
        let with_keys: Vec<String> = simulated
            .flat_map(ClaimSet::claims)
            .map(|claim| claim.claim)
            .filter(|claim| claim.split([' ', ',', ':']).any(is_key))
            .collect();
        assert_eq!(with_keys, Vec::<String>::new());
    }
}
