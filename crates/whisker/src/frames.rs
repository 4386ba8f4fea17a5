//! Planar frames as types: the type of a point, a pose or a twist includes its frame, and mixing frames does not
//! compile.
//!
//! ```
//! use whisker::frames::{Base, Point, Pose, World};
//!
//! let base: Pose<Base, World> = Pose::new(0.1, 0.0, std::f64::consts::FRAC_PI_2);
//! let contact: Point<Base> = Point::new(0.05, 0.0);
//! let seen: Point<World> = base.apply(contact);
//! assert!((seen.x() - 0.1).abs() < 1e-15 && (seen.y() - 0.05).abs() < 1e-15);
//! ```
//!
//! The same pose does not accept a point of the world:
//!
//! ```compile_fail
//! use whisker::frames::{Base, Point, Pose, World};
//!
//! let base: Pose<Base, World> = Pose::new(0.1, 0.0, std::f64::consts::FRAC_PI_2);
//! let contact: Point<World> = Point::new(0.05, 0.0);
//! let seen: Point<World> = base.apply(contact);
//! ```

use std::f64::consts::TAU;
use std::marker::PhantomData;

use filters::{congruence, product};
use nalgebra::{Matrix2, Rotation2, Vector2};

/// The fixed frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum World {}

/// The base's frame at the start of a recording: fixed like [`World`], and the reference of a robot's odometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {}

/// The frame of the whisker's base: origin at the root, +x along the tangent of the undeflected root, +y to the left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {}

/// The base's frame turned by the rotation of the compliant root: the frame in which the wire is clamped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Root {}

/// A point in frame `F`, in metres.
#[derive(Debug, PartialEq)]
pub struct Point<F> {
    xy: Vector2<f64>,
    frame: PhantomData<F>,
}

impl<F> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<F> Copy for Point<F> {}

impl<F> Point<F> {
    /// The point at (`x_m`, `y_m`).
    pub fn new(x_m: f64, y_m: f64) -> Self {
        Self::from_vector(Vector2::new(x_m, y_m))
    }

    /// The point with these coordinates.
    pub fn from_vector(xy: Vector2<f64>) -> Self {
        Self { xy, frame: PhantomData }
    }

    /// First coordinate.
    pub fn x(&self) -> f64 {
        self.xy.x
    }

    /// Second coordinate.
    pub fn y(&self) -> f64 {
        self.xy.y
    }

    /// Both coordinates.
    pub fn vector(&self) -> Vector2<f64> {
        self.xy
    }

    /// This point moved by an offset written in the same frame.
    pub fn shifted(&self, offset_m: Vector2<f64>) -> Self {
        Self::from_vector(self.xy + offset_m)
    }

    /// Distance to another point of the same frame.
    pub fn distance(&self, other: &Self) -> f64 {
        (self.xy - other.xy).norm()
    }
}

/// Pose of frame `From` in frame `To`: transforms coordinates from the former to the latter.
#[derive(Debug, PartialEq)]
pub struct Pose<From, To> {
    translation: Vector2<f64>,
    yaw_rad: f64,
    rotation: Rotation2<f64>,
    frames: PhantomData<(From, To)>,
}

impl<From, To> Clone for Pose<From, To> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<From, To> Copy for Pose<From, To> {}

impl<From, To> Pose<From, To> {
    /// The pose of a frame with its origin at (`x_m`, `y_m`) in `To`, rotated by `yaw_rad`.
    pub fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        let (translation, rotation) = (Vector2::new(x_m, y_m), Rotation2::new(yaw_rad));
        Self { translation, yaw_rad, rotation, frames: PhantomData }
    }

    /// Origin of `From`, in `To`.
    pub fn origin(&self) -> Point<To> {
        Point::from_vector(self.translation)
    }

    /// Angle by which `From` is turned in `To`.
    pub fn yaw_rad(&self) -> f64 {
        self.yaw_rad
    }

    /// The same pose, with its yaw in -pi to pi.
    pub fn with_wrapped_yaw(self) -> Self {
        let turns = (self.yaw_rad / TAU).round();
        Self { yaw_rad: self.yaw_rad - turns * TAU, ..self }
    }

    /// The rotation alone.
    pub fn rotation(&self) -> Matrix2<f64> {
        *self.rotation.matrix()
    }

    /// A point's coordinates in `To`.
    pub fn apply(&self, point: Point<From>) -> Point<To> {
        Point::from_vector(product(self.rotation.matrix(), &point.xy) + self.translation)
    }

    /// A covariance's components in `To`.
    pub fn turn(&self, covariance: Matrix2<f64>) -> Matrix2<f64> {
        congruence(self.rotation.matrix(), &covariance)
    }

    /// Pose of `To` in `From`.
    pub fn inverse(&self) -> Pose<To, From> {
        let rotation = self.rotation.inverse();
        let translation = -product(rotation.matrix(), &self.translation);
        Pose { translation, yaw_rad: -self.yaw_rad, rotation, frames: PhantomData }
    }

    /// This pose followed by one from `To` to `Next`.
    pub fn then<Next>(&self, next: &Pose<To, Next>) -> Pose<From, Next> {
        let translation = product(next.rotation.matrix(), &self.translation) + next.translation;
        let rotation = Rotation2::from_matrix_unchecked(product(next.rotation.matrix(), self.rotation.matrix()));
        Pose { translation, yaw_rad: self.yaw_rad + next.yaw_rad, rotation, frames: PhantomData }
    }
}

/// Velocity of the base relative to the world, written in the base's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Velocity along the base's x.
    pub vx_m_s: f64,
    /// Velocity along the base's y.
    pub vy_m_s: f64,
    /// Angular velocity.
    pub wz_rad_s: f64,
}

impl Twist {
    /// Motion of the base under this twist held for `duration_s`, as the pose of its earlier frame in its later one:
    /// the inverse of the twist's exponential. A point at rest in the world moves in the base's frame by `dp_x/dt =
    /// -v_x + w p_y`, `dp_y/dt = -v_y - w p_x` (Lin et al. 2022, with corrected sign of the rotation).
    pub fn motion(&self, duration_s: f64) -> Pose<Base, Base> {
        let angle = self.wz_rad_s * duration_s;
        // sin(a)/a and (1 - cos a)/a, by series where the quotient would lose its digits.
        let (along, across) = if angle.abs() < 1e-4 {
            (1.0 - angle * angle / 6.0, angle / 2.0)
        } else {
            (angle.sin() / angle, (1.0 - angle.cos()) / angle)
        };
        let (x, y) = (self.vx_m_s * duration_s, self.vy_m_s * duration_s);
        Pose::<Base, Base>::new(along * x - across * y, across * x + along * y, angle).inverse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_pose_and_inverse_cancel() {
        let pose: Pose<Base, World> = Pose::new(0.3, -0.2, 0.7);
        let point = Point::new(0.05, 0.01);
        assert!(pose.inverse().apply(pose.apply(point)).distance(&point) < 1e-15);
        assert!(pose.then(&pose.inverse()).apply(point).distance(&point) < 1e-15);
    }

    #[test]
    fn val_twist_solves_the_differential_equation_of_a_fixed_point() {
        let twist = Twist { vx_m_s: 0.02, vy_m_s: -0.03, wz_rad_s: 0.8 };
        let (mut x, mut y) = (0.06, 0.01);
        let steps = 200_000;
        let dt = 0.5 / f64::from(steps);
        for _ in 0..steps {
            let slope = |x: f64, y: f64| (-twist.vx_m_s + twist.wz_rad_s * y, -twist.vy_m_s - twist.wz_rad_s * x);
            let (kx, ky) = slope(x, y);
            let (mx, my) = slope(x + 0.5 * dt * kx, y + 0.5 * dt * ky);
            x += dt * mx;
            y += dt * my;
        }
        let moved = twist.motion(0.5).apply(Point::<Base>::new(0.06, 0.01));
        assert!(moved.distance(&Point::new(x, y)) < 1e-12);
    }

    #[test]
    fn verif_slow_rotation_tends_to_pure_translation() {
        let point = Point::<Base>::new(0.06, 0.01);
        let turning = Twist { vx_m_s: 0.02, vy_m_s: -0.03, wz_rad_s: 1e-9 };
        let straight = Twist { wz_rad_s: 0.0, ..turning };
        assert!(turning.motion(0.1).apply(point).distance(&straight.motion(0.1).apply(point)) < 1e-11);
    }
}
