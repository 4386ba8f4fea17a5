//! Contacts at or past the tip. The model of a contact on the side does not apply there, so that these readings are left out until
//! the contact is found again.

use filters::{Gaussian, Innovation};
use nalgebra::Vector1;

use super::{Follower, GaussianFilter, residual};
use crate::estimators::Sample;
use crate::estimators::doubt::Doubt;
use crate::estimators::motion::Motion;
use crate::regained::Regained;
use crate::sensor::AlongAway;

/// Standard deviation along the whisker below which a contact counts as located, and the standard deviations within
/// which it may be at the tip.
const SETTLED_SD_M: f64 = 3e-3;
const TIP_SDS: f64 = 4.0;

/// Smallest arc length, relative to the whisker's length, from which a contact that the readings contradict has slipped off the
/// tip.
const NEAR_TIP_SHARE: f64 = 0.9;

/// Distance of a contact from the whisker's end, in its standard deviations, above which it is certain to be on the side.
const SIDE_SDS: f64 = 3.0;

/// Smallest reading of a loaded whisker, in standard deviations of noise and model error.
const LOADED_SDS: f64 = 5.0;

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Follower<Filter, Model, N> {
    /// Whether the contact has reached the tip, so that the mean reading of `count` samples is left out.
    pub(super) fn has_passed(
        &mut self,
        leading: &Gaussian<N>,
        predicted: &Gaussian<N>,
        sample: &Sample,
        count: f64,
    ) -> bool {
        let at = AlongAway::of_state(&leading.mean);
        if self.is_lost || self.is_past_tip {
            if !self.is_regained(leading, sample, count) {
                return true;
            }
            (self.is_lost, self.is_past_tip) = (false, false);
            (self.regained, self.doubt) = (Regained::default(), Doubt::default());
        }
        let length_m = self.side.face.rest.length_m();
        let mean = AlongAway::of_state(&predicted.mean);
        let (arc_m, sd_m) = (self.side.bent_arc_m(mean), predicted.covariance[(0, 0)].max(0.0).sqrt());
        if !self.side.is_tip(at) {
            self.was_on_side |= arc_m + SIDE_SDS * sd_m < length_m;
            return false;
        }
        // From here on the belief cannot follow, and a return that it predicts would be a wrong contact. After a release, without
        // deflection, the belief may drift beyond the end too.
        let is_loaded = sample.reading_n_m.abs() > LOADED_SDS * self.side.variance_n2_m2(at).sqrt();
        self.is_past_tip = self.was_on_side && is_loaded && mean.away_m > 0.0 && arc_m - TIP_SDS * sd_m >= length_m;
        self.regained = Regained::default();
        self.was_on_side
    }

    /// Whether a contact that was lost is where the belief predicts it, by the mean reading of `count` samples.
    pub(super) fn is_regained(&mut self, belief: &Gaussian<N>, sample: &Sample, count: f64) -> bool {
        let at = AlongAway::of_state(&belief.mean);
        let reading = self.reading().with_error(self.error_sd_n_m(at, 0.0)).of_mean(count);
        let is_beside = self.side.is_beside(at);
        let residual =
            is_beside.then(|| residual(&reading, &belief.mean, &belief.covariance, sample.reading_n_m)).flatten();
        let innovation =
            residual.and_then(|(residual_n_m, variance)| Innovation::of(Vector1::new(residual_n_m), variance));
        let unknown = self.side.unknown(self.noise_sd_n_m.powi(2) / count);
        self.regained.next(sample.dt_s, &Vector1::new(sample.reading_n_m), innovation.as_ref(), &unknown)
    }

    /// Whether a contact that the readings contradict may lie beyond the calibrated arc lengths near the tip (mean plus [`TIP_SDS`]
    /// standard deviations), so that it is taken to have slipped off the tip.
    pub(super) fn may_have_slipped_off(&self, belief: &Gaussian<N>) -> bool {
        let sd_m = belief.covariance[(0, 0)].max(0.0).sqrt();
        let reach_m = self.side.bent_arc_m(AlongAway::of_state(&belief.mean)) + TIP_SDS * sd_m;
        let slipping_m = self.side.face.domain.arc_range_m().1.max(NEAR_TIP_SHARE * self.side.face.rest.length_m());
        self.config.corrected && sd_m < SETTLED_SD_M && reach_m >= slipping_m
    }

    /// Whether the contact is at the tip or past it, so that there is no estimate.
    pub(in crate::estimators) fn is_at_tip(&self, belief: &Gaussian<N>) -> bool {
        self.config.corrected
            && (self.is_lost || self.is_past_tip || self.side.is_tip(AlongAway::of_state(&belief.mean)))
    }
}
