//! Kinematics of the arm that carries whiskers: base poses from joint angles, base twists from joint rates.
//!
//! Links are given by Craig's modified Denavit-Hartenberg parameters (J. J. Craig, Introduction to Robotics, 2nd ed.
//! 1989): in the frame of joint `i - 1`, joint `i` has the pose `Rot_x(alpha) Trans_x(a) Rot_z(q_i) Trans_z(d)` and
//! rotates about its z axis. For a point `p` carried by the arm, column `i` of the geometric Jacobian is `(z_i x (p -
//! o_i), z_i)`, with axis `z_i` and origin `o_i` of the joint.

use std::f64::consts::TAU;
use std::path::Path;

use files::Error;
use nalgebra::{Isometry3, Matrix4, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use whisker::frames::{Base, Pose, Twist, World};

/// Number of joints.
pub const JOINTS: usize = 7;

/// Largest deviation of `R R^T` from the identity, per entry, for a matrix accepted as a rotation.
const NOT_RIGID: f64 = 1e-9;

/// Largest tilt of a base's z axis from the z axis of World. It shortens lengths projected on the plane by a factor of
/// 5e-7.
pub(crate) const TILT_RAD: f64 = 1e-3;

/// Pose in space as stored in files: a 4x4 homogeneous matrix in row-major order, translation in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct PoseMatrix(pub [f64; 16]);

impl PoseMatrix {
    pub(crate) fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        let matrix = Matrix4::from_row_slice(&self.0);
        let rotation = matrix.fixed_view::<3, 3>(0, 0).into_owned();
        let off = (rotation * rotation.transpose() - nalgebra::Matrix3::identity()).abs().max();
        if off.is_nan() || off > NOT_RIGID || (rotation.determinant() - 1.0).abs() > 1e-6 {
            return Err(Error::value(path, key, "no rotation in its upper left", "a rotation to within 1e-9"));
        }
        if self.0[12..] != [0.0, 0.0, 0.0, 1.0] {
            return Err(Error::value(path, key, format!("the last row {:?}", &self.0[12..]), "0, 0, 0, 1"));
        }
        Ok(())
    }

    /// Pose as an isometry.
    pub fn isometry(&self) -> Isometry3<f64> {
        let matrix = Matrix4::from_row_slice(&self.0);
        let rotation = Rotation3::from_matrix_unchecked(matrix.fixed_view::<3, 3>(0, 0).into_owned());
        let translation = Translation3::from(matrix.fixed_view::<3, 1>(0, 3).into_owned());
        Isometry3::from_parts(translation, UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

/// Link in Craig's modified Denavit-Hartenberg parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Link length: distance along the x axis of the previous joint.
    pub a_m: f64,
    /// Link twist: angle about the x axis of the previous joint.
    pub alpha_rad: f64,
    /// Link offset: distance along the joint's own axis.
    pub d_m: f64,
}

/// Serial arm of seven revolute joints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Name of the arm.
    pub name: String,
    /// Pose of the arm's base in World.
    pub base: PoseMatrix,
    /// Links from base to flange.
    pub links: [Link; JOINTS],
    /// Distance from the last joint to the flange along the last axis.
    pub flange_d_m: f64,
}

/// Joint angles and rates at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointInstant {
    /// Time since the start of the recording.
    pub t_s: f64,
    /// Joint angles.
    pub angles_rad: [f64; JOINTS],
    /// Joint rates.
    pub rates_rad_s: [f64; JOINTS],
}

impl Arm {
    /// Pose in World and body twist of a whisker base mounted on the flange, one entry per instant. Both are projected
    /// on the horizontal plane of World; the yaw is unwrapped.
    ///
    /// `mount` is the pose of the base in the flange frame. The twist is the body Jacobian times the joint rates,
    /// reduced to its three planar components.
    pub fn carry(&self, mount: &PoseMatrix, joints: &[JointInstant]) -> Vec<(Pose<Base, World>, Twist)> {
        let mount = mount.isometry();
        let mut last_rad: Option<f64> = None;
        joints
            .iter()
            .map(|instant| {
                let (pose, twist) = self.carried(&mount, instant);
                let yaw_rad = last_rad.map_or(pose.yaw_rad(), |last| last + wrapped_rad(pose.yaw_rad() - last));
                last_rad = Some(yaw_rad);
                (Pose::new(pose.origin().x(), pose.origin().y(), yaw_rad), twist)
            })
            .collect()
    }

    /// Heights above the origin of World of a base mounted on the flange, one entry per instant.
    pub fn heights_m(&self, mount: &PoseMatrix, joints: &[JointInstant]) -> Vec<f64> {
        let mount = mount.isometry();
        joints.iter().map(|instant| self.frames(&mount, &instant.angles_rad).1.translation.z).collect()
    }

    /// Angle between the z axis of a base mounted on the flange and the z axis of World, one entry per instant.
    pub fn tilts_rad(&self, mount: &PoseMatrix, joints: &[JointInstant]) -> Vec<f64> {
        let mount = mount.isometry();
        let up = |instant: &JointInstant| self.frames(&mount, &instant.angles_rad).1.rotation * Vector3::z();
        joints.iter().map(|instant| up(instant).angle(&Vector3::z())).collect()
    }

    /// Poses of the joint frames and of the mounted base in World.
    fn frames(&self, mount: &Isometry3<f64>, angles_rad: &[f64; JOINTS]) -> ([Isometry3<f64>; JOINTS], Isometry3<f64>) {
        let mut frame = self.base.isometry();
        let mut joints = [Isometry3::identity(); JOINTS];
        for ((joint, link), angle_rad) in joints.iter_mut().zip(&self.links).zip(angles_rad) {
            frame *= UnitQuaternion::from_axis_angle(&Vector3::x_axis(), link.alpha_rad)
                * Translation3::new(link.a_m, 0.0, 0.0)
                * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), *angle_rad)
                * Translation3::new(0.0, 0.0, link.d_m);
            *joint = frame;
        }
        (joints, frame * Translation3::new(0.0, 0.0, self.flange_d_m) * mount)
    }

    fn carried(&self, mount: &Isometry3<f64>, instant: &JointInstant) -> (Pose<Base, World>, Twist) {
        let (joints, base) = self.frames(mount, &instant.angles_rad);
        let (mut velocity, mut spin) = (Vector3::zeros(), Vector3::zeros());
        for (joint, rate_rad_s) in joints.iter().zip(instant.rates_rad_s) {
            let axis = joint.rotation * Vector3::z();
            velocity += axis.cross(&(base.translation.vector - joint.translation.vector)) * rate_rad_s;
            spin += axis * rate_rad_s;
        }
        let (velocity, spin) = (base.rotation.inverse() * velocity, base.rotation.inverse() * spin);
        let ahead = base.rotation * Vector3::x();
        let pose = Pose::new(base.translation.x, base.translation.y, ahead.y.atan2(ahead.x));
        (pose, Twist { vx_m_s: velocity.x, vy_m_s: velocity.y, wz_rad_s: spin.z })
    }
}

/// Angle wrapped to `[-pi, pi]`.
pub fn wrapped_rad(angle_rad: f64) -> f64 {
    angle_rad - TAU * (angle_rad / TAU).round()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    const IDENTITY: PoseMatrix =
        PoseMatrix([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);

    /// Franka Emika Panda with its published parameters (Franka Robotics, FCI documentation).
    fn panda() -> Arm {
        let link = |a_m, alpha_rad, d_m| Link { a_m, alpha_rad, d_m };
        Arm {
            name: "panda".into(),
            base: IDENTITY,
            links: [
                link(0.0, 0.0, 0.333),
                link(0.0, -FRAC_PI_2, 0.0),
                link(0.0, FRAC_PI_2, 0.316),
                link(0.0825, FRAC_PI_2, 0.0),
                link(-0.0825, -FRAC_PI_2, 0.384),
                link(0.0, FRAC_PI_2, 0.0),
                link(0.088, FRAC_PI_2, 0.0),
            ],
            flange_d_m: 0.107,
        }
    }

    fn at(t_s: f64) -> JointInstant {
        let angle = |i: usize| 0.3 * (i as f64) - 0.8 + 0.2 * (t_s * (1.0 + 0.3 * i as f64)).sin();
        let rate = |i: usize| 0.2 * (1.0 + 0.3 * i as f64) * (t_s * (1.0 + 0.3 * i as f64)).cos();
        JointInstant { t_s, angles_rad: std::array::from_fn(angle), rates_rad_s: std::array::from_fn(rate) }
    }

    /// With all joints at zero the arm is upright; the flange points down at x = 88 mm.
    #[test]
    fn val_zero_configuration_matches_the_published_geometry() {
        let zero = JointInstant { t_s: 0.0, angles_rad: [0.0; JOINTS], rates_rad_s: [0.0; JOINTS] };
        let flange = panda().carried(&Isometry3::identity(), &zero).0;
        assert!((flange.origin().x() - 0.088).abs() < 1e-12 && flange.origin().y().abs() < 1e-12);
    }

    /// If only the vertical first joint turns, every carried point moves on a circle.
    #[test]
    fn val_rotation_of_the_first_joint_moves_the_base_on_a_circle() {
        let (rate_rad_s, angle_rad) = (0.5, 0.7);
        let mut instant = JointInstant { t_s: 0.0, angles_rad: [0.0; JOINTS], rates_rad_s: [0.0; JOINTS] };
        (instant.angles_rad[0], instant.rates_rad_s[0]) = (angle_rad, rate_rad_s);
        // Base with its z axis up, mounted on a flange that points down.
        let mount = PoseMatrix([1.0, 0.0, 0.0, 0.1, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let (pose, twist) = panda().carried(&mount.isometry(), &instant);
        let radius_m = 0.188;
        assert!((pose.origin().vector().norm() - radius_m).abs() < 1e-12 && (pose.yaw_rad() - angle_rad).abs() < 1e-12);
        assert!(twist.vx_m_s.abs() < 1e-12 && (twist.vy_m_s - radius_m * rate_rad_s).abs() < 1e-12);
        assert!((twist.wz_rad_s - rate_rad_s).abs() < 1e-12);
    }

    /// Body twist compared with central differences of the pose.
    #[test]
    fn verif_jacobian_matches_finite_differences() {
        let arm = panda();
        let h_s = 1e-5;
        // Cyclic permutation of the mounted frame's axes, so that all six components of the twist are compared.
        let turn = Isometry3::new(Vector3::zeros(), Vector3::new(1.0, 1.0, 1.0).normalize() * (TAU / 3.0));
        let mut mount = Isometry3::translation(0.05, -0.02, 0.1);
        for _ in 0..3 {
            for step in 0..20 {
                let t_s = 0.37 * f64::from(step);
                let [before, now, after] =
                    [t_s - h_s, t_s, t_s + h_s].map(|t_s| arm.frames(&mount, &at(t_s).angles_rad).1);
                let moved = now.rotation.inverse() * (after.translation.vector - before.translation.vector);
                let turned = (before.rotation.inverse() * after.rotation).scaled_axis();
                let (_, twist) = arm.carried(&mount, &at(t_s));
                let seen = Vector3::new(twist.vx_m_s, twist.vy_m_s, twist.wz_rad_s);
                let expected = Vector3::new(moved.x, moved.y, turned.z) / (2.0 * h_s);
                assert!((seen - expected).norm() < 1e-8, "{seen} {expected}");
            }
            mount *= turn;
        }
    }

    #[test]
    fn verif_yaw_is_unwrapped() {
        let mut instants = Vec::new();
        for step in 0..100 {
            let mut instant =
                JointInstant { t_s: f64::from(step), angles_rad: [0.0; JOINTS], rates_rad_s: [0.0; JOINTS] };
            instant.angles_rad[0] = 0.1 * f64::from(step);
            instants.push(instant);
        }
        let yaws: Vec<f64> = panda().carry(&IDENTITY, &instants).iter().map(|(pose, _)| pose.yaw_rad()).collect();
        assert!((yaws[99] - yaws[0] - 9.9).abs() < 1e-9, "{yaws:?}");
    }

    #[test]
    fn robust_invalid_pose_matrices_are_reported_with_their_key() {
        let path = Path::new("r.json");
        let mut scaled = IDENTITY;
        scaled.0[0] = 1.1;
        let mut shifted = IDENTITY;
        shifted.0[12] = 1.0;
        assert!(IDENTITY.validate(path, "arm.base").is_ok());
        for (matrix, words) in [(scaled, "no rotation"), (shifted, "the last row")] {
            let message = matrix.validate(path, "arm.base").expect_err(words).to_string();
            assert!(message.starts_with("r.json: arm.base: found") && message.contains(words), "{message}");
        }
    }
}
