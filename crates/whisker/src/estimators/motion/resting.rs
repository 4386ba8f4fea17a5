//! A contact at rest in the world.

use filters::{Gaussian, Process, product};
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::Motion;
use crate::estimators::Sample;
use crate::estimators::side::Side;
use crate::frames::{Base, Point, Pose};
use crate::sensor::AlongAway;
use crate::settings::{SettingsError, within};

/// A contact at rest in the world, seen from the moving base, with a random walk. The state is `(s, d)`.
///
/// With the twist (v, w) of the base it moves in Base by `dp/dt = -v - w x p` (Lin et al. 2022); here the step is
/// exact, from the pose of the base's last frame in its present one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Resting {
    /// Random walk of the contact in the world, as the standard deviation after one second.
    pub wander_m_sqrt_s: f64,
}

impl Default for Resting {
    fn default() -> Self {
        Self { wander_m_sqrt_s: 1e-4 }
    }
}

impl Resting {
    pub(in crate::estimators) fn validate(&self) -> Result<(), SettingsError> {
        // Without process noise a covariance can lose its last digits; a whisker's length per second discards all
        // memory.
        within("wander_m_sqrt_s", self.wander_m_sqrt_s, 1e-9..=0.1)
    }

    /// The process of the step to a sample, for a contact in Cartesian coordinates of Base.
    pub(in crate::estimators) fn cartesian_step(&self, sample: &Sample) -> CartesianRest {
        CartesianRest { motion: sample.motion, wander_m2: self.wander_m2(sample) }
    }

    /// Variance that a step adds in each direction.
    fn wander_m2(&self, sample: &Sample) -> f64 {
        self.wander_m_sqrt_s.powi(2) * sample.dt_s
    }
}

/// Process of one step.
pub(in crate::estimators) struct Rest<'a> {
    side: &'a Side,
    motion: Pose<Base, Base>,
    /// Variance that it adds in each direction.
    wander_m2: f64,
}

impl Motion<2> for Resting {
    type Step<'a> = Rest<'a>;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<2> {
        *place
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Rest<'a> {
        Rest { side, motion: sample.motion, wander_m2: self.wander_m2(sample) }
    }
}

impl Rest<'_> {
    /// Coordinates of a contact one step later.
    fn moved(&self, contact: Point<Base>) -> Vector2<f64> {
        self.side.face.along_and_away(self.motion.apply(contact)).vector()
    }
}

impl Process<2> for Rest<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.moved(self.side.face.contact_at(AlongAway::of_state(x)))
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Matrix2<f64> {
        self.linearised(x).1
    }

    fn linearised(&self, x: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>, Matrix2<f64>) {
        let face = &self.side.face;
        let (contact, before) = face.contact_with_jacobian(AlongAway::of_state(x));
        let moved = self.moved(contact);
        // The inverse fails only at the whisker's centre of curvature; a contact there does not determine its position
        // along the whisker.
        let after = face.contact_jacobian(AlongAway::of_state(&moved)).try_inverse().unwrap_or_default();
        (moved, product(&product(&after, &self.motion.rotation()), &before), self.noise(x))
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.wander_m2
    }

    fn constant_noise(&self) -> Option<Matrix2<f64>> {
        Some(Matrix2::identity() * self.wander_m2)
    }
}

/// Process of one step in Cartesian coordinates: linear for any shape of the whisker.
pub(in crate::estimators) struct CartesianRest {
    motion: Pose<Base, Base>,
    /// Variance that it adds in each direction.
    wander_m2: f64,
}

impl Process<2> for CartesianRest {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.motion.apply(Point::from_vector(*x)).vector()
    }

    fn jacobian(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        self.motion.rotation()
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.wander_m2
    }

    fn constant_noise(&self) -> Option<Matrix2<f64>> {
        Some(Matrix2::identity() * self.wander_m2)
    }
}
