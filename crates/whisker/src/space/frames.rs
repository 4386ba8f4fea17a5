//! Frames in space as types, like the planar ones of [`crate::frames`], whose names they share.

use std::marker::PhantomData;

use filters::{congruence, product};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// A point in frame `F`, in metres.
#[derive(Debug, PartialEq)]
pub struct Point<F> {
    xyz: Vector3<f64>,
    frame: PhantomData<F>,
}

impl<F> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<F> Copy for Point<F> {}

impl<F> Point<F> {
    /// The point with these coordinates.
    pub fn new(x_m: f64, y_m: f64, z_m: f64) -> Self {
        Self::from_vector(Vector3::new(x_m, y_m, z_m))
    }

    /// The point with these coordinates.
    pub fn from_vector(xyz: Vector3<f64>) -> Self {
        Self { xyz, frame: PhantomData }
    }

    /// The coordinates, 3x1.
    pub fn vector(&self) -> Vector3<f64> {
        self.xyz
    }

    /// This point moved by an offset written in the same frame.
    pub fn shifted(&self, offset_m: Vector3<f64>) -> Self {
        Self::from_vector(self.xyz + offset_m)
    }

    /// Distance to another point of the same frame.
    pub fn distance(&self, other: &Self) -> f64 {
        (self.xyz - other.xyz).norm()
    }
}

/// Two unit vectors orthogonal to `unit` and to each other.
pub fn across(unit: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let first = unit.cross(&Vector3::ith(unit.iamin(), 1.0)).normalize();
    [first, unit.cross(&first)]
}

/// Pose of frame `From` in frame `To`: transforms coordinates from the former to the latter.
#[derive(Debug, PartialEq)]
pub struct Pose<From, To> {
    translation: Vector3<f64>,
    rotation: Rotation3<f64>,
    frames: PhantomData<(From, To)>,
}

impl<From, To> Clone for Pose<From, To> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<From, To> Copy for Pose<From, To> {}

impl<From, To> Pose<From, To> {
    /// The pose of a frame with this origin (m) in `To`, and this rotation from `From` to `To`.
    pub fn new(translation: Vector3<f64>, rotation: Rotation3<f64>) -> Self {
        Self { translation, rotation, frames: PhantomData }
    }

    /// The pose of a frame that coincides with `To`.
    pub fn identity() -> Self {
        Self::new(Vector3::zeros(), Rotation3::identity())
    }

    /// Origin of `From`, in `To`.
    pub fn origin(&self) -> Point<To> {
        Point::from_vector(self.translation)
    }

    /// The rotation alone, 3x3.
    pub fn rotation(&self) -> Matrix3<f64> {
        *self.rotation.matrix()
    }

    /// A point's coordinates in `To`.
    pub fn apply(&self, point: Point<From>) -> Point<To> {
        Point::from_vector(product(self.rotation.matrix(), &point.xyz) + self.translation)
    }

    /// A direction's components in `To`.
    pub fn turn_vector(&self, vector: Vector3<f64>) -> Vector3<f64> {
        product(self.rotation.matrix(), &vector)
    }

    /// A covariance's components in `To`.
    pub fn turn(&self, covariance: Matrix3<f64>) -> Matrix3<f64> {
        congruence(self.rotation.matrix(), &covariance)
    }

    /// Pose of `To` in `From`.
    pub fn inverse(&self) -> Pose<To, From> {
        let rotation = self.rotation.inverse();
        Pose::new(-product(rotation.matrix(), &self.translation), rotation)
    }

    /// This pose followed by one from `To` to `Next`.
    pub fn then<Next>(&self, next: &Pose<To, Next>) -> Pose<From, Next> {
        let translation = product(next.rotation.matrix(), &self.translation) + next.translation;
        Pose::new(translation, next.rotation * self.rotation)
    }
}

/// Rotation vector (rad) of a rotation matrix. By the quaternion: the angle of a matrix, from its trace, may be undefined after
/// rounding.
pub(crate) fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation)).scaled_axis()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Base, World};

    #[test]
    fn verif_pose_and_inverse_cancel() {
        let turned = Rotation3::from_euler_angles(0.3, -0.2, 0.7);
        let pose: Pose<Base, World> = Pose::new(Vector3::new(0.3, -0.2, 0.1), turned);
        let point = Point::new(0.05, 0.01, -0.02);
        assert!(pose.inverse().apply(pose.apply(point)).distance(&point) < 1e-15);
        assert!(pose.then(&pose.inverse()).apply(point).distance(&point) < 1e-15);
    }

    #[test]
    fn verif_a_rotation_in_the_plane_is_that_of_planar_frames() {
        let planar = crate::frames::Pose::<Base, World>::new(0.1, 0.2, 0.6);
        let pose: Pose<Base, World> =
            Pose::new(Vector3::new(0.1, 0.2, 0.0), Rotation3::from_axis_angle(&Vector3::z_axis(), 0.6));
        let (expected, found) =
            (planar.apply(crate::frames::Point::new(0.05, 0.01)), pose.apply(Point::new(0.05, 0.01, 0.0)));
        assert!((found.vector().xy() - expected.vector()).norm() < 1e-15);
    }
}
