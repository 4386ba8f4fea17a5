//! A contact that slides over a cone at rest in the world.

use std::f64::consts::PI;

use filters::Gaussian;
use nalgebra::{Matrix3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::line::{DIRECTION_SD_RAD, LEVER_M, Line, nearest_angle};
use super::rolling::{Axes, Object, Place, Roll, Shape};
use super::spine::{ANGLE, Spine, describe_axial};
use super::{Motion, RadiusPrior, extended};
use crate::frames::Base;
use crate::settings::{SettingsError, within};
use crate::space::estimators::side::Side;
use crate::space::estimators::{Estimate, Sample};
use crate::space::frames::Pose;

/// Index in the state of the sine of the half angle. The other entries are those of a rod along the generatrix.
const SINE: usize = 6;

/// Largest magnitude of the sine of the half angle.
const MOST_SINE: f64 = 0.9;

/// A cone at rest; the state is `(s, u, v, beta, psi, ln rho, sigma)`, with `rho` the distance from the contact to the axis along
/// the normal, which includes the radius of the wire, and `sigma` the sine of the half angle.
///
/// The generatrix through the contact has the direction `w`, which is the direction `e` of [`Line`]; the cone widens along it if
/// `sigma` is positive. With the half angle `alpha`, `sigma = sin alpha`, the axis has the direction
/// `e = w cos alpha - nu sin alpha` and passes through `c = p - rho nu`. When the base moves, the new
/// contact `p'`, at `l = e . (p' - c)` along the axis, fulfils
///
/// ```text
/// nu(p') . e = -sigma    p' - rho' nu(p') on the axis    rho' = (rho + sigma l) / (1 - sigma^2)
/// ```
///
/// With `sigma = 0` these are the equations of a rod. A cone with `-sigma` and the opposite direction `w` is the same.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::space::estimators) struct Cone {
    /// Prior of direction and radius, and random walks.
    axis: Line,
    /// Prior standard deviation of the sine of the half angle.
    sine_sd: f64,
}

impl Default for Cone {
    fn default() -> Self {
        Self { axis: Line { radius: RadiusPrior::ANY_FITTED, ..Line::default() }, sine_sd: 0.1 }
    }
}

impl Cone {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("sine_sd", self.sine_sd, 1e-6..=1.0)?;
        self.axis.validate()
    }
}

impl Motion<7> for Cone {
    type Step<'a> = Roll<'a, Self, 7>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<7>> {
        let sine = (0.0, self.sine_sd);
        self.axis.entries().map(|[tilt, angle, radius]| extended(place, [tilt, angle, radius, sine])).collect()
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Roll<'a, Self, 7> {
        Roll::new(*self, side, sample, unrest)
    }

    fn align(&self, x: &mut SVector<f64, 7>, with: &SVector<f64, 7>) {
        let angle = nearest_angle(x[ANGLE], with[ANGLE]);
        // Along the opposite direction the cone narrows.
        x[SINE] *= (angle - x[ANGLE]).cos().signum();
        x[ANGLE] = angle;
    }

    fn align_belief(&self, belief: &mut Gaussian<7>, with: &SVector<f64, 7>) {
        let sine = belief.mean[SINE];
        self.align(&mut belief.mean, with);
        if belief.mean[SINE] != sine {
            belief.covariance.row_mut(SINE).neg_mut();
            belief.covariance.column_mut(SINE).neg_mut();
        }
    }

    fn describe(&self, side: &Side, belief: &Gaussian<7>, estimate: &mut Estimate) {
        describe_axial(side, belief, estimate);
    }
}

/// A cone at the present instant.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Funnel {
    axis: Spine,
    /// Distance along the normal from that point to the contact for which it was chosen, and the sine of the half angle.
    radius_m: f64,
    sine: f64,
    tilt_rad: f64,
}

impl Object for Funnel {
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self {
        Self { axis: self.axis.moved(motion), tilt_rad, ..*self }
    }
}

impl Funnel {
    /// Distance from a contact to the axis, along the normal. Not a number beyond the apex, where there is no contact.
    fn radius_m(&self, place: &Place) -> f64 {
        let l = self.axis.along.dot(&(place.contact - self.axis.point));
        let radius_m = (self.radius_m + self.sine * l) / (1.0 - self.sine * self.sine);
        if radius_m > 0.0 { radius_m } else { f64::NAN }
    }
}

impl Shape<7> for Cone {
    type Object = Funnel;

    fn object(&self, x: &SVector<f64, 7>, place: &Place) -> Funnel {
        let (Spine { point, along: generatrix, outwards: normal }, radius_m) = Spine::of_state(x, place);
        let sine = x[SINE].clamp(-MOST_SINE, MOST_SINE);
        let cosine = (1.0 - sine * sine).sqrt();
        let along = generatrix * cosine - normal * sine;
        let axis = Spine { point, along, outwards: normal * cosine + generatrix * sine };
        Funnel { axis, radius_m, sine, tilt_rad: 0.0 }
    }

    fn residual(&self, cone: &Funnel, place: &Place) -> Vector3<f64> {
        let normal = place.axes(cone.tilt_rad).normal;
        let (one, other) = cone.axis.across();
        let off = place.contact - normal * cone.radius_m(place) - cone.axis.point;
        Vector3::new(one.dot(&off), other.dot(&off), LEVER_M * (cone.axis.along.dot(&normal) + cone.sine))
    }

    fn equations(&self, cone: &Funnel, place: &Place) -> (Vector3<f64>, Matrix3<f64>) {
        let (one, other) = cone.axis.across();
        let (normal, normal_slopes) = (place.axes(cone.tilt_rad).normal, place.normal_slopes(cone.tilt_rad));
        let along = cone.axis.along;
        let radius_slopes = place.slopes.tr_mul(&along) * (cone.sine / (1.0 - cone.sine * cone.sine));
        let off_slopes = place.slopes - normal_slopes * cone.radius_m(place) - normal * radius_slopes.transpose();
        let rows = [off_slopes.tr_mul(&one), off_slopes.tr_mul(&other), normal_slopes.tr_mul(&along) * LEVER_M];
        (self.residual(cone, place), Matrix3::from_columns(&rows).transpose())
    }

    fn state(&self, cone: &Funnel, place: &Place, before: &SVector<f64, 7>) -> SVector<f64, 7> {
        let Axes { tangent, across, .. } = place.axes(cone.tilt_rad);
        let angle = cone.axis.along.dot(&across).atan2(cone.axis.along.dot(&tangent));
        let angle = angle + 2.0 * PI * ((before[ANGLE] - angle) / (2.0 * PI)).round();
        let [s, u, v] = place.at.vector().into();
        [s, u, v, cone.tilt_rad, angle, cone.radius_m(place).ln(), before[SINE]].into()
    }

    fn prior(&self, x: &SVector<f64, 7>) -> (SVector<f64, 7>, SVector<f64, 7>) {
        let (radius, radius_sd) = self.axis.radius.logarithm();
        let sd = [1.0, 1.0, 1.0, 1.0, DIRECTION_SD_RAD, radius_sd, self.sine_sd];
        ([0.0, 0.0, 0.0, 0.0, x[ANGLE], radius, 0.0].into(), sd.into())
    }

    fn variances(&self, dt_s: f64) -> SVector<f64, 7> {
        self.axis.walk(dt_s)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::SMatrix;

    use super::*;

    #[test]
    fn verif_an_aligned_belief_is_that_of_the_same_cone() {
        let with = SVector::from([0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0]);
        let mut covariance = SMatrix::<f64, 7, 7>::identity();
        (covariance[(ANGLE, SINE)], covariance[(SINE, ANGLE)]) = (0.5, 0.5);
        let mut belief = Gaussian::new([0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.2].into(), covariance);
        Cone::default().align_belief(&mut belief, &with);
        // The opposite direction, along which the cone narrows.
        assert!((belief.mean[ANGLE] - 0.1 - PI).abs() < 1e-15 && belief.mean[SINE] == -0.2);
        assert_eq!((belief.covariance[(ANGLE, SINE)], belief.covariance[(SINE, SINE)]), (-0.5, 1.0));
        let aligned = belief.mean;
        Cone::default().align_belief(&mut belief, &with);
        assert_eq!(belief.mean, aligned);
    }
}
