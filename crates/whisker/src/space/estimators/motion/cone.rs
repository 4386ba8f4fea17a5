//! A contact that slides over a cone at rest in the world.

use std::f64::consts::PI;

use filters::Gaussian;
use nalgebra::{Matrix3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::line::{DIRECTION_SD_RAD, LEVER_M, Line};
use super::rolling::{Axes, FIRST_TILT_RAD, Object, Place, Roll, Shape, TILT, carried};
use super::{Motion, RadiusPrior, describe_normal, describe_radius, extended};
use crate::frames::Base;
use crate::settings::{SettingsError, within};
use crate::space::estimators::side::Side;
use crate::space::estimators::{Direction, Estimate, Sample};
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Indices in the state of the direction of the generatrix, of the logarithm of the distance from the axis, and of the taper.
const ANGLE: usize = 4;
const RADIUS: usize = 5;
const TAPER: usize = 6;

/// Largest sine of the half angle.
const MOST_TAPER: f64 = 0.9;

/// A cone at rest; the state is `(s, u, v, beta, psi, ln rho, sigma)`, with `rho` the distance from the contact to the axis along
/// the normal, which includes the radius of the wire, and `sigma` the sine of the half angle.
///
/// The generatrix through the contact has the direction `w` of [`Line`], along which the cone widens if `sigma` is positive, and
/// the axis the direction `e = w cos alpha - nu sin alpha`. It passes through `c = p - rho nu`. When the base moves, the new
/// contact `p'`, at `l = e . (p' - c)` along the axis, fulfils
///
/// ```text
/// nu(p') . e = -sigma    p' - rho' nu(p') on the axis    rho' = (rho + sigma l) / (1 - sigma^2)
/// ```
///
/// With `sigma = 0` these are the equations of a rod.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::space::estimators) struct Cone {
    /// Prior of direction and radius, and random walks.
    axis: Line,
    /// Prior standard deviation of the sine of the half angle.
    taper_sd: f64,
}

impl Default for Cone {
    fn default() -> Self {
        Self { axis: Line { radius: RadiusPrior::ANY_FITTED, ..Line::default() }, taper_sd: 0.1 }
    }
}

impl Cone {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("taper_sd", self.taper_sd, 1e-6..=1.0)?;
        self.axis.validate()
    }
}

impl Motion<7> for Cone {
    type Step<'a> = Roll<'a, Self, 7>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<7>> {
        let (tilt, taper) = ((0.0, FIRST_TILT_RAD), (0.0, self.taper_sd));
        let part =
            |angle| self.axis.radius.logarithms().map(move |radius| extended(place, [tilt, angle, radius, taper]));
        self.axis.angles().flat_map(part).collect()
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Roll<'a, Self, 7> {
        Roll::new(*self, side, sample, unrest)
    }

    fn align(&self, x: &mut SVector<f64, 7>, with: &SVector<f64, 7>) {
        let halves = ((with[ANGLE] - x[ANGLE]) / PI).round();
        x[ANGLE] += PI * halves;
        if halves % 2.0 != 0.0 {
            x[TAPER] = -x[TAPER];
        }
    }

    fn describe(&self, side: &Side, belief: &Gaussian<7>, estimate: &mut Estimate) {
        let Some(place) = Place::new(side, Around::of_state(&belief.mean)) else { return };
        describe_normal(&place, belief, estimate);
        describe_radius(side, belief, RADIUS, estimate);
        let Axes { tangent, across, .. } = place.axes(belief.mean[TILT]);
        let (sin, cos) = belief.mean[ANGLE].sin_cos();
        let sd_rad = belief.covariance[(ANGLE, ANGLE)].max(0.0).sqrt();
        estimate.direction = Some(Direction { along: tangent * cos + across * sin, sd_rad });
    }
}

/// A cone at the present instant.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Tapered {
    /// A point of its axis, its direction, and a direction across it.
    axis: Vector3<f64>,
    along: Vector3<f64>,
    outwards: Vector3<f64>,
    /// Distance from the contact to that point, and its slope along the axis.
    radius_m: f64,
    taper: f64,
    tilt_rad: f64,
}

impl Object for Tapered {
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self {
        Self {
            axis: carried(self.axis, motion),
            along: motion.turn_vector(self.along),
            outwards: motion.turn_vector(self.outwards),
            tilt_rad,
            ..*self
        }
    }
}

impl Tapered {
    /// Distance from a contact to the axis along the normal.
    fn radius_m(&self, place: &Place) -> f64 {
        let l = self.along.dot(&(place.contact - self.axis));
        (self.radius_m + self.taper * l) / (1.0 - self.taper * self.taper)
    }
}

impl Shape<7> for Cone {
    type Object = Tapered;

    fn object(&self, x: &SVector<f64, 7>, place: &Place) -> Tapered {
        let Axes { normal, tangent, across } = place.axes(x[TILT]);
        let (sin, cos) = x[ANGLE].sin_cos();
        let generatrix = tangent * cos + across * sin;
        let (radius_m, taper) = (x[RADIUS].exp(), x[TAPER].clamp(-MOST_TAPER, MOST_TAPER));
        let cosine = (1.0 - taper * taper).sqrt();
        Tapered {
            axis: place.contact - normal * radius_m,
            along: generatrix * cosine - normal * taper,
            outwards: normal * cosine + generatrix * taper,
            radius_m,
            taper,
            tilt_rad: 0.0,
        }
    }

    fn residual(&self, cone: &Tapered, place: &Place) -> Vector3<f64> {
        let normal = place.axes(cone.tilt_rad).normal;
        let off = place.contact - normal * cone.radius_m(place) - cone.axis;
        let other = cone.along.cross(&cone.outwards);
        Vector3::new(cone.outwards.dot(&off), other.dot(&off), LEVER_M * (cone.along.dot(&normal) + cone.taper))
    }

    fn equations(&self, cone: &Tapered, place: &Place) -> (Vector3<f64>, Matrix3<f64>) {
        let (one, other) = (cone.outwards, cone.along.cross(&cone.outwards));
        let (normal, normal_slopes) = (place.axes(cone.tilt_rad).normal, place.normal_slopes(cone.tilt_rad));
        let radius_slopes = place.slopes.tr_mul(&cone.along) * (cone.taper / (1.0 - cone.taper * cone.taper));
        let off_slopes = place.slopes - normal_slopes * cone.radius_m(place) - normal * radius_slopes.transpose();
        let rows = [off_slopes.tr_mul(&one), off_slopes.tr_mul(&other), normal_slopes.tr_mul(&cone.along) * LEVER_M];
        (self.residual(cone, place), Matrix3::from_columns(&rows).transpose())
    }

    fn state(&self, cone: &Tapered, place: &Place, before: &SVector<f64, 7>) -> SVector<f64, 7> {
        let Axes { tangent, across, .. } = place.axes(cone.tilt_rad);
        let angle = cone.along.dot(&across).atan2(cone.along.dot(&tangent));
        let angle = angle + 2.0 * PI * ((before[ANGLE] - angle) / (2.0 * PI)).round();
        let [s, u, v] = place.at.vector().into();
        [s, u, v, cone.tilt_rad, angle, cone.radius_m(place).max(1e-6).ln(), before[TAPER]].into()
    }

    fn prior(&self, x: &SVector<f64, 7>) -> (SVector<f64, 7>, SVector<f64, 7>) {
        let (radius, radius_sd) = self.axis.radius.logarithm();
        let sd = [1.0, 1.0, 1.0, 1.0, DIRECTION_SD_RAD, radius_sd, self.taper_sd];
        ([0.0, 0.0, 0.0, 0.0, x[ANGLE], radius, 0.0].into(), sd.into())
    }

    fn variances(&self, dt_s: f64) -> SVector<f64, 7> {
        let wander_m2 = self.axis.wander_m_sqrt_s.powi(2) * dt_s;
        let turn_rad2 = self.axis.turn_rad_sqrt_s.powi(2) * dt_s;
        [wander_m2, wander_m2, wander_m2, 0.0, turn_rad2, 0.0, 0.0].into()
    }
}
