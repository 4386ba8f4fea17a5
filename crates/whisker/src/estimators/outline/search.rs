//! Search for the most probable curve, some readings at a time, so that no step of an estimator takes long.
//!
//! A search starts from the last curve. It may try further ways: the cost is not convex, and a descent by way of another
//! prior can end in a better minimum. It works on the readings at its start; later ones count for the next search.

use std::cell::Cell;
use std::ops::ControlFlow;

use filters::least_squares::{Damping, Method, Minimisation, Settings, Wanted};
use nalgebra::DMatrix;

use super::contact::contact;
use super::curve::{Curve, PITCH_M};
use super::fit::{Evidence, Tally};
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

/// Number of readings that are compared with a curve in one step of an estimator; each takes about half a microsecond, and as much
/// again with its derivatives. A search that an outlier has triggered is urgent: the contact may have passed a corner, and the
/// estimates wait for its end.
const MOST_READINGS: usize = 100;
const MOST_URGENT_READINGS: usize = 1500;

/// Number of readings whose comparison takes as long as the solution of the equations of a step or of the covariance.
const SOLUTION_READINGS: usize = 30;

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
    readings: Vec<Reading>,
    /// `tau` of each reading's contact with the curve that was computed last: successive curves differ little.
    near_m: Vec<Cell<f64>>,
    /// Ways that remain, the present one last.
    ways: Vec<Way>,
    /// The most probable curve so far, and its cost.
    best: (Curve, f64),
    touched_m: (f64, f64),
    stage: Stage,
    /// Number of readings that are compared in one step of an estimator.
    most_readings: usize,
}

/// What a search computes, with the sums over the readings so far.
enum Stage {
    /// The range of all readings, to which the curve is extended or trimmed.
    Length(Length),
    /// The wanted evaluation of the present way.
    Descent(Tally),
    /// The cost of the curve at the end of the present way.
    Comparison(Tally),
    /// The covariance of the most probable curve.
    Covariance(Tally),
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

/// Descent under a sequence of priors.
struct Way {
    /// Priors that remain, the present one last.
    priors: Vec<Prior>,
    settings: Settings,
    descent: Minimisation<Curve>,
}

impl Search {
    /// A search from a curve, with the readings that are to determine it.
    pub(super) fn new(
        from: &Fitted,
        readings: &[Reading],
        (prior, gate_sds): (Prior, f64),
        (effort, is_urgent): (Effort, bool),
    ) -> Self {
        Self {
            prior,
            gate_sds,
            effort,
            readings: readings.to_vec(),
            near_m: readings.iter().map(|reading| Cell::new(reading.near_m)).collect(),
            ways: Vec::new(),
            best: (from.curve.clone(), f64::INFINITY),
            touched_m: from.touched_m,
            stage: Stage::Length(Length::new(0, false)),
            most_readings: if is_urgent { MOST_URGENT_READINGS } else { MOST_READINGS },
        }
    }

    /// Makes the search urgent.
    pub(super) fn hurry(&mut self) {
        self.most_readings = MOST_URGENT_READINGS;
    }

    /// Continues by as much as a step of an estimator has time for. The result, if it was found.
    pub(super) fn advance(&mut self, side: &Side) -> Option<Fitted> {
        let mut left = self.most_readings;
        while left > 0 {
            match self.proceed(side, left) {
                ControlFlow::Continue(compared) => left = left.saturating_sub(compared),
                ControlFlow::Break(fitted) => return Some(fitted),
            }
        }
        None
    }

    /// Continues to the end.
    pub(super) fn finish(mut self, side: &Side) -> Fitted {
        loop {
            if let ControlFlow::Break(fitted) = self.proceed(side, usize::MAX) {
                return fitted;
            }
        }
    }

    /// Compares up to `most` readings and takes the result if they were the last. Returns what took as long in readings.
    fn proceed(&mut self, side: &Side, most: usize) -> ControlFlow<Fitted, usize> {
        match std::mem::replace(&mut self.stage, Stage::Descent(Tally::default())) {
            Stage::Length(length) => ControlFlow::Continue(self.fit_length(side, length, most)),
            Stage::Descent(tally) => ControlFlow::Continue(self.descend(side, tally, most)),
            Stage::Comparison(tally) => ControlFlow::Continue(self.compare(side, tally, most)),
            Stage::Covariance(tally) => self.conclude(side, tally, most),
        }
    }

    /// Extends or trims the curve to the range of all readings.
    fn fit_length(&mut self, side: &Side, mut length: Length, most: usize) -> usize {
        let before = length.count;
        length.count = self.readings.len().min(before.saturating_add(most));
        let curve = &mut self.best.0;
        for (reading, near_m) in self.readings.iter().zip(&self.near_m).take(length.count).skip(before) {
            if let Some(contact) = contact(side, &reading.base, curve, near_m.get()) {
                near_m.set(contact.place.tau_m);
                length.low_m = length.low_m.min(contact.place.tau_m);
                length.high_m = length.high_m.max(contact.place.tau_m);
            }
        }
        let (compared, Length { low_m, high_m, rounds, is_last, .. }) = (length.count - before, length);
        if length.count < self.readings.len() {
            self.stage = Stage::Length(length);
            return compared;
        }
        let is_longer = low_m <= high_m && {
            self.touched_m = (low_m, high_m);
            let is_longer = curve.extend(low_m - MARGIN_M, high_m + MARGIN_M);
            curve.trim(low_m - MARGIN_M - PITCH_M, high_m + MARGIN_M + PITCH_M);
            is_longer
        };
        if is_longer && rounds + 1 < LENGTH_ROUNDS {
            self.stage = Stage::Length(Length::new(rounds + 1, is_last));
        } else if is_last {
            self.stage = Stage::Covariance(Tally::default());
        } else {
            self.begin_ways();
        }
        compared
    }

    fn begin_ways(&mut self) {
        let prior = self.prior;
        let (near, far): (usize, &[(Prior, usize)]) = match self.effort {
            Effort::Near => (NEAR_STEPS, &[]),
            Effort::Far => (NEAR_STEPS, &[(prior.rough(), FAR_STEPS)]),
            Effort::Last => (LAST_STEPS, &[(prior.smooth(), LAST_STEPS), (prior.rough(), LAST_STEPS)]),
        };
        let way = |by: Option<Prior>, steps| {
            let settings = Settings { iterations: steps, ..SETTINGS };
            let descent = Minimisation::begin(self.best.0.clone(), settings);
            Way { priors: std::iter::once(prior).chain(by).collect(), settings, descent }
        };
        self.ways = far.iter().map(|(by, steps)| way(Some(*by), *steps)).chain([way(None, near)]).collect();
    }

    /// Continues the present way by the evaluation that it wants.
    fn descend(&mut self, side: &Side, mut tally: Tally, most: usize) -> usize {
        let Some(way) = self.ways.last_mut() else {
            self.stage = Stage::Length(Length::new(0, true));
            return 0;
        };
        let prior = way.priors.last().copied().unwrap_or(self.prior);
        let evidence = Evidence::new(side, &self.readings, &self.near_m, prior, self.gate_sds);
        let before = tally.count;
        let flow = match way.descent.wanted() {
            Wanted::Approximation(curve) => {
                evidence.add_squares(curve, &mut tally, most.div_ceil(2));
                if tally.count < self.readings.len() {
                    let compared = 2 * (tally.count - before);
                    self.stage = Stage::Descent(tally);
                    return compared;
                }
                let (quadratic, _) = evidence.approximation(curve, tally);
                way.descent.take_approximation(&evidence, Some(quadratic))
            }
            Wanted::Cost { state, .. } => {
                evidence.add_costs(state, &mut tally, most);
                if tally.count < self.readings.len() {
                    let compared = tally.count - before;
                    self.stage = Stage::Descent(tally);
                    return compared;
                }
                let cost = evidence.total(state, &tally);
                Some(way.descent.take_cost(&evidence, Some(cost)))
            }
        };
        match flow {
            Some(ControlFlow::Continue(())) => {}
            Some(ControlFlow::Break(_)) => {
                way.priors.pop();
                if way.priors.is_empty() {
                    self.stage = Stage::Comparison(Tally::default());
                } else {
                    way.descent = Minimisation::begin(way.descent.state.clone(), way.settings);
                }
            }
            // The way leads nowhere.
            None => drop(self.ways.pop()),
        }
        SOLUTION_READINGS
    }

    /// Keeps the curve at the end of the present way if it is the most probable one.
    fn compare(&mut self, side: &Side, mut tally: Tally, most: usize) -> usize {
        let Some(way) = self.ways.last() else { return 0 };
        let (before, curve) = (tally.count, &way.descent.state);
        let evidence = Evidence::new(side, &self.readings, &self.near_m, self.prior, self.gate_sds);
        evidence.add_costs(curve, &mut tally, most);
        let compared = tally.count - before;
        if tally.count < self.readings.len() {
            self.stage = Stage::Comparison(tally);
            return compared;
        }
        let cost = evidence.total(curve, &tally);
        if cost + FAR_MARGIN < self.best.1 {
            self.best = (curve.clone(), cost);
        }
        self.ways.pop();
        compared
    }

    /// Covariance of the curve's state: that by the readings' noise under the prior, and the effect of a sensor model
    /// error that is the same everywhere (a consider parameter: Schmidt 1966).
    fn conclude(&mut self, side: &Side, mut tally: Tally, most: usize) -> ControlFlow<Fitted, usize> {
        let (before, curve) = (tally.count, &self.best.0);
        let prior = self.prior.for_covariance();
        let evidence = Evidence::new(side, &self.readings, &self.near_m, prior, self.gate_sds);
        evidence.add_squares(curve, &mut tally, most.div_ceil(2));
        if tally.count < self.readings.len() {
            let compared = 2 * (tally.count - before);
            self.stage = Stage::Covariance(tally);
            return ControlFlow::Continue(compared);
        }
        let (quadratic, pull) = evidence.approximation(curve, tally);
        let covariance = quadratic.curvature.cholesky().map_or_else(
            || unknown(curve),
            |factor| {
                let (shift, mut covariance) = (factor.solve(&pull), factor.inverse());
                covariance.ger(1.0, &shift, &shift, 1.0);
                covariance
            },
        );
        ControlFlow::Break(Fitted { curve: curve.clone(), covariance, touched_m: self.touched_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::testing::knowledge;
    use crate::frames::Pose;

    #[test]
    fn verif_a_search_in_parts_is_that_at_once() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let point = knowledge.rest.beside(0.055, -4e-3).vector();
        let curve = |radius_m: f64| Curve::new(-1.0, point, 0.0, radius_m);
        let object = curve(5e-3);
        let readings: Vec<_> = (0..60)
            .filter_map(|i| {
                let t = f64::from(i) / 10.0;
                let base = Pose::new(2e-3 * (t.cos() - 1.0), 1.5e-3 * t.sin(), 0.02 * (2.0 * t).sin());
                Some(Reading::new(base, contact(&side, &base, &object, 0.0)?.reading_n_m, 0.0))
            })
            .collect();
        assert!(readings.len() > 40);
        let prior = (Prior::default(), 5.0);
        let search = |is_urgent| Search::new(&Fitted::new(curve(2e-3)), &readings, prior, (Effort::Far, is_urgent));
        let at_once = search(true).finish(&side);
        let mut in_parts = search(false);
        let mut steps = 0;
        let found = loop {
            steps += 1;
            if let Some(found) = in_parts.advance(&side) {
                break found;
            }
        };
        assert!(steps > 5, "{steps}");
        assert_eq!((found.curve.logs(), found.touched_m), (at_once.curve.logs(), at_once.touched_m));
        assert_eq!(found.covariance, at_once.covariance);
    }
}
