//! Poses of a whisker's base by time, and the pose between two of them.

use std::f64::consts::TAU;

use trace::SpatialPose;
use whisker::frames::{Base, Pose, World};

use crate::clock::Clock;
use crate::motion::{Motion, Place};
use crate::samples::{Sampled, Samples};

/// Poses of the base in order of time.
#[derive(Clone, Debug, Default)]
pub struct Poses {
    samples: Samples<Pose<Base, World>>,
}

impl Motion for Poses {
    type Measured = Pose<Base, World>;
    type Base = Pose<Base, World>;

    fn is_finite(&self, pose: &Pose<Base, World>) -> bool {
        let at = pose.origin();
        [at.x(), at.y(), pose.yaw_rad()].into_iter().all(f64::is_finite)
    }

    fn clock(&mut self, _pose: &Pose<Base, World>) -> Option<&mut Clock> {
        Some(&mut self.samples.clock)
    }

    fn is_before_all(&self, t_s: f64, _pose: &Pose<Base, World>) -> bool {
        self.samples.is_before_all(t_s)
    }

    /// The yaw is continued from the pose before by whole turns.
    fn insert(&mut self, t_s: f64, pose: Pose<Base, World>) -> bool {
        let beside = self.samples.beside(t_s);
        let turns = beside.map_or(0.0, |beside| ((beside.yaw_rad() - pose.yaw_rad()) / TAU).round());
        self.samples.insert(t_s, if turns == 0.0 { pose } else { turned(&pose, turns * TAU) })
    }

    /// The pose with that time or, by linear interpolation, between its neighbours if they are at most `gap_s` apart.
    fn at(&self, t_s: f64, gap_s: f64) -> Place {
        match self.samples.at(t_s, gap_s, between) {
            Sampled::At(pose) => Place::At(pose),
            Sampled::Pending => Place::Pending,
            Sampled::Unknown => Place::Unknown,
        }
    }

    fn newest_s(&self) -> Option<f64> {
        self.samples.newest_s()
    }

    fn settle(&mut self, t_s: f64) {
        self.samples.settle(t_s);
    }

    fn restart(&mut self) {
        self.samples.clear();
    }
}

/// Poses of the base in space in order of time.
#[derive(Clone, Debug, Default)]
pub struct SpatialPoses {
    samples: Samples<SpatialPose>,
}

impl Motion for SpatialPoses {
    type Measured = SpatialPose;
    type Base = SpatialPose;

    fn is_finite(&self, pose: &SpatialPose) -> bool {
        pose.position.iter().chain(pose.rotation.coords.iter()).all(|number| number.is_finite())
    }

    fn clock(&mut self, _pose: &SpatialPose) -> Option<&mut Clock> {
        Some(&mut self.samples.clock)
    }

    fn is_before_all(&self, t_s: f64, _pose: &SpatialPose) -> bool {
        self.samples.is_before_all(t_s)
    }

    fn insert(&mut self, t_s: f64, pose: SpatialPose) -> bool {
        self.samples.insert(t_s, pose)
    }

    /// The pose with that time or, between its neighbours if they are at most `gap_s` apart, one with a linearly interpolated
    /// position and a rotation by a share of the shorter angle.
    fn at(&self, t_s: f64, gap_s: f64) -> Place<SpatialPose> {
        match self.samples.at(t_s, gap_s, between_in_space) {
            Sampled::At(pose) => Place::At(pose),
            Sampled::Pending => Place::Pending,
            Sampled::Unknown => Place::Unknown,
        }
    }

    fn newest_s(&self) -> Option<f64> {
        self.samples.newest_s()
    }

    fn settle(&mut self, t_s: f64) {
        self.samples.settle(t_s);
    }

    fn restart(&mut self) {
        self.samples.clear();
    }
}

/// Pose at a share of the way from one to another. Of two opposite rotations, the first.
fn between_in_space(before: &SpatialPose, after: &SpatialPose, share: f64) -> SpatialPose {
    SpatialPose {
        position: before.position + (after.position - before.position) * share,
        rotation: before.rotation.try_slerp(&after.rotation, share, f64::EPSILON).unwrap_or(before.rotation),
    }
}

/// A pose whose yaw is larger by whole turns.
fn turned(pose: &Pose<Base, World>, by_rad: f64) -> Pose<Base, World> {
    Pose::new(pose.origin().x(), pose.origin().y(), pose.yaw_rad() + by_rad)
}

/// Pose at a share of the way from one to another, the yaw by the shorter way.
fn between(before: &Pose<Base, World>, after: &Pose<Base, World>, share: f64) -> Pose<Base, World> {
    let (from, to) = (before.origin().vector(), after.origin().vector());
    let turn_rad = after.yaw_rad() - before.yaw_rad();
    let turn_rad = turn_rad - TAU * (turn_rad / TAU).round();
    let at = from + (to - from) * share;
    Pose::new(at.x, at.y, before.yaw_rad() + turn_rad * share)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

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
        assert_eq!(poses.at(0.175, 0.05), Place::Unknown);
        assert_eq!(poses.at(-0.1, 1.0), Place::Unknown);
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
        poses.settle(0.15);
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
            assert_eq!(poses.at(0.025, 0.05), Place::Unknown);
        }
    }
}
