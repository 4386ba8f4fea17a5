//! Poses of a whisker's base by time, and the pose between two of them.

use std::f64::consts::TAU;

use trace::{SpatialPose, wrapped_rad};
use whisker::frames::{Base, Pose, World};

use crate::clock::Clock;
use crate::motion::{Motion, Place};
use crate::samples::{Sampled, Samples};

/// A pose of a base that streams measure.
pub trait Posed: Copy + Send {
    /// Whether all of its values are finite.
    fn is_finite(&self) -> bool;

    /// The same pose, represented as the continuation of a neighbour in time. Default: as it is.
    fn continued(self, _beside: &Self) -> Self {
        self
    }

    /// Pose at a share of the way from one to another.
    fn between(before: &Self, after: &Self, share: f64) -> Self;
}

impl Posed for Pose<Base, World> {
    fn is_finite(&self) -> bool {
        let at = self.origin();
        [at.x(), at.y(), self.yaw_rad()].into_iter().all(f64::is_finite)
    }

    /// The yaw is continued by whole turns.
    fn continued(self, beside: &Self) -> Self {
        let turns = ((beside.yaw_rad() - self.yaw_rad()) / TAU).round();
        if turns == 0.0 { self } else { turned(&self, turns * TAU) }
    }

    /// The yaw by the shorter way.
    fn between(before: &Self, after: &Self, share: f64) -> Self {
        let (from, to) = (before.origin().vector(), after.origin().vector());
        let turn_rad = wrapped_rad(after.yaw_rad() - before.yaw_rad());
        let at = from + (to - from) * share;
        Pose::new(at.x, at.y, before.yaw_rad() + turn_rad * share)
    }
}

impl Posed for SpatialPose {
    fn is_finite(&self) -> bool {
        self.position.iter().chain(self.rotation.coords.iter()).all(|number| number.is_finite())
    }

    /// The position is interpolated linearly, the rotation by a share of the shorter angle. Of two opposite rotations, the first.
    fn between(before: &Self, after: &Self, share: f64) -> Self {
        Self {
            position: before.position + (after.position - before.position) * share,
            rotation: before.rotation.try_slerp(&after.rotation, share, f64::EPSILON).unwrap_or(before.rotation),
        }
    }
}

/// Poses of the base in order of time, interpolated between neighbours.
#[derive(Clone, Debug)]
pub struct Poses<P = Pose<Base, World>> {
    samples: Samples<P>,
}

/// Poses of a base in space.
pub type SpatialPoses = Poses<SpatialPose>;

impl<P: Posed> Default for Poses<P> {
    fn default() -> Self {
        Self { samples: Samples::default() }
    }
}

impl<P: Posed> Motion for Poses<P> {
    type Measured = P;
    type Base = P;

    fn is_finite(&self, pose: &P) -> bool {
        pose.is_finite()
    }

    fn clock(&mut self, _pose: &P) -> Option<&mut Clock> {
        Some(&mut self.samples.clock)
    }

    fn is_before_all(&self, t_s: f64, _pose: &P) -> bool {
        self.samples.is_before_all(t_s)
    }

    fn insert(&mut self, t_s: f64, pose: P) -> bool {
        let pose = self.samples.beside(t_s).map_or(pose, |beside| pose.continued(beside));
        self.samples.insert(t_s, pose)
    }

    /// The pose with that time or, by interpolation, between its neighbours if they are at most `gap_s` apart.
    fn at(&self, t_s: f64, gap_s: f64) -> Place<P> {
        match self.samples.at(t_s, gap_s, P::between) {
            Sampled::At(pose) => Place::At(pose),
            Sampled::Pending => Place::Pending,
            Sampled::Unknown(lack) => Place::Unknown(lack),
        }
    }

    fn newest_s(&self) -> Option<f64> {
        self.samples.newest_s()
    }

    fn settle(&mut self, t_s: f64, _is_used: bool) {
        self.samples.settle(t_s);
    }

    fn restart(&mut self) {
        self.samples.clear();
    }
}

/// A pose whose yaw is larger by whole turns.
fn turned(pose: &Pose<Base, World>, by_rad: f64) -> Pose<Base, World> {
    Pose::new(pose.origin().x(), pose.origin().y(), pose.yaw_rad() + by_rad)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::samples::Lack;

    fn poses(rows: &[(f64, f64, f64)]) -> Poses {
        let mut poses = Poses::default();
        rows.iter().for_each(|&(t_s, x_m, yaw_rad)| assert!(poses.insert(t_s, Pose::new(x_m, 0.0, yaw_rad))));
        poses
    }

    #[test]
    fn verif_poses_are_interpolated_in_any_order_of_arrival() {
        let poses = poses(&[(0.2, 2.0, 0.4), (0.0, 0.0, 0.0), (0.1, 1.0, 0.2)]);
        assert_eq!(poses.at(0.1, 0.1), Place::At(Pose::new(1.0, 0.0, 0.2)));
        let Place::At(pose) = poses.at(0.175, 0.11) else { panic!("a pose") };
        assert!((pose.origin().x() - 1.75).abs() < 1e-12 && (pose.yaw_rad() - 0.35).abs() < 1e-12);
        assert_eq!(poses.at(0.175, 0.05), Place::Unknown(Lack::Gap { before_s: 0.1, after_s: 0.2 }));
        assert_eq!(poses.at(-0.1, 1.0), Place::Unknown(Lack::BeforeAll { first_s: 0.0 }));
        assert_eq!(poses.at(0.3, 1.0), Place::Pending);
    }

    #[test]
    fn verif_a_wrapped_yaw_is_continued() {
        let poses = poses(&[(0.0, 0.0, 3.1), (0.1, 0.0, -3.1)]);
        let Place::At(pose) = poses.at(0.05, 1.0) else { panic!("a pose") };
        assert!((pose.yaw_rad() - PI).abs() < 1e-12);
    }

    #[test]
    fn verif_the_last_pose_before_a_time_is_kept() {
        let mut poses = poses(&[(0.0, 0.0, 0.0), (0.1, 1.0, 0.0), (0.2, 2.0, 0.0)]);
        poses.settle(0.15, true);
        let any = Pose::new(0.0, 0.0, 0.0);
        assert!(poses.is_before_all(0.05, &any) && !poses.is_before_all(0.1, &any));
        assert_eq!(poses.at(0.1, 1.0), Place::At(Pose::new(1.0, 0.0, 0.0)));
        assert!(!poses.insert(0.2, Pose::new(9.0, 0.0, 0.0)));
    }

    #[test]
    fn verif_poses_in_space_are_interpolated_by_the_shorter_rotation() {
        let axis = Vector3::new(1.0, 2.0, -1.0).normalize();
        let pose = |angle_rad: f64, sign: f64| {
            let rotation = UnitQuaternion::from_scaled_axis(axis * angle_rad);
            let rotation = UnitQuaternion::new_unchecked(rotation.into_inner() * sign);
            SpatialPose { position: Vector3::new(0.0, angle_rad, 1.0), rotation }
        };
        // A quaternion and its negative are the same rotation.
        for sign in [1.0, -1.0] {
            let mut poses = SpatialPoses::default();
            assert!(poses.insert(0.0, pose(0.2, 1.0)) && poses.insert(0.1, pose(0.6, sign)));
            let Place::At(found) = poses.at(0.025, 0.2) else { panic!("a pose") };
            let expected = pose(0.3, 1.0);
            assert!((found.position - expected.position).norm() < 1e-12);
            assert!(found.rotation.angle_to(&expected.rotation) < 1e-7, "{sign}");
            assert!(matches!(poses.at(0.025, 0.05), Place::Unknown(Lack::Gap { .. })));
        }
    }
}
