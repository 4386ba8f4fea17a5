//! The published configuration (Lin, Reyes, Bohg and Cutkosky 2022), for comparison.
//!
//! The state is the contact in Cartesian coordinates of Base. It rests in the world; the prior covariance is scaled by
//! 1.004 at each step; the sensor model is a polynomial of degree 5. The initial belief is one Gaussian, whose mean the
//! publication does not state. Its plots begin 8 to 10 mm off; here the mean lies on the undeflected whisker, at four
//! fifths of its calibrated part, and the standard deviation is 8 mm in every direction. On a curved whisker such a
//! Gaussian covers positions that the whisker never reaches, and the extended filter, linearised at its mean, draws
//! conclusions from the first readings that take seconds to correct.

use std::sync::Arc;

use filters::{Gaussian, Innovation, Measurement, ParticleSet};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::gaussian::GaussianFilter;
use super::motion::Resting;
use super::side::Side;
use super::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::{Base, Point};
use crate::sensor::{AlongAway, Shares};
use crate::settings::{Settings, SettingsError, parse, within};

/// Label of the sensor model.
pub(super) const SENSOR_MODEL: &str = "polynomial-5";

/// Settings common to the three filters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Published {
    /// Fading memory: factor of the prior covariance at each step.
    pub fading: f64,
    /// Mean of the initial belief, as a share of the calibrated part of the undeflected whisker from the root.
    pub start_share: f64,
    /// Standard deviation of the initial belief in every direction.
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

    /// The initial belief.
    fn start(&self, side: &Side, touch: &Touch<'_>) -> Gaussian<2> {
        let (low_m, high_m) = side.face.domain.arc_range_m();
        let middle = side.face.rest.point(low_m + self.start_share * (high_m - low_m));
        let (mean, sd_m) = touch
            .contact_prior
            .map_or((middle, self.start_sd_m), |contact_prior| (contact_prior.contact, contact_prior.sd_m));
        Gaussian::new(mean.vector(), Matrix2::identity() * (sd_m * sd_m))
    }
}

/// Measurement model of a contact in Cartesian coordinates, extrapolated linearly beyond the calibrated domain.
struct Reading<'a>(&'a Side);

impl Reading<'_> {
    /// The contact of a state, in Base and in coordinates along and away.
    fn place(&self, x: &Vector2<f64>) -> (Point<Base>, AlongAway) {
        let contact = Point::from_vector(*x);
        (contact, self.0.face.along_and_away(contact))
    }

    /// Expected reading of a contact and its gradient.
    fn expect(&self, contact: Point<Base>, place: AlongAway) -> (f64, RowVector2<f64>) {
        let held = self.0.face.nearest_calibrated_at(contact, place);
        let expected = self.0.face.model.predict(held);
        let gradient = expected.gradient_n.transpose();
        (expected.reading_n_m + gradient.transpose().dot(&(contact.vector() - held.vector())), gradient)
    }

    /// Expected reading of a contact with this position in the calibrated domain, and its variance. Computes the gradient only
    /// outside the domain.
    fn expect_with_noise(
        &self,
        contact: Point<Base>,
        place: AlongAway,
        (shares, is_calibrated): (Shares, bool),
    ) -> (f64, f64) {
        let face = &self.0.face;
        let expected_n_m = if is_calibrated { face.model.reading_n_m(contact) } else { self.expect(contact, place).0 };
        (expected_n_m, self.0.noise_n2_m2(place) + face.error.variance_n2_m2(shares))
    }

    /// Moves the contact of a state into the calibrated domain, and returns its expected reading and the variance of the reading.
    fn hold_and_expect(&self, x: &mut Vector2<f64>) -> (f64, f64) {
        let face = &self.0.face;
        let (mut contact, mut place) = self.place(x);
        let mut position = face.domain.shares_and_containment(place);
        if !position.1 {
            contact = face.contact_at(face.domain.clamp(place));
            *x = contact.vector();
            place = face.along_and_away(contact);
            position = face.domain.shares_and_containment(place);
        }
        self.expect_with_noise(contact, place, position)
    }
}

impl Measurement<2, 1> for Reading<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(self.predict_with_noise(x)?.0)
    }

    /// Computes the coordinates along and away only once.
    fn predict_with_noise(&self, x: &Vector2<f64>) -> Option<(Vector1<f64>, Matrix1<f64>)> {
        let (contact, place) = self.place(x);
        let position = self.0.face.domain.shares_and_containment(place);
        let (expected_n_m, variance_n2_m2) = self.expect_with_noise(contact, place, position);
        Some((Vector1::new(expected_n_m), Matrix1::new(variance_n2_m2)))
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Option<RowVector2<f64>> {
        Some(self.linearised(x)?.1)
    }

    /// Evaluates the sensor model once.
    fn linearised(&self, x: &Vector2<f64>) -> Option<(Vector1<f64>, RowVector2<f64>)> {
        let (contact, place) = self.place(x);
        let (expected_n_m, gradient) = self.expect(contact, place);
        Some((Vector1::new(expected_n_m), gradient))
    }

    fn noise(&self, x: &Vector2<f64>) -> Matrix1<f64> {
        let (_, place) = self.place(x);
        Matrix1::new(self.0.variance_n2_m2(place))
    }

    /// Computes the coordinates along and away once.
    fn linearised_with_noise(&self, x: &Vector2<f64>) -> Option<(Vector1<f64>, RowVector2<f64>, Matrix1<f64>)> {
        let (contact, place) = self.place(x);
        let (expected_n_m, gradient) = self.expect(contact, place);
        Some((Vector1::new(expected_n_m), gradient, Matrix1::new(self.0.variance_n2_m2(place))))
    }
}

/// The estimate of a belief, whose contact is moved into the calibrated domain.
fn estimate(side: &Side, belief: &Gaussian<2>, innovation: Option<Innovation<1>>) -> Estimate {
    let mean = Point::from_vector(belief.mean);
    let held = side.face.nearest_calibrated(mean);
    side.estimate_at(held, held == mean, belief.covariance, innovation)
}

/// Settings of the Gaussian filters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: GaussianFilter")]
pub(super) struct Config<Filter> {
    /// Fading memory and initial belief.
    pub paper: Published,
    /// Motion of the contact.
    pub motion: Resting,
    /// Settings of this filter alone.
    pub filter: Filter,
}

impl<Filter: GaussianFilter> Default for Config<Filter> {
    fn default() -> Self {
        Self { paper: Published::default(), motion: Resting::default(), filter: Filter::default() }
    }
}

impl<Filter: GaussianFilter> Settings for Config<Filter> {
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

pub(super) fn build<Filter: GaussianFilter>(
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Filtering::<Filter> { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl<Filter: GaussianFilter> Method for Filtering<Filter> {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let side = Side::new(touch.face, &self.knowledge);
        let belief = self.config.paper.start(&side, touch);
        Box::new(Follower { config: self.config, side, belief, is_first: true })
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

struct Follower<Filter> {
    config: Config<Filter>,
    side: Side,
    belief: Gaussian<2>,
    is_first: bool,
}

impl<Filter: GaussianFilter> Tracker for Follower<Filter> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            let process = self.config.motion.cartesian_step(sample);
            // A covariance that is no longer positive definite gives no estimate.
            self.config.filter.predict(&mut self.belief, &process).ok()?;
            self.belief.fade(self.config.paper.fading);
        }
        let z = Vector1::new(sample.reading_n_m);
        let innovation = self.config.filter.update(&mut self.belief, &Reading(&self.side), &z).ok();
        let estimate = estimate(&self.side, &self.belief, innovation);
        self.belief.mean = estimate.contact.vector();
        Some(estimate)
    }
}

/// Settings of the particle filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ParticleConfig {
    /// Fading memory and initial belief.
    pub paper: Published,
    /// Motion of the contact.
    pub motion: Resting,
    /// Number of particles.
    pub particles: usize,
    /// Share of the particles; the set is resampled if the effective sample size falls below it.
    pub resample_share: f64,
    /// Kernel of the resampling, in standard deviations of the set.
    pub kernel: f64,
}

impl Default for ParticleConfig {
    fn default() -> Self {
        Self {
            paper: Published::default(),
            motion: Resting::default(),
            particles: 1000,
            resample_share: 0.5,
            kernel: 0.1,
        }
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
        let side = Side::new(touch.face, &self.knowledge);
        let mut rng = Pcg64::seed_from_u64(touch.seed);
        let start = self.config.paper.start(&side, touch);
        let factor = start.covariance.cholesky().map_or_else(Matrix2::zeros, |factor| factor.l());
        let draw = |_| start.mean + factor * Vector2::from_fn(|_, _| rng.sample(StandardNormal));
        let set = ParticleSet::new((0..self.config.particles).map(draw).collect());
        Box::new(ParticleFollower { config: self.config, side, set, rng, is_first: true })
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

struct ParticleFollower {
    config: ParticleConfig,
    side: Side,
    set: ParticleSet<2>,
    rng: Pcg64,
    is_first: bool,
}

impl Tracker for ParticleFollower {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            self.set.predict(&self.config.motion.cartesian_step(sample), &mut self.rng);
            self.set.fade(self.config.paper.fading);
        }
        let reading = Reading(&self.side);
        let innovation = self.set.move_and_update(|x| Some(reading.hold_and_expect(x)), sample.reading_n_m).ok();
        let estimate = estimate(&self.side, &self.set.moments(), innovation);
        if self.set.effective_size() < self.config.resample_share * self.set.particles().len() as f64 {
            self.set.resample(self.config.kernel, &mut self.rng);
        }
        Some(estimate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::BaseNoise;
    use crate::estimators::testing::knowledge;

    #[test]
    fn verif_prediction_with_noise_is_prediction_and_noise_inside_and_outside_the_calibrated_domain() {
        let base_noise = BaseNoise(nalgebra::Matrix3::from_diagonal_element(1e-10));
        let knowledge = Knowledge { base_noise, ..knowledge() };
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let reading = Reading(&side);
        for (along_m, away_m) in [(0.05, 3e-3), (0.05, 0.0), (0.079, 3e-3), (0.05, 0.5)] {
            let x = side.face.contact_at(AlongAway::new(along_m, away_m)).vector();
            let (expected, noise) = reading.predict_with_noise(&x).unwrap();
            assert_eq!(noise, reading.noise(&x));
            let apart = (reading.linearised(&x).unwrap().0 - expected)[0].abs();
            assert!(apart < 1e-9 * knowledge.faces[0].largest_reading_n_m, "{apart}");
        }
    }
}
