//! Models of the contact's motion while the base moves, one file per model. The filters of `gaussian/` and `particle.rs` choose
//! between the rows of [`MotionSettings`]; `rubbing`, `drifting`, `pushed` and `installed` are methods of their own.
//!
//! The state begins with the contact's coordinates `(s, d)`; a model may append properties of the object.

mod drifting;
mod installed;
mod pushed;
mod resting;
mod round;
mod rubbing;

pub(super) use drifting::Drifting;
pub(super) use installed::Installed;
pub(super) use pushed::Pushed;
pub(super) use resting::Resting;
pub(super) use round::Round;
pub(super) use rubbing::Rubbing;

use filters::{Gaussian, Process};
use serde::{Deserialize, Serialize};

use super::side::{Side, StateIndices};
use super::{Estimate, Sample, Touch, Tracker};
use crate::settings::SettingsError;

/// A model of the contact's motion with a state of `N` entries.
pub(super) trait Motion<const N: usize>: Copy + Send + Sync + 'static {
    /// Indices in the state of the errors of the reading.
    const INDICES: StateIndices = StateIndices { model_error: None, gain: None, friction: None };

    /// Whether the object moves.
    const OBJECT_MOVES: bool = false;

    /// Process of one step.
    type Step<'a>: Process<N>;

    /// The initial belief, from one about the contact's coordinates.
    fn belief(&self, place: &Gaussian<2>) -> Gaussian<N>;

    /// The initial belief split into parts narrow enough for a filter that linearises, with the logarithms of their
    /// weights.
    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<N>, f64)> {
        vec![(self.belief(place), 0.0)]
    }

    /// Index of the radius of object and wire together in the state. `None` if it is not estimated.
    fn radius(&self) -> Option<usize> {
        None
    }

    /// The estimate of a belief in Base, from that in the frame of the state.
    fn place(&self, _side: &Side, _belief: &Gaussian<N>, estimate: Estimate) -> Estimate {
        estimate
    }

    /// Relative increase of the expected reading after which hypotheses are split ([`Motion::departure`]). `None` if none ever is.
    fn rise(&self) -> Option<f64> {
        None
    }

    /// The belief that is split off from this one, and its share of the probability. `step` is the increase of the logarithm of the
    /// expected reading since the last split. `None` if this belief is not split.
    fn departure(&self, _side: &Side, _belief: &Gaussian<N>, _step: f64) -> Option<(Gaussian<N>, f64)> {
        None
    }

    /// The process of the step to a sample.
    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Self::Step<'a>;
}

/// Motion models for any filter, with their settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum MotionSettings {
    /// The contact rests in the world.
    Resting(Resting),
    /// The contact slides over a round object at rest.
    Round(Round),
}

impl MotionSettings {
    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        match self {
            Self::Resting(resting) => resting.validate(),
            Self::Round(round) => round.validate(),
        }
    }

    /// Begins to track a contact by a method under this model.
    pub(super) fn begin(self, method: &impl AnyMotion, touch: &Touch<'_>) -> Box<dyn Tracker> {
        match self {
            Self::Resting(motion) => method.begin_with(motion, touch),
            Self::Round(motion) => method.begin_with(motion.beyond_pin(touch.face), touch),
        }
    }
}

/// A method that tracks contacts under any motion model.
pub(super) trait AnyMotion {
    /// Begins to track a contact under the given model.
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker>;
}
