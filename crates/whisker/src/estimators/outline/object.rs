//! An object that was touched: the estimate of its outline, and its readings.

use filters::Innovation;
use nalgebra::{DVector, Matrix1, Matrix2, Vector1, Vector2};

use super::Config;
use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve, PITCH_M, Place, SCALE_M};
use super::fit::Residual;
use super::readings::{Reading, Readings};
use super::search::{Effort, Fitted, Haste, Search};
use crate::estimators::side::Side;
use crate::estimators::{Estimate, OutlinePoint, Radius};
use crate::frames::{Base, Point, Pose, Start};
use crate::sensor::AlongAway;

/// Interval of `tau` over which the radius is averaged.
const RADIUS_STRETCH_M: f64 = 6e-3;

/// Variance of the difference of the radius' logarithm between neighbouring cells that were not touched yet.
const NEW_VARIANCE: f64 = 0.01;

/// An object in contact.
pub(super) struct Object {
    config: Config,
    fitted: Fitted,
    readings: Readings,
    /// `tau` of the last contact.
    near_m: f64,
    search: Option<Search>,
}

/// Prediction of the contact at a pose of the base.
pub(super) struct Expected {
    contact: Contact,
    /// Covariance of the contact in Start.
    spread: Matrix2<f64>,
    /// Innovation of the reading.
    pub(super) innovation: Option<Innovation<1>>,
}

impl Expected {
    /// Predicted contact.
    pub(super) fn point(&self) -> Point<Base> {
        self.contact.point
    }

    /// Coordinates of the contact along and away.
    pub(super) fn at(&self) -> AlongAway {
        self.contact.at
    }
}

/// Arc with which the curve of an object begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct FirstArc {
    /// Contact on the whisker's centre line.
    pub(super) point: Point<Start>,
    /// Angle in Start of the whisker's tangent there.
    pub(super) tangent_rad: f64,
    /// Radius of object and wire together.
    pub(super) radius_m: f64,
}

impl Object {
    /// An object whose curve begins with an arc, from its readings so far.
    pub(super) fn new(config: Config, side: &Side, arc: FirstArc, readings: Readings) -> Self {
        let curve = Curve::new(side.face.face.away_sign(), arc.point.vector(), arc.tangent_rad, arc.radius_m);
        let mut object = Self { config, fitted: Fitted::new(curve), readings, near_m: 0.0, search: None };
        object.refine(side, Effort::Far);
        object
    }

    /// The contact with the base at a pose.
    pub(super) fn contact(&self, side: &Side, base: &Pose<Base, Start>) -> Option<Point<Base>> {
        contact(side, base, &self.fitted.curve, self.near_m).map(|contact| contact.point)
    }

    /// The predicted contact, and the innovation of the mean of `count` readings.
    pub(super) fn expect(
        &self,
        side: &Side,
        base: &Pose<Base, Start>,
        reading_n_m: f64,
        count: f64,
    ) -> Option<Expected> {
        let contact = contact(side, base, &self.fitted.curve, self.near_m)?;
        let (residual, touches) =
            Residual::of(side, &Reading::new(*base, reading_n_m, self.near_m).of_mean(count), Some(&contact));
        let spread = self.spread(&contact);
        let predicted = if touches { contact.reading_by_point.dot(&(spread * contact.reading_by_point)) } else { 0.0 };
        let innovation =
            Innovation::of(Vector1::new(residual.residual_n_m), Matrix1::new(predicted + residual.variance_n2_m2));
        Some(Expected { contact, spread, innovation })
    }

    /// The estimate of the predicted contact.
    pub(super) fn estimate(&mut self, side: &Side, base: &Pose<Base, Start>, expected: &Expected) -> Estimate {
        let Expected { contact, spread, innovation } = expected;
        self.near_m = contact.place.tau_m;
        let calibrated = side.face.domain.contains(contact.at);
        let stated = side.estimate_at(contact.point, calibrated, base.inverse().turn(*spread), *innovation);
        Estimate { radius: Some(self.radius(side, contact)), ..stated }
    }

    /// Geometric mean of the object's radius over an interval around a contact.
    fn radius(&self, side: &Side, contact: &Contact) -> Radius {
        let reach_m = 0.5 * RADIUS_STRETCH_M;
        let cells = self.fitted.curve.cells_between(contact.place.tau_m - reach_m, contact.place.tau_m + reach_m);
        let count = cells.len() as f64;
        let mean = self.fitted.curve.logs()[cells.clone()].iter().sum::<f64>() / count;
        let rows = ANCHOR + cells.start;
        let variance = self.fitted.covariance.view((rows, rows), (cells.len(), cells.len())).sum() / count.powi(2);
        let radius_m = SCALE_M * mean.exp();
        let object_m = (radius_m - side.wire_radius_m(contact.at.along_m)).max(0.0);
        Radius { radius_m: object_m, sd_m: radius_m * variance.max(0.0).sqrt() }
    }

    /// Covariance of a contact in Start.
    fn spread(&self, contact: &Contact) -> Matrix2<f64> {
        let Fitted { curve, covariance, .. } = &self.fitted;
        let by_axis = [Vector2::x(), Vector2::y()].map(|axis| {
            let mut slopes = vec![0.0; curve.size()];
            contact.pull_back(curve, axis, &mut slopes);
            slopes
        });
        let slope = |entry: usize| Vector2::new(by_axis[0][entry], by_axis[1][entry]);
        // The contact does not depend on other entries of the state.
        let entries = || (0..ANCHOR).chain(curve.cells_to(contact.place.tau_m));
        let mut spread = Matrix2::zeros();
        for j in entries() {
            let column = covariance.column(j);
            let carried = entries().fold(Vector2::zeros(), |sum, i| sum + slope(i) * column[i]);
            spread += carried * slope(j).transpose();
        }
        // Beyond the curve's ends the logarithm of the radius is a random walk over the cells; its mean up to the
        // contact has a third of the variance.
        let (low_m, high_m) = curve.range_m();
        let beyond_m = (low_m - contact.place.tau_m).max(contact.place.tau_m - high_m).max(0.0);
        let end = slope(if contact.place.tau_m < low_m { ANCHOR } else { curve.size() - 1 });
        spread + end * end.transpose() * (NEW_VARIANCE * beyond_m / PITCH_M / 3.0)
    }

    /// Keeps a reading.
    pub(super) fn keep(&mut self, reading: Reading) {
        self.readings.keep(reading);
    }

    /// `tau` of the last contact.
    pub(super) fn near_m(&self) -> f64 {
        self.near_m
    }

    /// Begins a search for the most probable curve, which [`Self::advance`] continues.
    pub(super) fn begin_search(&mut self, effort: Effort, haste: Haste) {
        self.search = Some(self.new_search(effort, haste));
    }

    /// Makes the search in progress urgent.
    pub(super) fn hurry(&mut self) {
        if let Some(search) = &mut self.search {
            search.hurry();
        }
    }

    /// Whether a search is in progress.
    pub(super) fn is_searching(&self) -> bool {
        self.search.is_some()
    }

    /// Continues the search in progress.
    pub(super) fn advance(&mut self, side: &Side) {
        if let Some(fitted) = self.search.as_mut().and_then(|search| search.advance(side)) {
            self.fitted = fitted;
            self.search = None;
        }
    }

    /// Searches for the most probable curve to the end.
    pub(super) fn refine(&mut self, side: &Side, effort: Effort) {
        self.search = None;
        self.fitted = self.new_search(effort, Haste::Urgent).finish(side);
    }

    fn new_search(&self, effort: Effort, haste: Haste) -> Search {
        let cost = (self.config.prior, self.config.gate_sds);
        Search::new(&self.fitted, self.readings.means(), cost, effort, haste)
    }

    /// Covariance of a point of the curve. A displacement of the curve along itself does not change it, so only the
    /// component out of the curve counts: normal to it in the space of position and orientation, in which one radian
    /// equals `SCALE_M`. On a side that is the direction across, at a corner any direction.
    fn normal_covariance(&self, place: &Place) -> Matrix2<f64> {
        let slope = |by_point: Vector2<f64>, by_tangent: f64| {
            let mut slope = DVector::zeros(self.fitted.curve.size());
            self.fitted.curve.pull_back(place, by_point, by_tangent, slope.as_mut_slice());
            slope
        };
        let by_tangent = SCALE_M * SCALE_M * place.tangent_rad_per_m;
        let length = place.point_by_tau.norm_squared() + by_tangent * place.tangent_rad_per_m;
        let within = slope(place.point_by_tau, by_tangent) / length;
        let out = [Vector2::x(), Vector2::y()].map(|axis| slope(axis, 0.0) - &within * place.point_by_tau.dot(&axis));
        let spread = |i: usize, j: usize| out[i].dot(&(&self.fitted.covariance * &out[j]));
        Matrix2::new(spread(0, 0), spread(0, 1), spread(0, 1), spread(1, 1))
    }

    /// The outline where it was touched, without the wire's radius.
    pub(super) fn outline(&self, wire_radius_m: f64) -> Vec<OutlinePoint> {
        let (low_m, high_m) = self.fitted.touched_m;
        let places = (0..=((high_m - low_m) / PITCH_M) as usize).map(|i| low_m + i as f64 * PITCH_M);
        places
            .map(|tau_m| {
                let place = self.fitted.curve.at(tau_m);
                let tangent = place.knot.tangent;
                let normal = Vector2::new(-tangent.y, tangent.x) * self.fitted.curve.sign();
                OutlinePoint {
                    surface: Point::from_vector(place.knot.point - normal * wire_radius_m),
                    normal,
                    covariance_m2: self.normal_covariance(&place),
                }
            })
            .collect()
    }
}
