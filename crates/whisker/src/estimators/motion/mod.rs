//! How a contact moves while the base moves: one file and one row of [`MotionSettings`] a model.
//!
//! The state begins with the contact's place `(s, d)`; a model may add what it needs to know of the object.

mod cartesian;
mod resting;
mod round;

pub(super) use resting::Resting;
pub(super) use round::Round;

use filters::{Gaussian, Process};
use serde::{Deserialize, Serialize};

use super::side::Side;
use super::{Sample, Touch, Tracker};
use crate::settings::SettingsError;

/// A model of the contact's motion, with `N` numbers in its state.
pub(super) trait Motion<const N: usize>: Copy + Send + Sync + 'static {
    /// Which number of the state is the sensor model's error at the contact, in standard deviations; without one that error counts as
    /// noise.
    const MODEL_ERROR: Option<usize> = None;

    /// One step of it.
    type Step<'a>: Process<N>;

    /// The same of a state whose place stands in Cartesian coordinates of Base, as in the publication.
    type CartesianStep<'a>: Process<N>;

    /// The belief that begins with a belief about the place.
    fn belief(&self, place: &Gaussian<2>) -> Gaussian<N>;

    /// That belief in parts narrow enough for a filter that linearises, with the logarithms of their weights.
    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<N>, f64)> {
        vec![(self.belief(place), 0.0)]
    }

    /// Which number of the state is the radius of object and wire together, where the readings are to tell it.
    fn radius(&self) -> Option<usize> {
        None
    }

    /// The step that belongs to a sample.
    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Self::Step<'a>;

    /// The step that belongs to a sample in Cartesian coordinates.
    fn cartesian_step<'a>(&self, side: &'a Side, sample: &Sample) -> Self::CartesianStep<'a>;
}

/// The registry of motions: which one, and its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum MotionSettings {
    /// The contact rests in the world.
    Resting(Resting),
    /// The contact wanders over a round object at rest.
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

    /// Begins a touch by a method under this model.
    pub(super) fn begin(self, method: &impl AnyMotion, touch: &Touch<'_>) -> Box<dyn Tracker> {
        match self {
            Self::Resting(motion) => method.begin_with(motion, touch),
            Self::Round(motion) => method.begin_with(motion.beyond_pin(touch.face), touch),
        }
    }
}

/// A method that follows contacts under any model of their motion.
pub(super) trait AnyMotion {
    /// Begins at a touch under one.
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker>;
}
