//! Hindsight.
use std::sync::Arc;

use filters::least_squares::{Problem, Search, descend};
use serde_json::Value;

use super::Config;
use super::contact::contact;
use super::curve::Curve;
use super::fit::{Evidence, Prior, Reading, covariance, keep};
use crate::estimators::extended::Extended;
use crate::estimators::gaussian::{self, Follower};
use crate::estimators::motion::Round;
use crate::estimators::settings::{SettingsError, parse};
use crate::estimators::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::{Base, Pose, Start};

struct Batch {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(in crate::estimators) fn build(
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Batch { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for Batch {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let front = Follower::new(gaussian::Config::sliding(), Round::of_any_size(), touch, &self.knowledge);
        Box::new(Collector {
            config: self.config,
            front,
            base: touch.before,
            curve: None,
            readings: Vec::new(),
            poses: Vec::new(),
            steps: 0,
        })
    }
}

struct Collector {
    config: Config,
    front: Follower<Extended, Round, 4>,
    base: Pose<Base, Start>,
    curve: Option<Curve>,
    readings: Vec<Reading>,
    poses: Vec<Pose<Base, Start>>,
    steps: usize,
}

impl Collector {
    fn relocate(&mut self) {
        let Some(curve) = &mut self.curve else { return };
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
            if curve.extend(low - 5e-4, high + 5e-4) == (0, 0) {
                break;
            }
        }
    }

    fn improve(&mut self, iterations: usize, prior: &Prior) {
        self.relocate();
        let Some(curve) = self.curve.clone() else { return };
        let evidence =
            Evidence { side: &self.front.side, readings: &self.readings, prior, gate_sds: self.config.gate_sds };
        if let Some((curve, _)) = descend(&evidence, curve, &Search { iterations, tolerance: 1e-3 }) {
            self.curve = Some(curve);
        }
    }
}

impl Tracker for Collector {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        self.steps += 1;
        self.poses.push(self.base);
        keep(&mut self.readings, Reading::new(self.base, sample.reading_n_m, 0.0));
        let advance = self.front.advance(sample)?;
        let estimate = self.front.side.estimate(&advance.filtered, advance.innovation);
        let count = self.steps;
        if count == 75 {
            let x = advance.filtered.mean;
            let side = &self.front.side;
            let point = self.base.apply(side.face.contact_at(x[0], x[1]));
            let tangent = self.base.yaw_rad() + side.tangent_rad(x[0], x[1]).0;
            let sign = side.face.face.away_sign();
            self.curve = Some(Curve::new(sign, point.vector(), tangent, x[2].clamp(1e-3, 50e-3)));
        }
        if count >= 75 && count % 25 == 0 {
            self.improve(3, &self.config.rough());
        }
        Some(estimate)
    }

    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let target = self.config.prior;
        let start = self.curve.clone();
        let smooth = Prior { change_cost: 30.0, change_large: 100.0, ..target };
        let mut best: Option<(f64, Curve)> = None;
        for path in [
            [self.config.rough(), self.config.rough(), target, target, target],
            [smooth, smooth, target, target, target],
        ] {
            self.curve = start.clone();
            for prior in path {
                self.improve(self.config.iterations, &prior);
            }
            self.relocate();
            let evidence = Evidence {
                side: &self.front.side,
                readings: &self.readings,
                prior: &target,
                gate_sds: self.config.gate_sds,
            };
            let curve = self.curve.clone()?;
            let cost = evidence.cost(&curve).unwrap_or(f64::INFINITY);
            if best.as_ref().is_none_or(|best| cost < best.0) {
                best = Some((cost, curve));
            }
        }
        self.curve = best.map(|best| best.1);
        self.relocate();
        let curve = self.curve.as_ref()?;
        let side = &self.front.side;
        let evidence =
            Evidence { side, readings: &self.readings, prior: &self.config.prior, gate_sds: self.config.gate_sds };
        let sure = self.config.sure();
        let evidence = Evidence { prior: &sure, ..evidence };
        let quadratic = evidence.approximate(curve)?;
        let factor = quadratic.curvature.cholesky()?;
        let mut near_m = 0.0;
        let estimates = self.poses.iter().map(|base| {
            let c = contact(side, base, curve, near_m)?;
            near_m = c.place.tau_m;
            let cov = base.inverse().turn(covariance(&c, curve, &factor));
            let calibrated = side.face.domain.contains(c.along_m, c.away_m);
            Some(side.estimate_at(c.point, calibrated, cov, None))
        });
        Some(estimates.collect())
    }
}
