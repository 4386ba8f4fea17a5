//! A contact that slides over a sphere at rest in the world.

use filters::Gaussian;
use nalgebra::{Matrix3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::rolling::{FIRST_TILT_RAD, Object, Place, Roll, Shape, TILT, carried};
use super::{Motion, RadiusPrior, check_wander, describe_normal, describe_radius, extended};
use crate::frames::Base;
use crate::settings::SettingsError;
use crate::space::estimators::side::Side;
use crate::space::estimators::{Estimate, Sample};
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Index in the state of the logarithm of the radius.
const RADIUS: usize = 4;

/// A sphere of radius `r` at rest; the state is `(s, u, v, beta, ln rho)`, with `rho` the sum of `r` and the radius of the wire.
/// With the normal `nu` of [`super::rolling`] its centre is `p - rho nu(p)`, for every contact `p`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::space::estimators) struct Sphere {
    /// Random walk of the contact in the world along each axis, as the standard deviation after one second.
    wander_m_sqrt_s: f64,
    /// Prior of the radius of sphere and wire together.
    radius: RadiusPrior,
}

impl Default for Sphere {
    fn default() -> Self {
        Self { wander_m_sqrt_s: 3e-5, radius: RadiusPrior::ANY }
    }
}

impl Sphere {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        check_wander(self.wander_m_sqrt_s)?;
        self.radius.validate()
    }
}

impl Motion<5> for Sphere {
    type Step<'a> = Roll<'a, Self, 5>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<5>> {
        self.radius.logarithms().map(|radius| extended(place, [(0.0, FIRST_TILT_RAD), radius])).collect()
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Roll<'a, Self, 5> {
        Roll::new(*self, side, sample, unrest)
    }

    fn describe(&self, side: &Side, belief: &Gaussian<5>, estimate: &mut Estimate) {
        if let Some(place) = Place::new(side, Around::of_state(&belief.mean)) {
            describe_normal(&place, belief, estimate);
            describe_radius(side, belief, RADIUS, estimate);
        }
    }
}

/// A sphere at the present instant.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Ball {
    center: Vector3<f64>,
    /// Radius of sphere and wire together.
    radius_m: f64,
    tilt_rad: f64,
}

impl Object for Ball {
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self {
        Self { center: carried(self.center, motion), tilt_rad, ..*self }
    }
}

impl Shape<5> for Sphere {
    type Object = Ball;

    fn object(&self, x: &SVector<f64, 5>, place: &Place) -> Ball {
        let radius_m = x[RADIUS].exp();
        Ball { center: place.contact - place.axes(x[TILT]).normal * radius_m, radius_m, tilt_rad: 0.0 }
    }

    fn residual(&self, ball: &Ball, place: &Place) -> Vector3<f64> {
        ball.center - place.contact + place.axes(ball.tilt_rad).normal * ball.radius_m
    }

    fn equations(&self, ball: &Ball, place: &Place) -> (Vector3<f64>, Matrix3<f64>) {
        let Ball { radius_m, tilt_rad, .. } = *ball;
        (self.residual(ball, place), place.normal_slopes(tilt_rad) * radius_m - place.slopes)
    }

    fn state(&self, ball: &Ball, place: &Place, before: &SVector<f64, 5>) -> SVector<f64, 5> {
        let [s, u, v] = place.at.vector().into();
        [s, u, v, ball.tilt_rad, before[RADIUS]].into()
    }

    fn prior(&self, _: &SVector<f64, 5>) -> (SVector<f64, 5>, SVector<f64, 5>) {
        let (radius, radius_sd) = self.radius.logarithm();
        ([0.0, 0.0, 0.0, 0.0, radius].into(), [1.0, 1.0, 1.0, 1.0, radius_sd].into())
    }

    fn variances(&self, dt_s: f64) -> SVector<f64, 5> {
        let wander_m2 = self.wander_m_sqrt_s.powi(2) * dt_s;
        [wander_m2, wander_m2, wander_m2, 0.0, 0.0].into()
    }
}
