//! Steps of the candidates. At the onset of a touch, some are updated late, with the means of blocks of samples.

use super::AveragingTracker;
use crate::estimators::block::Latecomers;
use crate::estimators::{Estimate, Sample, Tracker};

impl AveragingTracker {
    /// The candidates' estimates after a sample that is the mean of `count`. `None` also for those that are late.
    pub(super) fn estimates(&mut self, sample: &Sample, count: f64) -> Vec<Option<Estimate>> {
        if !std::mem::replace(&mut self.has_begun, true) {
            let estimates = self.trackers.iter_mut().map(|tracker| tracker.step_mean(sample, count)).collect();
            self.late = self.latecomers();
            return estimates;
        }
        let Some(mut late) = self.late.take() else {
            return self.trackers.iter_mut().map(|tracker| tracker.step_mean(sample, count)).collect();
        };
        let is_onset = late.wait(count);
        let (block, after) = if is_onset {
            (late.take(&self.base, sample), None)
        } else {
            let (rest, after) = late.end(&self.base, sample);
            (rest, Some(after))
        };
        let advance = |(candidate, tracker): (usize, &mut Box<dyn Tracker>)| {
            if !late.contain(candidate) {
                return tracker.step_mean(sample, count);
            }
            if let Some(block) = &block {
                tracker.step_mean(&block.sample, block.count);
            }
            tracker.step_mean(&after?, count)
        };
        let estimates = self.trackers.iter_mut().enumerate().map(advance).collect();
        self.late = Some(late).filter(|_| is_onset);
        estimates
    }

    /// The candidates that are late at the onset of a touch: those that are improbable, those that do as another one does, and
    /// those that are considered, to which the covariance of a contact that is hardly known yet owes little.
    fn latecomers(&self) -> Option<Latecomers> {
        let settings = &self.config.block;
        let does_as_another =
            |tracker: &dyn Tracker| tracker.follows_as().is_some_and(|other| self.names().any(|name| name == other));
        let candidates = self.improbable().into_iter().zip(&self.trackers);
        let is_late: Vec<_> =
            candidates.map(|(improbable, tracker)| improbable || does_as_another(&**tracker)).collect();
        let has_any = settings.samples > 1 && is_late.contains(&true) && is_late.contains(&false);
        has_any.then(|| Latecomers::new(is_late, settings, self.base, self.face.rest.length_m()))
    }

    /// Whether each candidate's probability is too small to count for the mean.
    fn improbable(&self) -> Vec<bool> {
        let shares = self.right.probabilities();
        let most = shares.iter().copied().fold(0.0, f64::max);
        let leads = self.considered.contains(&true) && self.lead_of_considered() > 0.0;
        let is_improbable = |(share, considered): (&f64, &bool)| {
            if *considered { !leads } else { *share < self.config.ignored_share * most }
        };
        shares.iter().zip(&self.considered).map(is_improbable).collect()
    }

    /// Probability of the candidates that are not late.
    pub(super) fn present_share(&self) -> f64 {
        let is_late = |candidate: usize| self.late.as_ref().is_some_and(|late| late.contain(candidate));
        self.right.probabilities().iter().enumerate().filter(|(i, _)| !is_late(*i)).map(|(_, share)| share).sum()
    }
}
