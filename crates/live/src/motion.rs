//! Motion of a whisker's base, from the measurements that arrive.

use whisker::frames::{Base, Pose, World};

use crate::clock::Clock;
use crate::samples::Lack;

/// Pose of the base at a requested time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place<P = Pose<Base, World>> {
    /// It is known.
    At(P),
    /// A later measurement may determine it.
    Pending,
    /// No later measurement can determine it: there is none before, or too long a gap.
    Unknown(Lack),
    /// It is known and lies outside the plane of the estimators.
    OffPlane(Deviation),
}

/// Deviation of a pose from the plane of the estimators.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Angle between the z axis of the base and the normal of the plane (rad).
    pub tilt_rad: f64,
    /// Distance of the base from the plane (m).
    pub height_m: f64,
}

/// Motion of a base that is measured in parts, such as poses ([`Poses`](crate::Poses)), transforms of frames or angles of
/// joints, and interpolated in time.
pub trait Motion: Send {
    /// A measurement.
    type Measured;
    /// Pose of the base.
    type Base;

    /// Whether all values of a measurement are finite.
    fn is_finite(&self, measured: &Self::Measured) -> bool;

    /// Clock of the measurements of this kind. `None` if the pose does not depend on them, or not on their time.
    fn clock(&mut self, measured: &Self::Measured) -> Option<&mut Clock>;

    /// Whether a measurement of this kind and time lies before all that are kept.
    fn is_before_all(&self, t_s: f64, measured: &Self::Measured) -> bool;

    /// Adds a measurement and returns whether there was none of its kind and time.
    fn insert(&mut self, t_s: f64, measured: Self::Measured) -> bool;

    /// Pose at a time. Measurements are interpolated if they are at most `gap_s` apart.
    fn at(&self, t_s: f64, gap_s: f64) -> Place<Self::Base>;

    /// Time up to which the measurements determine the pose.
    fn newest_s(&self) -> Option<f64>;

    /// Drops the measurements that no time from `t_s` on requires. `is_used` states whether the pose of that time is used with a
    /// reading.
    fn settle(&mut self, t_s: f64, is_used: bool);

    /// Drops all measurements after a jump of a clock.
    fn restart(&mut self);
}
