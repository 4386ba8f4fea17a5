//! Search for the most probable curve, some readings at a time, so that no step of an estimator takes long.
//!
//! A search starts from the last curve. It may try further ways: the cost is not convex, and a descent by way of another
//! prior can end in a better minimum. It works on the readings at its start; later ones count for the next search.

use std::cell::RefCell;
use std::ops::ControlFlow;

use filters::cholesky;
use filters::least_squares::{Damping, Method, Minimisation, Settings, Wanted};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::curve::{Curve, PITCH_M};
use super::fit::{Comparisons, Evidence, Tally};
use super::prior::Prior;
use super::readings::Reading;
use crate::estimators::side::Side;

/// Cells beyond the outermost contacts.
const MARGIN_M: f64 = 2.0 * PITCH_M;

/// Iterations for the length of a curve.
const LENGTH_ROUNDS: usize = 3;

/// Maximum numbers of steps of a search from the last curve, of one by way of another prior, and of either at the end.
const NEAR_STEPS: usize = 10;
const FAR_STEPS: usize = 6;
const LAST_STEPS: usize = 40;

/// Levenberg-Marquardt method, whose damping begins with next to none: where a prior ties many unknowns to one another,
/// the diagonal of the curvature is far larger than the curvature for all of them together.
const SETTINGS: Settings = Settings {
    method: Method::LevenbergMarquardt(Damping {
        first: 1e-9,
        lowest: 1e-9,
        restart: 1e-9,
        highest: f64::INFINITY,
        decrease: 0.01,
        increase: 20.0,
        attempts: 10,
    }),
    iterations: LAST_STEPS,
    absolute: 1e-2,
    relative: 0.0,
    step: 0.0,
};

/// Work of one step of an estimator on a search, in comparisons of a reading with a curve, of about half a microsecond each if the
/// contact is not known yet, and the same for an urgent search.
const WORK: usize = 100;
const URGENT_WORK: usize = 8000;

/// Work of most searches per reading.
const SEARCH_WORK: usize = 40;

/// Work of a comparison with its derivatives.
const DERIVATIVES_WORK: usize = 2;

/// Work of the solution of the equations of a step for a number of unknowns, whose factorisation takes a time in proportion to the
/// third power of the number. Like [`column_work`], an upper bound, from the time on processors with narrow registers.
fn solution_work(unknowns: usize) -> usize {
    30 + unknowns.pow(3) / 4500
}

/// Work of a column of the inverse.
fn column_work(unknowns: usize) -> usize {
    1 + unknowns.pow(2) / 700
}

/// Difference of cost by which the result of a distant search must be better.
const FAR_MARGIN: f64 = 1.0;

/// Extent of a search for the curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// From the last curve.
    Near,
    /// Also by way of the rough prior.
    Far,
    /// Also by way of the smooth prior, and until convergence.
    Last,
}

/// Work on a search in each step of an estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Haste {
    /// Little, so that no step takes long, but enough for most searches to end within a number of steps.
    Calm { steps: usize },
    /// As much as most searches take: the object may have changed, as at a corner, and the estimates wait for the end.
    Urgent,
}

/// A curve with its uncertainty.
#[derive(Clone, Debug)]
pub(super) struct Fitted {
    pub(super) curve: Curve,
    /// Covariance of the curve's state.
    pub(super) covariance: DMatrix<f64>,
    /// Range of `tau` that was touched.
    pub(super) touched_m: (f64, f64),
}

impl Fitted {
    /// A curve that no reading has determined yet.
    pub(super) fn new(curve: Curve) -> Self {
        Self { covariance: unknown(&curve), curve, touched_m: (0.0, 0.0) }
    }
}

fn unknown(curve: &Curve) -> DMatrix<f64> {
    DMatrix::identity(curve.size(), curve.size())
}

/// A search in progress.
pub(super) struct Search {
    prior: Prior,
    gate_sds: f64,
    effort: Effort,
    haste: Haste,
    readings: Vec<Reading>,
    /// The readings compared with the curve that was computed last.
    compared: RefCell<Comparisons>,
    /// Ways that remain, the next one last.
    ways: Vec<Way>,
    /// The most probable curve so far, and its cost.
    best: (Curve, f64),
    touched_m: (f64, f64),
    stage: Stage,
}

/// Stage of a search. Each holds the sums over the readings that it has compared so far.
enum Stage {
    /// The range of all readings, to which the curve is extended or trimmed.
    Length(Length),
    /// The wanted evaluation of a way.
    Descent(Box<Way>, Tally),
    /// The cost of a curve at the end of a way.
    Comparison(Curve, Tally),
    /// The information about the most probable curve, the inverse of its covariance.
    Information(Tally),
    /// The covariance of the most probable curve, column by column.
    Covariance(Box<Inversion>),
}

/// Inversion of a matrix, some columns at a time.
struct Inversion {
    factor: Cholesky<f64, Dyn>,
    /// The identity, of which the first columns have been replaced by the lower triangle of the inverse.
    columns: DMatrix<f64>,
    /// Number of these.
    count: usize,
    /// Effect on the curve's state of a sensor model error that is the same everywhere.
    shift: DVector<f64>,
}

/// Range of the readings' contacts.
#[derive(Clone, Copy)]
struct Length {
    count: usize,
    low_m: f64,
    high_m: f64,
    /// Number of times that the curve has been extended before.
    rounds: usize,
    /// Whether the ways are at their end.
    is_last: bool,
}

impl Length {
    fn new(rounds: usize, is_last: bool) -> Self {
        Self { count: 0, low_m: f64::INFINITY, high_m: f64::NEG_INFINITY, rounds, is_last }
    }
}

/// Descent under a prior, and then under another one.
struct Way {
    prior: Prior,
    /// `None` if there is no other, or it is the present one.
    then: Option<Prior>,
    settings: Settings,
    descent: Minimisation<Curve>,
}

/// Result of some work: the next stage and how much work it was, or the end of the search.
type Worked = ControlFlow<Fitted, (Stage, usize)>;

impl Search {
    /// A search from a curve, with the readings that are to determine it.
    pub(super) fn new(
        from: &Fitted,
        readings: &[Reading],
        (prior, gate_sds): (Prior, f64),
        effort: Effort,
        haste: Haste,
    ) -> Self {
        Self {
            prior,
            gate_sds,
            effort,
            haste,
            readings: readings.to_vec(),
            compared: RefCell::new(Comparisons::new(readings)),
            ways: Vec::new(),
            best: (from.curve.clone(), f64::INFINITY),
            touched_m: from.touched_m,
            stage: Stage::Length(Length::new(0, false)),
        }
    }

    /// Makes the search urgent.
    pub(super) fn hurry(&mut self) {
        self.haste = Haste::Urgent;
    }

    /// Continues by the work of one step of an estimator. The result, if it was found.
    pub(super) fn advance(&mut self, side: &Side) -> Option<Fitted> {
        let most = match self.haste {
            Haste::Calm { steps } => WORK.max(SEARCH_WORK * self.readings.len() / steps.max(1)),
            Haste::Urgent => URGENT_WORK,
        };
        self.work(side, most)
    }

    /// Continues to the end.
    pub(super) fn finish(mut self, side: &Side) -> Fitted {
        loop {
            if let Some(fitted) = self.work(side, usize::MAX) {
                return fitted;
            }
        }
    }

    /// Continues by this work, which a solution may exceed if it is all that is done. The result, if it was found.
    fn work(&mut self, side: &Side, mut most: usize) -> Option<Fitted> {
        while most > 0 {
            let placeholder = Stage::Length(Length::new(0, true));
            let worked = match std::mem::replace(&mut self.stage, placeholder) {
                Stage::Length(length) => self.fit_length(side, length, most),
                Stage::Descent(way, tally) => self.descend(side, way, tally, most),
                Stage::Comparison(curve, tally) => self.compare(side, curve, tally, most),
                Stage::Information(tally) => self.inform(side, tally, most),
                Stage::Covariance(inversion) => self.invert(inversion, most),
            };
            match worked {
                ControlFlow::Continue((stage, work)) => {
                    self.stage = stage;
                    most = most.saturating_sub(work);
                }
                ControlFlow::Break(fitted) => return Some(fitted),
            }
        }
        None
    }

    fn evidence<'a>(&'a self, side: &'a Side, prior: Prior) -> Evidence<'a> {
        Evidence::new(side, &self.readings, &self.compared, prior, self.gate_sds)
    }

    /// Extends or trims the curve to the range of all readings.
    fn fit_length(&mut self, side: &Side, mut length: Length, most: usize) -> Worked {
        let before = length.count;
        length.count = self.readings.len().min(before.saturating_add(most));
        let curve = &mut self.best.0;
        let compared = self.compared.get_mut().with(curve, side, &self.readings, before..length.count);
        for contact in compared.iter().filter_map(|found| found.contact.as_ref()) {
            length.low_m = length.low_m.min(contact.place.tau_m);
            length.high_m = length.high_m.max(contact.place.tau_m);
        }
        let work = length.count - before;
        let Length { count, low_m, high_m, rounds, is_last } = length;
        if count < self.readings.len() {
            return ControlFlow::Continue((Stage::Length(length), work));
        }
        let is_longer = low_m <= high_m && {
            self.touched_m = (low_m, high_m);
            let is_longer = curve.extend(low_m - MARGIN_M, high_m + MARGIN_M);
            curve.trim(low_m - MARGIN_M - PITCH_M, high_m + MARGIN_M + PITCH_M);
            is_longer
        };
        let stage = if is_longer && rounds + 1 < LENGTH_ROUNDS {
            Stage::Length(Length::new(rounds + 1, is_last))
        } else if is_last {
            Stage::Information(Tally::default())
        } else {
            self.ways = self.all_ways();
            self.next_way()
        };
        ControlFlow::Continue((stage, work))
    }

    /// The ways of the search, the first one last.
    fn all_ways(&self) -> Vec<Way> {
        let prior = self.prior;
        let (near, far): (usize, &[(Prior, usize)]) = match self.effort {
            Effort::Near => (NEAR_STEPS, &[]),
            Effort::Far => (NEAR_STEPS, &[(prior.rough(), FAR_STEPS)]),
            Effort::Last => (LAST_STEPS, &[(prior.smooth(), LAST_STEPS), (prior.rough(), LAST_STEPS)]),
        };
        let way = |by: Option<Prior>, steps| {
            let settings = Settings { iterations: steps, ..SETTINGS };
            let descent = Minimisation::begin(self.best.0.clone(), settings);
            Way { prior: by.unwrap_or(prior), then: by.map(|_| prior), settings, descent }
        };
        far.iter().map(|(by, steps)| way(Some(*by), *steps)).chain([way(None, near)]).collect()
    }

    /// The beginning of the next way, or of the end.
    fn next_way(&mut self) -> Stage {
        self.ways
            .pop()
            .map_or_else(|| Stage::Length(Length::new(0, true)), |way| Stage::Descent(Box::new(way), Tally::default()))
    }

    /// Continues a way by the evaluation that its descent needs next.
    fn descend(&mut self, side: &Side, mut way: Box<Way>, mut tally: Tally, most: usize) -> Worked {
        let evidence = self.evidence(side, way.prior);
        let solution_work = solution_work(self.best.0.size());
        let (work, flow) = match way.descent.wanted() {
            Wanted::Approximation(curve) => {
                let work = DERIVATIVES_WORK * evidence.add_squares(curve, &mut tally, most.div_ceil(DERIVATIVES_WORK));
                if !evidence.is_complete(&tally) || waits(work, solution_work, most) {
                    return ControlFlow::Continue((Stage::Descent(way, tally), most));
                }
                let (quadratic, _) = evidence.approximation(curve, tally);
                (work, way.descent.take_approximation(&evidence, Some(quadratic)))
            }
            Wanted::Cost { state, .. } => {
                let work = evidence.add_costs(state, &mut tally, most);
                if !evidence.is_complete(&tally) || waits(work, solution_work, most) {
                    return ControlFlow::Continue((Stage::Descent(way, tally), most));
                }
                let cost = evidence.total(state, &tally);
                (work, Some(way.descent.take_cost(&evidence, Some(cost))))
            }
        };
        let stage = match flow {
            Some(ControlFlow::Continue(())) => Stage::Descent(way, Tally::default()),
            Some(ControlFlow::Break(_)) => match way.then.take() {
                Some(prior) => {
                    (way.prior, way.descent) = (prior, Minimisation::begin(way.descent.state, way.settings));
                    Stage::Descent(way, Tally::default())
                }
                None => Stage::Comparison(way.descent.state, Tally::default()),
            },
            // The way leads nowhere.
            None => self.next_way(),
        };
        ControlFlow::Continue((stage, work + solution_work))
    }

    /// Keeps the curve at the end of a way if it is the most probable one.
    fn compare(&mut self, side: &Side, curve: Curve, mut tally: Tally, most: usize) -> Worked {
        let evidence = self.evidence(side, self.prior);
        let work = evidence.add_costs(&curve, &mut tally, most);
        if !evidence.is_complete(&tally) {
            return ControlFlow::Continue((Stage::Comparison(curve, tally), work));
        }
        let cost = evidence.total(&curve, &tally);
        if cost + FAR_MARGIN < self.best.1 {
            self.best = (curve, cost);
        }
        ControlFlow::Continue((self.next_way(), work))
    }

    /// Begins with the covariance of the curve's state: that by the readings' noise under the prior, and the effect of a sensor
    /// model error that is the same everywhere (a consider parameter: Schmidt 1966).
    fn inform(&mut self, side: &Side, mut tally: Tally, most: usize) -> Worked {
        let curve = &self.best.0;
        let evidence = self.evidence(side, self.prior.for_covariance());
        let work = DERIVATIVES_WORK * evidence.add_squares(curve, &mut tally, most.div_ceil(DERIVATIVES_WORK));
        let solution_work = solution_work(curve.size());
        if !evidence.is_complete(&tally) || waits(work, solution_work, most) {
            return ControlFlow::Continue((Stage::Information(tally), most));
        }
        let (quadratic, pull) = evidence.approximation(curve, tally);
        let Some(factor) = cholesky(quadratic.curvature) else { return self.conclude(unknown(curve)) };
        let (shift, columns) = (factor.solve(&pull), unknown(curve));
        let inversion = Inversion { factor, columns, count: 0, shift };
        ControlFlow::Continue((Stage::Covariance(Box::new(inversion)), work + solution_work))
    }

    /// Computes the next columns of the covariance.
    fn invert(&mut self, mut inversion: Box<Inversion>, most: usize) -> Worked {
        let Inversion { factor, columns, count, shift } = &mut *inversion;
        let (size, column_work) = (columns.ncols(), column_work(columns.ncols()));
        let added = (most / column_work).clamp(1, size - *count);
        // Entries above the diagonal are those below it, and those below it depend on the rest of the factor alone.
        for j in *count..*count + added {
            let (rest, mut column) = (factor.l_dirty().view_range(j.., j..), columns.view_range_mut(j.., j));
            rest.solve_lower_triangular_unchecked_mut(&mut column);
            rest.ad_solve_lower_triangular_unchecked_mut(&mut column);
        }
        *count += added;
        if *count < size {
            return ControlFlow::Continue((Stage::Covariance(inversion), most));
        }
        columns.fill_upper_triangle_with_lower_triangle();
        columns.ger(1.0, shift, shift, 1.0);
        let covariance = std::mem::take(columns);
        self.conclude(covariance)
    }

    /// The result, with the covariance of the curve's state.
    fn conclude(&self, covariance: DMatrix<f64>) -> Worked {
        ControlFlow::Break(Fitted { curve: self.best.0.clone(), covariance, touched_m: self.touched_m })
    }
}

/// Whether a solution waits for the next step of the estimator: with it, the present step would exceed `most`, and has done some
/// work already.
fn waits(work: usize, solution_work: usize, most: usize) -> bool {
    work > 0 && solution_work > most.saturating_sub(work)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::Knowledge;
    use crate::estimators::outline::contact::contact;
    use crate::estimators::testing::knowledge;
    use crate::frames::Pose;

    const CALM: Haste = Haste::Calm { steps: 1000 };

    /// Readings of a whisker that slides back and forth on an arc of 5 mm, and a curve of another radius there.
    fn problem(side: &Side, knowledge: &Knowledge, count: u32) -> (Vec<Reading>, Fitted) {
        let point = knowledge.rest.beside(0.055, -4e-3).vector();
        let curve = |radius_m: f64| Curve::new(-1.0, point, 0.0, radius_m);
        let object = curve(5e-3);
        let reading = |i: u32| {
            let t = f64::from(i) / 10.0;
            let base = Pose::new(2e-3 * (t.cos() - 1.0), 1.5e-3 * t.sin(), 0.02 * (2.0 * t).sin());
            Reading::new(base, contact(side, &base, &object, 0.0).expect("a contact").reading_n_m, 0.0)
        };
        ((0..count).map(reading).collect(), Fitted::new(curve(2e-3)))
    }

    #[test]
    fn verif_a_search_in_parts_is_that_at_once_and_no_part_takes_long() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        for count in [0, 1, 60, 256] {
            let (readings, from) = problem(&side, &knowledge, count);
            let search = |haste| Search::new(&from, &readings, (Prior::default(), 5.0), Effort::Far, haste);
            let at_once = search(Haste::Urgent).finish(&side);
            // A part ends with the work that is due or with one comparison or solution more.
            for most in [1, WORK, URGENT_WORK] {
                let mut in_parts = search(CALM);
                let parts = (0..1_000_000).find_map(|part| Some((part, in_parts.work(&side, most)?)));
                let (parts, found) = parts.expect("an end");
                assert_eq!((found.curve.logs(), found.touched_m), (at_once.curve.logs(), at_once.touched_m));
                assert_eq!(found.covariance, at_once.covariance);
                // The covariance alone compares every reading with its derivatives.
                assert!(
                    parts >= 2 * readings.len() / (most + DERIVATIVES_WORK + solution_work(found.curve.size())),
                    "{count} {most}: {parts}"
                );
            }
        }
    }

    #[test]
    fn verif_an_urgent_search_takes_fewer_steps() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let (readings, from) = problem(&side, &knowledge, 60);
        let steps = |hurries: bool| {
            let mut search = Search::new(&from, &readings, (Prior::default(), 5.0), Effort::Far, CALM);
            search.advance(&side);
            if hurries {
                search.hurry();
            }
            (1..10_000).find(|_| search.advance(&side).is_some()).expect("an end")
        };
        let (calm, urgent) = (steps(false), steps(true));
        assert!(calm > 10 && urgent <= 2, "{calm} {urgent}");
    }
}
