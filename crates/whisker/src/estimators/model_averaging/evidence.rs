//! Probabilities of the candidates, from the likelihoods of their innovations; the probabilities of motion and of friction that
//! follow from them; and the signal that the object moves.

use filters::imm::Transition;
use filters::{Innovation, robust};

use super::AveragingTracker;
use crate::estimators::{Estimate, Sample, Tracker};
use crate::frames::{Base, Point};

/// Smallest factor of the innovation covariances in the evidence, so that after nearly exact readings one of ordinary size does not
/// decide between candidates.
const LEAST_FACTOR: f64 = 0.05;

/// Probability of a moving object, without the considered candidates, above which the object probably moves: the places that were
/// touched are forgotten, and at a new touch the candidates for an object at rest begin anew.
const LIKELY_MOVING_SHARE: f64 = 0.9;

/// Probability of a moving object at or below which it probably rests again. At a new touch the probabilities are the means of
/// those at the release and the priors, so that an object which certainly moved has one of about a half.
const LIKELY_RESTING_SHARE: f64 = 0.25;

/// Whether the object probably moves, at the probability `share` of a moving object. The threshold is lower if it probably moved
/// before.
pub(super) fn probably_moves(moved: bool, share: f64) -> bool {
    share > if moved { LIKELY_RESTING_SHARE } else { LIKELY_MOVING_SHARE }
}

/// Probability of a moving object, without the considered candidates, above which the models of objects at rest are in doubt. A
/// contact that jumps from corner to corner of an object at rest makes a moving object probable for an instant. Chosen on training
/// suites.
const MOVING_SHARE: f64 = 1.0 - 1e-6;

/// Probability of a moving object at or below which this doubt ends.
const NO_LONGER_MOVING_SHARE: f64 = 0.9;

/// Whether the signal that the object moves is raised at the probability `share` of a moving object. The threshold is lower if it
/// was raised before.
pub(super) fn signals_motion(was_raised: bool, share: f64) -> bool {
    share > if was_raised { NO_LONGER_MOVING_SHARE } else { MOVING_SHARE }
}

impl AveragingTracker {
    /// Updates the candidates' probabilities and returns the innovation of the mixture.
    pub(super) fn weigh(
        &mut self,
        sample: &Sample,
        count: f64,
        estimates: &[Option<Estimate>],
    ) -> Option<Innovation<1>> {
        let sojourns_s = vec![self.config.sojourn_s; self.methods.len()];
        self.right.predict(&Transition::from_sojourns(sample.dt_s, &sojourns_s, &self.weights));
        let innovations: Vec<_> = estimates.iter().map(|estimate| estimate.as_ref()?.innovation).collect();
        let known = innovations.iter().zip(self.right.probabilities());
        let innovation = Innovation::of_mixture(known.filter_map(|(found, share)| Some(((*found)?, *share))))?;
        let mut evidence: Vec<_> = innovations.iter().map(|found| Some(self.log_evidence(found.as_ref()?))).collect();
        if !self.shows_motion(estimates) {
            let of_moving = evidence.iter_mut().zip(&self.trackers).filter(|(_, tracker)| tracker.assumes_motion());
            of_moving.for_each(|(evidence, _)| *evidence = None);
        }
        let evidence = self.discounted(&self.tempered(&evidence), count);
        self.right.reweight(&self.completed(&evidence))?;
        Some(innovation)
    }

    /// Logarithm of the likelihood of a candidate's innovation, bounded by the gate. Its covariance is multiplied by the running
    /// mean of the mixture's normalised innovations squared, if that is below 1.
    pub(super) fn log_evidence(&self, innovation: &Innovation<1>) -> f64 {
        robust::log_likelihood(&innovation.scaled(self.noise_factor()), self.config.gate_sds)
    }

    /// Factor of the covariances of innovations in the evidence.
    pub(super) fn noise_factor(&self) -> f64 {
        self.doubtful.mean_nis().clamp(LEAST_FACTOR, 1.0)
    }

    /// The evidence with its powers: within the group of a candidate, considered or not, and that of the group as a whole.
    pub(super) fn tempered(&self, evidence: &[Option<f64>]) -> Vec<Option<f64>> {
        let largest = evidence.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        // Logarithm of the mean likelihood of a group with a power.
        let of_group = |considered: bool, power: f64| {
            let members = || self.considered.iter().zip(self.right.probabilities().iter().zip(evidence));
            let (mut share, mut likelihood) = (0.0, 0.0);
            for (_, (probability, log)) in members().filter(|(is_considered, _)| **is_considered == considered) {
                let Some(log) = log else { continue };
                share += probability;
                likelihood += probability * (power * (log - largest)).exp();
            }
            if likelihood > 0.0 { (likelihood / share).ln() } else { 0.0 }
        };
        let of_groups = [false, true].map(|considered| {
            self.config.considered_power * of_group(considered, 1.0) - of_group(considered, self.config.evidence_power)
        });
        let of_candidate = |(log, considered): (&Option<f64>, &bool)| {
            Some(self.config.evidence_power * ((*log)? - largest) + of_groups[usize::from(*considered)])
        };
        evidence.iter().zip(&self.considered).map(of_candidate).collect()
    }

    /// Evidence of all candidates. One without has the mean likelihood of the others, weighted by their probabilities, so that its
    /// own probability does not change.
    pub(super) fn completed(&self, evidence: &[Option<f64>]) -> Vec<Option<f64>> {
        let mean = self.mean_evidence(evidence);
        evidence.iter().map(|log| Some(log.unwrap_or(mean))).collect()
    }

    /// Logarithm of the mean likelihood of the candidates that have one, weighted by their probabilities.
    fn mean_evidence(&self, evidence: &[Option<f64>]) -> f64 {
        let known =
            || evidence.iter().zip(self.right.probabilities()).filter_map(|(log, share)| Some(((*log)?, *share)));
        let largest = known().map(|(log, _)| log).fold(f64::NEG_INFINITY, f64::max);
        let (likelihood, total) = known().fold((0.0, 0.0), |(likelihood, total), (log, share)| {
            (likelihood + share * (log - largest).exp(), total + share)
        });
        if likelihood > 0.0 { largest + (likelihood / total).ln() } else { largest }
    }

    /// The evidence with that of moving objects, relative to the mean of all, multiplied by the noise's share of the variance of
    /// the mean of `count` readings. The rest is the sensor model's error. It recurs at the same place and varies slowly along the
    /// whisker, as the effect of a motion does, so that many readings with it count as one.
    fn discounted(&self, evidence: &[Option<f64>], count: f64) -> Vec<Option<f64>> {
        let Some(stated) = self.stated else { return evidence.to_vec() };
        let share = self.noise_share(count, stated.contact);
        let mean = self.mean_evidence(evidence);
        let discounted = evidence.iter().zip(&self.trackers).map(|(log, tracker)| {
            let log = (*log)?;
            Some(if tracker.assumes_motion() { mean + share * (log - mean) } else { log })
        });
        discounted.collect()
    }

    /// The noise's share of the variance of the mean of `count` readings of a contact.
    pub(super) fn noise_share(&self, count: f64, contact: Point<Base>) -> f64 {
        let noise_n2_m2 = self.noise_n2_m2 / count;
        noise_n2_m2 / (noise_n2_m2 + self.face.model_variance_n2_m2(contact))
    }

    /// Whether readings can tell a moving object from one at rest: whether the more probable candidates at rest have their contacts
    /// in the calibrated domain. Where a tip slides over an object, the reading may be constant, as if the object moved along.
    pub(super) fn shows_motion(&self, estimates: &[Option<Estimate>]) -> bool {
        let known = self.trackers.iter().zip(&self.considered).zip(self.right.probabilities()).zip(estimates);
        let (mut calibrated, mut total) = (0.0, 0.0);
        for (((tracker, considered), share), estimate) in known {
            if !considered && !tracker.assumes_motion() {
                calibrated += if estimate.is_some_and(|estimate| estimate.calibrated) { *share } else { 0.0 };
                total += share;
            }
        }
        2.0 * calibrated >= total
    }

    /// Probability of a moving object, without the considered candidates.
    pub(super) fn moving_share(&self) -> f64 {
        self.deciding_share(|tracker| tracker.assumes_motion())
    }

    /// Probability of friction, without the considered candidates.
    pub(super) fn rubbing_share(&self) -> f64 {
        self.deciding_share(|tracker| tracker.assumes_friction())
    }

    /// Probability of the candidates that this is true of, without the considered ones.
    fn deciding_share(&self, is_true: impl Fn(&dyn Tracker) -> bool) -> f64 {
        let candidates = self.trackers.iter().zip(self.right.probabilities()).zip(&self.considered);
        let deciding = || candidates.clone().filter(|(_, considered)| !**considered).map(|(candidate, _)| candidate);
        let total: f64 = deciding().map(|(_, share)| share).sum();
        let known: f64 = deciding().filter(|(tracker, _)| is_true(tracker.as_ref())).map(|(_, share)| share).sum();
        if total > 0.0 { known / total } else { 0.0 }
    }
}
