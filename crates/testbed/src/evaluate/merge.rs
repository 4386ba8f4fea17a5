//! From what the items left behind to the tables of a run.
//!
//! Tables with a row a trial are written as the shards are read, in the order of trials, noise levels and seeds, whatever the order in which they were
//! finished. A row over the trials of a set needs one value of each of them at once, for quantiles. Such rows are made some at a time, as many as a fixed memory
//! allows, and the shards are read again for the next: memory does not grow with the number of trials, unless a single column of one set does not fit.

use std::collections::BTreeMap;
use std::path::Path;

use files::{AtomicFile, write_atomically};
use rayon::prelude::*;

use super::contours;
use super::plan::Plan;
use super::shards::{Outcome, Shards, Yield};
use super::tables::{self, Place};
use crate::consistency::{Average, NEES_TEST, NIS_TEST};
use crate::metrics::{METRICS, Scores};
use crate::results::{
    ContourTrialRow, FailureRow, MapObjectRow, MapRow, SummaryHead, SummaryRow, TableFile, TrialRow, csv_bytes,
    score_bytes,
};

/// Bytes of values that are held at once.
const MOST_BYTES: usize = 100_000_000;

/// What comes of a run beside its tables.
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
    let table = |name: &str| folder.join(name);
    let file = |name: &str| AtomicFile::create(&table(name));
    let mut trials = TableFile::<TrialRow>::of_scores(file("trials.csv")?)?;
    let mut contour_trials = TableFile::<ContourTrialRow>::new(file("contour_trials.csv")?)?;
    let mut maps = TableFile::<MapRow>::new(file("maps.csv")?)?;
    let mut map_objects = TableFile::<MapObjectRow>::new(file("map_objects.csv")?)?;
    let mut failures = Vec::new();
    let (mut sets, mut contour_sets) = (Sets::default(), Sets::default());
    shards.each(|done| {
        for outcome in done.outcomes {
            trials.push_scores(&outcome.row)?;
            sets.add(&outcome);
        }
        for contour in done.contours {
            contour_trials.push(&contour)?;
            contour_sets.of(&place_of_contour(&contour)).trials += 1;
        }
        done.maps.iter().try_for_each(|map| maps.push(map))?;
        done.map_objects.iter().try_for_each(|object| map_objects.push(object))?;
        failures.extend(done.failures);
        Ok(())
    })?;
    trials.finish()?.finish()?;
    contour_trials.finish()?.finish()?;
    maps.finish()?.finish()?;
    map_objects.finish()?.finish()?;
    write_atomically(&table("failures.csv"), &csv_bytes(&failures)?)?;

    let columns = contour_sets.sets.iter().enumerate().map(|(set, of)| ((set, 0), of.trials)).collect();
    let contours = shards.by_column(
        columns,
        |done, keep| {
            for contour in &done.contours {
                keep((contour_sets.place(&place_of_contour(contour)), 0), contours::judged(contour));
            }
        },
        |(set, _), judged| contours::summarise(&contour_sets.sets[set].place, &judged),
    )?;
    write_atomically(&table("contours.csv"), &csv_bytes(&contours)?)?;

    let errors = shards.by_column(
        sets.columns(|set| &set.error_bins),
        |done, keep| {
            for outcome in &done.outcomes {
                let set = sets.place(&place_of(outcome));
                outcome.over_time.errors_m.iter().for_each(|&(bin, error_m)| keep((set, bin), error_m));
            }
        },
        |(set, bin), errors_m| tables::error_band(&sets.sets[set].place, bin, errors_m),
    )?;
    write_atomically(&table("error_over_time.csv"), &csv_bytes(&errors)?)?;

    let consistency = shards.by_column(
        sets.columns(|set| &set.state_bins),
        |done, keep| {
            for outcome in &done.outcomes {
                let set = sets.place(&place_of(outcome));
                outcome.over_time.states.iter().for_each(|&(bin, state)| keep((set, bin), state));
            }
        },
        |(set, bin), states| tables::consistency(&sets.sets[set].place, bin, &states),
    )?;
    write_atomically(&table("consistency.csv"), &csv_bytes(&consistency)?)?;

    let metrics = sets
        .sets
        .iter()
        .enumerate()
        .flat_map(|(set, of)| (0..METRICS.len() as u64).map(move |metric| ((set, metric), of.trials)));
    let scores = shards.by_column(
        metrics.collect(),
        |done, keep| {
            for outcome in &done.outcomes {
                let set = sets.place(&place_of(outcome));
                (0..).zip(outcome.row.scores.values()).for_each(|(metric, &value)| keep((set, metric), value));
            }
        },
        |(_, metric), values| Score::of(metric as usize, &values),
    )?;
    let summary: Vec<SummaryRow> =
        sets.sets.iter().zip(scores.chunks(METRICS.len())).map(|(set, scores)| set.summary(scores)).collect();
    write_atomically(&table("summary.csv"), &score_bytes(&summary)?)?;
    Ok(Merged { summary, failures })
}

/// A row over a set: the set by its place, and which of its rows of this kind.
type Column = (usize, u64);

/// The shards, in the order of results.
struct InOrder<'a> {
    shards: &'a Shards,
    plan: &'a Plan,
    order: &'a [(usize, usize)],
}

impl InOrder<'_> {
    /// Takes every trial in turn.
    fn each(&self, mut take: impl FnMut(Yield) -> anyhow::Result<()>) -> anyhow::Result<()> {
        for some in self.order.chunks(2 * rayon::current_num_threads()) {
            let read = |&(item, member): &(usize, usize)| {
                let mut trials = self.shards.read(item)?;
                let seeds = self.plan.items[item].seeds.len();
                Ok(trials.drain(member * seeds..(member + 1) * seeds).collect())
            };
            let read: Vec<Vec<Yield>> = some.par_iter().map(read).collect::<anyhow::Result<_>>()?;
            read.into_iter().flatten().try_for_each(&mut take)?;
        }
        Ok(())
    }

    /// Makes a row of each column, in their order: `pick` hands over the values of a trial, each with its column. `columns` says how many values each one has.
    fn by_column<T: Send, Row: Send>(
        &self,
        columns: Vec<(Column, usize)>,
        pick: impl Fn(&Yield, &mut dyn FnMut(Column, T)),
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
            self.each(|done| {
                pick(&done, &mut |column, value| {
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

fn place_of(outcome: &Outcome) -> Place {
    let head = &outcome.row.head;
    let (group, whisker, estimator) = (head.group.clone(), head.whisker.clone(), head.estimator.clone());
    Place { group, whisker, estimator, noise: head.noise }
}

fn place_of_contour(row: &ContourTrialRow) -> Place {
    let (group, whisker, estimator) = (row.group.clone(), row.whisker.clone(), row.estimator.clone());
    Place { group, whisker, estimator, noise: row.noise }
}

/// Trials that are put together, and how many values each row over them will have.
struct Set {
    place: Place,
    object: String,
    trials: usize,
    elapsed_ns: u64,
    steps: usize,
    /// Of models that are weighed against one another: their names, the sums of their probabilities, and in how many trials.
    models: Vec<(String, f64)>,
    weighed: usize,
    error_bins: BTreeMap<u64, usize>,
    state_bins: BTreeMap<u64, usize>,
}

/// Sets in the order in which they first appear.
#[derive(Default)]
struct Sets {
    sets: Vec<Set>,
    places: BTreeMap<(String, String, u64, String), usize>,
}

impl Sets {
    fn key(place: &Place) -> (String, String, u64, String) {
        (place.group.clone(), place.whisker.clone(), place.noise.to_bits(), place.estimator.clone())
    }

    fn place(&self, place: &Place) -> usize {
        self.places[&Self::key(place)]
    }

    fn of(&mut self, place: &Place) -> &mut Set {
        let next = self.sets.len();
        let set = *self.places.entry(Self::key(place)).or_insert(next);
        if set == next {
            self.sets.push(Set::new(place.clone()));
        }
        &mut self.sets[set]
    }

    fn add(&mut self, outcome: &Outcome) {
        self.of(&place_of(outcome)).add(outcome);
    }

    /// The columns of a table over time.
    fn columns(&self, bins: impl Fn(&Set) -> &BTreeMap<u64, usize>) -> Vec<(Column, usize)> {
        let sets = self.sets.iter().enumerate();
        sets.flat_map(|(set, of)| bins(of).iter().map(move |(&bin, &count)| ((set, bin), count))).collect()
    }
}

impl Set {
    fn new(place: Place) -> Self {
        Self {
            place,
            object: String::new(),
            trials: 0,
            elapsed_ns: 0,
            steps: 0,
            models: Vec::new(),
            weighed: 0,
            error_bins: BTreeMap::new(),
            state_bins: BTreeMap::new(),
        }
    }

    fn add(&mut self, outcome: &Outcome) {
        if self.trials == 0 {
            self.object = outcome.row.head.object.clone();
        }
        self.trials += 1;
        self.elapsed_ns += outcome.elapsed_ns;
        self.steps += outcome.steps;
        if !outcome.models.is_empty() {
            if self.weighed == 0 {
                self.models = outcome.models.iter().map(|(name, _)| (name.clone(), 0.0)).collect();
            }
            self.weighed += 1;
            for (name, sum) in &mut self.models {
                *sum += outcome.models.iter().find(|(known, _)| known == name).map_or(0.0, |(_, share)| *share);
            }
        }
        for &(bin, _) in &outcome.over_time.errors_m {
            *self.error_bins.entry(bin).or_default() += 1;
        }
        for &(bin, _) in &outcome.over_time.states {
            *self.state_bins.entry(bin).or_default() += 1;
        }
    }

    fn summary(&self, scores: &[Score]) -> SummaryRow {
        let mut models: Vec<(&str, f64)> =
            self.models.iter().map(|(name, sum)| (name.as_str(), sum / self.weighed as f64)).collect();
        models.sort_by(|a, b| b.1.total_cmp(&a.1));
        let models: Vec<String> = models.into_iter().map(|(name, share)| format!("{name}={share:.3}")).collect();
        let mut over_trials = scores.iter().map(|score| score.over_trials);
        SummaryRow {
            head: SummaryHead {
                group: self.place.group.clone(),
                whisker: self.place.whisker.clone(),
                object: self.object.clone(),
                estimator: self.place.estimator.clone(),
                noise: self.place.noise,
                trials: self.trials,
                step_ns: self.elapsed_ns as f64 / self.steps as f64,
                models: (!models.is_empty()).then(|| models.join(" ")),
                verdict: verdict(scores),
            },
            scores: Scores::from_fn(|_| over_trials.next().flatten()),
        }
    }
}

/// One metric of a set.
struct Score {
    over_trials: Option<f64>,
    /// Its average beside what it would be if all that is stated were right, where it is a mean of chi-square numbers.
    average: Option<Average>,
}

impl Score {
    fn of(metric: usize, values: &[Option<f64>]) -> Self {
        let metric = &METRICS[metric];
        let judged = [NEES_TEST, NIS_TEST].into_iter().find(|judged| judged.metric.name == metric.name);
        let stated = || values.iter().copied().flatten().collect::<Vec<f64>>();
        let average = judged.and_then(|judged| Average::of_trials(judged.freedom, &stated()));
        Self { over_trials: metric.summary.of(values), average }
    }
}

/// What the innovations of a set say of the estimator's model; of one that states none, what its errors do.
fn verdict(scores: &[Score]) -> Option<String> {
    let place = |name: &str| METRICS.iter().position(|metric| metric.name == name);
    [NIS_TEST, NEES_TEST].iter().find_map(|judged| {
        let average = scores[place(judged.metric.name)?].average.as_ref()?;
        Some(average.sentence())
    })
}
