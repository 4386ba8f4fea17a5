//! Fit of a curve to readings.

use std::cell::Cell;

use filters::least_squares::{Problem, Quadratic};
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
    /// `tau` of each reading's contact with the curve that was computed last, from which the next one is sought.
    near_m: &'a [Cell<f64>],
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

/// A reading of a contact, linearised.
struct Linear<'a> {
    contact: &'a Contact,
    residual_n_m: f64,
    /// Weight of the square.
    weight: f64,
    /// Derivative of the expected reading by the curve's state.
    slope: &'a [f64],
}

impl<'a> Evidence<'a> {
    /// The cost function under a prior, with residuals gated at `gate_sds` standard deviations.
    pub(super) fn new(
        side: &'a Side,
        readings: &'a [Reading],
        near_m: &'a [Cell<f64>],
        prior: Prior,
        gate_sds: f64,
    ) -> Self {
        Self { side, readings, prior, gate_sds, near_m }
    }

    /// Readings with their contacts with a curve.
    fn contacts(&self, curve: &Curve) -> impl Iterator<Item = (&Reading, Option<Contact>)> {
        self.readings.iter().zip(self.near_m).map(|(reading, near_m)| {
            let contact = contact(self.side, &reading.base, curve, near_m.get());
            if let Some(contact) = &contact {
                near_m.set(contact.place.tau_m);
            }
            (reading, contact)
        })
    }

    /// Linearises every reading of a contact about a curve, and returns the cost of all readings.
    fn linearise(&self, curve: &Curve, mut take: impl FnMut(&Linear<'_>)) -> f64 {
        let mut slope = vec![0.0; curve.size()];
        let costs = self.contacts(curve).map(|(reading, contact)| {
            let (residual, touches) = Residual::of(self.side, reading, contact.as_ref());
            let (cost, weight) = residual.robust(self.gate_sds);
            if let Some(contact) = contact.filter(|_| touches) {
                slope.fill(0.0);
                contact.pull_back(curve, contact.reading_by_point, &mut slope);
                take(&Linear { contact: &contact, residual_n_m: residual.residual_n_m, weight, slope: &slope });
            }
            cost
        });
        costs.sum()
    }

    /// Quadratic approximation of the cost, and the gradient that the sensor model's error adds to it if that is one
    /// standard deviation everywhere. It does not average out: it is nearly the same at nearby contacts.
    pub(super) fn approximate_with_model_error(&self, curve: &Curve) -> (Quadratic, DVector<f64>) {
        let size = curve.size();
        let (mut gradient, mut curvature) = (DVector::zeros(size), DMatrix::zeros(size, size));
        let mut pull = DVector::zeros(size);
        let of_readings = self.linearise(curve, |linear| {
            let model_error_n_m = self.side.model_variance_n2_m2(linear.contact.at).sqrt();
            // Of the lower triangle, the entries on which the reading depends: the anchor, and the cells between anchor
            // and contact.
            let cells = curve.cells_to(linear.contact.place.tau_m);
            for j in (0..ANCHOR).chain(cells.clone()) {
                let share = linear.weight * linear.slope[j];
                gradient[j] -= share * linear.residual_n_m;
                pull[j] += share * model_error_n_m;
                let mut column = curvature.column_mut(j);
                let column = column.as_mut_slice();
                for rows in [j..ANCHOR.max(j), j.max(cells.start)..cells.end] {
                    let entries = column[rows.clone()].iter_mut().zip(&linear.slope[rows]);
                    entries.for_each(|(entry, slope)| *entry += share * slope);
                }
            }
        });
        let mut quadratic = Quadratic { cost: self.prior.cost(curve) + of_readings, gradient, curvature };
        self.prior.add_to(curve, &mut quadratic);
        (quadratic, pull)
    }
}

impl Problem for Evidence<'_> {
    type State = Curve;

    fn cost(&self, curve: &Curve, _: &Curve) -> Option<f64> {
        let costs = self
            .contacts(curve)
            .map(|(reading, contact)| Residual::of(self.side, reading, contact.as_ref()).0.robust(self.gate_sds).0);
        Some(self.prior.cost(curve) + costs.sum::<f64>())
    }

    fn approximate(&self, curve: &Curve) -> Option<Quadratic> {
        Some(self.approximate_with_model_error(curve).0)
    }

    fn moved(&self, curve: &Curve, step: &DVector<f64>) -> Option<Curve> {
        Some(curve.moved(step.as_slice()))
    }
}
