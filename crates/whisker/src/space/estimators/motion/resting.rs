//! A contact at rest in the world.

use filters::{Gaussian, Process};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::{Motion, check_wander};
use crate::frames::Base;
use crate::settings::SettingsError;
use crate::space::estimators::Sample;
use crate::space::estimators::side::Side;
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// A contact at rest in the world, seen from the moving base, with a random walk. The state is `(s, u, v)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::space::estimators) struct Resting {
    /// Random walk of the contact in the world along each axis, as the standard deviation after one second.
    pub(super) wander_m_sqrt_s: f64,
}

impl Default for Resting {
    fn default() -> Self {
        Self { wander_m_sqrt_s: 1e-4 }
    }
}

impl Resting {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        check_wander(self.wander_m_sqrt_s)
    }
}

/// Process of one step.
pub(in crate::space::estimators) struct Rest<'a> {
    side: &'a Side,
    motion: Pose<Base, Base>,
    wander_m2: f64,
}

impl Motion<3> for Resting {
    type Step<'a> = Rest<'a>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<3>> {
        vec![*place]
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, _: &Matrix3<f64>) -> Rest<'a> {
        Rest { side, motion: sample.motion, wander_m2: self.wander_m_sqrt_s.powi(2) * sample.dt_s }
    }
}

impl Process<3> for Rest<'_> {
    fn predict(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let axis = self.side.axis();
        Around::of(axis, self.motion.apply(Around::of_state(x).contact(axis))).vector()
    }

    fn jacobian(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        self.linearised(x).1
    }

    fn linearised(&self, x: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>, Matrix3<f64>) {
        let axis = self.side.axis();
        let (contact, before) = Around::of_state(x).contact_with_jacobian(axis);
        let moved = Around::of(axis, self.motion.apply(contact));
        // The inverse fails only at the whisker's centre of curvature; a contact there does not determine its position along
        // the whisker.
        let after = moved.contact_with_jacobian(axis).1.try_inverse().unwrap_or_default();
        (moved.vector(), after * self.motion.rotation() * before, self.noise(x))
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::identity() * self.wander_m2
    }
}
