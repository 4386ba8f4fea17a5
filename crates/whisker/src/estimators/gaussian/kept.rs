//! Banks stored during a touch, from which the next touch of the same object begins.

use filters::Bank;

use super::{Follower, GaussianFilter};
use crate::estimators::Sample;
use crate::estimators::motion::Motion;
use crate::frames::{Base, Pose, Start};

/// A bank with the pose of the base and the time to which it belongs.
#[derive(Clone)]
pub(super) struct Kept<const N: usize> {
    pub(super) bank: Bank<N>,
    pub(super) base: Pose<Base, Start>,
    pub(super) time_s: f64,
}

/// Time between two stored banks, within which a release is detected.
const SETTLING_S: f64 = 0.05;

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Follower<Filter, Model, N> {
    /// Stores the bank every [`SETTLING_S`]. Allocates at most twice per touch.
    pub(super) fn keep(&mut self) {
        let is_due = self.recent.as_ref().is_none_or(|recent| self.time_s - recent.time_s >= SETTLING_S);
        let Some(bank) = self.bank.as_ref().filter(|_| self.config.kept_share > 0.0 && is_due) else { return };
        let (base, time_s) = (self.base, self.time_s);
        let oldest = if self.recent.is_some() { self.settled.take() } else { None };
        let kept = match oldest {
            Some(Kept { bank: mut buffer, .. }) => {
                buffer.copy_from(bank);
                Kept { bank: buffer, base, time_s }
            }
            None => Kept { bank: bank.clone(), base, time_s },
        };
        if let Some(recent) = self.recent.replace(kept) {
            self.settled = Some(recent);
        }
    }

    /// The kept bank at the touch, conditioned on its reading. `None` if there is none, or none that touches.
    pub(super) fn kept_until(&self, touch: &Sample) -> Option<Bank<N>> {
        let kept = self.settled.as_ref()?;
        let mut bank = kept.bank.clone();
        self.predict(&mut bank, &self.since(kept));
        self.condition(&mut bank, &self.reading(), touch.reading_n_m).ok()?;
        (!bank.hypotheses().is_empty()).then_some(bank)
    }

    /// Motion and time since a bank was stored, as a sample without a reading.
    pub(super) fn since(&self, kept: &Kept<N>) -> Sample {
        Sample { motion: kept.base.then(&self.base.inverse()), dt_s: self.time_s - kept.time_s, reading_n_m: 0.0 }
    }
}
