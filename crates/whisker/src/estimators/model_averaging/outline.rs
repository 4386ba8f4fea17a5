//! Outline of the object: that of the most probable candidate that has one.

use filters::product;

use super::AveragingTracker;
use crate::estimators::{OutlinePoint, Tracker};

/// Smallest probability, relative to that of the leading candidate, at which a candidate's outline is used. Where `ignored_share`
/// is smaller, it takes its place.
const CARRYING_SHARE: f64 = 1e-6;

impl AveragingTracker {
    /// Outline of the leading candidate or, if it has none, of the most probable candidate that has one and whose relative
    /// probability is at least [`CARRYING_SHARE`]. The band of an outline that does not lead contains the variance of the mixture
    /// across it.
    pub(super) fn mixture_outline(&self) -> Option<Vec<OutlinePoint>> {
        let ranked = self.ranked();
        let most = ranked.first()?.0;
        let least = most * self.config.ignored_share.min(CARRYING_SHARE);
        let counting = ranked.iter().filter(|(share, _)| *share >= least);
        let points = counting.into_iter().find_map(|(_, tracker)| tracker.outline())?;
        Some(if self.mixture_outline_leads() { points } else { self.widened(points) })
    }

    /// A refuted outline does not lead: since the refutation it is that of the last place alone, whereas the contacts are those of
    /// all.
    pub(super) fn mixture_outline_leads(&self) -> bool {
        let leads = |tracker: &dyn Tracker| tracker.outline().is_some() && tracker.outline_leads();
        self.ranked().first().is_some_and(|(_, tracker)| leads(*tracker) && !tracker.refutes_convexity())
    }

    /// The candidates that may determine the contact, with their probabilities, the most probable first.
    fn ranked(&self) -> Vec<(f64, &dyn Tracker)> {
        let trackers = self.trackers.iter().map(|tracker| tracker.as_ref());
        let candidates = self.right.probabilities().iter().copied().zip(trackers).zip(&self.considered);
        let may_lead = |considered: &bool| !considered || self.config.may_considered_lead();
        let mut ranked: Vec<_> =
            candidates.filter(|(_, considered)| may_lead(considered)).map(|(ranked, _)| ranked).collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        ranked
    }

    /// Points of an outline with the last stated variance across it, at the point nearest to the contact, in their covariances.
    fn widened(&self, points: Vec<OutlinePoint>) -> Vec<OutlinePoint> {
        let Some((contact, covariance_m2)) = self.last else { return points };
        let distance_m = |point: &OutlinePoint| point.surface.distance(&contact);
        let nearest = points.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        let across_m2 = nearest.map_or(0.0, |point| point.normal.dot(&product(&covariance_m2, &point.normal)));
        let widen = |point: OutlinePoint| OutlinePoint {
            covariance_m2: point.covariance_m2 + point.normal * point.normal.transpose() * across_m2,
            ..point
        };
        points.into_iter().map(widen).collect()
    }
}
