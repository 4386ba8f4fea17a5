//! The published configuration (Lin, Reyes, Bohg and Cutkosky 2022), so that anyone can see what it does.
//!
//! The state is the contact in Cartesian coordinates of the base's frame; it rests in the world; the prior covariance is scaled by 1.004 at each
//! step; the sensor model is a polynomial of degree 5. The belief begins as one Gaussian, of which the paper does not say where. Its plots
//! begin 8 to 10 mm off; here the mean lies on the undeflected whisker, at four fifths of its calibrated part, and the standard deviation is
//! 8 mm in every direction. On a curved whisker such a Gaussian reaches over places to which the whisker never comes, and the extended filter,
//! linearised at its mean, concludes from the first readings what it takes seconds to forget.

use std::sync::Arc;

use filters::{Gaussian, Innovation, Measurement, ParticleSet};
use nalgebra::{Matrix1, Matrix2, RowVector2, SMatrix, SVector, Vector1, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::gaussian::Verbs;
use super::motion::{AnyMotion, Motion, MotionSettings, Resting};
use super::side::Side;
use super::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::{Base, Point};
use crate::settings::{Settings, SettingsError, parse, within};

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
}

impl Default for Published {
    fn default() -> Self {
        Self { fading: 1.004, start_share: 0.8, start_sd_m: 8e-3 }
    }
}

impl Published {
    fn validate(&self) -> Result<(), SettingsError> {
        within("paper.fading", self.fading, 1.0..=2.0)?;
        within("paper.start_share", self.start_share, 0.0..=1.0)?;
        within("paper.start_sd_m", self.start_sd_m, 1e-6..=0.1)
    }

    /// The first belief.
    fn start(&self, side: &Side, touch: &Touch<'_>) -> Gaussian<2> {
        let (low_m, high_m) = side.face.domain.arc_range_m();
        let middle = side.face.rest.point(low_m + self.start_share * (high_m - low_m));
        let (mean, sd_m) = touch
            .contact_prior
            .map_or((middle, self.start_sd_m), |contact_prior| (contact_prior.contact, contact_prior.sd_m));
        Gaussian::new(mean.vector(), Matrix2::identity() * (sd_m * sd_m))
    }
}

/// The reading of a contact in Cartesian coordinates; beyond the calibrated region continued linearly.
struct Reading<'a> {
    side: &'a Side,
    /// Which number of the state is the sensor model's error, in standard deviations; without one the error is part of the noise.
    model_error: Option<usize>,
}

impl<'a> Reading<'a> {
    /// The measurement that belongs to a model of the contact's motion.
    fn of<Model: Motion<N>, const N: usize>(side: &'a Side) -> Self {
        Self { side, model_error: Model::MODEL_ERROR }
    }

    /// The contact of a state, and its place along and away.
    fn place<const N: usize>(&self, x: &SVector<f64, N>) -> (Point<Base>, (f64, f64)) {
        let contact = Point::new(x[0], x[1]);
        (contact, self.side.face.along_and_away(contact))
    }

    fn expect(&self, contact: Point<Base>, place: (f64, f64)) -> (f64, RowVector2<f64>) {
        let held = self.side.face.nearest_calibrated_at(contact, place);
        let expected = self.side.face.model.predict(held);
        let gradient = expected.gradient_n.transpose();
        (expected.reading_n_m + gradient.transpose().dot(&(contact.vector() - held.vector())), gradient)
    }

    fn linearised_at<const N: usize>(
        &self,
        x: &SVector<f64, N>,
        contact: Point<Base>,
        place: (f64, f64),
    ) -> (Vector1<f64>, SMatrix<f64, 1, N>) {
        let (mut expected_n_m, gradient) = self.expect(contact, place);
        let mut jacobian = SMatrix::<f64, 1, N>::zeros();
        jacobian.fixed_view_mut::<1, 2>(0, 0).copy_from(&gradient);
        if let Some(e) = self.model_error {
            let sd_n_m = self.side.model_variance_n2_m2(place.0, place.1).sqrt();
            expected_n_m += x[e] * sd_n_m;
            jacobian[e] = sd_n_m;
        }
        (Vector1::new(expected_n_m), jacobian)
    }
}

impl<const N: usize> Measurement<N, 1> for Reading<'_> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector1<f64>> {
        let (contact, place) = self.place(x);
        let error_n_m =
            self.model_error.map_or(0.0, |e| x[e] * self.side.model_variance_n2_m2(place.0, place.1).sqrt());
        Some(Vector1::new(self.expect(contact, place).0 + error_n_m))
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 1, N>> {
        Some(self.linearised(x)?.1)
    }

    /// The sensor model is asked once.
    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>)> {
        let (contact, place) = self.place(x);
        Some(self.linearised_at(x, contact, place))
    }

    fn noise(&self, x: &SVector<f64, N>) -> Matrix1<f64> {
        let (_, place) = self.place(x);
        Matrix1::new(self.side.variance_n2_m2(place.0, place.1))
    }

    /// The place along and away is found once.
    fn linearised_with_noise(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>, Matrix1<f64>)> {
        let (contact, place) = self.place(x);
        let (expected, jacobian) = self.linearised_at(x, contact, place);
        Some((expected, jacobian, Matrix1::new(self.side.variance_n2_m2(place.0, place.1))))
    }
}

/// Holds the place of a state within the calibrated region.
fn held<const N: usize>(side: &Side, x: &SVector<f64, N>) -> SVector<f64, N> {
    let contact = side.face.nearest_calibrated(Point::new(x[0], x[1]));
    let mut held = *x;
    (held[0], held[1]) = (contact.x(), contact.y());
    held
}

fn estimate<Model: Motion<N>, const N: usize>(
    side: &Side,
    motion: &Model,
    belief: &Gaussian<N>,
    innovation: Option<Innovation<1>>,
) -> Estimate {
    let held = held(side, &belief.mean);
    let covariance_m2 = belief.covariance.fixed_view::<2, 2>(0, 0).into();
    let contact = Point::new(held[0], held[1]);
    let radius = side.radius(motion.radius(), belief, contact);
    Estimate { radius, ..side.estimate_at(contact, held == belief.mean, covariance_m2, innovation) }
}

/// The first belief under a model of the motion: what the publication says of the place, and what the model says of the rest.
fn beginning<Model: Motion<N>, const N: usize>(motion: &Model, side: &Side, place: &Gaussian<2>) -> Gaussian<N> {
    let (arc_m, away_m) = side.face.along_and_away(Point::from_vector(place.mean));
    let mut belief = motion.belief(&Gaussian::new(vector![arc_m, away_m], place.covariance));
    belief.mean.fixed_rows_mut::<2>(0).copy_from(&place.mean);
    belief
}

/// Settings of the Gaussian filters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: Verbs")]
pub(super) struct Config<Filter> {
    /// Memory and start.
    pub paper: Published,
    /// How the contact moves; as published it rests.
    pub motion: MotionSettings,
    /// What only this filter has.
    pub filter: Filter,
}

impl<Filter: Verbs> Default for Config<Filter> {
    fn default() -> Self {
        Self { paper: Published::default(), motion: at_rest(), filter: Filter::default() }
    }
}

/// The published motion.
fn at_rest() -> MotionSettings {
    MotionSettings::Resting(Resting::default())
}

impl<Filter: Verbs> Settings for Config<Filter> {
    fn validate(&self) -> Result<(), SettingsError> {
        self.paper.validate()?;
        self.motion.validate()?;
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
        self.config.motion.begin(self, touch)
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

impl<Filter: Verbs> AnyMotion for Filtering<Filter> {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let side = Side::new(touch.face, &self.knowledge);
        let belief = beginning(&motion, &side, &self.config.paper.start(&side, touch));
        Box::new(Follower { config: self.config, motion, side, belief, is_first: true })
    }
}

struct Follower<Filter, Model, const N: usize> {
    config: Config<Filter>,
    motion: Model,
    side: Side,
    belief: Gaussian<N>,
    is_first: bool,
}

impl<Filter: Verbs, Model: Motion<N>, const N: usize> Tracker for Follower<Filter, Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            let process = self.motion.cartesian_step(&self.side, sample);
            // A belief whose covariance has lost its definiteness says nothing any more.
            self.config.filter.predict(&mut self.belief, &process).ok()?;
            self.belief.fade(self.config.paper.fading);
        }
        let z = Vector1::new(sample.reading_n_m);
        let reading = Reading::of::<Model, N>(&self.side);
        let innovation = self.config.filter.update(&mut self.belief, &reading, &z).ok();
        let estimate = estimate(&self.side, &self.motion, &self.belief, innovation);
        // The estimate's contact is held within the calibrated region.
        (self.belief.mean[0], self.belief.mean[1]) = (estimate.contact.x(), estimate.contact.y());
        Some(estimate)
    }
}

/// Settings of the particle filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ParticleConfig {
    /// Memory and start.
    pub paper: Published,
    /// How the contact moves; as published it rests.
    pub motion: MotionSettings,
    /// Number of particles.
    pub particles: usize,
    /// Resample where the effective sample size falls below this share of the particles.
    pub resample_share: f64,
    /// Kernel of the resampling, in standard deviations of the cloud.
    pub kernel: f64,
}

impl Default for ParticleConfig {
    fn default() -> Self {
        Self { paper: Published::default(), motion: at_rest(), particles: 1000, resample_share: 0.5, kernel: 0.1 }
    }
}

impl Settings for ParticleConfig {
    fn validate(&self) -> Result<(), SettingsError> {
        self.paper.validate()?;
        self.motion.validate()?;
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
        self.config.motion.begin(self, touch)
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

impl AnyMotion for ParticleFilter {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let side = Side::new(touch.face, &self.knowledge);
        let mut rng = Pcg64::seed_from_u64(touch.seed);
        let start = beginning(&motion, &side, &self.config.paper.start(&side, touch));
        let factor = start.covariance.cholesky().map_or_else(SMatrix::zeros, |factor| factor.l());
        let draw = |_| start.mean + factor * SVector::<f64, N>::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
        let cloud = ParticleSet::new((0..self.config.particles).map(draw).collect());
        Box::new(CloudFollower { config: self.config, motion, side, cloud, rng, is_first: true })
    }
}

struct CloudFollower<Model, const N: usize> {
    config: ParticleConfig,
    motion: Model,
    side: Side,
    cloud: ParticleSet<N>,
    rng: Pcg64,
    is_first: bool,
}

impl<Model: Motion<N>, const N: usize> Tracker for CloudFollower<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            let process = self.motion.cartesian_step(&self.side, sample);
            self.cloud.predict(&process, &mut self.rng);
            self.cloud.fade(self.config.paper.fading);
        }
        self.cloud.map(|x| held(&self.side, x));
        let reading = Reading::of::<Model, N>(&self.side);
        let innovation = self.cloud.update(&reading, &Vector1::new(sample.reading_n_m)).ok();
        let estimate = estimate(&self.side, &self.motion, &self.cloud.moments(), innovation);
        if self.cloud.effective_size() < self.config.resample_share * self.cloud.particles().len() as f64 {
            self.cloud.resample(self.config.kernel, &mut self.rng);
        }
        Some(estimate)
    }
}
