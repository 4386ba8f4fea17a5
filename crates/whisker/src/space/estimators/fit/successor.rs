//! A second fit, to the later readings, while the readings contradict the first one.
//!
//! Where the contact has jumped from one edge of an object to another, and the innovations did not show it at once, a single object
//! is fitted to both edges, and the readings contradict it. Two objects, one after the other, then explain the readings
//! better: a fit that begins when the readings have contradicted the first one for [`DOUBTED_S`](super::DOUBTED_S) takes its place.
//! It is not begun while another model explains the readings.

use super::{Fitter, SETTLED_S};
use crate::space::estimators::Sample;
use crate::space::estimators::motion::{Motion, Shape};

/// Difference of the logarithm of the evidence above which two objects are preferred to one. Chosen on random scenes in space that are
/// not reported.
const PREFERRED: f64 = 20.0;

/// Smallest excess of all models below which one of them explains the readings. Chosen in the same way.
const EXPLAINED: f64 = 1.2;

/// The second fit.
pub(super) struct Successor<Model: Shape<N>, const N: usize> {
    fit: Box<Fitter<Model, N>>,
    /// Evidence that the contradiction had taken away from the first fit when the second one began.
    lost: f64,
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    /// Begins or continues the second fit with the present sample, which this fit has taken. It takes the place of this one once it
    /// has settled and explains the readings better, without contradiction; but not where this fit states no contact: beyond the
    /// calibrated domain, the readings contradict the true object too.
    pub(super) fn succeed(&mut self, sample: &Sample, is_stated: bool) {
        if !self.is_fitted() || !self.is_contradicted() || self.least_excess < EXPLAINED {
            self.successor = None;
            return;
        }
        let Some(Successor { mut fit, lost }) = self.successor.take() else {
            if !is_stated {
                return;
            }
            let memory = self.memory.as_ref().map(|_| Default::default());
            let fit = Box::new(Self { memory, ..self.anew() });
            self.successor = Some(Successor { fit, lost: self.log_evidence.lost() });
            return;
        };
        fit.advance(sample);
        let has_settled = fit.is_fitted() && fit.elapsed_s > self.config.start_s + SETTLED_S;
        if is_stated && has_settled && fit.contradicted_s.is_none() && fit.explains_more_than(self) {
            fit.memory = self.followed_by(&mut fit);
            // The contradiction came from readings of the second object.
            fit.log_evidence = fit.log_evidence.forgiven(lost);
            *self = *fit;
        } else {
            self.successor = Some(Successor { fit, lost });
        }
    }

    /// Whether this fit, whose evidence includes that of `first` before it began, is preferred.
    fn explains_more_than(&self, first: &Self) -> bool {
        let both = self.log_evidence.total().zip(first.log_evidence.total());
        both.is_some_and(|(two, one)| two > one + PREFERRED)
    }
}
