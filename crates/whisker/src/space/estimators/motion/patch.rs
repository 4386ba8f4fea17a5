//! A contact that slides over a surface of two principal curvatures at rest in the world.

use filters::Gaussian;
use nalgebra::{Matrix3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::line::{DIRECTION_SD_RAD, LEVER_M, Line, nearest_angle};
use super::rolling::{Axes, Object, Place, Roll, Shape};
use super::spine::{ANGLE, RADIUS, Spine};
use super::{Motion, RadiusPrior, describe_normal, extended};
use crate::frames::Base;
use crate::settings::{SettingsError, within};
use crate::space::estimators::side::Side;
use crate::space::estimators::{Estimate, Sample};
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Index in the state of the curvature of the spine.
const BEND: usize = 6;

/// Length by which the curvature of the spine is made dimensionless.
const BEND_M: f64 = 0.01;

/// A torus at rest, which has any two principal curvatures; the state is `(s, u, v, beta, psi, ln rho, 0.01 m K)`, with `rho` the
/// sum of the radius about the spine and that of the wire.
///
/// The spine is a circle of curvature `K` which passes through `c = p - rho nu` in the direction `e` of [`Line`]; it lies in the
/// plane of `e` and the normal `nu`, and bends away from the latter if `K` is positive. With `K = 0` it is the axis of a rod. A
/// point at `l` along `e` and `h` along `nu` from `c`, and at 0 across both, lies on the spine if
///
/// ```text
/// h + K (l^2 + h^2) / 2 = 0
/// ```
///
/// where its direction is `e (1 + K h) - nu K l`. When the base moves, `p' - rho nu(p')` is again on the spine, and the force
/// across it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::space::estimators) struct Patch {
    /// Prior of direction and radius, and random walks.
    spine: Line,
    /// Prior standard deviation of the curvature of the spine.
    bend_sd_per_m: f64,
}

impl Default for Patch {
    fn default() -> Self {
        Self { spine: Line { radius: RadiusPrior::ANY_FITTED, ..Line::default() }, bend_sd_per_m: 50.0 }
    }
}

impl Patch {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("bend_sd_per_m", self.bend_sd_per_m, 1e-6..=1e6)?;
        self.spine.validate()
    }

    fn bend_sd(&self) -> f64 {
        self.bend_sd_per_m * BEND_M
    }
}

impl Motion<7> for Patch {
    type Step<'a> = Roll<'a, Self, 7>;

    fn parts(&self, place: &Gaussian<3>) -> Vec<Gaussian<7>> {
        let bend = (0.0, self.bend_sd());
        self.spine.entries().map(|[tilt, angle, radius]| extended(place, [tilt, angle, radius, bend])).collect()
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample, unrest: &Matrix3<f64>) -> Roll<'a, Self, 7> {
        Roll::new(*self, side, sample, unrest)
    }

    fn align(&self, x: &mut SVector<f64, 7>, with: &SVector<f64, 7>) {
        x[ANGLE] = nearest_angle(x[ANGLE], with[ANGLE]);
    }

    fn describe(&self, side: &Side, belief: &Gaussian<7>, estimate: &mut Estimate) {
        if let Some(place) = Place::new(side, Around::of_state(&belief.mean)) {
            describe_normal(&place, belief, estimate);
        }
    }
}

/// A torus at the present instant.
#[derive(Clone, Copy)]
pub(in crate::space::estimators) struct Torus {
    /// The spine, with the direction away from its centre.
    spine: Spine,
    bend_per_m: f64,
    /// Radius of the torus about the spine, and of the wire, together.
    radius_m: f64,
    tilt_rad: f64,
}

impl Object for Torus {
    fn moved(&self, motion: &Pose<Base, Base>, tilt_rad: f64) -> Self {
        Self { spine: self.spine.moved(motion), tilt_rad, ..*self }
    }
}

/// The centre of a cross-section of a torus, and the direction of the spine there.
struct Section {
    /// The centre relative to the known point of the spine, and its coordinates along and away from the centre of the spine.
    off: Vector3<f64>,
    l: f64,
    h: f64,
    direction: Vector3<f64>,
}

impl Section {
    fn residual(&self, torus: &Torus, normal: &Vector3<f64>) -> Vector3<f64> {
        let Self { off, l, h, direction } = *self;
        let on_spine = h + 0.5 * torus.bend_per_m * (l * l + h * h);
        Vector3::new(torus.across().dot(&off), on_spine, LEVER_M * direction.dot(normal))
    }
}

impl Torus {
    /// The direction across the plane of the spine.
    fn across(&self) -> Vector3<f64> {
        self.spine.outwards.cross(&self.spine.along)
    }

    /// The cross-section that is touched at a place with this normal.
    fn section(&self, place: &Place, normal: &Vector3<f64>) -> Section {
        let Spine { point, along, outwards } = self.spine;
        let off = place.contact - normal * self.radius_m - point;
        let (l, h) = (along.dot(&off), outwards.dot(&off));
        let direction = along * (1.0 + self.bend_per_m * h) - outwards * (self.bend_per_m * l);
        Section { off, l, h, direction }
    }
}

impl Shape<7> for Patch {
    type Object = Torus;

    fn object(&self, x: &SVector<f64, 7>, place: &Place) -> Torus {
        let (spine, radius_m) = Spine::of_state(x, place);
        Torus { spine, bend_per_m: x[BEND] / BEND_M, radius_m, tilt_rad: 0.0 }
    }

    fn residual(&self, torus: &Torus, place: &Place) -> Vector3<f64> {
        let normal = place.axes(torus.tilt_rad).normal;
        torus.section(place, &normal).residual(torus, &normal)
    }

    fn equations(&self, torus: &Torus, place: &Place) -> (Vector3<f64>, Matrix3<f64>) {
        let Torus { spine: Spine { along, outwards, .. }, bend_per_m, radius_m, tilt_rad } = *torus;
        let across = torus.across();
        let (normal, normal_slopes) = (place.axes(tilt_rad).normal, place.normal_slopes(tilt_rad));
        let section = torus.section(place, &normal);
        let Section { l, h, direction, .. } = section;
        let off_slopes = place.slopes - normal_slopes * radius_m;
        let (l_slopes, h_slopes) = (off_slopes.tr_mul(&along), off_slopes.tr_mul(&outwards));
        let (bent, turned) = (1.0 + bend_per_m * h, bend_per_m * l);
        let by_direction =
            h_slopes * (bend_per_m * along.dot(&normal)) - l_slopes * (bend_per_m * outwards.dot(&normal));
        let rows = [
            off_slopes.tr_mul(&across),
            h_slopes * bent + l_slopes * turned,
            (normal_slopes.tr_mul(&direction) + by_direction) * LEVER_M,
        ];
        (section.residual(torus, &normal), Matrix3::from_columns(&rows).transpose())
    }

    fn state(&self, torus: &Torus, place: &Place, before: &SVector<f64, 7>) -> SVector<f64, 7> {
        let Axes { normal, tangent, across } = place.axes(torus.tilt_rad);
        let Section { direction, .. } = torus.section(place, &normal);
        let angle = nearest_angle(direction.dot(&across).atan2(direction.dot(&tangent)), before[ANGLE]);
        let [s, u, v] = place.at.vector().into();
        [s, u, v, torus.tilt_rad, angle, before[RADIUS], before[BEND]].into()
    }

    fn prior(&self, x: &SVector<f64, 7>) -> (SVector<f64, 7>, SVector<f64, 7>) {
        let (radius, radius_sd) = self.spine.radius.logarithm();
        let sd = [1.0, 1.0, 1.0, 1.0, DIRECTION_SD_RAD, radius_sd, self.bend_sd()];
        ([0.0, 0.0, 0.0, 0.0, x[ANGLE], radius, 0.0].into(), sd.into())
    }

    fn variances(&self, dt_s: f64) -> SVector<f64, 7> {
        self.spine.walk(dt_s)
    }
}
