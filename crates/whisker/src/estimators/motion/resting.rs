//! A contact at rest in the world.

use filters::{Gaussian, Process, product};
use nalgebra::{Matrix2, Vector2, vector};
use serde::{Deserialize, Serialize};

use super::Motion;
use crate::estimators::Sample;
use crate::estimators::settings::{SettingsError, within};
use crate::estimators::side::Side;
use crate::frames::{Base, Point, Pose};

/// A contact that rests in the world, seen from the moving base, and wanders a little. The state is its place `(s, d)`.
///
/// With the twist (v, w) of the base it moves in Base by `dp/dt = -v - w x p` (Lin et al. 2022); here the step is exact, from the pose of the
/// base's last frame in its present one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Resting {
    /// How far the contact may wander in the world, as the standard deviation after one second.
    pub wander_m_sqrt_s: f64,
}

impl Default for Resting {
    fn default() -> Self {
        Self { wander_m_sqrt_s: 1e-4 }
    }
}

impl Resting {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        // Without any wander a covariance can lose its last digits; a whisker's length in a second forgets everything at once.
        within("wander_m_sqrt_s", self.wander_m_sqrt_s, 1e-9..=0.1)
    }

    /// Variance that a step adds in each direction.
    fn wander_m2(&self, sample: &Sample) -> f64 {
        self.wander_m_sqrt_s.powi(2) * sample.dt_s
    }
}

/// One step.
pub(in crate::estimators) struct Rest<'a> {
    side: &'a Side,
    motion: Pose<Base, Base>,
    /// Variance that it adds in each direction.
    wander_m2: f64,
}

impl Motion<2> for Resting {
    type Step<'a> = Rest<'a>;
    type CartesianStep<'a> = CartesianRest;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<2> {
        *place
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Rest<'a> {
        Rest { side, motion: sample.motion, wander_m2: self.wander_m2(sample) }
    }

    fn cartesian_step(&self, _: &Side, sample: &Sample) -> CartesianRest {
        CartesianRest { motion: sample.motion, wander_m2: self.wander_m2(sample) }
    }
}

impl Rest<'_> {
    /// Where a contact is along and away one step later.
    fn moved(&self, contact: Point<Base>) -> Vector2<f64> {
        let (arc_m, away_m) = self.side.face.along_and_away(self.motion.apply(contact));
        vector![arc_m, away_m]
    }
}

impl Process<2> for Rest<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.moved(self.side.face.contact_at(x[0], x[1]))
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Matrix2<f64> {
        self.linearised(x).1
    }

    fn linearised(&self, x: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>, Matrix2<f64>) {
        let face = &self.side.face;
        let (contact, before) = face.contact_with_jacobian(x[0], x[1]);
        let moved = self.moved(contact);
        // Only in the whisker's centre of curvature there is no inverse; a contact there says nothing of where along the whisker it was.
        let after = face.contact_jacobian(moved[0], moved[1]).try_inverse().unwrap_or_default();
        (moved, product(&product(&after, &self.motion.rotation()), &before), self.noise(x))
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.wander_m2
    }

    fn constant_noise(&self) -> Option<Matrix2<f64>> {
        Some(Matrix2::identity() * self.wander_m2)
    }
}

/// One step in Cartesian coordinates: linear, whatever the whisker's shape.
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
