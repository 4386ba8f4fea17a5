//! The curve that readings tell.

use filters::least_squares::{Problem, Quadratic};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve, SCALE_M};
use crate::estimators::settings::{SettingsError, within};
use crate::estimators::side::Side;
use crate::frames::{Base, Pose, Start};

/// What is believed of outlines before anything is touched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Prior {
    /// Radius that is expected, and the standard deviation of its logarithm.
    pub radius_m: f64,
    pub log_radius_sd: f64,
    /// Cost of a change of the radius's logarithm by one.
    pub change_cost: f64,
    /// Change that counts as none.
    pub change_least: f64,
    /// Change that is no small one any more.
    pub change_large: f64,
    /// Standard deviation of the place of the first contact.
    pub place_sd_m: f64,
    /// Standard deviation of the tangent there.
    pub tangent_sd_rad: f64,
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            radius_m: 5e-3,
            log_radius_sd: 3.0,
            change_cost: 10.0,
            change_least: 0.001,
            change_large: 0.3,
            place_sd_m: 2e-2,
            tangent_sd_rad: 1.0,
        }
    }
}

impl Prior {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("radius_m", self.radius_m, 1e-6..=10.0)?;
        within("log_radius_sd", self.log_radius_sd, 1e-3..=100.0)?;
        within("change_cost", self.change_cost, 1e-3..=1e3)?;
        within("change_least", self.change_least, 1e-6..=10.0)?;
        within("change_large", self.change_large, 1e-6..=1e6)?;
        within("place_sd_m", self.place_sd_m, 1e-6..=1.0)?;
        within("tangent_sd_rad", self.tangent_sd_rad, 1e-6..=10.0)
    }
}

/// Readings between which the base moved so little that their mean stands for them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Mean pose of the base, and the first.
    pub(super) base: Pose<Base, Start>,
    first: Pose<Base, Start>,
    /// Mean reading.
    pub(super) reading_n_m: f64,
    /// How many there are.
    pub(super) count: f64,
    /// Where on the curve the contact was last found.
    pub(super) near_m: f64,
}

/// Most readings that are taken together, and how far the base may move and turn meanwhile.
const MOST_TOGETHER: f64 = 8.0;
const MOST_WAY_M: f64 = 0.3e-3;
const MOST_TURN_RAD: f64 = 5e-3;

impl Reading {
    /// A single one, the contact of which lies about `near_m`.
    pub(super) fn new(base: Pose<Base, Start>, reading_n_m: f64, near_m: f64) -> Self {
        Self { base, first: base, reading_n_m, count: 1.0, near_m }
    }

    /// Takes another reading to this one, unless the base has moved too far.
    fn joins(&mut self, next: &Self) -> bool {
        let way_m = next.base.origin().distance(&self.first.origin());
        let turn_rad = (next.base.yaw_rad() - self.first.yaw_rad()).abs();
        if self.count >= MOST_TOGETHER || way_m > MOST_WAY_M || turn_rad > MOST_TURN_RAD {
            return false;
        }
        let share = 1.0 / (self.count + 1.0);
        let origin = self.base.origin().vector().lerp(&next.base.origin().vector(), share);
        let yaw_rad = self.base.yaw_rad() + share * (next.base.yaw_rad() - self.base.yaw_rad());
        self.base = Pose::new(origin.x, origin.y, yaw_rad);
        self.reading_n_m += share * (next.reading_n_m - self.reading_n_m);
        self.near_m = next.near_m;
        self.count += 1.0;
        true
    }
}

/// Adds a reading to those before it.
pub(super) fn keep(readings: &mut Vec<Reading>, reading: Reading) {
    if !readings.last_mut().is_some_and(|last| last.joins(&reading)) {
        readings.push(reading);
    }
}

/// Readings and what they are explained by.
pub(super) struct Evidence<'a> {
    pub(super) side: &'a Side,
    pub(super) readings: &'a [Reading],
    pub(super) prior: &'a Prior,
    pub(super) gate_sds: f64,
}

/// What a reading says at a contact.
pub(super) struct Residual {
    pub(super) residual_n_m: f64,
    pub(super) variance_n2_m2: f64,
    /// Whether the whisker is off the object, as was expected.
    pub(super) is_free: bool,
}

impl Evidence<'_> {
    pub(super) fn residual(&self, reading: &Reading, contact: &Contact) -> Residual {
        let variance_n2_m2 = self.side.variance_of_mean_n2_m2(contact.along_m, contact.away_m, reading.count);
        let residual_n_m = reading.reading_n_m - contact.reading_n_m;
        let is_free = contact.away_m < 0.0 && reading.reading_n_m.powi(2) < 16.0 * variance_n2_m2;
        Residual { residual_n_m, variance_n2_m2, is_free }
    }

    /// Half the squared residual, growing as its logarithm beyond the gate, and the weight of the square that touches it there.
    fn robust(&self, residual: &Residual) -> (f64, f64) {
        if residual.is_free {
            return (0.0, 0.0);
        }
        let squared = residual.residual_n_m.powi(2) / residual.variance_n2_m2;
        let gate = self.gate_sds * self.gate_sds;
        if squared <= gate {
            (0.5 * squared, 1.0 / residual.variance_n2_m2)
        } else {
            (0.5 * gate * (1.0 + (squared / gate).ln()), gate / squared / residual.variance_n2_m2)
        }
    }

    /// Cost of a reading where no contact is expected.
    fn lost(&self, reading: &Reading) -> f64 {
        let variance_n2_m2 = self.side.variance_of_mean_n2_m2(0.05, 0.0, reading.count);
        self.robust(&Residual { residual_n_m: reading.reading_n_m, variance_n2_m2, is_free: false }).0
    }

    fn prior_cost(&self, curve: &Curve) -> f64 {
        let Prior { radius_m, log_radius_sd, change_cost, change_least, change_large, .. } = *self.prior;
        let middle = (radius_m / SCALE_M).ln();
        let logs = curve.logs();
        let levels: f64 = logs.iter().map(|u| 0.5 * ((u - middle) / log_radius_sd).powi(2)).sum();
        let changes: f64 =
            logs.windows(2).map(|pair| (1.0 + (pair[1] - pair[0]).hypot(change_least) / change_large).ln()).sum();
        levels / logs.len() as f64 + change_cost * change_large * changes
    }
}

impl Problem for Evidence<'_> {
    type State = Curve;

    fn cost(&self, curve: &Curve) -> Option<f64> {
        let mut cost = self.prior_cost(curve);
        for reading in self.readings {
            cost += match contact(self.side, &reading.base, curve, reading.near_m) {
                Some(contact) => self.robust(&self.residual(reading, &contact)).0,
                None => self.lost(reading),
            };
        }
        Some(cost)
    }

    fn approximate(&self, curve: &Curve) -> Option<Quadratic> {
        let size = curve.size();
        let Prior { radius_m, log_radius_sd, change_cost, change_least, change_large, place_sd_m, tangent_sd_rad } =
            *self.prior;
        let mut cost = self.prior_cost(curve);
        let mut gradient = DVector::zeros(size);
        let mut curvature = DMatrix::zeros(size, size);
        let logs = curve.logs();
        let middle = (radius_m / SCALE_M).ln();
        let weight = log_radius_sd.powi(-2) / logs.len() as f64;
        for i in 0..2 {
            curvature[(i, i)] += place_sd_m.powi(-2);
        }
        curvature[(2, 2)] += tangent_sd_rad.powi(-2);
        for (i, u) in logs.iter().enumerate() {
            gradient[ANCHOR + i] += weight * (u - middle);
            curvature[(ANCHOR + i, ANCHOR + i)] += weight;
        }
        for (i, pair) in logs.windows(2).enumerate() {
            let change = pair[1] - pair[0];
            let size = change.hypot(change_least);
            let weight = change_cost / (size * (1.0 + size / change_large));
            let (one, other) = (ANCHOR + i, ANCHOR + i + 1);
            gradient[one] -= weight * change;
            gradient[other] += weight * change;
            curvature[(one, one)] += weight;
            curvature[(other, other)] += weight;
            curvature[(other, one)] -= weight;
        }
        let mut slope = vec![0.0; size];
        for reading in self.readings {
            let Some(contact) = contact(self.side, &reading.base, curve, reading.near_m) else {
                cost += self.lost(reading);
                continue;
            };
            let residual = self.residual(reading, &contact);
            let (of_reading, weight) = self.robust(&residual);
            cost += of_reading;
            if weight == 0.0 {
                continue;
            }
            slope.fill(0.0);
            contact.pull_back(curve, contact.reading_by_point, &mut slope);
            let cells = curve.between(contact.place.tau_m);
            for j in (0..ANCHOR).chain(cells.clone()) {
                let share = weight * slope[j];
                gradient[j] -= share * residual.residual_n_m;
                for i in j..ANCHOR {
                    curvature[(i, j)] += share * slope[i];
                }
                let rows = j.max(cells.start)..cells.end;
                let mut column = curvature.column_mut(j);
                for (entry, slope) in column.as_mut_slice()[rows.clone()].iter_mut().zip(&slope[rows]) {
                    *entry += share * slope;
                }
            }
        }
        Some(Quadratic { cost, gradient, curvature })
    }

    fn moved(&self, curve: &Curve, step: &DVector<f64>) -> Curve {
        curve.moved(step.as_slice())
    }
}

/// Covariance of a contact's point, from that of the curve's numbers given by the factor of their information.
pub(super) fn covariance(
    contact: &Contact,
    curve: &Curve,
    factor: &nalgebra::Cholesky<f64, nalgebra::Dyn>,
) -> Matrix2<f64> {
    let mut rows = DMatrix::zeros(curve.size(), 2);
    for (i, axis) in [Vector2::x(), Vector2::y()].into_iter().enumerate() {
        let mut column = vec![0.0; curve.size()];
        contact.pull_back(curve, axis, &mut column);
        rows.set_column(i, &DVector::from_vec(column));
    }
    let spread = rows.transpose() * factor.solve(&rows);
    Matrix2::new(spread[(0, 0)], spread[(0, 1)], spread[(1, 0)], spread[(1, 1)])
}
