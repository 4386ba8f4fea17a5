//! The outline smoothed at the end of a touch.

use super::recursive::Tracer;
use super::search::Effort;
use crate::estimators::{Estimate, OutlinePoint, Sample, Touch, Tracker};
use crate::frames::{Base, Pose, Start};

/// A tracer that recomputes the contacts of a touch from the outline at its end.
pub(super) struct Reviser {
    tracer: Tracer,
    /// Poses of the base at each sample of this touch.
    bases: Vec<Pose<Base, Start>>,
}

impl Reviser {
    pub(super) fn new(tracer: Tracer) -> Self {
        Self { tracer, bases: Vec::new() }
    }
}

impl Tracker for Reviser {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimate = self.tracer.step(sample);
        self.bases.push(self.tracer.base);
        estimate
    }

    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let bases = std::mem::take(&mut self.bases);
        let (side, object) = self.tracer.concluded()?;
        object.refine(side, Effort::Last);
        let state = |base: &Pose<Base, Start>| {
            let expected = object.expect(side, base, 0.0, 1.0)?;
            Some(Estimate { innovation: None, ..object.estimate(side, base, &expected) })
        };
        Some(bases.iter().map(state).collect())
    }

    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        self.bases.clear();
        self.tracer.resume(touch)
    }

    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        self.tracer.outline()
    }
}
