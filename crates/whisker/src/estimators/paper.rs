//! The published configuration (Lin, Reyes, Bohg and Cutkosky 2022), so that anyone can see what it does.
//!
//! The state is the contact in Cartesian coordinates of the base's frame; it rests in the world; the prior covariance is scaled by 1.004 at each
//! step; the sensor model is a polynomial of degree 5. The belief begins as one Gaussian, of which the paper does not say where. Its plots
//! begin 8 to 10 mm off; here the mean lies on the undeflected whisker, at four fifths of its calibrated part, and the standard deviation is
//! 8 mm in every direction. On a curved whisker such a Gaussian reaches over places to which the whisker never comes, and the extended filter,
//! linearised at its mean, concludes from the first readings what it takes seconds to forget.

use std::sync::Arc;

use filters::{Cloud, Gaussian, Innovation, Measurement, Process};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::gaussian::Verbs;
use super::settings::{Settings, SettingsError, parse, within};
use super::side::Side;
use super::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::{Base, Point, Pose};

/// Label of its sensor model.
pub(super) const SENSOR_MODEL: &str = "polynomial-5";

/// What all three share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Published {
    /// Fading memory: the prior covariance is scaled by it at each step.
    pub fading: f64,
    /// Mean of the first belief: a share of the calibrated part of the undeflected whisker, from the root.
    pub start_share: f64,
    /// Its standard deviation, in every direction.
    pub start_sd_m: f64,
    /// How far the contact may wander in the world, as the standard deviation after one second.
    pub wander_m_sqrt_s: f64,
}

impl Default for Published {
    fn default() -> Self {
        Self { fading: 1.004, start_share: 0.8, start_sd_m: 8e-3, wander_m_sqrt_s: 1e-4 }
    }
}

impl Published {
    fn validate(&self) -> Result<(), SettingsError> {
        within("paper.fading", self.fading, 1.0..=2.0)?;
        within("paper.start_share", self.start_share, 0.0..=1.0)?;
        within("paper.start_sd_m", self.start_sd_m, 1e-6..=0.1)?;
        within("paper.wander_m_sqrt_s", self.wander_m_sqrt_s, 1e-9..=0.1)
    }

    /// The first belief.
    fn start(&self, side: &Side, touch: &Touch<'_>) -> Gaussian<2> {
        let (low_m, high_m) = side.face.domain.arc_range_m();
        let middle = side.face.rest.point(low_m + self.start_share * (high_m - low_m));
        let (mean, sd_m) = touch.told.map_or((middle, self.start_sd_m), |told| (told.contact, told.sd_m));
        Gaussian::new(mean.vector(), Matrix2::identity() * (sd_m * sd_m))
    }

    fn process(&self, sample: &Sample) -> Rest {
        Rest { motion: sample.motion, wander_m2: self.wander_m_sqrt_s.powi(2) * sample.dt_s }
    }
}

/// A contact at rest in the world, in Cartesian coordinates of Base.
struct Rest {
    motion: Pose<Base, Base>,
    wander_m2: f64,
}

impl Process<2> for Rest {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.motion.apply(Point::from_vector(*x)).vector()
    }

    fn jacobian(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        self.motion.rotation()
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.wander_m2
    }
}

/// The reading of a contact in Cartesian coordinates; beyond the calibrated region continued linearly.
struct Reading<'a>(&'a Side);

impl Reading<'_> {
    fn expect(&self, x: &Vector2<f64>) -> (f64, RowVector2<f64>) {
        let contact = Point::from_vector(*x);
        let held = self.0.face.nearest_calibrated(contact);
        let expected = self.0.face.model.predict(held);
        let gradient = expected.gradient_n.transpose();
        (expected.reading_n_m + (gradient * (contact.vector() - held.vector()))[0], gradient)
    }
}

impl Measurement<2, 1> for Reading<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(self.expect(x).0))
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Option<RowVector2<f64>> {
        Some(self.expect(x).1)
    }

    fn noise(&self, x: &Vector2<f64>) -> Matrix1<f64> {
        let (arc_m, away_m) = self.0.face.along_and_away(Point::from_vector(*x));
        Matrix1::new(self.0.variance_n2_m2(arc_m, away_m))
    }
}

/// Holds a contact within the calibrated region.
fn held(side: &Side, x: &Vector2<f64>) -> Vector2<f64> {
    side.face.nearest_calibrated(Point::from_vector(*x)).vector()
}

fn estimate(side: &Side, belief: &Gaussian<2>, innovation: Option<Innovation<1>>) -> Estimate {
    let contact = Point::from_vector(held(side, &belief.mean));
    side.estimate_at(contact, contact.vector() == belief.mean, belief.covariance, innovation)
}

/// Settings of the Gaussian filters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: Verbs")]
pub(super) struct Config<Filter> {
    /// Memory, start and wander.
    pub paper: Published,
    /// What only this filter has.
    pub filter: Filter,
}

impl<Filter: Verbs> Settings for Config<Filter> {
    fn validate(&self) -> Result<(), SettingsError> {
        self.paper.validate()?;
        self.filter.validate()
    }
}

struct Filtering<Filter> {
    config: Config<Filter>,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build<Filter: Verbs>(
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Filtering::<Filter> { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl<Filter: Verbs> Method for Filtering<Filter> {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let side = Side::new(touch.face, &self.knowledge);
        let belief = self.config.paper.start(&side, touch);
        Box::new(Follower { config: self.config, side, belief, is_first: true })
    }
}

struct Follower<Filter> {
    config: Config<Filter>,
    side: Side,
    belief: Gaussian<2>,
    is_first: bool,
}

impl<Filter: Verbs> Tracker for Follower<Filter> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            // A belief whose covariance has lost its definiteness says nothing any more.
            self.config.filter.predict(&mut self.belief, &self.config.paper.process(sample)).ok()?;
            self.belief.fade(self.config.paper.fading);
        }
        let z = Vector1::new(sample.reading_n_m);
        let innovation = self.config.filter.update(&mut self.belief, &Reading(&self.side), &z).ok();
        let estimate = estimate(&self.side, &self.belief, innovation);
        self.belief.mean = held(&self.side, &self.belief.mean);
        Some(estimate)
    }
}

/// Settings of the particle filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ParticleConfig {
    /// Memory, start and wander.
    pub paper: Published,
    /// Number of particles.
    pub particles: usize,
    /// Resample where the effective sample size falls below this share of the particles.
    pub resample_share: f64,
    /// Kernel of the resampling, in standard deviations of the cloud.
    pub kernel: f64,
}

impl Default for ParticleConfig {
    fn default() -> Self {
        Self { paper: Published::default(), particles: 1000, resample_share: 0.5, kernel: 0.1 }
    }
}

impl Settings for ParticleConfig {
    fn validate(&self) -> Result<(), SettingsError> {
        self.paper.validate()?;
        within("particles", self.particles as f64, 1.0..=1e7)?;
        within("resample_share", self.resample_share, 0.0..=1.0)?;
        within("kernel", self.kernel, 0.0..=1.0)
    }
}

struct ParticleFilter {
    config: ParticleConfig,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build_particle(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(ParticleFilter { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for ParticleFilter {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let side = Side::new(touch.face, &self.knowledge);
        let mut rng = Pcg64::seed_from_u64(touch.seed);
        let start = self.config.paper.start(&side, touch);
        let sd_m = start.covariance[(0, 0)].sqrt();
        let draw = |_| start.mean + Vector2::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)) * sd_m;
        let cloud = Cloud::new((0..self.config.particles).map(draw).collect());
        Box::new(CloudFollower { config: self.config, side, cloud, rng, is_first: true })
    }
}

struct CloudFollower {
    config: ParticleConfig,
    side: Side,
    cloud: Cloud<2>,
    rng: Pcg64,
    is_first: bool,
}

impl Tracker for CloudFollower {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            self.cloud.predict(&self.config.paper.process(sample), &mut self.rng);
            self.cloud.fade(self.config.paper.fading);
        }
        self.cloud.map(|x| held(&self.side, x));
        let innovation = self.cloud.update(&Reading(&self.side), &Vector1::new(sample.reading_n_m)).ok();
        let estimate = estimate(&self.side, &self.cloud.moments(), innovation);
        if self.cloud.effective_size() < self.config.resample_share * self.cloud.particles().len() as f64 {
            self.cloud.resample(self.config.kernel, &mut self.rng);
        }
        Some(estimate)
    }
}
