//! Estimate at the present sample, whose reading is not yet part of the fit, and at earlier ones in hindsight.

use filters::{Gaussian, Innovation};
use nalgebra::{Matrix3, SMatrix, SVector};

use super::memory::KeptSample;
use super::mode::Mode;
use super::{Earlier, Fitter, LOST_S};
use crate::doubt::DoubtSettings;
use crate::space::estimators::follower::Tracker;
use crate::space::estimators::motion::{Motion, Shape, Swing, TILT, TILT_S};
use crate::space::estimators::{Estimate, Sample};
use crate::space::sensor::Around;

/// Innovations of the modes that show that the whisker has slipped to another edge, so that the object is given up.
const SLIPPED: DoubtSettings = DoubtSettings { window_s: 0.5, most_nis: 12.5, nis: 8.0 };

/// Power of a mode's excess by which its stated covariance grows. Birge's factor is the first power, for independent errors; those
/// of a wrong model are not independent, for example where a whisker slides over the face of a box from edge to edge, and one
/// cylinder is fitted to both edges. Chosen on random scenes in space that are not reported.
const EXCESS_POWER: i32 = 6;

/// Largest factor by which the covariance grows with the excess, unless the excess itself is larger. Chosen in the same way.
const MOST_GROWTH: f64 = 200.0;

/// The beliefs of all modes at a sample.
struct Mixture<const N: usize> {
    /// Mean and covariance. `None` if the weights vanish.
    belief: Option<Gaussian<N>>,
    /// The belief with the largest weight.
    likeliest: Gaussian<N>,
    innovation: Option<Innovation<2>>,
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    /// The estimate of the modes.
    pub(super) fn together(&mut self, sample: &Sample) -> Option<Estimate> {
        let now = self.kept(sample);
        let mut modes = std::mem::take(&mut self.modes);
        let mixture = self.mixture(&mut modes, &now, self.slipped.mean_nis());
        self.modes = modes;
        // After a gap, one failed search is not enough.
        self.lost_s = if mixture.is_none() { self.lost_s + sample.dt_s.min(0.25 * LOST_S) } else { 0.0 };
        let Some(Mixture { belief, likeliest, innovation }) = mixture else {
            // Without a contact there, the object explains no reading.
            self.count(1.0 - 0.5 * self.config.gate_sds.powi(2));
            return None;
        };
        self.slipped.advance(&SLIPPED, sample.dt_s, innovation);
        if let Some(innovation) = &innovation {
            let share = self.side.new_share(&sample.motion);
            self.count(self.evidence_of(innovation, &likeliest) * share);
        }
        self.stated(&belief?, innovation)
    }

    /// The estimate at a sample without a detected contact, if the reading shows that the whisker touches the known object.
    pub(super) fn expected(&mut self, sample: &Sample) -> Option<Estimate> {
        if !self.is_determined() {
            return None;
        }
        self.carry();
        let now = self.kept(sample);
        let mut modes = std::mem::take(&mut self.modes);
        let mixture = self.mixture(&mut modes, &now, 0.0);
        self.modes = modes;
        let innovation = mixture.as_ref().and_then(|mixture| mixture.innovation);
        if !self.regained.next(sample.dt_s, &sample.reading_n_m, innovation.as_ref(), &self.side.unknown()) {
            self.calm();
            return None;
        }
        let estimate = self.stated(&mixture?.belief?, None)?;
        Some(Estimate { model_doubtful: Some(self.is_contradicted()), ..estimate })
    }

    /// The estimates at the samples of this touch by the present modes, which all readings determine. All are `None` if the object
    /// is not known.
    pub(super) fn revisited(&self, samples: &[KeptSample]) -> Vec<Option<Estimate>> {
        let Some(first) = samples.first().filter(|_| self.is_fitted() && self.earlier != Earlier::Unconfirmed) else {
            return vec![None; samples.len()];
        };
        // The contact at the first sample is sought from where a contact at rest would have been.
        let (axis, motion) = (self.side.axis(), self.base.then(&first.base.inverse()));
        let at_first = |mode: &Mode<Model::Object, N>| {
            let near = Around::of(axis, motion.apply(mode.near.contact(axis)));
            Mode { near, tilt: (0.0, 0.0), swing: Swing::default(), ..*mode }
        };
        let mut modes: Vec<_> = self.modes.iter().map(at_first).collect();
        let model_doubtful = Some(self.is_contradicted());
        let estimate = |kept: &KeptSample| {
            // The fit includes the readings, so that their mean innovation does not measure its error.
            let Mixture { belief, innovation, .. } = self.mixture(&mut modes, kept, 0.0)?;
            Some(Estimate { model_doubtful, ..self.stated(&belief?, innovation)? })
        };
        samples.iter().map(estimate).collect()
    }

    /// The beliefs of the modes at a sample, with the recent mean of the innovations. `None` without a contact on any of their
    /// objects.
    fn mixture(&self, modes: &mut [Mode<Model::Object, N>], kept: &KeptSample, recent_nis: f64) -> Option<Mixture<N>> {
        let mut beliefs: Vec<(Gaussian<N>, Innovation<2>, f64)> = modes
            .iter_mut()
            .filter(|mode| !mode.is_new())
            .filter_map(|mode| {
                let (belief, innovation) = self.present(mode, kept, recent_nis)?;
                Some((belief, innovation, mode.log_weight.exp()))
            })
            .filter(|(belief, ..)| belief.is_finite())
            .collect();
        let (likeliest, ..) = *beliefs.iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
        for (belief, ..) in &mut beliefs {
            self.model.align_belief(belief, &likeliest.mean);
        }
        let innovation = Innovation::of_mixture(beliefs.iter().map(|(_, innovation, weight)| (*innovation, *weight)));
        let belief = Gaussian::of_mixture(beliefs.into_iter().map(|(belief, _, weight)| (belief, weight)));
        Some(Mixture { belief, likeliest, innovation })
    }

    /// The estimate of a belief.
    fn stated(&self, belief: &Gaussian<N>, innovation: Option<Innovation<2>>) -> Option<Estimate> {
        let mut estimate = self.side.estimate(belief, innovation)?;
        self.model.describe(&self.side, belief, &mut estimate);
        Some(estimate)
    }

    /// Belief about the state of a mode at a sample, and the innovation of its reading, as of one that the fit does not include.
    /// Called for consecutive samples, in either direction of time: the contact is sought from that of the sample before in the
    /// sequence.
    fn present(
        &self,
        mode: &mut Mode<Model::Object, N>,
        kept: &KeptSample,
        recent_nis: f64,
    ) -> Option<(Gaussian<N>, Innovation<2>)> {
        let (side, model) = (&self.side, &self.model);
        let KeptSample { base, sample, acceleration, response } = kept;
        let motion = mode.reference.then(&base.inverse());
        let object = mode.about.object(&motion);
        let Some(found) = mode.about.touched(side, model, (&object, &motion), mode.near, &mut 0) else {
            mode.swing = Swing::default();
            return None;
        };
        let place = found.0;
        mode.near = place.at;
        // The entries about the object hardly change from pose to pose.
        let mut slopes = SMatrix::<f64, N, N>::identity();
        let (of_contact, of_tilt, here) = mode.about.contact_slopes(model, &motion, &found);
        slopes.fixed_rows_mut::<3>(0).copy_from(&of_contact);
        slopes[(TILT, TILT)] = 0.0;
        // The readings of a contradicted object are scattered more than their covariance says (Birge, "The calculation of errors by
        // the method of least squares", Physical Review 40, 1932).
        let mut covariance = slopes * mode.covariance * slopes.transpose() * mode.excess;
        for i in 0..3 {
            covariance[(i, i)] += self.config.deviation_m.powi(2);
        }
        let mut by_tilt = SVector::<f64, N>::zeros();
        by_tilt.fixed_rows_mut::<3>(0).copy_from(&of_tilt);
        by_tilt[TILT] = 1.0;

        let contact = (&place, &found.1, &here);
        let dynamic = mode.about.dynamic_tilt(side, model, &motion, contact, response);
        mode.oscillation_rad_s = place.oscillation_rad_s(side, &of_tilt);
        let equilibrium = mode.about.equilibrium((side, model), &motion, contact, acceleration, dynamic.damped_rad);
        let damping_s = side.calibrated.whisker.whisker.damping_s;
        mode.swing.advance(&equilibrium, mode.oscillation_rad_s, damping_s, sample.dt_s);
        let dynamic = dynamic.with(&mode.swing.tilt());
        // The tilt is an Ornstein-Uhlenbeck process, of which the reading tells what the contact does not explain.
        let decay = (-sample.dt_s / TILT_S).exp();
        let variance = dynamic.sd_rad().powi(2);
        let (tilt_rad, tilt_rad2) = (decay * mode.tilt.0, variance + decay.powi(2) * (mode.tilt.1 - variance));
        let state = model.state(&object, &place, &mode.about.x) + by_tilt * dynamic.rad;
        let at = Around::of_state(&(state + by_tilt * tilt_rad));
        let expected = side.expect(at);
        let by_contact = expected.slopes;
        let by_reading = by_contact * by_tilt.fixed_rows::<3>(0);
        let of_contact: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let spread = by_contact * of_contact * by_contact.transpose()
            + by_reading * by_reading.transpose() * tilt_rad2
            + expected.covariance_n2_m2()
            + side.noise_of_mean_n2_m2(1.0);
        let innovation = Innovation::of(sample.reading_n_m - expected.reading_n_m, spread)?;
        let gain = spread.try_inverse()? * by_reading * tilt_rad2;
        let bounded = (self.config.gate_sds / innovation.nis.sqrt()).min(1.0);
        mode.tilt =
            (tilt_rad + gain.dot(&innovation.residual) * bounded, (tilt_rad2 * (1.0 - gain.dot(&by_reading))).max(0.0));
        // The growth is limited to the variance of a contact that is uniformly distributed over the calibrated part.
        let most = (side.along_sd_m().powi(2) / covariance.fixed_view::<3, 3>(0, 0).trace()).max(1.0);
        covariance *= further_factor(mode.excess, recent_nis).min(most);
        covariance += by_tilt * by_tilt.transpose() * mode.tilt.1;
        Some((Gaussian::new(state + by_tilt * mode.tilt.0, covariance), innovation))
    }

    /// Evidence of a reading: the logarithm of its likelihood, `-nis / 2 - ln det S / 2` up to a constant, relative to the expected
    /// one under the [reference covariance](super::Side::reference_n2_m2) `R`, `-1 - ln det R / 2` up to the same constant: a
    /// contact gains no evidence from a covariance that is large because it lies beyond the calibrated domain.
    fn evidence_of(&self, innovation: &Innovation<2>, belief: &Gaussian<N>) -> f64 {
        let reference = self.side.reference_n2_m2(self.side.expect(Around::of_state(&belief.mean)).model_n2_m2);
        let spread = (innovation.covariance.determinant() / reference.determinant()).ln();
        1.0 - 0.5 * innovation.nis.min(self.config.gate_sds.powi(2)) - 0.5 * spread
    }

    /// Adds the evidence of a reading.
    fn count(&mut self, evidence: f64) {
        self.log_evidence.since += evidence;
        if let Some(round) = &mut self.round {
            round.since += evidence;
        }
        if let Some(joining) = &mut self.joining {
            joining.since += evidence;
        }
    }
}

/// Factor of the stated covariance of a mode relative to that of its innovations, which contains the excess once. The recent mean
/// of the innovations includes those since the last round, which the excess does not.
fn further_factor(excess: f64, recent_nis: f64) -> f64 {
    let growth = excess.powi(EXCESS_POWER).min(MOST_GROWTH.max(excess));
    (recent_nis / excess).max(1.0) * growth / excess
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_covariance_grows_with_a_power_of_the_excess_or_with_recent_innovations() {
        for (excess, recent_nis, factor) in [
            (1.0, 0.5, 1.0),
            (1.0, 3.0, 3.0),
            (2.0, 1.0, 64.0),
            (2.0, 4.0, 128.0),
            (4.0, 2.0, 200.0),
            (256.0, 1.0, 256.0),
        ] {
            assert_eq!(excess * further_factor(excess, recent_nis), factor);
        }
    }
}
