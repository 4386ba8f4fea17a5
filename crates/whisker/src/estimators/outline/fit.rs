//! Fit of a curve to readings.

use std::cell::RefCell;
use std::ops::Range;

use filters::least_squares::{Moves, Quadratic};
use filters::robust::logarithmic_cost;
use nalgebra::{DMatrix, DVector};

use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve};
use super::prior::Prior;
use super::readings::Reading;
use crate::estimators::side::Side;
use crate::sensor::AlongAway;

/// Standard deviations within which a reading may be that of a free whisker.
const FREE_SDS: f64 = 4.0;

/// Readings and the cost function of curves.
pub(super) struct Evidence<'a> {
    side: &'a Side,
    readings: &'a [Reading],
    prior: Prior,
    gate_sds: f64,
    compared: &'a RefCell<Comparisons>,
}

/// A reading compared with a curve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Comparison {
    pub(super) contact: Option<Contact>,
    residual: Residual,
    /// Whether the reading is that of the contact, not of a free whisker.
    touches: bool,
}

/// Comparisons of the readings with one curve. A descent wants the derivatives where it has just computed the cost, and a search
/// compares its result once more: the contacts, which take most of the time, are found once.
pub(super) struct Comparisons {
    curve: Option<Curve>,
    /// Those of the first readings with this curve.
    known: Vec<Comparison>,
    /// `tau` of each reading's last contact, from which the next one is sought: successive curves differ little.
    near_m: Vec<f64>,
}

impl Comparisons {
    /// No comparisons of these readings yet.
    pub(super) fn new(readings: &[Reading]) -> Self {
        let near_m = readings.iter().map(|reading| reading.near_m).collect();
        Self { curve: None, known: Vec::with_capacity(readings.len()), near_m }
    }

    /// The comparisons of some of the readings with a curve.
    pub(super) fn with(
        &mut self,
        curve: &Curve,
        side: &Side,
        readings: &[Reading],
        range: Range<usize>,
    ) -> &[Comparison] {
        if self.curve.as_ref().is_none_or(|known| !known.is_in_state_of(curve)) {
            self.curve = Some(curve.clone());
            self.known.clear();
        }
        let first = self.known.len();
        for (reading, near_m) in readings.iter().zip(&mut self.near_m).take(range.end).skip(first) {
            let contact = contact(side, &reading.base, curve, *near_m);
            if let Some(contact) = &contact {
                *near_m = contact.place.tau_m;
            }
            let (residual, touches) = Residual::of(side, reading, contact.as_ref());
            self.known.push(Comparison { contact, residual, touches });
        }
        &self.known[range]
    }
}

/// Difference between a reading and its prediction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    pub(super) residual_n_m: f64,
    pub(super) variance_n2_m2: f64,
}

impl Residual {
    /// Residual of a reading, and whether it is that of a contact: if no contact is predicted, or one that would have
    /// to pull, it is that of a free whisker.
    pub(super) fn of(side: &Side, reading: &Reading, contact: Option<&Contact>) -> (Self, bool) {
        let free = || AlongAway::new(side.face.domain.arc_range_m().0, 0.0);
        let at = contact.map_or_else(free, |contact| contact.at);
        let variance_n2_m2 = side.variance_of_mean_n2_m2(at, reading.count);
        let is_free = match contact {
            Some(_) => at.away_m < 0.0 && reading.reading_n_m.powi(2) < FREE_SDS.powi(2) * variance_n2_m2,
            None => true,
        };
        let expected_n_m = contact.filter(|_| !is_free).map_or(0.0, |contact| contact.reading_n_m);
        (Self { residual_n_m: reading.reading_n_m - expected_n_m, variance_n2_m2 }, !is_free)
    }

    /// Cost, logarithmic beyond the gate, and weight of the quadratic that majorises it.
    fn robust(&self, gate_sds: f64) -> (f64, f64) {
        let (cost, factor) = logarithmic_cost(self.residual_n_m.powi(2) / self.variance_n2_m2, gate_sds);
        (cost, factor / self.variance_n2_m2)
    }
}

/// Sums over the readings so far, for evaluations that take a part of the readings at a time.
#[derive(Default)]
pub(super) struct Tally {
    /// Number of readings so far.
    count: usize,
    cost: f64,
    squares: Option<Squares>,
}

/// Quadratic approximation of the readings' costs.
struct Squares {
    gradient: DVector<f64>,
    /// Its lower triangle.
    curvature: DMatrix<f64>,
    /// Gradient that the sensor model's error adds.
    pull: DVector<f64>,
    /// Derivative of an expected reading by the curve's state.
    slope: Vec<f64>,
}

impl Squares {
    fn zeros(size: usize) -> Self {
        Self {
            gradient: DVector::zeros(size),
            curvature: DMatrix::zeros(size, size),
            pull: DVector::zeros(size),
            slope: vec![0.0; size],
        }
    }

    /// Adds the square of a residual with a weight. The contact is that of a curve.
    fn add(&mut self, side: &Side, curve: &Curve, contact: &Contact, residual_n_m: f64, weight: f64) {
        let Self { gradient, curvature, pull, slope } = self;
        slope.fill(0.0);
        contact.pull_back(curve, contact.reading_by_point, slope);
        let model_error_n_m = side.model_variance_n2_m2(contact.at).sqrt();
        // Of the lower triangle, the entries on which the reading depends: the anchor, and the cells between anchor and contact.
        let cells = curve.cells_to(contact.place.tau_m);
        for j in (0..ANCHOR).chain(cells.clone()) {
            let share = weight * slope[j];
            gradient[j] -= share * residual_n_m;
            pull[j] += share * model_error_n_m;
            let mut column = curvature.column_mut(j);
            let column = column.as_mut_slice();
            for rows in [j..ANCHOR.max(j), j.max(cells.start)..cells.end] {
                let entries = column[rows.clone()].iter_mut().zip(&slope[rows]);
                entries.for_each(|(entry, slope)| *entry += share * slope);
            }
        }
    }
}

impl<'a> Evidence<'a> {
    /// The cost function under a prior, with residuals gated at `gate_sds` standard deviations.
    pub(super) fn new(
        side: &'a Side,
        readings: &'a [Reading],
        compared: &'a RefCell<Comparisons>,
        prior: Prior,
        gate_sds: f64,
    ) -> Self {
        Self { side, readings, prior, gate_sds, compared }
    }

    /// Adds the costs of the next readings to a tally, at most `most` of them. Returns their number.
    pub(super) fn add_costs(&self, curve: &Curve, tally: &mut Tally, most: usize) -> usize {
        self.each(curve, tally, most, |_, _, _| ())
    }

    /// As [`Self::add_costs`], with the squares that approximate them.
    pub(super) fn add_squares(&self, curve: &Curve, tally: &mut Tally, most: usize) -> usize {
        let mut squares = tally.squares.take().unwrap_or_else(|| Squares::zeros(curve.size()));
        let added = self.each(curve, tally, most, |contact, residual_n_m, weight| {
            squares.add(self.side, curve, contact, residual_n_m, weight);
        });
        tally.squares = Some(squares);
        added
    }

    /// Adds the costs of the next readings to a tally, and calls `take` for those of a contact: with the contact, the residual and
    /// the weight of its square.
    fn each(&self, curve: &Curve, tally: &mut Tally, most: usize, mut take: impl FnMut(&Contact, f64, f64)) -> usize {
        let before = tally.count;
        tally.count = self.readings.len().min(before.saturating_add(most));
        let mut compared = self.compared.borrow_mut();
        for found in compared.with(curve, self.side, self.readings, before..tally.count) {
            let (cost, weight) = found.residual.robust(self.gate_sds);
            if let Some(contact) = found.contact.as_ref().filter(|_| found.touches) {
                take(contact, found.residual.residual_n_m, weight);
            }
            tally.cost += cost;
        }
        tally.count - before
    }

    /// Whether a tally contains all readings.
    pub(super) fn is_complete(&self, tally: &Tally) -> bool {
        tally.count == self.readings.len()
    }

    /// Cost of a curve, from the tally of all readings.
    pub(super) fn total(&self, curve: &Curve, tally: &Tally) -> f64 {
        self.prior.cost(curve) + tally.cost
    }

    /// Quadratic approximation of the cost, from the tally of all readings, and the gradient that the sensor model's error adds to
    /// it if that is one standard deviation everywhere. It does not average out: it is nearly the same at nearby contacts.
    pub(super) fn approximation(&self, curve: &Curve, tally: Tally) -> (Quadratic, DVector<f64>) {
        let cost = self.total(curve, &tally);
        let Squares { gradient, curvature, pull, .. } = tally.squares.unwrap_or_else(|| Squares::zeros(curve.size()));
        let mut quadratic = Quadratic { cost, gradient, curvature };
        self.prior.add_to(curve, &mut quadratic);
        (quadratic, pull)
    }
}

impl Moves for Evidence<'_> {
    type State = Curve;

    fn moved(&self, curve: &Curve, step: &DVector<f64>) -> Option<Curve> {
        Some(curve.moved(step.as_slice()))
    }
}
