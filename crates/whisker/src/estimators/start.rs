//! Initial belief at a touch: hypotheses along the whisker, with the deflection from the first reading, conditioned on
//! the readings just before.

use filters::{Gaussian, Measurement, Process};
use nalgebra::{Matrix1, Matrix2, SMatrix, SVector, Vector1, vector};
use serde::{Deserialize, Serialize};

use super::side::{ContactReading, Side};
use super::{ContactPrior, Sample};
use crate::frames::{Base, Pose};
use crate::sensor::AlongAway;
use crate::settings::{SettingsError, within};

/// Initial hypotheses of a filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Start {
    /// One Gaussian.
    Single,
    /// Several Gaussians along the whisker, weighted by their evidence.
    Hypotheses {
        /// Number of hypotheses.
        count: usize,
    },
}

/// Range on either side of the mean of a contact prior that the hypotheses cover, in its standard deviations.
const PRIOR_REACH_SDS: f64 = 3.0;

/// Newton steps for the deflection that explains a reading.
const NEWTON_STEPS: usize = 8;

impl Start {
    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        match self {
            Self::Single => Ok(()),
            Self::Hypotheses { count } => within("start.count", *count as f64, 1.0..=1000.0),
        }
    }

    /// Half as many hypotheses.
    pub(super) fn coarser(self) -> Self {
        match self {
            Self::Single => Self::Single,
            Self::Hypotheses { count } => Self::Hypotheses { count: count.div_ceil(2) },
        }
    }

    /// Gaussians of the contact at the touch, with the logarithms of their weights. The calibrated part of the whisker,
    /// or its part near the contact prior, is divided into equal intervals; the standard deviation along the whisker is
    /// half an interval. The deflection follows from the reading, with the reading's uncertainty, so no position along
    /// the whisker is favoured before it is known how the reading grows.
    pub(super) fn beliefs(
        self,
        side: &Side,
        reading_n_m: f64,
        contact_prior: Option<ContactPrior>,
    ) -> Vec<(Gaussian<2>, f64)> {
        let count = match self {
            Self::Single => 1,
            Self::Hypotheses { count } => count,
        };
        let (mut low_m, mut high_m) = side.face.modelled.arc_range_m();
        let contact_prior = contact_prior.map(|contact_prior| {
            (side.face.along_and_away(contact_prior.contact).along_m.clamp(low_m, high_m), contact_prior.sd_m)
        });
        if let Some((arc_m, sd_m)) = contact_prior {
            low_m = low_m.max(arc_m - PRIOR_REACH_SDS * sd_m);
            high_m = high_m.min(arc_m + PRIOR_REACH_SDS * sd_m);
        }
        let stretch_m = (high_m - low_m) / count as f64;
        (0..count)
            .map(|i| {
                let arc_m = low_m + (i as f64 + 0.5) * stretch_m;
                let log_weight = contact_prior.map_or(0.0, |(prior_m, sd_m)| -0.5 * ((arc_m - prior_m) / sd_m).powi(2));
                (pushed(side, arc_m, 0.5 * stretch_m, reading_n_m), log_weight)
            })
            .collect()
    }
}

/// The belief that the contact lies about `arc_m`, with the deflection at which it reads `reading_n_m`.
fn pushed(side: &Side, arc_m: f64, sd_m: f64, reading_n_m: f64) -> Gaussian<2> {
    let (lowest_m, highest_m) = side.face.modelled.away_range_m(arc_m);
    let mut away_m = 0.0;
    for _ in 0..NEWTON_STEPS {
        let (expected_n_m, slope) = side.expect(AlongAway::new(arc_m, away_m));
        away_m = (away_m + (reading_n_m - expected_n_m) / slope[1]).clamp(lowest_m, highest_m);
    }
    let (_, slope) = side.expect(AlongAway::new(arc_m, away_m));
    // Along a line of equal reading, and across it.
    let along = vector![1.0, -slope[0] / slope[1]] * sd_m;
    let mut covariance: Matrix2<f64> = along * along.transpose();
    covariance[(1, 1)] += side.variance_n2_m2(AlongAway::new(arc_m, away_m)) / slope[1].powi(2);
    Gaussian::new(vector![arc_m, away_m], covariance)
}

/// Largest rotation of the base among the samples before a touch that are averaged.
const MOST_TURN_RAD: f64 = 5e-3;

/// Mean of consecutive samples before a touch, between which the base hardly moved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Earlier {
    /// Mean reading, with the mean motion from now back to it.
    pub(super) sample: Sample,
    /// Number of samples.
    pub(super) count: f64,
    /// Motion from now back to the latest of them.
    latest: Pose<Base, Base>,
}

impl Earlier {
    /// Includes a sample before these, unless the base moved by `way_m` or more in between. Returns whether it was
    /// included.
    fn joins(&mut self, before: &Sample, way_m: f64) -> bool {
        let moved_m = before.motion.origin().distance(&self.latest.origin());
        let turn_rad = (before.motion.yaw_rad() - self.latest.yaw_rad()).abs();
        if moved_m >= way_m || turn_rad > MOST_TURN_RAD {
            return false;
        }
        let (mean, share) = (&mut self.sample, 1.0 / (self.count + 1.0));
        let origin = mean.motion.origin().vector().lerp(&before.motion.origin().vector(), share);
        let yaw_rad = mean.motion.yaw_rad() + share * (before.motion.yaw_rad() - mean.motion.yaw_rad());
        mean.motion = Pose::new(origin.x, origin.y, yaw_rad);
        mean.reading_n_m += share * (before.reading_n_m - mean.reading_n_m);
        self.count += 1.0;
        true
    }
}

/// The samples before a touch that belong to its onset, averaged over ways of the base below `way_m`, the latest first.
///
/// `history` holds the samples since the whisker was last known to be free, in the order of time; `touch` is the first
/// of the touch. A reading of the opposite sign, or a larger one, belongs to an oscillating whisker; it and the samples
/// before it are left out.
pub(super) fn earlier(history: &[Sample], touch: &Sample, noise_sd_n_m: f64, way_m: f64) -> Vec<Earlier> {
    const SWING_SDS: f64 = 4.0;
    let sign = touch.reading_n_m.signum();
    let mut back: Pose<Base, Base> = touch.motion.inverse();
    let mut least_n_m = sign * touch.reading_n_m;
    let mut found: Vec<Earlier> = Vec::new();
    for sample in history.iter().rev() {
        let reading_n_m = sign * sample.reading_n_m;
        let allowed_n_m = SWING_SDS * noise_sd_n_m;
        if reading_n_m < -allowed_n_m || reading_n_m > least_n_m + allowed_n_m {
            break;
        }
        least_n_m = least_n_m.min(reading_n_m);
        let before = Sample { motion: back, dt_s: 0.0, reading_n_m: sample.reading_n_m };
        if !found.last_mut().is_some_and(|last| last.joins(&before, way_m)) {
            found.push(Earlier { sample: before, count: 1.0, latest: back });
        }
        back = back.then(&sample.motion.inverse());
    }
    found
}

/// Standard deviations of the distance from the whisker beyond which a contact is certain not to touch.
const FREE_SDS: f64 = 5.0;

/// Whether the whisker was certainly free at the instant back to which a process leads.
pub(super) fn is_free<const N: usize>(back: &impl Process<N>, belief: &Gaussian<N>) -> bool {
    let (then, jacobian, _) = back.linearised(&belief.mean);
    let slope = jacobian.row(1);
    let variance_m2 = (slope * belief.covariance * slope.transpose())[0];
    then[1] < -FREE_SDS * variance_m2.max(0.0).sqrt()
}

/// A reading taken before the present instant, of a whisker that may not have touched yet; without contact it reads
/// zero.
pub(super) struct EarlierReading<'a, Step> {
    /// The process from the present back to that instant.
    pub(super) back: Step,
    pub(super) reading: ContactReading<'a>,
}

impl<Step> EarlierReading<'_, Step> {
    /// The expected reading at the state then.
    fn expect<const N: usize>(&self, then: &SVector<f64, N>) -> Option<Vector1<f64>> {
        if is_touching(then) { self.reading.predict(then) } else { Some(Vector1::zeros()) }
    }
}

fn is_touching<const N: usize>(then: &SVector<f64, N>) -> bool {
    then[1] > 0.0
}

/// The way back is solved once per evaluation.
impl<const N: usize, Step: Process<N>> Measurement<N, 1> for EarlierReading<'_, Step> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector1<f64>> {
        self.expect(&self.back.predict(x))
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 1, N>> {
        Some(self.linearised(x)?.1)
    }

    fn noise(&self, x: &SVector<f64, N>) -> Matrix1<f64> {
        self.reading.noise(&self.back.predict(x))
    }

    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>)> {
        let (expected, jacobian, _) = self.linearised_with_noise(x)?;
        Some((expected, jacobian))
    }

    fn predict_with_noise(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, Matrix1<f64>)> {
        let then = self.back.predict(x);
        Some((self.expect(&then)?, self.reading.noise(&then)))
    }

    fn linearised_with_noise(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>, Matrix1<f64>)> {
        let (then, transition, _) = self.back.linearised(x);
        if !is_touching(&then) {
            return Some((Vector1::zeros(), SMatrix::zeros(), self.reading.noise(&then)));
        }
        let (expected, slope, noise) = self.reading.linearised_with_noise(&then)?;
        Some((expected, slope * transition, noise))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::motion::{Motion, Round};
    use crate::estimators::testing::knowledge;

    /// The joint evaluation equals the single ones, both where the whisker touched then and where it was free.
    #[test]
    fn verif_the_joint_evaluation_of_an_earlier_reading_equals_the_single_ones() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let round = Round::of_any_scale();
        for (back_m, touches) in [(1e-4, true), (-5e-3, false)] {
            let sample = Sample { motion: Pose::new(0.0, -back_m, 1e-3), dt_s: 0.0, reading_n_m: 0.0 };
            let reading = ContactReading::new(&side, Round::INDICES).of_mean(3.0);
            let earlier = EarlierReading { back: round.step(&side, &sample), reading };
            // The change of the sensor model's error along the whisker is neglected.
            let x = SVector::from([0.055, 2e-3, 1e-3, 0.0]);
            let (expected, jacobian, noise) = earlier.linearised_with_noise(&x).unwrap();
            assert_eq!(expected[0] != 0.0, touches);
            let (predicted, predicted_noise) = earlier.predict_with_noise(&x).unwrap();
            assert!((predicted - expected).norm() < 1e-12 && (earlier.predict(&x).unwrap() - expected).norm() < 1e-12);
            assert!(
                (predicted_noise - noise).norm() < 1e-9 * noise[0]
                    && (earlier.noise(&x) - noise).norm() < 1e-9 * noise[0]
            );
            assert_eq!(earlier.jacobian(&x), Some(jacobian));
            for i in 0..4 {
                let step = if i == 3 { 1e-3 } else { 1e-6 };
                let at = |by: f64| earlier.predict(&(x + SVector::<f64, 4>::ith(i, by))).unwrap()[0];
                let slope = (at(step) - at(-step)) / (2.0 * step);
                assert!((slope - jacobian[i]).abs() <= 1e-3 * jacobian.norm(), "{i}: {slope} {jacobian}");
            }
        }
    }
}
