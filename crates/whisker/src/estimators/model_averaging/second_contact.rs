//! Tests for a second contact: by the innovations of the mixture, and by the whisker's shape at places that were touched before.

use filters::Innovation;
use nalgebra::Matrix2;

use super::AveragingTracker;
use crate::estimators::Estimate;
use crate::estimators::second::Found;
use crate::frames::{Base, Point};

/// Probability of friction above which a change of the readings is no evidence of a second contact: friction changes them as the
/// motion reverses.
const LIKELY_RUBBING_SHARE: f64 = 0.95;

impl AveragingTracker {
    /// Advances the tests for a second contact. Returns whether the innovations raise the signal.
    pub(super) fn seek_second(
        &mut self,
        dt_s: f64,
        count: f64,
        estimates: &[Option<Estimate>],
        together: Option<&Estimate>,
    ) -> bool {
        let largest_sd_m = |covariance_m2: Matrix2<f64>| covariance_m2.symmetric_eigenvalues().max().sqrt();
        let known = together.and_then(|estimate| Some((estimate.contact, estimate.covariance_m2.map(largest_sd_m)?)));
        let known = known.filter(|(_, sd_m)| sd_m.is_finite());
        let found = together.and_then(|together| self.found(count, estimates, together));
        let is_known = known.is_some_and(|(_, sd_m)| self.is_known(sd_m));
        let is_second = self.second.advance(&self.config.second, dt_s, found, is_known);
        let place = self.returned(dt_s, known);
        let had_returned = std::mem::replace(&mut self.has_returned, place.is_some());
        if let Some(place) = place {
            if self.rubbing_share() <= LIKELY_RUBBING_SHARE {
                self.second.raise(&self.config.second);
            }
            if !had_returned {
                self.trackers.iter_mut().for_each(|tracker| tracker.expect_return(place));
            }
        }
        is_second
    }

    /// The innovations of the mean of `count` readings, for the test for a second contact at the estimate of the mixture.
    fn found(&self, count: f64, estimates: &[Option<Estimate>], together: &Estimate) -> Option<Found> {
        let known = self.trackers.iter().zip(self.right.probabilities()).zip(estimates);
        let of_moving = known.filter(|((tracker, _), _)| tracker.assumes_motion());
        let of_moving = of_moving.filter_map(|((_, share), estimate)| Some((estimate.as_ref()?.innovation?, *share)));
        Some(Found {
            mixture: together.innovation?,
            moving: Innovation::of_mixture(of_moving),
            count,
            variance_n2_m2: self.noise_n2_m2 / count + self.face.model_variance_n2_m2(together.contact),
        })
    }

    /// Whether a change of the readings at this estimate is evidence of a second contact: whether the contact is known, and neither
    /// a moving object nor friction is probable.
    fn is_known(&self, sd_m: f64) -> bool {
        sd_m <= self.config.second.known_m && !self.moves && self.rubbing_share() <= LIKELY_RUBBING_SHARE
    }

    /// A place that was touched before and on which the whisker with this contact bears.
    fn returned(&mut self, dt_s: f64, estimate: Option<(Point<Base>, f64)>) -> Option<Point<Base>> {
        let settings = Some(self.config.second).filter(|settings| settings.past_m > 0.0)?;
        let Some((contact, sd_m)) = estimate else {
            self.touched.interrupt();
            return None;
        };
        if self.moves {
            self.touched.forget();
        } else if self.second.is_raised() {
            self.touched.forget_latest();
        }
        let (past_m, place) = self.touched.advance(dt_s, &self.base, contact, sd_m)?;
        self.second.bears(&settings, past_m).then_some(place)
    }
}
