//! Posterior Cramér–Rao bound of a trace in space.
//!
//! As the planar bound ([`crate::bound`]): along the true contacts, with the calibrated sensor model and the measurement noise,
//! without model errors. The prior at a touch is the calibrated part of the undeflected whisker. Readings of contacts outside the
//! calibrated domain, at the tip or at several places add no information. There are two bounds:
//!
//! - *Known sliding*: the state is the contact in World, whose displacement is taken as known.
//! - *Unknown object*: the unknowns are the parameters of a rod or a sphere at rest, of which the contact without friction is a
//!   function at every pose of the base. It is the bound of an estimator that knows the kind of the object: rod, cylinder or edge,
//!   or sphere.
//!
//! The rod has the axis `q + l e` and, with the radius of the wire, the radius `rho`; `a` and `b` complete `e` to orthonormal
//! axes. The contact `p` with the normal `n(p)` of the mechanics fulfils
//!
//! ```text
//! a . (p - rho n - q) = 0    b . (p - rho n - q) = 0    e . n = 0
//! ```
//!
//! Their derivatives give those of the contact by the rod's displacements and turns along `a` and `b` and by `ln rho`. The contact
//! with a sphere about `c` fulfils `p - rho n - c = 0`; its parameters are `c` and `ln rho`.

use filters::bound::{Bound, information};
use filters::{Measurement, Process};
use nalgebra::{DMatrix, Matrix2, Matrix2x3, Matrix3, Matrix3xX, RowVector5, SMatrix, Vector2, Vector3, Vector5};
use trace::SpatialTrace;
use whisker::frames::{Base, World};
use whisker::space::frames::{Point, Pose, across};
use whisker::space::sensor::CalibratedSpace;

use super::object::{TrueObject, TrueRod};
use super::to_base;
use crate::bound::START_AWAY_SD_M;

/// Prior standard deviation of the rod's direction about the normal at the touch: that of a uniform distribution on a half circle.
const DIRECTION_SD_RAD: f64 = 0.907;

/// Prior standard deviation of the logarithm of the radius of object and wire together.
const RADIUS_LOG_SD: f64 = 0.7;

/// Bound at one instant of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialBoundAt {
    /// Time since the start of the touch.
    pub since_touch_s: f64,
    /// Lower bound of the error covariance in World with known sliding (m2), 3x3.
    pub covariance_m2: Matrix3<f64>,
    /// Bound with an unknown object. `None` if the object is no rod, cylinder, edge or sphere.
    pub object: Option<ObjectBoundAt>,
}

/// Bound of a contact with an unknown object at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectBoundAt {
    /// Lower bound of the error covariance in World (m2), 3x3.
    pub covariance_m2: Matrix3<f64>,
    /// Lower bound of the variance of the rod's direction, both angles together (rad2). `None` for a sphere.
    pub direction_rad2: Option<f64>,
    /// Lower bound of the variance of the logarithm of the radius of object and wire together.
    pub log_radius2: f64,
}

/// Bound at every instant of a trace; `None` while the whisker is free. `object` is the touched object, if it has few parameters.
pub fn bound(
    trace: &SpatialTrace,
    face: &CalibratedSpace,
    object: Option<&TrueObject>,
    noise_sd_n_m: f64,
) -> Vec<Option<SpatialBoundAt>> {
    let mut touch: Option<(f64, Bound<3>, Option<UnknownObject>)> = None;
    let rows = trace.recording.instants.iter().zip(&trace.truth.instants);
    let at = rows.map(|(known, truth)| {
        let Some(contact_m) = truth.contact_m() else {
            touch = None;
            return None;
        };
        let to_base = to_base(&known.base);
        if touch.is_none() {
            let prior = prior_m2(face, &to_base, to_base.apply(Point::from_vector(contact_m)));
            let unknown = object.and_then(|object| UnknownObject::new(face, object, &to_base, contact_m, &prior));
            touch = Some((known.t_s, Bound::new(&prior)?, unknown));
        }
        let (touch_s, bound, unknown) = touch.as_mut()?;
        bound.predict(&KnownSlide, &contact_m);
        let reading = Reading { face, to_base: &to_base, noise_sd_n_m };
        let gained = information(&reading, &contact_m).filter(|_| truth.is_single());
        if let Some(gained) = gained {
            bound.update(gained);
        }
        let object = unknown.as_mut().and_then(|unknown| unknown.advance(face, &to_base, contact_m, gained));
        Some(SpatialBoundAt { since_touch_s: known.t_s - *touch_s, covariance_m2: bound.covariance()?, object })
    });
    at.collect()
}

/// Information about the parameters of an object at rest.
struct UnknownObject {
    object: TrueObject,
    information: DMatrix<f64>,
}

impl UnknownObject {
    /// The prior information at a touch, from that of the contact in World, 3x3. `None` if the contact is not determined.
    fn new(
        face: &CalibratedSpace,
        object: &TrueObject,
        to_base: &Pose<World, Base>,
        contact: Vector3<f64>,
        prior_m2: &Matrix3<f64>,
    ) -> Option<Self> {
        let Surface { normal, slopes } = Surface::of(face, object, to_base, contact)?;
        let mut information = slopes.transpose() * prior_m2.cholesky()?.solve(&slopes);
        if let Some(rod) = object.rod() {
            let [a, b] = across(&rod.along);
            let turn = normal.cross(&rod.along);
            let turn = Vector5::new(0.0, 0.0, a.dot(&turn), b.dot(&turn), 0.0) / DIRECTION_SD_RAD;
            information += turn * turn.transpose();
        }
        // The logarithm of the radius is the last parameter.
        let last = information.nrows() - 1;
        information[(last, last)] += 1.0 / RADIUS_LOG_SD.powi(2);
        Some(Self { object: *object, information })
    }

    /// The bound after a reading of a contact in World, with the information of the reading about the contact.
    fn advance(
        &mut self,
        face: &CalibratedSpace,
        to_base: &Pose<World, Base>,
        contact: Vector3<f64>,
        gained: Option<Matrix3<f64>>,
    ) -> Option<ObjectBoundAt> {
        let Surface { slopes, .. } = Surface::of(face, &self.object, to_base, contact)?;
        if let Some(gained) = gained {
            self.information += slopes.transpose() * gained * &slopes;
        }
        let covariance = self.information.clone().cholesky()?.inverse();
        let direction_rad2 = self.object.rod().map(|_| covariance[(2, 2)] + covariance[(3, 3)]);
        let last = covariance.nrows() - 1;
        let log_radius2 = covariance[(last, last)];
        Some(ObjectBoundAt { covariance_m2: &slopes * covariance * slopes.transpose(), direction_rad2, log_radius2 })
    }
}

/// A contact as a function of the parameters of the touched object.
struct Surface {
    /// Normal in World.
    normal: Vector3<f64>,
    /// Derivatives of the contact in World by the parameters of the object: by displacements along two axes across a rod, turns
    /// towards these, and the logarithm of the radius (3x5); by displacements of a sphere and the logarithm of its radius (3x4).
    slopes: Matrix3xX<f64>,
}

impl Surface {
    /// That at a contact in World. `None` if the contact is not determined.
    fn of(
        face: &CalibratedSpace,
        object: &TrueObject,
        to_base: &Pose<World, Base>,
        contact: Vector3<f64>,
    ) -> Option<Self> {
        let at = face.around(to_base.apply(Point::from_vector(contact)));
        let directions = face.geometry()?.at(at);
        let back = to_base.then(&face.pose()).rotation().transpose();
        let normal = back * directions.normal;
        let normal_slopes = back * directions.normal_slopes;
        let contact_slopes = back * at.contact_with_jacobian(&face.axis).1;
        let (equations, by_object) = match object {
            TrueObject::Rod(rod) => rod_equations(rod, contact, &normal, &contact_slopes, &normal_slopes),
            TrueObject::Sphere { radius_m } => {
                let mut by_sphere = Matrix3xX::identity(4);
                by_sphere.set_column(3, &(normal * *radius_m));
                (contact_slopes - normal_slopes * *radius_m, by_sphere)
            }
        };
        Some(Self { normal, slopes: contact_slopes * equations.try_inverse()? * by_object })
    }
}

/// Derivatives of the left-hand sides of a rod's equations by the coordinates of the contact, 3x3, and those of their right-hand
/// sides by the parameters of the rod, 3x5.
fn rod_equations(
    rod: &TrueRod,
    contact: Vector3<f64>,
    normal: &Vector3<f64>,
    contact_slopes: &Matrix3<f64>,
    normal_slopes: &Matrix3<f64>,
) -> (Matrix3<f64>, Matrix3xX<f64>) {
    let (along, [a, b]) = (rod.along, across(&rod.along));
    let center_slopes = contact_slopes - normal_slopes * rod.radius_m;
    let rows = [center_slopes.tr_mul(&a), center_slopes.tr_mul(&b), normal_slopes.tr_mul(&along)];
    let place_m = along.dot(&(contact - rod.axis));
    let [left, up] = [a.dot(normal), b.dot(normal)];
    let by_rod = SMatrix::<f64, 3, 5>::from_rows(&[
        RowVector5::new(1.0, 0.0, place_m, 0.0, rod.radius_m * left),
        RowVector5::new(0.0, 1.0, 0.0, place_m, rod.radius_m * up),
        RowVector5::new(0.0, 0.0, -left, -up, 0.0),
    ]);
    (Matrix3::from_columns(&rows).transpose(), Matrix3xX::from_columns(&by_rod.column_iter().collect::<Vec<_>>()))
}

/// Prior covariance in World of a contact at a touch that is seen at `seen`.
fn prior_m2(face: &CalibratedSpace, to_base: &Pose<World, Base>, seen: Point<Base>) -> Matrix3<f64> {
    let (low, high) = face.domain.arc_range_m();
    // A uniform distribution has the variance of its squared length divided by 12.
    let variances = Vector3::new((high - low).powi(2) / 12.0, START_AWAY_SD_M.powi(2), START_AWAY_SD_M.powi(2));
    let back = to_base.then(&face.pose()).rotation().transpose();
    let jacobian = back * face.around(seen).contact_with_jacobian(&face.axis).1;
    jacobian * Matrix3::from_diagonal(&variances) * jacobian.transpose()
}

/// Process model of a contact whose displacement in World is known: the covariance is unchanged.
struct KnownSlide;

impl Process<3> for KnownSlide {
    fn predict(&self, contact: &Vector3<f64>) -> Vector3<f64> {
        *contact
    }

    fn jacobian(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::identity()
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::zeros()
    }
}

/// Measurement model of a contact in World.
struct Reading<'a> {
    face: &'a CalibratedSpace,
    to_base: &'a Pose<World, Base>,
    noise_sd_n_m: f64,
}

impl Measurement<3, 2> for Reading<'_> {
    fn predict(&self, contact: &Vector3<f64>) -> Option<Vector2<f64>> {
        Some(self.face.predict(self.to_base.apply(Point::from_vector(*contact)))?.reading_n_m)
    }

    fn jacobian(&self, contact: &Vector3<f64>) -> Option<Matrix2x3<f64>> {
        let expected = self.face.predict(self.to_base.apply(Point::from_vector(*contact)))?;
        Some(expected.gradient_n * self.to_base.rotation())
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.noise_sd_n_m.powi(2)
    }
}
