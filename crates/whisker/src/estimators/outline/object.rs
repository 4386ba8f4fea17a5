//! An object that was touched: the estimate of its outline, and its readings.

use filters::Innovation;
use filters::least_squares::{Damping, Method, Problem, Settings, minimise};
use nalgebra::{DMatrix, DVector, Matrix1, Matrix2, Vector1, Vector2};

use super::Config;
use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve, PITCH_M, Place, SCALE_M};
use super::fit::{Evidence, Residual};
use super::prior::Prior;
use super::readings::{Reading, Readings};
use crate::estimators::side::Side;
use crate::estimators::{Estimate, OutlinePoint, Radius};
use crate::frames::{Base, Point, Pose, Start};
use crate::rest::direction;
use crate::sensor::AlongAway;

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

/// Difference of cost by which the result of a distant search must be better.
const FAR_MARGIN: f64 = 1.0;

/// Interval of `tau` over which the radius is averaged.
const RADIUS_STRETCH_M: f64 = 6e-3;

/// Variance of the difference of the radius' logarithm between neighbouring cells that were not touched yet.
const NEW_VARIANCE: f64 = 0.01;

/// An object in contact.
pub(super) struct Object {
    config: Config,
    curve: Curve,
    /// Covariance of the curve's state.
    covariance: DMatrix<f64>,
    readings: Readings,
    /// `tau` of the last contact.
    near_m: f64,
    /// Range of `tau` that was touched.
    touched_m: (f64, f64),
}

/// Prediction of the contact at a pose of the base.
pub(super) struct Expected {
    contact: Contact,
    /// Innovation of the reading.
    pub(super) innovation: Option<Innovation<1>>,
}

impl Expected {
    /// Coordinates of the contact along and away.
    pub(super) fn at(&self) -> AlongAway {
        self.contact.at
    }
}

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
        let covariance = DMatrix::identity(curve.size(), curve.size());
        let mut object = Self { config, curve, covariance, readings, near_m: 0.0, touched_m: (0.0, 0.0) };
        object.refine(side, Effort::Far);
        object
    }

    /// The predicted contact, and the innovation of a reading.
    pub(super) fn expect(&self, side: &Side, base: &Pose<Base, Start>, reading_n_m: f64) -> Option<Expected> {
        let contact = contact(side, base, &self.curve, self.near_m)?;
        let (residual, touches) = Residual::of(side, &Reading::new(*base, reading_n_m, self.near_m), Some(&contact));
        let predicted = if touches { self.spread(&contact, &[contact.reading_by_point])[(0, 0)] } else { 0.0 };
        let innovation =
            Innovation::of(Vector1::new(residual.residual_n_m), Matrix1::new(predicted + residual.variance_n2_m2));
        Some(Expected { contact, innovation })
    }

    /// The estimate of the predicted contact.
    pub(super) fn estimate(&mut self, side: &Side, base: &Pose<Base, Start>, expected: &Expected) -> Estimate {
        let Expected { contact, innovation } = expected;
        self.near_m = contact.place.tau_m;
        let spread = self.spread(contact, &[Vector2::x(), Vector2::y()]);
        let spread = Matrix2::new(spread[(0, 0)], spread[(0, 1)], spread[(1, 0)], spread[(1, 1)]);
        let calibrated = side.face.domain.contains(contact.at);
        let stated = side.estimate_at(contact.point, calibrated, base.inverse().turn(spread), *innovation);
        Estimate { radius: Some(self.radius(side, contact)), ..stated }
    }

    /// Geometric mean of the object's radius over an interval around a contact.
    fn radius(&self, side: &Side, contact: &Contact) -> Radius {
        let reach_m = 0.5 * RADIUS_STRETCH_M;
        let cells = self.curve.cells_between(contact.place.tau_m - reach_m, contact.place.tau_m + reach_m);
        let count = cells.len() as f64;
        let mean = self.curve.logs()[cells.clone()].iter().sum::<f64>() / count;
        let rows = ANCHOR + cells.start;
        let variance = self.covariance.view((rows, rows), (cells.len(), cells.len())).sum() / count.powi(2);
        let radius_m = SCALE_M * mean.exp();
        let object_m = (radius_m - side.wire_radius_m(contact.at.along_m)).max(0.0);
        Radius { radius_m: object_m, sd_m: radius_m * variance.max(0.0).sqrt() }
    }

    /// Covariance of quantities whose derivatives by the contact's point are `by_point`.
    fn spread(&self, contact: &Contact, by_point: &[Vector2<f64>]) -> DMatrix<f64> {
        let (low_m, high_m) = self.curve.range_m();
        let mut slopes = DMatrix::zeros(self.curve.size(), by_point.len());
        for (mut column, by_point) in slopes.column_iter_mut().zip(by_point) {
            contact.pull_back(&self.curve, *by_point, column.as_mut_slice());
        }
        let mut spread = slopes.transpose() * &self.covariance * &slopes;
        // Beyond the curve's ends the logarithm of the radius is a random walk over the cells; its mean up to the
        // contact has a third of the variance.
        let beyond_m = (low_m - contact.place.tau_m).max(contact.place.tau_m - high_m).max(0.0);
        let cells = beyond_m / PITCH_M;
        let end = if contact.place.tau_m < low_m { ANCHOR } else { self.curve.size() - 1 };
        for i in 0..by_point.len() {
            for j in 0..by_point.len() {
                spread[(i, j)] += NEW_VARIANCE * cells / 3.0 * slopes[(end, i)] * slopes[(end, j)];
            }
        }
        spread
    }

    /// Keeps a reading.
    pub(super) fn keep(&mut self, reading: Reading) {
        self.readings.keep(reading);
    }

    /// `tau` of the last contact.
    pub(super) fn near_m(&self) -> f64 {
        self.near_m
    }

    fn evidence<'a>(&'a self, side: &'a Side, prior: Prior) -> Evidence<'a> {
        Evidence::new(side, self.readings.means(), prior, self.config.gate_sds)
    }

    /// Extends or trims the curve to the range of all readings.
    fn fit_length(&mut self, side: &Side) {
        for _ in 0..LENGTH_ROUNDS {
            let (mut low_m, mut high_m) = (f64::INFINITY, f64::NEG_INFINITY);
            for reading in self.readings.means_mut() {
                if let Some(contact) = contact(side, &reading.base, &self.curve, reading.near_m) {
                    reading.near_m = contact.place.tau_m;
                    low_m = low_m.min(reading.near_m);
                    high_m = high_m.max(reading.near_m);
                }
            }
            if low_m > high_m {
                break;
            }
            self.touched_m = (low_m, high_m);
            let is_longer = self.curve.extend(low_m - MARGIN_M, high_m + MARGIN_M);
            self.curve.trim(low_m - MARGIN_M - PITCH_M, high_m + MARGIN_M + PITCH_M);
            if !is_longer {
                break;
            }
        }
    }

    /// Result of a search under a sequence of priors, and its cost under the last one.
    fn sought(&self, side: &Side, priors: &[Prior], iterations: usize) -> Option<(Curve, f64)> {
        let settings = Settings { iterations, ..SETTINGS };
        let descend = |curve: Curve, prior: &Prior| {
            minimise(&self.evidence(side, *prior), curve, &settings).map(|solution| solution.state)
        };
        let curve = priors.iter().try_fold(self.curve.clone(), descend)?;
        let cost = self.evidence(side, *priors.last()?).cost(&curve, &curve)?;
        Some((curve, cost))
    }

    /// Searches for the most probable curve.
    pub(super) fn refine(&mut self, side: &Side, effort: Effort) {
        self.fit_length(side);
        let prior = self.config.prior;
        let by_rough = [prior.rough(), prior];
        let by_smooth = [prior.smooth(), prior];
        let (near, far): (usize, &[(&[Prior], usize)]) = match effort {
            Effort::Near => (NEAR_STEPS, &[]),
            Effort::Far => (NEAR_STEPS, &[(&by_rough, FAR_STEPS)]),
            Effort::Last => (LAST_STEPS, &[(&by_rough, LAST_STEPS), (&by_smooth, LAST_STEPS)]),
        };
        let mut best = self.sought(side, &[prior], near);
        for (priors, steps) in far {
            let Some((curve, cost)) = self.sought(side, priors, *steps) else { continue };
            if best.as_ref().is_none_or(|best| cost + FAR_MARGIN < best.1) {
                best = Some((curve, cost));
            }
        }
        if let Some((curve, _)) = best {
            self.curve = curve;
        }
        self.fit_length(side);
        self.covariance =
            self.posterior_covariance(side).unwrap_or_else(|| DMatrix::identity(self.curve.size(), self.curve.size()));
    }

    /// Covariance of the curve's state: that by the readings' noise under the prior, and the effect of a sensor model
    /// error that is the same everywhere (a consider parameter: Schmidt 1966).
    fn posterior_covariance(&self, side: &Side) -> Option<DMatrix<f64>> {
        let evidence = self.evidence(side, self.config.prior.for_covariance());
        let factor = evidence.approximate(&self.curve)?.curvature.cholesky()?;
        let shift = factor.solve(&evidence.model_error_pull(&self.curve));
        let mut covariance = factor.inverse();
        covariance.ger(1.0, &shift, &shift, 1.0);
        Some(covariance)
    }

    /// Covariance of a point of the curve. A displacement of the curve along itself does not change it, so only the
    /// component out of the curve counts: normal to it in the space of position and orientation, in which one radian
    /// equals `SCALE_M`. On a side that is the direction across, at a corner any direction.
    fn normal_covariance(&self, place: &Place) -> Matrix2<f64> {
        let slope = |by_point: Vector2<f64>, by_tangent: f64| {
            let mut slope = DVector::zeros(self.curve.size());
            self.curve.pull_back(place, by_point, by_tangent, slope.as_mut_slice());
            slope
        };
        let by_tangent = SCALE_M * SCALE_M * place.tangent_rad_per_m;
        let length = place.point_by_tau.norm_squared() + by_tangent * place.tangent_rad_per_m;
        let within = slope(place.point_by_tau, by_tangent) / length;
        let out = [Vector2::x(), Vector2::y()].map(|axis| slope(axis, 0.0) - &within * place.point_by_tau.dot(&axis));
        let spread = |i: usize, j: usize| out[i].dot(&(&self.covariance * &out[j]));
        Matrix2::new(spread(0, 0), spread(0, 1), spread(0, 1), spread(1, 1))
    }

    /// The outline where it was touched, without the wire's radius.
    pub(super) fn outline(&self, wire_radius_m: f64) -> Vec<OutlinePoint> {
        let (low_m, high_m) = self.touched_m;
        let places = (0..=((high_m - low_m) / PITCH_M) as usize).map(|i| low_m + i as f64 * PITCH_M);
        places
            .map(|tau_m| {
                let place = self.curve.at(tau_m);
                let tangent = direction(place.knot.tangent_rad);
                let normal = Vector2::new(-tangent.y, tangent.x) * self.curve.sign();
                OutlinePoint {
                    surface: Point::from_vector(place.knot.point - normal * wire_radius_m),
                    normal,
                    covariance_m2: self.normal_covariance(&place),
                }
            })
            .collect()
    }
}
