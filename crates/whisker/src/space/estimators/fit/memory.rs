//! Samples of a touch that a fit keeps to revise their estimates when the touch has ended.

use super::Fitter;
use crate::frames::{Base, Start};
use crate::space::estimators::motion::{Motion, Shape};
use crate::space::estimators::ringing::{Rates, Response};
use crate::space::estimators::{Estimate, Sample};
use crate::space::frames::Pose;

/// A sample with the pose and the acceleration of the base, and the response of the wire to the acceleration.
#[derive(Clone, Copy)]
pub(super) struct KeptSample {
    pub(super) base: Pose<Base, Start>,
    pub(super) sample: Sample,
    pub(super) acceleration: Rates,
    pub(super) response: Response,
}

/// The samples of a touch.
#[derive(Clone, Default)]
pub(super) struct Memory {
    /// Revised estimates of the samples before the fit last began anew.
    revised: Vec<Option<Estimate>>,
    /// The later samples.
    samples: Vec<KeptSample>,
    /// Samples of the fit that ended when this one began anew. Their estimates, revised by that fit, are the last of `revised`.
    handed_over: Vec<KeptSample>,
}

impl Memory {
    /// Takes the samples of the fit that ended as those of this one, whose object explains them.
    pub(super) fn join(&mut self) {
        self.revised.truncate(self.revised.len() - self.handed_over.len());
        self.samples.splice(0..0, std::mem::take(&mut self.handed_over));
    }
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    /// The present sample with its pose and response.
    pub(super) fn kept(&self, sample: &Sample) -> KeptSample {
        let (acceleration, response) = (self.ringing.acceleration(), self.ringing.response());
        KeptSample { base: self.base, sample: *sample, acceleration, response }
    }

    /// Keeps the present sample, if samples are kept.
    pub(super) fn keep(&mut self, sample: &Sample) {
        let kept = self.memory.is_some().then(|| self.kept(sample));
        self.memory.iter_mut().zip(kept).for_each(|(memory, kept)| memory.samples.push(kept));
    }

    /// Takes the kept samples for a fit that begins anew at the present pose. If the new fit has another object, that object is to
    /// explain all of them; otherwise their estimates are first revised by this fit.
    pub(super) fn handed_over(&mut self, is_another: bool) -> Option<Memory> {
        let mut memory = self.memory.take()?;
        let samples = std::mem::take(&mut memory.samples);
        let anew = self.start_anew();
        let moved = samples.iter().map(|kept| KeptSample { base: kept.base.then(&anew), ..*kept }).collect();
        if is_another {
            memory.samples = moved;
        } else {
            memory.revised.extend(self.revisited(&samples));
            memory.handed_over = moved;
        }
        Some(memory)
    }

    /// The memory of a second fit that takes the place of this one. This fit revises none of the kept samples, since the readings
    /// contradict it. The second fit revises them from its beginning backwards, up to the first sample that its object does not
    /// explain. The causal estimates of the samples before that are kept.
    pub(super) fn followed_by(&mut self, successor: &mut Self) -> Option<Memory> {
        let Memory { mut revised, mut samples, .. } = self.memory.take()?;
        let later = successor.memory.take()?;
        samples.truncate(samples.len() - later.revised.len() - later.samples.len());
        if let Some(last) = samples.last() {
            // The Base of this sample is the Start of the second fit.
            let anew: Pose<Start, Start> = last.base.inverse().then(&Pose::identity());
            samples.iter_mut().for_each(|kept| kept.base = kept.base.then(&anew));
        }
        samples.reverse();
        let is_explained = |estimate: &&Option<Estimate>| {
            let innovation = estimate.and_then(|estimate| estimate.innovation);
            innovation.is_some_and(|innovation| innovation.nis < self.config.gate_sds.powi(2))
        };
        // If the second fit has itself begun anew, its present object is not the one that was touched at these samples.
        let found = if later.revised.is_empty() { successor.revisited(&samples) } else { Vec::new() };
        let explained = found.iter().take_while(is_explained).count();
        revised.resize(revised.len() + samples.len() - explained, None);
        revised.extend(later.revised);
        samples.truncate(explained);
        samples.reverse();
        samples.extend(later.samples);
        Some(Memory { revised, samples, handed_over: Vec::new() })
    }

    /// Returns the estimates of all samples of the touch and discards the samples. `None` if there are none.
    pub(super) fn revised(&mut self) -> Option<Vec<Option<Estimate>>> {
        let memory = self.memory.as_mut()?;
        let Memory { mut revised, samples, .. } = std::mem::take(memory);
        self.successor = None;
        if revised.is_empty() && samples.is_empty() {
            return None;
        }
        // A touch that was too short for a fit leaves no object for the next one.
        if self.is_fitted() {
            self.finish();
        }
        revised.extend(self.revisited(&samples));
        Some(revised)
    }

    /// Completes the searches in progress, then those with all readings.
    fn finish(&mut self) {
        for _ in 0..2 {
            self.search(f64::INFINITY);
            while self.round.is_some() || self.joining.is_some() {
                self.search(f64::INFINITY);
            }
        }
    }
}
