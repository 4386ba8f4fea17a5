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
use nalgebra::{Matrix1, Matrix2, RowVector2, SMatrix, SVector, Vector1};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::gaussian::GaussianFilter;
use super::motion::{AnyMotion, Motion, MotionSettings, Resting};
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
struct Reading<'a> {
    side: &'a Side,
    /// Index of the sensor model's error in the state, in standard deviations. `None` if the error is part of the
    /// measurement noise.
    model_error: Option<usize>,
}

impl<'a> Reading<'a> {
    /// The measurement model that belongs to a model of the contact's motion.
    fn of<Model: Motion<N>, const N: usize>(side: &'a Side) -> Self {
        Self { side, model_error: Model::INDICES.model_error }
    }

    /// The contact of a state, in Base and in coordinates along and away.
    fn place<const N: usize>(&self, x: &SVector<f64, N>) -> (Point<Base>, AlongAway) {
        let contact = Point::new(x[0], x[1]);
        (contact, self.side.face.along_and_away(contact))
    }

    /// Expected reading of a contact and its gradient.
    fn expect(&self, contact: Point<Base>, place: AlongAway) -> (f64, RowVector2<f64>) {
        let held = self.side.face.nearest_calibrated_at(contact, place);
        let expected = self.side.face.model.predict(held);
        let gradient = expected.gradient_n.transpose();
        (expected.reading_n_m + gradient.transpose().dot(&(contact.vector() - held.vector())), gradient)
    }

    /// Expected reading of a state and the variance of the sensor model's error. Computes the gradient only outside the calibrated
    /// domain.
    fn predicted_at<const N: usize>(
        &self,
        x: &SVector<f64, N>,
        contact: Point<Base>,
        place: AlongAway,
    ) -> (Vector1<f64>, f64) {
        self.predicted_in(x, contact, place, self.side.face.domain.shares_and_containment(place))
    }

    /// As [`Self::predicted_at`], with the known position in the calibrated domain.
    fn predicted_in<const N: usize>(
        &self,
        x: &SVector<f64, N>,
        contact: Point<Base>,
        place: AlongAway,
        (shares, is_calibrated): (Shares, bool),
    ) -> (Vector1<f64>, f64) {
        let face = &self.side.face;
        let variance_n2_m2 = face.error.variance_n2_m2(shares);
        let expected_n_m = if is_calibrated { face.model.reading_n_m(contact) } else { self.expect(contact, place).0 };
        let error_n_m = self.model_error.map_or(0.0, |e| x[e] * variance_n2_m2.sqrt());
        (Vector1::new(expected_n_m + error_n_m), variance_n2_m2)
    }

    /// Moves the contact of a state into the calibrated domain, and returns its expected reading and the variance of the reading.
    fn hold_and_predict<const N: usize>(&self, x: &mut SVector<f64, N>) -> Option<(f64, f64)> {
        let face = &self.side.face;
        let (mut contact, mut place) = self.place(x);
        let mut position = face.domain.shares_and_containment(place);
        if !position.1 {
            contact = face.contact_at(face.domain.clamp(place));
            (x[0], x[1]) = (contact.x(), contact.y());
            place = face.along_and_away(contact);
            position = face.domain.shares_and_containment(place);
        }
        let (expected, model_variance_n2_m2) = self.predicted_in(x, contact, place, position);
        Some((expected[0], self.side.noise_n2_m2(place) + model_variance_n2_m2))
    }

    fn linearised_at<const N: usize>(
        &self,
        x: &SVector<f64, N>,
        contact: Point<Base>,
        place: AlongAway,
    ) -> (Vector1<f64>, SMatrix<f64, 1, N>) {
        let (mut expected_n_m, gradient) = self.expect(contact, place);
        let mut jacobian = SMatrix::<f64, 1, N>::zeros();
        jacobian.fixed_view_mut::<1, 2>(0, 0).copy_from(&gradient);
        if let Some(e) = self.model_error {
            let sd_n_m = self.side.model_variance_n2_m2(place).sqrt();
            expected_n_m += x[e] * sd_n_m;
            jacobian[e] = sd_n_m;
        }
        (Vector1::new(expected_n_m), jacobian)
    }
}

impl<const N: usize> Measurement<N, 1> for Reading<'_> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector1<f64>> {
        let (contact, place) = self.place(x);
        Some(self.predicted_at(x, contact, place).0)
    }

    /// Computes the coordinates along and away only once.
    fn predict_with_noise(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, Matrix1<f64>)> {
        let (contact, place) = self.place(x);
        let (expected, model_variance_n2_m2) = self.predicted_at(x, contact, place);
        Some((expected, Matrix1::new(self.side.noise_n2_m2(place) + model_variance_n2_m2)))
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 1, N>> {
        Some(self.linearised(x)?.1)
    }

    /// Evaluates the sensor model once.
    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>)> {
        let (contact, place) = self.place(x);
        Some(self.linearised_at(x, contact, place))
    }

    fn noise(&self, x: &SVector<f64, N>) -> Matrix1<f64> {
        let (_, place) = self.place(x);
        Matrix1::new(self.side.variance_n2_m2(place))
    }

    /// Computes the coordinates along and away once.
    fn linearised_with_noise(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>, Matrix1<f64>)> {
        let (contact, place) = self.place(x);
        let (expected, jacobian) = self.linearised_at(x, contact, place);
        Some((expected, jacobian, Matrix1::new(self.side.variance_n2_m2(place))))
    }
}

/// Moves the contact of a state into the calibrated domain.
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

/// The initial belief under a motion model: the contact's position as published, the other entries from the motion
/// model.
fn beginning<Model: Motion<N>, const N: usize>(motion: &Model, side: &Side, place: &Gaussian<2>) -> Gaussian<N> {
    let at = side.face.along_and_away(Point::from_vector(place.mean));
    let mut belief = motion.belief(&Gaussian::new(at.vector(), place.covariance));
    belief.mean.fixed_rows_mut::<2>(0).copy_from(&place.mean);
    belief
}

/// Settings of the Gaussian filters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: GaussianFilter")]
pub(super) struct Config<Filter> {
    /// Fading memory and initial belief.
    pub paper: Published,
    /// Model of the contact's motion; as published, rest.
    pub motion: MotionSettings,
    /// Settings of this filter alone.
    pub filter: Filter,
}

impl<Filter: GaussianFilter> Default for Config<Filter> {
    fn default() -> Self {
        Self { paper: Published::default(), motion: at_rest(), filter: Filter::default() }
    }
}

/// The published motion.
fn at_rest() -> MotionSettings {
    MotionSettings::Resting(Resting::default())
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
        self.config.motion.begin(self, touch)
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

impl<Filter: GaussianFilter> AnyMotion for Filtering<Filter> {
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

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Tracker for Follower<Filter, Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            let process = self.motion.cartesian_step(&self.side, sample);
            // A covariance that is no longer positive definite gives no estimate.
            self.config.filter.predict(&mut self.belief, &process).ok()?;
            self.belief.fade(self.config.paper.fading);
        }
        let z = Vector1::new(sample.reading_n_m);
        let reading = Reading::of::<Model, N>(&self.side);
        let innovation = self.config.filter.update(&mut self.belief, &reading, &z).ok();
        let estimate = estimate(&self.side, &self.motion, &self.belief, innovation);
        // The estimate's contact is held within the calibrated domain.
        (self.belief.mean[0], self.belief.mean[1]) = (estimate.contact.x(), estimate.contact.y());
        Some(estimate)
    }
}

/// Settings of the particle filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ParticleConfig {
    /// Fading memory and initial belief.
    pub paper: Published,
    /// Model of the contact's motion; as published, rest.
    pub motion: MotionSettings,
    /// Number of particles.
    pub particles: usize,
    /// Share of the particles; the set is resampled if the effective sample size falls below it.
    pub resample_share: f64,
    /// Kernel of the resampling, in standard deviations of the set.
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
        let set = ParticleSet::new((0..self.config.particles).map(draw).collect());
        Box::new(ParticleFollower { config: self.config, motion, side, set, rng, is_first: true })
    }
}

struct ParticleFollower<Model, const N: usize> {
    config: ParticleConfig,
    motion: Model,
    side: Side,
    set: ParticleSet<N>,
    rng: Pcg64,
    is_first: bool,
}

impl<Model: Motion<N>, const N: usize> Tracker for ParticleFollower<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !std::mem::take(&mut self.is_first) {
            let process = self.motion.cartesian_step(&self.side, sample);
            self.set.predict(&process, &mut self.rng);
            self.set.fade(self.config.paper.fading);
        }
        let reading = Reading::of::<Model, N>(&self.side);
        let innovation = self.set.move_and_update(|x| reading.hold_and_predict(x), sample.reading_n_m).ok();
        let estimate = estimate(&self.side, &self.motion, &self.set.moments(), innovation);
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
        for model_error in [None, Some(2)] {
            let reading = Reading { side: &side, model_error };
            for (along_m, away_m) in [(0.05, 3e-3), (0.05, 0.0), (0.079, 3e-3), (0.05, 0.5)] {
                let contact = side.face.contact_at(AlongAway::new(along_m, away_m));
                let x = SVector::from([contact.x(), contact.y(), 0.7]);
                let (expected, noise) = reading.predict_with_noise(&x).unwrap();
                let single: (Option<Vector1<f64>>, Matrix1<f64>) = (reading.predict(&x), reading.noise(&x));
                assert_eq!((Some(expected), noise), single);
                let linearised: Option<(Vector1<f64>, SMatrix<f64, 1, 3>)> = reading.linearised(&x);
                let apart = (linearised.unwrap().0 - expected)[0].abs();
                assert!(apart < 1e-9 * knowledge.faces[0].largest_reading_n_m, "{apart}");
            }
        }
    }
}
