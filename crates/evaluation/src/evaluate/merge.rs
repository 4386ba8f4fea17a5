//! Merging of the items' results into the tables of a run.
//!
//! Tables with one row per trial are written as the shards are read, in the order of trials, noise levels and seeds,
//! which does not depend on the order in which the items were finished. A row over the trials of a set needs the values
//! of all of them at once, for quantiles. Such rows are computed in windows of limited memory, and the shards are read
//! again for each window: memory does not grow with the number of trials, unless the values of a single row exceed the
//! limit.

use std::collections::BTreeMap;
use std::path::Path;

use files::{AtomicFile, write_atomically};
use rayon::prelude::*;
use testbed::consistency::{Average, ErrorConsistency, NEES_FREEDOM, NIS_FREEDOM, TrialErrors};
use testbed::metrics::consistency::NIS;
use testbed::metrics::error::RMSE;
use testbed::metrics::{METRICS, Metric, Scores};
use testbed::results::files::{
    CONSISTENCY, CONTOUR_TRIALS, CONTOURS, ERROR_OVER_TIME, FAILURES, MAP_OBJECTS, MAPS, QUANTITIES, SUMMARY, TRIALS,
};
use testbed::results::{
    ContourTrialRow, FailureRow, Keyed, MapObjectRow, MapRow, QuantityRow, RunFile, SetKey, SetName, SummaryHead,
    SummaryRow, TableFile, TrialRow, csv_bytes, score_bytes,
};
use testbed::statistics::{mean, quantile};

use super::contours::{ContourScores, contour_score};
use super::plan::Plan;
use super::shards::{EstimatorResult, Shards, TrialResults};
use super::tables;

/// Largest number of bytes of values held at once.
const MOST_BYTES: usize = 100_000_000;

/// Summary and failures of a merged run.
pub(super) struct Merged {
    pub(super) summary: Vec<SummaryRow>,
    pub(super) failures: Vec<FailureRow>,
}

/// Writes the tables of a run into its folder.
///
/// # Errors
/// If a shard cannot be read or a table cannot be written.
pub(super) fn merge(plan: &Plan, shards: &Shards, folder: &Path) -> anyhow::Result<Merged> {
    let order = plan.in_order();
    let shards = InOrder { shards, plan, order: &order };
    let TrialTables { sets, contour_sets, failures } = write_trial_tables(&shards, folder)?;
    write_contours(&shards, &contour_sets, folder)?;
    write_errors(&shards, &sets, folder)?;
    write_consistency(&shards, &sets, folder)?;
    let summary = write_summary(&shards, &sets, folder)?;
    Ok(Merged { summary, failures })
}

/// Sets and failures found while the tables by trial are written.
struct TrialTables {
    sets: Sets,
    /// Sets with outlines.
    contour_sets: Sets,
    failures: Vec<FailureRow>,
}

/// Writes the tables with one row per trial, map, object of a map or failure.
fn write_trial_tables(shards: &InOrder<'_>, folder: &Path) -> anyhow::Result<TrialTables> {
    let create = |file: RunFile| AtomicFile::create(&file.path(folder));
    let mut trials = TableFile::<TrialRow>::of_scores(create(TRIALS)?)?;
    let mut contour_trials = TableFile::<ContourTrialRow>::new(create(CONTOUR_TRIALS)?)?;
    let mut quantities = TableFile::<QuantityRow>::new(create(QUANTITIES)?)?;
    let mut maps = TableFile::<MapRow>::new(create(MAPS)?)?;
    let mut map_objects = TableFile::<MapObjectRow>::new(create(MAP_OBJECTS)?)?;
    let mut failures = Vec::new();
    let (mut sets, mut contour_sets) = (Sets::default(), Sets::default());
    shards.each(|results| {
        for result in results.estimators {
            trials.push_scores(&result.row)?;
            sets.of(&result.row.head.key()).add(&result);
        }
        for contour in results.contours {
            contour_trials.push(&contour)?;
            contour_sets.of(&contour.key()).trials += 1;
        }
        results.quantities.iter().try_for_each(|quantity| quantities.push(quantity))?;
        results.maps.iter().try_for_each(|map| maps.push(map))?;
        results.map_objects.iter().try_for_each(|object| map_objects.push(object))?;
        failures.extend(results.failures);
        Ok(())
    })?;
    trials.finish()?.finish()?;
    contour_trials.finish()?.finish()?;
    quantities.finish()?.finish()?;
    maps.finish()?.finish()?;
    map_objects.finish()?.finish()?;
    write_atomically(&FAILURES.path(folder), &csv_bytes(&failures)?)?;
    Ok(TrialTables { sets, contour_sets, failures })
}

fn write_contours(shards: &InOrder<'_>, sets: &Sets, folder: &Path) -> anyhow::Result<()> {
    let columns = sets.sets.iter().enumerate().map(|(set, of)| ((set, 0), of.trials)).collect();
    let rows = shards.by_column(
        columns,
        |results, keep| {
            for contour in &results.contours {
                keep((sets.index(&contour.key()), 0), ContourScores::of(contour));
            }
        },
        |(set, _), scores| contour_score(&sets.sets[set].key, &scores),
    )?;
    write_atomically(&CONTOURS.path(folder), &csv_bytes(&rows)?)?;
    Ok(())
}

fn write_errors(shards: &InOrder<'_>, sets: &Sets, folder: &Path) -> anyhow::Result<()> {
    let rows = shards.by_column(
        sets.columns(|set| &set.error_bins),
        |results, keep| {
            for result in &results.estimators {
                let set = sets.index(&result.row.head.key());
                result.over_time.errors_m.iter().for_each(|&(bin, error_m)| keep((set, bin), error_m));
            }
        },
        |(set, bin), errors_m| tables::error_band(&sets.sets[set].key, bin, errors_m),
    )?;
    write_atomically(&ERROR_OVER_TIME.path(folder), &csv_bytes(&rows)?)?;
    Ok(())
}

fn write_consistency(shards: &InOrder<'_>, sets: &Sets, folder: &Path) -> anyhow::Result<()> {
    let rows = shards.by_column(
        sets.columns(|set| &set.state_bins),
        |results, keep| {
            for result in &results.estimators {
                let set = sets.index(&result.row.head.key());
                result.over_time.states.iter().for_each(|&(bin, state)| keep((set, bin), state));
            }
        },
        |(set, bin), states| tables::consistency(&sets.sets[set].key, bin, &states),
    )?;
    write_atomically(&CONSISTENCY.path(folder), &csv_bytes(&rows)?)?;
    Ok(())
}

fn write_summary(shards: &InOrder<'_>, sets: &Sets, folder: &Path) -> anyhow::Result<Vec<SummaryRow>> {
    let metrics = sets
        .sets
        .iter()
        .enumerate()
        .flat_map(|(set, of)| (0..METRICS.len() as u64).map(move |metric| ((set, metric), of.trials)));
    let scores = shards.by_column(
        metrics.collect(),
        |results, keep| {
            for result in &results.estimators {
                let set = sets.index(&result.row.head.key());
                (0..).zip(result.row.scores.values()).for_each(|(metric, &value)| keep((set, metric), value));
            }
        },
        |(_, metric), values| SetScore::of(metric as usize, &values),
    )?;
    let trials = sets.sets.iter().enumerate().map(|(set, of)| ((set, 0), of.trials));
    let by_errors = shards.by_column(
        trials.collect(),
        |results, keep| {
            for result in &results.estimators {
                let set = sets.index(&result.row.head.key());
                keep((set, 0), TrialErrors::of(&result.row));
            }
        },
        |_, errors| ErrorConsistency::of_trials(NEES_FREEDOM, &errors.into_iter().flatten().collect::<Vec<_>>()),
    )?;
    let of_sets = sets.sets.iter().zip(scores.chunks(METRICS.len())).zip(by_errors);
    let summary: Vec<SummaryRow> =
        of_sets.map(|((set, scores), by_errors)| set.summary(scores, by_errors.as_ref())).collect();
    write_atomically(&SUMMARY.path(folder), &score_bytes(&summary)?)?;
    Ok(summary)
}

/// A row over the trials of a set: index of the set, and number of the row within the set.
type Column = (usize, u64);

/// Shards in the order of results.
struct InOrder<'a> {
    shards: &'a Shards,
    plan: &'a Plan,
    order: &'a [(usize, usize)],
}

impl InOrder<'_> {
    /// Passes the results of every trial to a function, in order.
    fn each(&self, mut take: impl FnMut(TrialResults) -> anyhow::Result<()>) -> anyhow::Result<()> {
        for some in self.order.chunks(2 * rayon::current_num_threads()) {
            let read = |&(item, member): &(usize, usize)| {
                let mut trials = self.shards.read(item)?;
                let seeds = self.plan.items[item].seeds.len();
                Ok(trials.drain(member * seeds..(member + 1) * seeds).collect())
            };
            let read: Vec<Vec<TrialResults>> = some.par_iter().map(read).collect::<anyhow::Result<_>>()?;
            read.into_iter().flatten().try_for_each(&mut take)?;
        }
        Ok(())
    }

    /// Computes the row of each column, in their order. `pick` extracts the values of a trial, each with its column;
    /// `columns` gives the number of values of each.
    fn by_column<T: Send, Row: Send>(
        &self,
        columns: Vec<(Column, usize)>,
        pick: impl Fn(&TrialResults, &mut dyn FnMut(Column, T)),
        row: impl Fn(Column, Vec<T>) -> Row + Sync,
    ) -> anyhow::Result<Vec<Row>> {
        let mut rows = Vec::new();
        let mut left = columns.as_slice();
        while !left.is_empty() {
            let mut bytes = 0;
            let fits = |(_, count): &&(Column, usize)| {
                bytes += count * size_of::<T>();
                bytes <= MOST_BYTES
            };
            let (window, later) = left.split_at(left.iter().take_while(fits).count().max(1));
            left = later;
            let mut held: BTreeMap<Column, Vec<T>> =
                window.iter().map(|&(column, count)| (column, Vec::with_capacity(count))).collect();
            self.each(|results| {
                pick(&results, &mut |column, value| {
                    if let Some(values) = held.get_mut(&column) {
                        values.push(value);
                    }
                });
                Ok(())
            })?;
            rows.par_extend(
                held.into_iter().collect::<Vec<_>>().into_par_iter().map(|(column, values)| row(column, values)),
            );
        }
        Ok(rows)
    }
}

/// Trials of one key, and the numbers of values of the rows over them.
struct Set {
    key: SetKey,
    object: String,
    trials: usize,
    elapsed_ns: u64,
    steps: usize,
    /// Names of the models that the estimator averages, with the sums of their probabilities over trials.
    models: Vec<(String, f64)>,
    /// Number of trials with model probabilities.
    averaged: usize,
    error_bins: BTreeMap<u64, usize>,
    state_bins: BTreeMap<u64, usize>,
}

/// Sets in the order in which they first appear.
#[derive(Default)]
struct Sets {
    sets: Vec<Set>,
    indices: BTreeMap<(SetName, u64, String), usize>,
}

impl Sets {
    /// Index of a set that is known.
    fn index(&self, key: &SetKey) -> usize {
        self.indices[&key.ordered()]
    }

    fn of(&mut self, key: &SetKey) -> &mut Set {
        let next = self.sets.len();
        let set = *self.indices.entry(key.ordered()).or_insert(next);
        if set == next {
            self.sets.push(Set::new(key.clone()));
        }
        &mut self.sets[set]
    }

    /// The columns of a table over time.
    fn columns(&self, bins: impl Fn(&Set) -> &BTreeMap<u64, usize>) -> Vec<(Column, usize)> {
        let sets = self.sets.iter().enumerate();
        sets.flat_map(|(set, of)| bins(of).iter().map(move |(&bin, &count)| ((set, bin), count))).collect()
    }
}

impl Set {
    fn new(key: SetKey) -> Self {
        Self {
            key,
            object: String::new(),
            trials: 0,
            elapsed_ns: 0,
            steps: 0,
            models: Vec::new(),
            averaged: 0,
            error_bins: BTreeMap::new(),
            state_bins: BTreeMap::new(),
        }
    }

    fn add(&mut self, result: &EstimatorResult) {
        if self.trials == 0 {
            self.object = result.row.head.object.clone();
        }
        self.trials += 1;
        self.elapsed_ns += result.elapsed_ns;
        self.steps += result.steps;
        if !result.models.is_empty() {
            if self.averaged == 0 {
                self.models = result.models.iter().map(|(name, _)| (name.clone(), 0.0)).collect();
            }
            self.averaged += 1;
            for (name, sum) in &mut self.models {
                *sum += result.models.iter().find(|(known, _)| known == name).map_or(0.0, |(_, share)| *share);
            }
        }
        for &(bin, _) in &result.over_time.errors_m {
            *self.error_bins.entry(bin).or_default() += 1;
        }
        for &(bin, _) in &result.over_time.states {
            *self.state_bins.entry(bin).or_default() += 1;
        }
    }

    fn summary(&self, scores: &[SetScore], by_errors: Option<&ErrorConsistency>) -> SummaryRow {
        let mut models: Vec<(&str, f64)> =
            self.models.iter().map(|(name, sum)| (name.as_str(), sum / self.averaged as f64)).collect();
        models.sort_by(|a, b| b.1.total_cmp(&a.1));
        let models: Vec<String> = models.into_iter().map(|(name, share)| format!("{name}={share:.3}")).collect();
        let of = |metric: &Metric| &scores[metric.place()];
        let rmse = of(&RMSE).spread.as_ref();
        let mut over_trials = scores.iter().map(|score| score.over_trials);
        SummaryRow {
            head: SummaryHead {
                group: self.key.set.group.clone(),
                whisker: self.key.set.whisker.clone(),
                object: self.object.clone(),
                estimator: self.key.estimator.clone(),
                noise: self.key.noise,
                trials: self.trials,
                step_ns: self.elapsed_ns as f64 / self.steps as f64,
                models: (!models.is_empty()).then(|| models.join(" ")),
                verdict: by_errors.map(ErrorConsistency::sentence),
                nis_verdict: of(&NIS).average.as_ref().map(Average::sentence),
                rmse_mean_m: rmse.and_then(|spread| spread.mean_m),
                rmse_p90_m: rmse.and_then(|spread| spread.p90_m),
                above_0p5mm: rmse.map_or(0.0, |spread| spread.above_0p5mm),
            },
            scores: Scores::from_fn(|_| over_trials.next().flatten()),
        }
    }
}

/// One metric over the trials of a set.
struct SetScore {
    over_trials: Option<f64>,
    /// Average with the expectation of a consistent estimator. `None` unless the metric is the NIS.
    average: Option<Average>,
    /// `None` unless the metric is the RMSE.
    spread: Option<Spread>,
}

impl SetScore {
    fn of(metric: usize, values: &[Option<f64>]) -> Self {
        let metric = &METRICS[metric];
        let stated = || values.iter().copied().flatten().collect::<Vec<f64>>();
        let is_nis = metric.name == NIS.name;
        let average = is_nis.then(|| Average::of_trials(NIS_FREEDOM, &stated())).flatten();
        let spread = (metric.name == RMSE.name).then(|| Spread::of(values));
        Self { over_trials: metric.summary.of(values), average, spread }
    }
}

/// Distribution of errors over the trials of a set.
struct Spread {
    mean_m: Option<f64>,
    p90_m: Option<f64>,
    above_0p5mm: f64,
}

impl Spread {
    /// Distribution of errors, of which some are missing. A missing error counts as larger than any other.
    fn of(errors_m: &[Option<f64>]) -> Self {
        let errors_m: Vec<f64> = errors_m.iter().map(|error_m| error_m.unwrap_or(f64::INFINITY)).collect();
        Self {
            mean_m: mean(errors_m.iter().copied()).filter(|mean| mean.is_finite()),
            p90_m: quantile(&errors_m, 0.9).filter(|p90| p90.is_finite()),
            above_0p5mm: mean(errors_m.iter().map(|error_m| f64::from(*error_m > 0.5e-3))).unwrap_or(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_missing_error_is_the_largest() {
        let errors_m = [1e-4, 2e-4, 3e-4, 6e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4].map(Some);
        let all = Spread::of(&errors_m);
        assert!((all.mean_m.unwrap() - 1.9e-3 / 11.0).abs() < 1e-12, "{:?}", all.mean_m);
        assert_eq!((all.p90_m, all.above_0p5mm), (Some(3e-4), 1.0 / 11.0));
        let some = Spread::of(&[&errors_m[..], &[None, None]].concat());
        assert_eq!((some.mean_m, some.p90_m, some.above_0p5mm), (None, None, 3.0 / 13.0));
        assert_eq!(Spread::of(&[]).above_0p5mm, 0.0);
    }
}
