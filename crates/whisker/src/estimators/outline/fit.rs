//! The curve that explains the readings best.

use filters::least_squares::{Problem, Quadratic};
use nalgebra::{DMatrix, DVector};

use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve};
use super::prior::Prior;
use super::readings::Reading;
use crate::estimators::side::Side;

/// Standard deviations within which a reading may be that of a free whisker.
const FREE_SDS: f64 = 4.0;

/// Readings, and what curves are held against.
#[derive(Clone, Copy)]
pub(super) struct Evidence<'a> {
    pub(super) side: &'a Side,
    pub(super) readings: &'a [Reading],
    pub(super) prior: Prior,
    pub(super) gate_sds: f64,
}

/// How far a reading lies from what a contact is expected to give.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    pub(super) residual_n_m: f64,
    pub(super) variance_n2_m2: f64,
}

impl Residual {
    /// That of a reading; where no contact is expected, or one that would pull, that of a free whisker.
    pub(super) fn new(side: &Side, reading: &Reading, contact: Option<&Contact>) -> (Self, bool) {
        let (along_m, away_m) = contact.map_or((side.face.domain.arc_range_m().0, 0.0), |contact| contact.place_m);
        let variance_n2_m2 = side.variance_of_mean_n2_m2(along_m, away_m, reading.count);
        let is_free = match contact {
            Some(_) => away_m < 0.0 && reading.reading_n_m.powi(2) < FREE_SDS.powi(2) * variance_n2_m2,
            None => true,
        };
        let expected_n_m = contact.filter(|_| !is_free).map_or(0.0, |contact| contact.reading_n_m);
        (Self { residual_n_m: reading.reading_n_m - expected_n_m, variance_n2_m2 }, !is_free)
    }

    /// Half the square, growing as its logarithm beyond the gate; and the weight of the square that touches it from above.
    fn robust(&self, gate_sds: f64) -> (f64, f64) {
        let (squared, gate) = (self.residual_n_m.powi(2) / self.variance_n2_m2, gate_sds * gate_sds);
        if squared <= gate {
            (0.5 * squared, 1.0 / self.variance_n2_m2)
        } else {
            (0.5 * gate * (1.0 + (squared / gate).ln()), gate / squared / self.variance_n2_m2)
        }
    }
}

impl Evidence<'_> {
    fn contact(&self, reading: &Reading, curve: &Curve) -> Option<Contact> {
        contact(self.side, &reading.base, curve, reading.near_m)
    }
}

impl Problem for Evidence<'_> {
    type State = Curve;

    fn cost(&self, curve: &Curve) -> Option<f64> {
        let costs = self.readings.iter().map(|reading| {
            let contact = self.contact(reading, curve);
            Residual::new(self.side, reading, contact.as_ref()).0.robust(self.gate_sds).0
        });
        Some(self.prior.cost(curve) + costs.sum::<f64>())
    }

    fn approximate(&self, curve: &Curve) -> Option<Quadratic> {
        let size = curve.size();
        let mut quadratic = Quadratic {
            cost: self.prior.cost(curve),
            gradient: DVector::zeros(size),
            curvature: DMatrix::zeros(size, size),
        };
        self.prior.add_to(curve, &mut quadratic);
        let mut slope = vec![0.0; size];
        for reading in self.readings {
            let contact = self.contact(reading, curve);
            let (residual, touches) = Residual::new(self.side, reading, contact.as_ref());
            let (cost, weight) = residual.robust(self.gate_sds);
            quadratic.cost += cost;
            let Some(contact) = contact.filter(|_| touches) else { continue };
            slope.fill(0.0);
            contact.pull_back(curve, contact.reading_by_point, &mut slope);
            let cells = curve.cells_to(contact.place.tau_m);
            for j in (0..ANCHOR).chain(cells.clone()) {
                let share = weight * slope[j];
                quadratic.gradient[j] -= share * residual.residual_n_m;
                for i in j..ANCHOR {
                    quadratic.curvature[(i, j)] += share * slope[i];
                }
                let rows = j.max(cells.start)..cells.end;
                let mut column = quadratic.curvature.column_mut(j);
                for (entry, slope) in column.as_mut_slice()[rows.clone()].iter_mut().zip(&slope[rows]) {
                    *entry += share * slope;
                }
            }
        }
        Some(quadratic)
    }

    fn moved(&self, curve: &Curve, step: &DVector<f64>) -> Curve {
        curve.moved(step.as_slice())
    }
}
