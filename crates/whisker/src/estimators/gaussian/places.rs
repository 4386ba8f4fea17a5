//! Other places on the object: contacts that jump, and contacts that return to a place they have left.

use filters::{Bank, Gaussian, Innovation, robust};
use nalgebra::{Matrix2, SVector, Vector1, Vector2};

use super::{Follower, GaussianFilter};
use crate::estimators::Sample;
use crate::estimators::motion::Motion;
use crate::estimators::side::ContactReading;
use crate::frames::{Base, Point};
use crate::odds::Odds;
use crate::regained::Regained;
use crate::sensor::AlongAway;

/// A place that the contact has left.
pub(super) struct Left<const N: usize> {
    /// Belief of a contact there at the present pose of the base.
    belief: Gaussian<N>,
    /// Odds that the contact has returned.
    pub(super) odds: Odds,
}

/// Largest number of places that are remembered.
pub(super) const MOST_LEFT: usize = 4;

/// Largest standard deviation along the whisker of a place that is remembered.
const LEFT_SD_M: f64 = 1e-3;

/// Distance below which two places are the same.
const SAME_PLACE_M: f64 = 1e-3;

/// Standard deviations of a place to which the contact has returned, along the whisker and away from it.
const RETURNED_ALONG_SD_M: f64 = 1e-3;
const RETURNED_AWAY_SD_M: f64 = 0.2e-3;

/// Probability of a place to which the contact may have returned.
const RETURN_SHARE: f64 = 0.5;

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Follower<Filter, Model, N> {
    /// Propagates the places that the contact has left to a sample.
    pub(super) fn carry_left(&mut self, sample: &Sample) {
        if self.left.is_empty() {
            return;
        }
        let (process, filter) = (self.motion.step(&self.side, sample), &self.config.filter);
        self.left.retain_mut(|left| filter.predict(&mut left.belief, &process).is_ok() && left.belief.is_finite());
    }

    /// Adds hypotheses at the place to which the contact may have returned, conditioned on the sample's reading.
    pub(super) fn return_to(
        &self,
        place: Option<Point<Base>>,
        bank: &mut Bank<N>,
        sample: &Sample,
        reading: &ContactReading<'_>,
    ) {
        let Some(place) = place else { return };
        let mean = self.side.face.along_and_away(place).vector();
        let variances_m2 = Vector2::new(RETURNED_ALONG_SD_M, RETURNED_AWAY_SD_M).map(|sd_m| sd_m.powi(2));
        let place = Gaussian { mean, covariance: Matrix2::from_diagonal(&variances_m2) };
        let conditioned = |(there, log_weight)| {
            let (there, found) = self.conditioned(there, reading, sample.reading_n_m)?;
            Some((there, log_weight + self.log_evidence(&found)))
        };
        let parts: Vec<_> = self.motion.parts(&place).into_iter().filter_map(conditioned).collect();
        if !parts.is_empty() {
            bank.add(parts, RETURN_SHARE);
        }
    }

    /// Adds remembered places to which a return is more probable than none. The likelihood of a reading for a contact at the place,
    /// divided by that of the bank, is raised to `evidence_power`. The innovations of the bank alone detect a return late: where
    /// the base goes back the way that it came, the bank explains the readings by a displaced contact.
    pub(super) fn go_back(
        &self,
        left: &mut [Left<N>],
        bank: &mut Bank<N>,
        sample: &Sample,
        reading: &ContactReading<'_>,
        innovation: Option<Innovation<1>>,
    ) {
        let Some(found) = innovation.filter(|_| self.jumps) else { return };
        let Some(most) = bank.most_probable().map(|most| most.belief) else { return };
        let of_bank = self.log_evidence(&found);
        for Left { belief, odds } in left {
            let conditioned = self.conditioned(*belief, reading, sample.reading_n_m);
            let Some((there, found)) = conditioned.filter(|_| !is_same_place(&belief.mean, &most.mean)) else {
                *odds = Odds::default();
                continue;
            };
            odds.advance(self.config.return_rate * sample.dt_s, (self.log_evidence(&found) - of_bank).exp());
            if odds.are_favourable() {
                bank.add([(there, 0.0)], RETURN_SHARE);
                *odds = Odds::default();
            }
        }
    }

    /// Whether the innovations are larger than stated, so that hypotheses at other places are due. If the contact may then have
    /// slipped off the tip, no other place is searched until the next touch.
    pub(super) fn must_search(&mut self, bank: &Bank<N>, sample: &Sample, innovation: Option<Innovation<1>>) -> bool {
        let Some(Innovation { nis, .. }) = innovation.filter(|_| self.config.search.is_on()) else { return false };
        if !self.doubt.next(&self.config.search, sample.dt_s, nis.min(self.config.gate_sds.powi(2))) {
            return false;
        }
        let Some(belief) = bank.moments_above(self.config.ignored_share) else { return false };
        self.is_lost |= self.may_have_slipped_off(&belief);
        self.regained = Regained::default();
        !self.is_lost
    }

    /// Remembers the place of the contact from before the readings contradicted it, if it was known.
    pub(super) fn leave(&mut self) {
        let Some(kept) = self.settled.as_ref().filter(|_| self.config.return_rate > 0.0) else { return };
        let Some(most) = kept.bank.most_probable() else { return };
        let mut belief = most.belief;
        if most.weight() < 0.5 || belief.covariance[(0, 0)] > LEFT_SD_M.powi(2) {
            return;
        }
        let process = self.motion.step(&self.side, &self.since(kept));
        if self.config.filter.predict(&mut belief, &process).is_err() {
            return;
        }
        self.left.retain(|left| !is_same_place(&left.belief.mean, &belief.mean));
        if self.left.len() == MOST_LEFT {
            self.left.remove(0);
        }
        self.left.push(Left { belief, odds: Odds::default() });
    }

    /// Hypotheses for a contact that has jumped to another place of the object, with the logarithms of their weights: at each place
    /// one with the prior of the object, that of a thin one such as a corner, and one for which everything but the place is as
    /// believed.
    pub(super) fn elsewhere(&self, sample: &Sample, belief: &Gaussian<N>) -> Vec<(Gaussian<N>, f64)> {
        let places = self.config.start.coarser().beliefs(&self.side, sample.reading_n_m, None);
        let parts = |(place, log_weight): &(Gaussian<2>, f64)| {
            [self.motion.belief(place), moved_to(belief, place)].map(|part| (part, *log_weight))
        };
        places.iter().flat_map(parts).collect()
    }

    /// The belief conditioned on a reading, with its innovation. `None` without a valid update.
    fn conditioned(
        &self,
        mut belief: Gaussian<N>,
        reading: &ContactReading<'_>,
        z_n_m: f64,
    ) -> Option<(Gaussian<N>, Innovation<1>)> {
        let found = self.config.filter.update(&mut belief, reading, &Vector1::new(z_n_m)).ok()?;
        self.side.hold(&mut belief.mean);
        belief.is_finite().then_some((belief, found))
    }

    /// Evidence of an innovation for a hypothesis, bounded at the gate.
    fn log_evidence(&self, found: &Innovation<1>) -> f64 {
        self.config.evidence_power * robust::log_likelihood(found, self.config.gate_sds)
    }
}

/// A belief of which the contact is at another place.
fn moved_to<const N: usize>(belief: &Gaussian<N>, place: &Gaussian<2>) -> Gaussian<N> {
    let Gaussian { mut mean, mut covariance } = *belief;
    mean.fixed_rows_mut::<2>(0).copy_from(&place.mean);
    covariance.fixed_rows_mut::<2>(0).fill(0.0);
    covariance.fixed_columns_mut::<2>(0).fill(0.0);
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&place.covariance);
    Gaussian::new(mean, covariance)
}

/// Whether two states have their contacts at the same place.
pub(super) fn is_same_place<const N: usize>(one: &SVector<f64, N>, other: &SVector<f64, N>) -> bool {
    AlongAway::of_state(one).vector().metric_distance(&AlongAway::of_state(other).vector()) < SAME_PLACE_M
}

#[cfg(test)]
mod tests {
    use nalgebra::SMatrix;

    use super::*;

    #[test]
    fn verif_a_contact_elsewhere_is_one_of_the_same_object_and_sensor() {
        let covariance = SMatrix::<f64, 4, 4>::from_fn(|i, j| if i == j { 2.0 } else { 0.5 });
        let belief = Gaussian::new(SVector::from([0.05, 1e-3, 4e-3, 0.7]), covariance);
        let place = Gaussian::new(Vector2::new(0.03, 2e-3), Matrix2::new(3.0, 0.1, 0.1, 4.0));
        let moved = moved_to(&belief, &place);
        assert_eq!(moved.mean, SVector::from([0.03, 2e-3, 4e-3, 0.7]));
        assert_eq!(moved.covariance.fixed_view::<2, 2>(0, 0), place.covariance);
        assert_eq!(moved.covariance.fixed_view::<2, 2>(2, 2), covariance.fixed_view::<2, 2>(2, 2));
        assert_eq!(moved.covariance.fixed_view::<2, 2>(0, 2), Matrix2::zeros());
        assert_eq!(moved.covariance.fixed_view::<2, 2>(2, 0), Matrix2::zeros());
    }
}
