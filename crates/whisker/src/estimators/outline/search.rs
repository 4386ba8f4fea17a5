//! Search for the most probable curve, one iteration at a time, so that no step of an estimator takes long.
//!
//! A search starts from the last curve. It may try further ways: the cost is not convex, and a descent by way of another
//! prior can end in a better minimum. It works on the readings at its start; later ones count for the next search.

use std::cell::Cell;
use std::ops::ControlFlow;

use filters::least_squares::{Damping, Method, Minimisation, Problem, Settings};
use nalgebra::DMatrix;

use super::contact::contact;
use super::curve::{Curve, PITCH_M};
use super::fit::Evidence;
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

/// Number of readings by which the iterations in one step of an estimator are limited: as many as this number holds, and one
/// more. An iteration compares every reading with at least two curves; each takes about half a microsecond.
const MOST_READINGS: usize = 500;

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
    readings: Vec<Reading>,
    /// `tau` of each reading's contact with the curve that was computed last: successive curves differ little.
    near_m: Vec<Cell<f64>>,
    /// Ways that remain, the next one last.
    ways: Vec<Way>,
    /// The most probable curve so far, and its cost.
    best: (Curve, f64),
    touched_m: (f64, f64),
    is_at_end: bool,
}

/// Descent under a sequence of priors.
struct Way {
    curve: Curve,
    /// Priors that remain, the present one last.
    priors: Vec<Prior>,
    steps: usize,
    descent: Option<Minimisation<Curve>>,
}

impl Way {
    /// One iteration. `None` if the way leads nowhere.
    fn advance<'a>(&mut self, evidence: impl Fn(Prior) -> Evidence<'a>) -> Option<()> {
        let evidence = evidence(*self.priors.last()?);
        let mut descent = match self.descent.take() {
            Some(descent) => descent,
            None => {
                let settings = Settings { iterations: self.steps, ..SETTINGS };
                Minimisation::begin(&evidence, self.curve.clone(), settings)?
            }
        };
        match descent.advance(&evidence)? {
            ControlFlow::Continue(()) => self.descent = Some(descent),
            ControlFlow::Break(_) => {
                self.curve = descent.state;
                self.priors.pop();
            }
        }
        Some(())
    }
}

impl Search {
    /// A search from a curve, with the readings that are to determine it.
    pub(super) fn new(
        side: &Side,
        from: &Fitted,
        readings: &[Reading],
        (prior, gate_sds): (Prior, f64),
        effort: Effort,
    ) -> Self {
        let near_m = readings.iter().map(|reading| Cell::new(reading.near_m)).collect();
        let mut search = Self {
            prior,
            gate_sds,
            readings: readings.to_vec(),
            near_m,
            ways: Vec::new(),
            best: (from.curve.clone(), f64::INFINITY),
            touched_m: from.touched_m,
            is_at_end: false,
        };
        search.fit_length(side);
        let (near, far): (usize, &[(Prior, usize)]) = match effort {
            Effort::Near => (NEAR_STEPS, &[]),
            Effort::Far => (NEAR_STEPS, &[(prior.rough(), FAR_STEPS)]),
            Effort::Last => (LAST_STEPS, &[(prior.smooth(), LAST_STEPS), (prior.rough(), LAST_STEPS)]),
        };
        let way = |by: Option<Prior>, steps| Way {
            curve: search.best.0.clone(),
            priors: std::iter::once(prior).chain(by).collect(),
            steps,
            descent: None,
        };
        search.ways = far.iter().map(|(by, steps)| way(Some(*by), *steps)).chain([way(None, near)]).collect();
        search
    }

    fn evidence<'a>(&'a self, side: &'a Side, prior: Prior) -> Evidence<'a> {
        Evidence::new(side, &self.readings, &self.near_m, prior, self.gate_sds)
    }

    /// Continues by as many iterations as a step of an estimator has time for, at least one. The result, if it was found.
    pub(super) fn advance(&mut self, side: &Side) -> Option<Fitted> {
        let iterations = 1 + MOST_READINGS / (1 + self.readings.len());
        (0..iterations).find_map(|_| self.iterate(side))
    }

    /// One iteration. The result, if it was the last.
    fn iterate(&mut self, side: &Side) -> Option<Fitted> {
        let Some(mut way) = self.ways.pop() else {
            if !std::mem::replace(&mut self.is_at_end, true) {
                self.fit_length(side);
                return None;
            }
            let curve = self.best.0.clone();
            let covariance = self.posterior_covariance(side).unwrap_or_else(|| unknown(&curve));
            return Some(Fitted { curve, covariance, touched_m: self.touched_m });
        };
        way.advance(|prior| self.evidence(side, prior))?;
        if !way.priors.is_empty() {
            self.ways.push(way);
        } else if let Some(cost) = self.evidence(side, self.prior).cost(&way.curve, &way.curve)
            && cost + FAR_MARGIN < self.best.1
        {
            self.best = (way.curve, cost);
        }
        None
    }

    /// All iterations that remain.
    pub(super) fn finish(mut self, side: &Side) -> Fitted {
        loop {
            if let Some(fitted) = self.iterate(side) {
                return fitted;
            }
        }
    }

    /// Extends or trims the curve to the range of all readings.
    fn fit_length(&mut self, side: &Side) {
        let curve = &mut self.best.0;
        for _ in 0..LENGTH_ROUNDS {
            let (mut low_m, mut high_m) = (f64::INFINITY, f64::NEG_INFINITY);
            for (reading, near_m) in self.readings.iter().zip(&self.near_m) {
                if let Some(contact) = contact(side, &reading.base, curve, near_m.get()) {
                    near_m.set(contact.place.tau_m);
                    low_m = low_m.min(contact.place.tau_m);
                    high_m = high_m.max(contact.place.tau_m);
                }
            }
            if low_m > high_m {
                break;
            }
            self.touched_m = (low_m, high_m);
            let is_longer = curve.extend(low_m - MARGIN_M, high_m + MARGIN_M);
            curve.trim(low_m - MARGIN_M - PITCH_M, high_m + MARGIN_M + PITCH_M);
            if !is_longer {
                break;
            }
        }
    }

    /// Covariance of the curve's state: that by the readings' noise under the prior, and the effect of a sensor model
    /// error that is the same everywhere (a consider parameter: Schmidt 1966).
    fn posterior_covariance(&self, side: &Side) -> Option<DMatrix<f64>> {
        let curve = &self.best.0;
        let evidence = self.evidence(side, self.prior.for_covariance());
        let (quadratic, pull) = evidence.approximate_with_model_error(curve);
        let factor = quadratic.curvature.cholesky()?;
        let shift = factor.solve(&pull);
        let mut covariance = factor.inverse();
        covariance.ger(1.0, &shift, &shift, 1.0);
        Some(covariance)
    }
}
