//! A second fit, to the later readings, while the readings contradict the first one.
//!
//! If the contact jumps from one edge of an object to another, and the innovations do not show it at once, a single object is
//! fitted to both edges, and the readings contradict it. Two objects, one after the other, then explain the readings better.
//! Therefore, when the readings have contradicted the first fit for [`DOUBTED_S`](super::DOUBTED_S), a second one begins, and takes
//! its place if its evidence is sufficient. There is no second fit while another model explains the readings.

use super::Fitter;
use crate::space::estimators::motion::{Motion, Shape};
use crate::space::estimators::{Estimate, Sample};

/// Difference of the logarithm of the evidence above which two objects are preferred to one. Chosen on random scenes in space that
/// are not reported.
const PREFERRED: f64 = 20.0;

/// Excess below which a model explains the readings. Chosen in the same way.
const EXPLAINED: f64 = 1.2;

/// The second fit.
pub(super) struct Successor<Model: Shape<N>, const N: usize> {
    fit: Box<Fitter<Model, N>>,
    /// Logarithm of the evidence that the first fit had lost by the contradiction when the second one began
    /// ([`LogEvidence::lost`](super::LogEvidence::lost)).
    lost: f64,
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    /// Begins the second fit after the present sample, or continues it with this sample, which this fit has already taken. The
    /// second fit takes the place of this one once it has settled, the readings do not contradict it, and its evidence is
    /// sufficient. Where this fit states no contact, neither happens: beyond the calibrated domain, the readings contradict the
    /// true object too. Returns the estimate of the fit that remains, given that of this one.
    pub(super) fn succeed(&mut self, sample: &Sample, estimate: Option<Estimate>) -> Option<Estimate> {
        if !self.is_fitted() || !self.is_contradicted() || self.least_excess < EXPLAINED {
            self.successor = None;
            return estimate;
        }
        let Some(Successor { mut fit, lost }) = self.successor.take() else {
            if estimate.is_some() {
                let memory = self.memory.as_ref().map(|_| Default::default());
                let fit = Box::new(Self { memory, forerunner: None, ..self.anew() });
                self.successor = Some(Successor { fit, lost: self.log_evidence.lost() });
            }
            return estimate;
        };
        let later = fit.advance(sample);
        let has_settled = fit.is_fitted() && fit.has_settled();
        if estimate.is_some() && has_settled && fit.contradicted_s.is_none() && fit.explains_more_than(self) {
            fit.memory = self.followed_by(&mut fit);
            // The first fit lost it to readings of the second object, which do not count against the model.
            fit.log_evidence = fit.log_evidence.with_restored(lost);
            *self = *fit;
            return later;
        }
        self.successor = Some(Successor { fit, lost });
        estimate
    }

    /// Whether this fit is preferred to `first`. Its evidence includes that of `first` until this fit began.
    fn explains_more_than(&self, first: &Self) -> bool {
        let both = self.log_evidence.total().zip(first.log_evidence.total());
        both.is_some_and(|(two, one)| two > one + PREFERRED)
    }
}
