//! The outline, sample by sample.
use std::sync::Arc;

use filters::Innovation;
use filters::least_squares::{Problem, Search, descend};
use nalgebra::{DMatrix, DVector, Matrix1, Matrix2, Vector1, Vector2};
use serde_json::Value;

use super::Config;
use super::contact::{Contact, contact};
use super::curve::{ANCHOR, Curve, PITCH_M};
use super::fit::{Evidence, Prior, Reading, keep};
use crate::estimators::extended::Extended;
use crate::estimators::gaussian::{self, Follower};
use crate::estimators::motion::Round;
use crate::estimators::settings::{SettingsError, parse};
use crate::estimators::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::{Base, Pose, Start};

struct Online {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(in crate::estimators) fn build(
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Online { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for Online {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let front = Follower::new(gaussian::Config::sliding(), Round::of_any_size(), touch, &self.knowledge);
        Box::new(Tracing {
            config: self.config,
            front,
            base: touch.before,
            belief: None,
            readings: Vec::new(),
            steps: 0,
            next: 0,
            last: 0,
            hurry: false,
            relinearisations: 0,
        })
    }
}

/// A curve and how sure it is.
struct Belief {
    curve: Curve,
    covariance: DMatrix<f64>,
    /// loose
    loose: DMatrix<f64>,
    near_m: f64,
}

struct Tracing {
    config: Config,
    front: Follower<Extended, Round, 4>,
    base: Pose<Base, Start>,
    belief: Option<Belief>,
    readings: Vec<Reading>,
    steps: usize,
    next: usize,
    last: usize,
    hurry: bool,
    relinearisations: usize,
}

impl Belief {
    fn extend(&mut self, low_m: f64, high_m: f64, variance: f64) -> bool {
        let (front, back) = self.curve.extend(low_m, high_m);
        if front + back == 0 {
            return false;
        }
        for old in [&mut self.covariance, &mut self.loose] {
            let size = old.nrows();
            let new = size + front + back;
            let source =
                |i: usize| -> usize { if i < ANCHOR { i } else { (i.max(ANCHOR + front) - front).min(size - 1) } };
            let mut grown = DMatrix::from_fn(new, new, |i, j| old[(source(i), source(j))]);
            for i in 0..front {
                for j in 0..front {
                    let steps = front - i.max(j);
                    grown[(ANCHOR + i, ANCHOR + j)] += variance * steps as f64;
                }
            }
            for i in 0..back {
                for j in 0..back {
                    let steps = i.min(j) + 1;
                    let at = ANCHOR + front + (size - ANCHOR);
                    grown[(at + i, at + j)] += variance * steps as f64;
                }
            }
            *old = grown;
        }
        true
    }
}

impl Tracing {
    /// Makes the curve long enough for every reading, and no longer.
    fn fit_length(&mut self) {
        let Some(Belief { curve, .. }) = &mut self.belief else { return };
        let side = &self.front.side;
        for _ in 0..3 {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for r in &mut self.readings {
                if let Some(c) = contact(side, &r.base, curve, r.near_m) {
                    r.near_m = c.place.tau_m;
                    low = low.min(r.near_m);
                    high = high.max(r.near_m);
                }
            }
            let (front, back) = curve.extend(low - 2.0 * PITCH_M, high + 2.0 * PITCH_M);
            curve.trim(low - 3.0 * PITCH_M, high + 3.0 * PITCH_M);
            if front + back == 0 {
                break;
            }
        }
    }

    /// Descends.
    fn descended(&self, from: &Curve, iterations: usize, prior: &Prior) -> Option<(Curve, f64)> {
        let side = &self.front.side;
        let evidence = Evidence { side, readings: &self.readings, prior, gate_sds: self.config.gate_sds };
        let (curve, _) = descend(&evidence, from.clone(), &Search { iterations, tolerance: 1e-2 })?;
        let cost = evidence.cost(&curve)?;
        Some((curve, cost))
    }

    fn relinearise(&mut self, search_wide: bool) {
        self.fit_length();
        let Some(belief) = &self.belief else { return };
        let config = self.config;
        let near = self.descended(&belief.curve, config.online_steps, &config.prior);
        let wide = search_wide.then(|| {
            let (rough, _) = self.descended(&belief.curve, config.online_rough, &config.rough())?;
            self.descended(&rough, config.online_rough, &config.prior)
        });
        let best = [near, wide.flatten()].into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1));
        if let (Some((curve, _)), Some(belief)) = (best, &mut self.belief) {
            belief.curve = curve;
        }
        self.fit_length();
        self.spread();
    }

    fn spread(&mut self) {
        let Some(belief) = &mut self.belief else { return };
        let loose = self.config.sure();
        for (prior, covariance) in [(&self.config.prior, &mut belief.covariance), (&loose, &mut belief.loose)] {
            let evidence =
                Evidence { side: &self.front.side, readings: &self.readings, prior, gate_sds: self.config.gate_sds };
            if let Some(factor) =
                evidence.approximate(&belief.curve).and_then(|quadratic| quadratic.curvature.cholesky())
            {
                *covariance = factor.inverse();
            }
        }
    }

    fn state(&mut self, sample: &Sample) -> Option<Estimate> {
        let side = &self.front.side;
        let belief = self.belief.as_mut()?;
        let mut found = contact(side, &self.base, &belief.curve, belief.near_m)?;
        let tau = found.place.tau_m;
        if belief.extend(tau - PITCH_M, tau + PITCH_M, self.config.new_variance) {
            found = contact(side, &self.base, &belief.curve, tau)?;
        }
        let size = belief.curve.size();
        let mut slope = vec![0.0; size];
        found.pull_back(&belief.curve, found.reading_by_point, &mut slope);
        let slope = DVector::from_vec(slope);
        let reading = Reading::new(self.base, sample.reading_n_m, found.place.tau_m);
        let evidence = Evidence { side, readings: &[], prior: &self.config.prior, gate_sds: self.config.gate_sds };
        let residual = evidence.residual(&reading, &found);
        let spread = &belief.covariance * &slope;
        let told = slope.dot(&spread);
        let expected = told + residual.variance_n2_m2;
        let honest = slope.dot(&(&belief.loose * &slope)) + residual.variance_n2_m2;
        let innovation = Innovation::of(Vector1::new(residual.residual_n_m), Matrix1::new(honest));
        if !residual.is_free {
            let gate = self.config.gate_sds.powi(2);
            let nis = residual.residual_n_m.powi(2) / expected;
            let widened = expected * (nis / gate).max(1.0);
            // Along the direction in which the reading draws, not beyond where it explains more.
            let cost = |curve: &Curve, pull: f64| {
                let found = contact(side, &reading.base, curve, reading.near_m)?;
                let residual = evidence.residual(&reading, &found);
                let noise = residual.variance_n2_m2 * widened / expected;
                Some(residual.residual_n_m.powi(2) / noise + pull * pull * told)
            };
            let full = residual.residual_n_m / widened;
            let still = residual.residual_n_m.powi(2) / (residual.variance_n2_m2 * widened / expected);
            for halving in 0..6 {
                let pull = full * 0.5f64.powi(halving);
                let moved = belief.curve.moved((&spread * pull).as_slice());
                if cost(&moved, pull).is_some_and(|cost| cost <= still) {
                    belief.curve = moved;
                    break;
                }
                self.hurry = true;
            }
            if nis > 9.0 {
                self.hurry = true;
            }
            belief.covariance.ger(-1.0 / widened, &spread, &spread, 1.0);
            let spread = &belief.loose * &slope;
            belief.loose.ger(-1.0 / (honest * (widened / expected)), &spread, &spread, 1.0);
        }
        keep(&mut self.readings, reading);
        let found = contact(side, &self.base, &belief.curve, found.place.tau_m)?;
        belief.near_m = found.place.tau_m;
        let covariance = covariance(&found, &belief.curve, &belief.loose);
        let covariance = self.base.inverse().turn(covariance);
        let calibrated = side.face.domain.contains(found.along_m, found.away_m);
        Some(side.estimate_at(found.point, calibrated, covariance, innovation))
    }
}

fn covariance(contact: &Contact, curve: &Curve, covariance: &DMatrix<f64>) -> Matrix2<f64> {
    let mut rows = DMatrix::zeros(curve.size(), 2);
    for (i, axis) in [Vector2::x(), Vector2::y()].into_iter().enumerate() {
        let mut column = vec![0.0; curve.size()];
        contact.pull_back(curve, axis, &mut column);
        rows.set_column(i, &DVector::from_vec(column));
    }
    let spread = rows.transpose() * covariance * &rows;
    Matrix2::new(spread[(0, 0)], spread[(0, 1)], spread[(1, 0)], spread[(1, 1)])
}

impl Tracker for Tracing {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        self.steps += 1;
        if self.belief.is_some() {
            let estimate = self.state(sample);
            let count = self.steps;
            if count >= self.next || self.hurry && count >= self.last + 5 + count / 100 {
                self.relinearisations += 1;
                let wide = self.hurry || self.relinearisations % 4 == 0;
                self.relinearise(wide);
                self.hurry = false;
                self.last = count;
                self.next = count + (count / 20).max(10);
            }
            return estimate;
        }
        keep(&mut self.readings, Reading::new(self.base, sample.reading_n_m, 0.0));
        let advance = self.front.advance(sample)?;
        let estimate = self.front.side.estimate(&advance.filtered, advance.innovation);
        let p = advance.filtered.covariance;
        let sd_m = p[(0, 0)].sqrt();
        let count = self.steps;
        if count >= 250 || count > 25 && sd_m < self.config.start_sd_m {
            let x = advance.filtered.mean;
            let side = &self.front.side;
            let point = self.base.apply(side.face.contact_at(x[0], x[1]));
            let tangent = self.base.yaw_rad() + side.tangent_rad(x[0], x[1]).0;
            let sign = side.face.face.away_sign();
            let curve = Curve::new(sign, point.vector(), tangent, x[2].clamp(1e-3, 50e-3));
            let size = curve.size();
            self.belief = Some(Belief {
                curve,
                covariance: DMatrix::identity(size, size),
                loose: DMatrix::identity(size, size),
                near_m: 0.0,
            });
            self.relinearise(true);
            self.next = count + 10;
        }
        Some(estimate)
    }
}
