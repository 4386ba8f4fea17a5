//! Readings of a fit that ended, joined to those of the fit that began anew.
//!
//! A fit begins anew where it loses the contact or where the whisker has slipped to another edge. In the former case the object may
//! have been wrong, because few readings had determined it, and the new fit may find the object that explains the readings of both.
//! When the new fit has settled, its object is therefore searched once more with all readings. If they do not contradict it, and
//! one object is more probable than two, one after the other, the readings are joined, and their evidence replaces that of the fit
//! that ended. The evidence of two objects includes that of the readings without a contact, which is small: a change of the object
//! during a touch is improbable. If the new fit begins anew before, only its own readings can be joined to those of the next one.

use super::evidence::LogEvidence;
use super::memory::Memory;
use super::readings::{Mean, Readings};
use super::search::{Evidence, START_TRIALS, Search};
use super::{CONTRADICTED, Earlier, Fitter};
use crate::space::estimators::motion::{Motion, Shape};

/// A fit that ended: its readings, in the frame of the new fit, and its evidence.
pub(super) struct Forerunner {
    readings: Readings,
    evidence: LogEvidence,
}

/// Search of the object with the readings of both fits, in progress.
pub(super) struct Joining<Body, const N: usize> {
    search: Search<Body, N>,
    means: Vec<Mean>,
    /// Logarithm of the evidence of the readings since the means were taken.
    pub(super) since: f64,
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    /// This fit as the forerunner of one that begins anew at the present pose. `None` if it has no object.
    pub(super) fn forerunner(&self) -> Option<Forerunner> {
        if !self.is_fitted() || self.earlier == Earlier::Unconfirmed {
            return None;
        }
        Some(Forerunner { readings: self.readings.seen_from(&self.start_anew()), evidence: self.log_evidence })
    }

    /// Begins to search the object of the likeliest mode with the readings of both fits, once this fit has settled and the readings
    /// do not contradict it.
    pub(super) fn begin_joining(&mut self) {
        let is_confirmed = self.is_fitted() && self.earlier != Earlier::Unconfirmed;
        let is_sure = is_confirmed && self.has_settled() && self.contradicted_s.is_none();
        let (Some(forerunner), true) = (&self.forerunner, is_sure && self.log_evidence.is_weighed()) else { return };
        // The modes are sorted by weight.
        let Some(mode) = self.modes.first() else { return };
        let means = forerunner.readings.followed_by(&self.readings).means().to_vec();
        let (models, last) = ((&self.side, &self.model), (mode.near, self.base));
        let search = Search::new(models, mode.reference, mode.prior, &mode.about.x, last, START_TRIALS, f64::INFINITY);
        self.joining = search.map(|search| Joining { search, means, since: 0.0 });
        if self.joining.is_none() {
            self.forerunner = None;
        }
    }

    /// Goes on with this search. `work` grows by the evaluations of the whisker's geometry, up to `most_work`.
    pub(super) fn join(&mut self, work: &mut usize, most_work: usize) {
        let Some(joining) = &mut self.joining else { return };
        let gate_sds = self.config.gate_sds;
        let evidence = Evidence { side: &self.side, shape: &self.model, means: &joining.means, gate_sds };
        if !joining.search.advance(&evidence, work, most_work) {
            return;
        }
        let (joining, forerunner) = (self.joining.take(), self.forerunner.take());
        let Some((Joining { search, means, since }, forerunner)) = joining.zip(forerunner) else { return };
        let Some((about, quadratic)) = search.best() else { return };
        let mode = &self.modes[0];
        let (Some(covariance), Some(of_all)) = (quadratic.covariance(), quadratic.log_evidence(&mode.prior)) else {
            return;
        };
        let count = means.len() as f64;
        let joined = self.log_evidence.joined(&forerunner.evidence, of_all + count, since);
        if quadratic.cost > CONTRADICTED * count || joined.total() < self.log_evidence.total() {
            return;
        }
        let excess = (quadratic.cost / count).max(1.0);
        self.modes.truncate(1);
        let mode = &mut self.modes[0];
        (mode.about, mode.covariance, mode.excess, mode.log_weight) = (about, covariance, excess, 0.0);
        mode.swing.change_object();
        self.readings = forerunner.readings.followed_by(&self.readings);
        self.log_evidence = joined;
        self.memory.iter_mut().for_each(Memory::join);
    }
}
