//! A contact that friction holds at a point of an object at rest, for fits.

use filters::Gaussian;
use nalgebra::{Matrix3, SVector, Vector3};

use super::resting::Resting;
use super::rolling::{FIRST_TILT_RAD, Object, Place, Roll, Shape, carried};
use super::{Motion, describe_normal, extended};
use crate::frames::Base;
use crate::space::estimators::side::Side;
use crate::space::estimators::{Estimate, Sample};
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Standard deviation of the angle between the force and the normal of the surface, in each direction along the surface: that of a
/// uniform distribution up to the angle of friction for a coefficient of 0.5.
const LEAN_SD_RAD: f64 = 0.27;

/// A point at rest, with the settings of the filter [`Resting`]; the state is `(s, u, v, beta)`, as in [`super::rolling`]. The tilt
/// `beta` does not move the contact.
///
/// Where the contact sticks, the force lies within the cone of friction about the normal, so that the direction of the force
/// determines the normal only up to the angle of friction.
#[derive(Clone, Copy, Debug)]
pub(in crate::space::estimators) struct Stuck(pub(super) Resting);

impl Motion<4> for Stuck {
    type Step<'a> = Roll<'a, Self, 4>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<4>> {
        vec![extended(place, [(0.0, FIRST_TILT_RAD)])]
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Roll<'a, Self, 4> {
        Roll::new(*self, side, sample, unrest)
    }

    fn describe(&self, side: &Side, belief: &Gaussian<4>, estimate: &mut Estimate) {
        if let Some(place) = Place::new(side, Around::of_state(&belief.mean)) {
            describe_normal(&place, belief, estimate);
            let normal = estimate.normal;
            estimate.normal_covariance += (Matrix3::identity() - normal * normal.transpose()) * LEAN_SD_RAD.powi(2);
        }
    }
}

/// The point in Base (m) at the present instant, and the tilt.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Held {
    point: Vector3<f64>,
    tilt_rad: f64,
}

impl Object for Held {
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self {
        Self { point: carried(self.point, motion), tilt_rad }
    }
}

impl Shape<4> for Stuck {
    type Object = Held;

    fn object(&self, _: &SVector<f64, 4>, place: &Place) -> Held {
        Held { point: place.contact, tilt_rad: 0.0 }
    }

    fn residual(&self, held: &Held, place: &Place) -> Vector3<f64> {
        place.contact - held.point
    }

    fn equations(&self, held: &Held, place: &Place) -> (Vector3<f64>, Matrix3<f64>) {
        (self.residual(held, place), place.slopes)
    }

    fn state(&self, held: &Held, place: &Place, _: &SVector<f64, 4>) -> SVector<f64, 4> {
        let [s, u, v] = place.at.vector().into();
        [s, u, v, held.tilt_rad].into()
    }

    fn prior(&self, _: &SVector<f64, 4>) -> (SVector<f64, 4>, SVector<f64, 4>) {
        (SVector::zeros(), SVector::repeat(1.0))
    }

    fn variances(&self, dt_s: f64) -> SVector<f64, 4> {
        let wander_m2 = self.0.wander_m_sqrt_s.powi(2) * dt_s;
        [wander_m2, wander_m2, wander_m2, 0.0].into()
    }
}
