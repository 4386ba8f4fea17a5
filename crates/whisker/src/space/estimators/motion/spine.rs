//! Axis of a rod or cone, or spine of a torus, at the present instant.

use filters::Gaussian;
use nalgebra::{SVector, Vector3};

use super::rolling::{Axes, Place, TILT, carried};
use super::{describe_direction, describe_normal, describe_radius};
use crate::frames::Base;
use crate::space::estimators::Estimate;
use crate::space::estimators::side::Side;
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Indices in the state of the direction and of the logarithm of the radius, as in the states of cones and tori.
pub(super) const ANGLE: usize = 4;
pub(super) const RADIUS: usize = 5;

/// States normal, radius and direction of an object with an axis.
pub(super) fn describe_axial<const N: usize>(side: &Side, belief: &Gaussian<N>, estimate: &mut Estimate) {
    let Some(place) = Place::new(side, Around::of_state(&belief.mean)) else { return };
    describe_normal(&place, belief, estimate);
    describe_radius(side, belief, RADIUS, estimate);
    describe_direction(&place, belief, ANGLE, estimate);
}

/// A point of the axis, its direction there, and a direction across it.
#[derive(Clone, Copy)]
pub(super) struct Spine {
    pub(super) point: Vector3<f64>,
    pub(super) along: Vector3<f64>,
    pub(super) outwards: Vector3<f64>,
}

impl Spine {
    /// The axis of a rod that is touched at a place by a state, with the radius of rod and wire together.
    pub(super) fn of_state<const N: usize>(x: &SVector<f64, N>, place: &Place) -> (Self, f64) {
        let Axes { normal, tangent, across } = place.axes(x[TILT]);
        let (sin, cos) = x[ANGLE].sin_cos();
        let radius_m = x[RADIUS].exp();
        let point = place.contact - normal * radius_m;
        (Self { point, along: tangent * cos + across * sin, outwards: normal }, radius_m)
    }

    /// The axis after the motion of the base.
    pub(super) fn moved(&self, motion: &Pose<Base, Base>) -> Self {
        Self {
            point: carried(self.point, motion),
            along: motion.turn_vector(self.along),
            outwards: motion.turn_vector(self.outwards),
        }
    }

    /// Two directions across the axis, which with its own are a right-handed frame.
    pub(super) fn across(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.outwards, self.along.cross(&self.outwards))
    }
}
