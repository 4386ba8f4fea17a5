//! An object that was touched: its outline as far as it is known, and every reading of it.

use filters::Innovation;
use filters::least_squares::{Damping, Method, Problem, Settings, minimise};
use nalgebra::{DMatrix, DVector, Matrix1, Matrix2, Vector1, Vector2};

use super::Config;
use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve, PITCH_M, Place, SCALE_M};
use super::fit::{Evidence, Residual};
use super::prior::Prior;
use super::readings::{Reading, keep};
use crate::estimators::side::Side;
use crate::estimators::{Estimate, OutlinePoint, Radius};
use crate::frames::{Base, Point, Pose, Start};
use crate::rest::direction;

/// Cells beyond the outermost contacts.
const MARGIN_M: f64 = 2.0 * PITCH_M;

/// Rounds in which a curve finds its length.
const LENGTH_ROUNDS: usize = 3;

/// Most steps of a search from the last curve, of one by way of another prior, and of either at the end.
const NEAR_STEPS: usize = 10;
const FAR_STEPS: usize = 6;
const LAST_STEPS: usize = 40;

/// Levenberg-Marquardt method, whose damping begins with next to none: where a prior ties many unknowns to one another, the diagonal of the curvature
/// is far larger than the curvature for all of them together.
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

/// By how much less a curve from far has to cost.
const FAR_MARGIN: f64 = 1.0;

/// Stretch of `tau` over which the radius is stated.
const RADIUS_STRETCH_M: f64 = 6e-3;

/// Variance by which the logarithm of the radius may differ from one cell to the next where nothing was touched yet.
const NEW_VARIANCE: f64 = 0.01;

/// An object.
pub(super) struct Object {
    config: Config,
    curve: Curve,
    /// Of the curve's numbers.
    covariance: DMatrix<f64>,
    readings: Vec<Reading>,
    /// Where on the curve the last contact was.
    near_m: f64,
    /// Span of `tau` that was touched.
    touched_m: (f64, f64),
}

/// What an object makes one expect at a pose of the base.
pub(super) struct Expected {
    contact: Contact,
    /// The innovation of the reading there.
    pub(super) innovation: Option<Innovation<1>>,
}

/// How thoroughly a curve is sought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// From the last one.
    Near,
    /// Also by way of one that is rough.
    Far,
    /// Also by way of one that is smooth, and to the end.
    Last,
}

impl Object {
    /// An object with a contact at `point`, from the readings of it so far.
    pub(super) fn new(
        config: Config,
        side: &Side,
        (point, tangent_rad, radius_m): (Point<Start>, f64, f64),
        readings: Vec<Reading>,
    ) -> Self {
        let curve = Curve::new(side.face.face.away_sign(), point.vector(), tangent_rad, radius_m);
        let covariance = DMatrix::identity(curve.size(), curve.size());
        let mut object = Self { config, curve, covariance, readings, near_m: 0.0, touched_m: (0.0, 0.0) };
        object.refine(side, Effort::Far);
        object
    }

    /// The contact that is expected, and the innovation of a reading.
    pub(super) fn expect(&self, side: &Side, base: &Pose<Base, Start>, reading_n_m: f64) -> Option<Expected> {
        let contact = contact(side, base, &self.curve, self.near_m)?;
        let (residual, touches) = Residual::of(side, &Reading::new(*base, reading_n_m, self.near_m), Some(&contact));
        let told = if touches { self.spread(&contact, &[contact.reading_by_point])[(0, 0)] } else { 0.0 };
        let innovation =
            Innovation::of(Vector1::new(residual.residual_n_m), Matrix1::new(told + residual.variance_n2_m2));
        Some(Expected { contact, innovation })
    }

    /// StateArray the contact that is expected.
    pub(super) fn estimate(&mut self, side: &Side, base: &Pose<Base, Start>, expected: &Expected) -> Estimate {
        let Expected { contact, innovation } = expected;
        self.near_m = contact.place.tau_m;
        let spread = self.spread(contact, &[Vector2::x(), Vector2::y()]);
        let spread = Matrix2::new(spread[(0, 0)], spread[(0, 1)], spread[(1, 0)], spread[(1, 1)]);
        let calibrated = side.face.domain.contains(contact.place_m.0, contact.place_m.1);
        let stated = side.estimate_at(contact.point, calibrated, base.inverse().turn(spread), *innovation);
        Estimate { radius: Some(self.radius(side, contact)), ..stated }
    }

    /// The object's mean radius, of the logarithm, over a stretch about a contact.
    fn radius(&self, side: &Side, contact: &Contact) -> Radius {
        let reach_m = 0.5 * RADIUS_STRETCH_M;
        let cells = self.curve.cells_between(contact.place.tau_m - reach_m, contact.place.tau_m + reach_m);
        let count = cells.len() as f64;
        let mean = self.curve.logs()[cells.clone()].iter().sum::<f64>() / count;
        let rows = ANCHOR + cells.start;
        let variance = self.covariance.view((rows, rows), (cells.len(), cells.len())).sum() / count.powi(2);
        let radius_m = SCALE_M * mean.exp();
        let object_m = (radius_m - side.wire_radius_m(contact.place_m.0)).max(0.0);
        Radius { radius_m: object_m, sd_m: radius_m * variance.max(0.0).sqrt() }
    }

    /// Covariance of what has the derivatives `by_point` by the contact's point.
    fn spread(&self, contact: &Contact, by_point: &[Vector2<f64>]) -> DMatrix<f64> {
        let (low_m, high_m) = self.curve.range_m();
        let mut slopes = DMatrix::zeros(self.curve.size(), by_point.len());
        for (mut column, by_point) in slopes.column_iter_mut().zip(by_point) {
            contact.pull_back(&self.curve, *by_point, column.as_mut_slice());
        }
        let mut spread = slopes.transpose() * &self.covariance * &slopes;
        // Beyond the curve's ends the radius wanders from cell to cell; over the way to the contact its mean does by a third of that.
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
        keep(&mut self.readings, reading);
    }

    /// Where on the curve the last contact was.
    pub(super) fn near_m(&self) -> f64 {
        self.near_m
    }

    fn evidence<'a>(&'a self, side: &'a Side, prior: Prior) -> Evidence<'a> {
        Evidence { side, readings: &self.readings, prior, gate_sds: self.config.gate_sds }
    }

    /// Makes the curve long enough for every reading, and no longer.
    fn fit_length(&mut self, side: &Side) {
        for _ in 0..LENGTH_ROUNDS {
            let (mut low_m, mut high_m) = (f64::INFINITY, f64::NEG_INFINITY);
            for reading in &mut self.readings {
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

    /// The curve to which a search comes under one prior after the other, and its cost under the last.
    fn sought(&self, side: &Side, priors: &[Prior], iterations: usize) -> Option<(Curve, f64)> {
        let settings = Settings { iterations, ..SETTINGS };
        let descend = |curve: Curve, prior: &Prior| {
            minimise(&self.evidence(side, *prior), curve, &settings).map(|solution| solution.state)
        };
        let curve = priors.iter().try_fold(self.curve.clone(), descend)?;
        let cost = self.evidence(side, *priors.last()?).cost(&curve, &curve)?;
        Some((curve, cost))
    }

    /// Seeks the most probable curve anew.
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
        self.covariance = self.doubt(side).unwrap_or_else(|| DMatrix::identity(self.curve.size(), self.curve.size()));
    }

    /// Covariance of the curve's numbers: that of the readings' noise under the prior, and what a sensor model that errs the same way everywhere does to them
    /// (a consider parameter: Schmidt 1966).
    fn doubt(&self, side: &Side) -> Option<DMatrix<f64>> {
        let evidence = self.evidence(side, self.config.prior.doubtful());
        let factor = evidence.approximate(&self.curve)?.curvature.cholesky()?;
        let shift = factor.solve(&evidence.model_error_pull(&self.curve));
        let mut covariance = factor.inverse();
        covariance.ger(1.0, &shift, &shift, 1.0);
        Some(covariance)
    }

    /// Covariance of the curve at a place. A curve that slides within itself is the same curve, so only what leads out of it counts: at right angles to it in
    /// the space of place and orientation, in which one radian is as far as `SCALE_M`. Along a side that is the way across, at a corner any way.
    fn doubt_about(&self, place: &Place) -> Matrix2<f64> {
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

    /// The outline where it was touched, given the wire's radius.
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
                    covariance_m2: self.doubt_about(&place),
                }
            })
            .collect()
    }
}
