//! Estimate of the mixture: mean and covariance over the candidates.

use filters::{Gaussian, Innovation};
use nalgebra::{Matrix1, Matrix2, Vector1, Vector2};

use super::AveragingTracker;
use crate::candidates::LEAST_KNOWN;
use crate::estimators::{Estimate, FrictionCoefficient, Radius, Velocity};

/// A candidate's estimate in the mixture.
#[derive(Clone, Copy)]
struct Part<'a> {
    estimate: &'a Estimate,
    share: f64,
    considered: bool,
}

impl AveragingTracker {
    /// Estimate of the mixture. `None` if no candidate has an estimate.
    pub(super) fn together<'a>(
        &self,
        estimates: &'a [Option<Estimate>],
        innovation: Option<Innovation<1>>,
    ) -> Option<Estimate> {
        let shares = self.right.probabilities();
        let stated = estimates.iter().zip(shares).zip(&self.considered);
        let part = |((estimate, share), considered): ((&'a Option<Estimate>, &f64), &bool)| {
            Some(Part { estimate: estimate.as_ref()?, share: *share, considered: *considered })
        };
        let parts: Vec<Part<'_>> = stated.filter_map(part).collect();
        let most = parts.iter().map(|part| part.share).fold(0.0, f64::max);
        let parts: Vec<_> = parts.into_iter().filter(|part| part.share >= self.config.ignored_share * most).collect();
        let known: f64 = parts.iter().map(|part| part.share).sum();
        // The more probable candidates may have none because the contact is at the tip.
        if known < LEAST_KNOWN * self.present_share() {
            return None;
        }
        let leads = self.leads(&parts);
        let moving = || parts.iter().zip(&leads).map(|(part, lead)| (part, *lead)).filter(|(_, lead)| *lead > 0.0);
        let leading = moving().max_by(|a, b| a.1.total_cmp(&b.1))?.0.estimate;
        // Relative to the leading candidate's contact, so that no digits are lost to rounding if its probability is nearly
        // one.
        let offset = |part: &Part<'_>| part.estimate.contact.vector() - leading.contact.vector();
        let shift = moving().map(|(part, lead)| offset(part) * lead).sum::<Vector2<f64>>();
        let spreads = Self::spreads(&parts, &leads);
        let place = |(part, spread): (&Part<'_>, &f64)| {
            Some((Gaussian::new(offset(part), part.estimate.covariance_m2?), *spread))
        };
        let size = |(part, lead): (&Part<'_>, f64)| {
            let Radius { radius_m, sd_m } = part.estimate.radius?;
            Some((Gaussian::new(Vector1::new(radius_m), Matrix1::new(sd_m * sd_m)), lead))
        };
        let rubs = |(part, lead): (&Part<'_>, f64)| {
            let FrictionCoefficient { coefficient, sd } = part.estimate.friction?;
            Some((Gaussian::new(Vector1::new(coefficient), Matrix1::new(sd * sd)), lead))
        };
        let places: Option<Vec<_>> =
            parts.iter().zip(&spreads).filter(|(_, spread)| **spread > 0.0).map(place).collect();
        // The candidate for thin objects states no radius. If others state one, the radius is the mean over those that do.
        let size = Gaussian::of_mixture(moving().filter_map(size));
        // Likewise, the candidates without friction state no coefficient.
        let friction = Gaussian::of_mixture(moving().filter_map(rubs));
        // Velocity and deviation hold under the assumption that the object moves, or that the sensor deviates: their candidates
        // count with the probabilities among themselves.
        let velocities = parts.iter().filter_map(|part| {
            let Velocity { velocity_m_s, covariance_m2_s2 } = part.estimate.velocity?;
            Some((Gaussian::new(velocity_m_s, covariance_m2_s2), part.share))
        });
        let velocity = Gaussian::of_mixture(velocities)
            .map(|Gaussian { mean, covariance }| Velocity { velocity_m_s: mean, covariance_m2_s2: covariance });
        let deviating = parts.iter().filter(|part| part.estimate.installation.is_some());
        let installation =
            deviating.max_by(|a, b| a.share.total_cmp(&b.share)).and_then(|part| part.estimate.installation);
        let about_shift = |places: Gaussian<2>| {
            let apart = places.mean - shift;
            places.covariance + apart * apart.transpose()
        };
        let covariance_m2 = places.and_then(Gaussian::of_mixture).map(about_shift);
        Some(Estimate {
            contact: leading.contact.shifted(shift),
            covariance_m2,
            radius: size.map(|size| Radius { radius_m: size.mean[0], sd_m: size.covariance[0].sqrt() }),
            friction: friction.map(|friction| FrictionCoefficient {
                coefficient: friction.mean[0],
                sd: friction.covariance[0].sqrt(),
            }),
            velocity,
            installation,
            innovation,
            models: Some(self.shares()),
            model_doubtful: false,
            second_contact: false,
            ..*leading
        })
    }

    /// Weight of the considered candidates together in the mean: with the log-likelihood ratio `L` of them to the others, the
    /// logistic function of `mean_power L - mean_evidence`. Zero with the largest `mean_evidence`.
    pub(super) fn lead_of_considered(&self) -> f64 {
        if !self.config.may_considered_lead() {
            return 0.0;
        }
        let sum = |values: &[f64], of: bool| -> f64 {
            values.iter().zip(&self.considered).filter(|(_, is)| **is == of).map(|(value, _)| value).sum()
        };
        let [now, prior] = [self.right.probabilities(), self.weights.as_slice()]
            .map(|shares| sum(shares, true).ln() - sum(shares, false).ln());
        let evidence = (now - prior) / self.config.considered_power;
        let lead = 1.0 / (1.0 + (self.config.mean_evidence - self.config.mean_power * evidence).exp());
        if lead < self.config.ignored_share { 0.0 } else { lead }
    }

    /// Weights of the candidates in the mean; their sum is one.
    fn leads(&self, parts: &[Part<'_>]) -> Vec<f64> {
        let total = |of: bool| parts.iter().filter(|part| part.considered == of).map(|part| part.share).sum::<f64>();
        let [others, considered] = [false, true].map(total);
        let lead = match (others > 0.0, considered > 0.0) {
            (true, true) => self.lead_of_considered(),
            (false, _) => 1.0,
            (true, false) => 0.0,
        };
        let weight = |part: &Part<'_>| {
            if part.considered { lead * part.share / considered } else { (1.0 - lead) * part.share / others }
        };
        parts.iter().map(weight).collect()
    }

    /// Weights of the candidates in the covariance. What the mean leaves out because of the evidence is no uncertainty either.
    fn spreads(parts: &[Part<'_>], leads: &[f64]) -> Vec<f64> {
        let known: f64 = parts.iter().map(|part| part.share).sum();
        let considered: f64 = parts.iter().filter(|part| part.considered).map(|part| part.share).sum();
        let lead: f64 = parts.iter().zip(leads).filter(|(part, _)| part.considered).map(|(_, lead)| lead).sum();
        let spread = |part: &Part<'_>| {
            if part.considered {
                part.share / considered * lead.max(considered / known)
            } else {
                part.share / (known - considered) * (1.0 - lead).min(1.0 - considered / known)
            }
        };
        parts.iter().map(spread).collect()
    }

    /// The estimate with systematic errors in its covariance: the mean over the candidates that follow them and have an estimate.
    pub(super) fn with_systematic(&self, estimate: Estimate, estimates: &[Option<Estimate>]) -> Estimate {
        let known = self.trackers.iter().zip(self.right.probabilities()).zip(estimates);
        let (total, sum_m2) = known
            .filter(|(_, estimate)| estimate.is_some())
            .filter_map(|((tracker, share), _)| Some((share, tracker.systematic_m2()? * *share)))
            .fold((0.0, Matrix2::zeros()), |(total, sum_m2), (share, added_m2)| (total + share, sum_m2 + added_m2));
        let added_m2 = if total > 0.0 { sum_m2 / total } else { Matrix2::zeros() };
        Estimate { covariance_m2: estimate.covariance_m2.map(|covariance_m2| covariance_m2 + added_m2), ..estimate }
    }

    /// The estimate with the distance from the calibrated domain in its covariance. `None` if it is too far away.
    pub(super) fn near_the_domain(&self, estimate: Estimate) -> Option<Estimate> {
        let outside_m = self.face.nearest_calibrated(estimate.contact).distance(&estimate.contact);
        let added_m2 = Matrix2::identity() * outside_m.powi(2);
        let covariance_m2 = estimate.covariance_m2.map(|covariance| covariance + added_m2);
        (outside_m <= self.config.farthest_m).then_some(Estimate { covariance_m2, ..estimate })
    }
}
