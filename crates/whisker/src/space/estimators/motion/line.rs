//! A contact that slides along a straight rod or edge at rest in the world.

use std::f64::consts::PI;

use filters::Gaussian;
use nalgebra::{Matrix3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::rolling::{Axes, FIRST_TILT_RAD, Object, Place, Roll, Shape};
use super::spine::{ANGLE, RADIUS, Spine, describe_axial};
use super::{Motion, RadiusPrior, check_wander, extended};
use crate::frames::Base;
use crate::settings::{SettingsError, within};
use crate::space::estimators::side::Side;
use crate::space::estimators::{Estimate, Sample};
use crate::space::frames::Pose;

/// Length by which the condition on the direction of the force is compared with distances.
pub(super) const LEVER_M: f64 = 0.05;

/// Standard deviation of a direction that is uniform on a half circle.
pub(super) const DIRECTION_SD_RAD: f64 = 0.907;

/// A straight rod of radius `r` at rest; the state is `(s, u, v, beta, psi, ln rho)`, with `rho` the sum of `r` and the radius of
/// the wire.
///
/// With the axes of [`super::rolling`] at the contact `p`, the rod's direction is `e = t cos psi + (nu x t) sin psi`, and its
/// axis passes through `p - rho nu`. When the base moves, the new contact `p'` fulfils
///
/// ```text
/// nu(p') . e = 0    p' - rho nu(p') on the axis
/// ```
///
/// it slides along the rod until the force is again across it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::space::estimators) struct Line {
    /// Random walk of the contact in the world along each axis, as the standard deviation after one second.
    pub(super) wander_m_sqrt_s: f64,
    /// Random walk of the rod's direction, as the standard deviation after one second.
    pub(super) turn_rad_sqrt_s: f64,
    /// Number of Gaussians over the half circle of directions at the touch.
    pub(super) directions: usize,
    /// Prior of the radius of rod and wire together.
    pub(super) radius: RadiusPrior,
}

impl Default for Line {
    fn default() -> Self {
        Self { wander_m_sqrt_s: 3e-5, turn_rad_sqrt_s: 1e-3, directions: 4, radius: RadiusPrior::THIN }
    }
}

impl Line {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        check_wander(self.wander_m_sqrt_s)?;
        within("turn_rad_sqrt_s", self.turn_rad_sqrt_s, 1e-9..=10.0)?;
        within("directions", self.directions as f64, 1.0..=100.0)?;
        self.radius.validate()
    }

    /// Means and standard deviations of tilt, direction and logarithm of the radius of each Gaussian at the touch.
    pub(super) fn entries(&self) -> impl Iterator<Item = [(f64, f64); 3]> {
        let stretch = PI / self.directions as f64;
        let angles = (0..self.directions).map(move |i| ((i as f64 + 0.5) * stretch, 0.5 * stretch));
        let tilt = (0.0, FIRST_TILT_RAD);
        angles.flat_map(move |angle| self.radius.logarithms().map(move |radius| [tilt, angle, radius]))
    }

    /// Variances that one step of `dt_s` adds to the entries of a state that begins like that of a rod.
    pub(super) fn walk<const N: usize>(&self, dt_s: f64) -> SVector<f64, N> {
        let mut variances = SVector::<f64, N>::zeros();
        variances.fixed_rows_mut::<3>(0).fill(self.wander_m_sqrt_s.powi(2) * dt_s);
        variances[ANGLE] = self.turn_rad_sqrt_s.powi(2) * dt_s;
        variances
    }
}

impl Motion<6> for Line {
    type Step<'a> = Roll<'a, Self, 6>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<6>> {
        self.entries().map(|entries| extended(place, entries)).collect()
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Roll<'a, Self, 6> {
        Roll::new(*self, side, sample, unrest)
    }

    fn align(&self, x: &mut SVector<f64, 6>, with: &SVector<f64, 6>) {
        x[ANGLE] = nearest_angle(x[ANGLE], with[ANGLE]);
    }

    fn describe(&self, side: &Side, belief: &Gaussian<6>, estimate: &mut Estimate) {
        describe_axial(side, belief, estimate);
    }
}

/// The angle of the same direction, which has no sign, nearest to another.
pub(super) fn nearest_angle(angle: f64, other: f64) -> f64 {
    angle + PI * ((other - angle) / PI).round()
}

/// A rod at the present instant.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Rod {
    axis: Spine,
    /// Radius of rod and wire together.
    radius_m: f64,
    tilt_rad: f64,
}

impl Object for Rod {
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self {
        Self { axis: self.axis.moved(motion), tilt_rad, ..*self }
    }
}

impl Shape<6> for Line {
    type Object = Rod;

    fn object(&self, x: &SVector<f64, 6>, place: &Place) -> Rod {
        let (axis, radius_m) = Spine::of_state(x, place);
        Rod { axis, radius_m, tilt_rad: 0.0 }
    }

    fn residual(&self, rod: &Rod, place: &Place) -> Vector3<f64> {
        let (one, other) = rod.axis.across();
        let normal = place.axes(rod.tilt_rad).normal;
        let off = place.contact - normal * rod.radius_m - rod.axis.point;
        Vector3::new(one.dot(&off), other.dot(&off), LEVER_M * rod.axis.along.dot(&normal))
    }

    fn equations(&self, rod: &Rod, place: &Place) -> (Vector3<f64>, Matrix3<f64>) {
        let (one, other) = rod.axis.across();
        let normal_slopes = place.normal_slopes(rod.tilt_rad);
        let off_slopes = place.slopes - normal_slopes * rod.radius_m;
        let rows =
            [off_slopes.tr_mul(&one), off_slopes.tr_mul(&other), normal_slopes.tr_mul(&rod.axis.along) * LEVER_M];
        (self.residual(rod, place), Matrix3::from_columns(&rows).transpose())
    }

    fn state(&self, rod: &Rod, place: &Place, before: &SVector<f64, 6>) -> SVector<f64, 6> {
        let Axes { tangent, across, .. } = place.axes(rod.tilt_rad);
        let angle = rod.axis.along.dot(&across).atan2(rod.axis.along.dot(&tangent));
        let angle = nearest_angle(angle, before[ANGLE]);
        let [s, u, v] = place.at.vector().into();
        [s, u, v, rod.tilt_rad, angle, before[RADIUS]].into()
    }

    fn prior(&self, x: &SVector<f64, 6>) -> (SVector<f64, 6>, SVector<f64, 6>) {
        let (radius, radius_sd) = self.radius.logarithm();
        ([0.0, 0.0, 0.0, 0.0, x[ANGLE], radius].into(), [1.0, 1.0, 1.0, 1.0, DIRECTION_SD_RAD, radius_sd].into())
    }

    fn variances(&self, dt_s: f64) -> SVector<f64, 6> {
        self.walk(dt_s)
    }
}
