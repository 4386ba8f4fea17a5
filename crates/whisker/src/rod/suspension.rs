//! The compliant root: three rotational springs in series.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Stiffness of the suspension at the root, in N m/rad.
///
/// The root turns by a yaw about Base's +z, then by a pitch about the turned +y, then by a twist about the wire, each
/// against its own spring: `R = Rz(yaw) Ry(pitch) Rx(twist)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suspension {
    /// Stiffness in yaw, the bending in the plane of the whisker.
    pub yaw_n_m_rad: f64,
    /// Stiffness in pitch, the bending out of that plane.
    pub pitch_n_m_rad: f64,
    /// Stiffness in twist about the wire.
    pub twist_n_m_rad: f64,
}

/// Rotation of the root, as the angles of its springs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RootAngles {
    /// Rotation about Base's +z.
    pub yaw_rad: f64,
    /// Rotation about the turned +y.
    pub pitch_rad: f64,
    /// Rotation about the wire.
    pub twist_rad: f64,
}

impl RootAngles {
    /// Rotation of the root against Base.
    pub fn rotation(&self) -> Rotation3<f64> {
        // nalgebra's Euler angles are roll, pitch and yaw about the fixed axes, in this order.
        Rotation3::from_euler_angles(self.twist_rad, self.pitch_rad, self.yaw_rad)
    }
}

/// Root under a moment, and the dependence of its rotation on the moment.
pub(super) struct Turned {
    pub(super) angles: RootAngles,
    pub(super) rotation: Matrix3<f64>,
    /// Derivative of the rotation vector in Base by the moment in the frame of the turned root.
    pub(super) flexibility: Matrix3<f64>,
}

impl Suspension {
    /// Root under a moment (N m) in the frame of the turned root.
    ///
    /// In that frame the axis of the twist is +x, that of the pitch depends on the twist, and that of the yaw on both: the angles
    /// follow one after the other, without iteration.
    pub(super) fn turn(&self, moment: Vector3<f64>) -> Turned {
        let twist_rad = moment.x / self.twist_n_m_rad;
        let (sin_twist, cos_twist) = twist_rad.sin_cos();
        let pitch_axis = Vector3::new(0.0, cos_twist, -sin_twist);
        let pitch_axis_by_twist = Vector3::new(0.0, -sin_twist, -cos_twist);
        let pitch_rad = moment.dot(&pitch_axis) / self.pitch_n_m_rad;
        let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
        let yaw_axis = Vector3::new(-sin_pitch, sin_twist * cos_pitch, cos_twist * cos_pitch);
        let yaw_axis_by_pitch = Vector3::new(-cos_pitch, -sin_twist * sin_pitch, -cos_twist * sin_pitch);
        let yaw_axis_by_twist = Vector3::new(0.0, cos_twist * cos_pitch, -sin_twist * cos_pitch);
        let yaw_rad = moment.dot(&yaw_axis) / self.yaw_n_m_rad;

        // Rows: derivatives of twist, pitch and yaw by the moment.
        let twist_row = Vector3::x().transpose() / self.twist_n_m_rad;
        let pitch_row = (pitch_axis.transpose() + moment.dot(&pitch_axis_by_twist) * twist_row) / self.pitch_n_m_rad;
        let by_angles = moment.dot(&yaw_axis_by_pitch) * pitch_row + moment.dot(&yaw_axis_by_twist) * twist_row;
        let yaw_row = (yaw_axis.transpose() + by_angles) / self.yaw_n_m_rad;

        let angles = RootAngles { yaw_rad, pitch_rad, twist_rad };
        let rotation = angles.rotation().into_inner();
        let axes = [Vector3::x(), pitch_axis, yaw_axis].map(|axis| rotation * axis);
        let flexibility = axes[0] * twist_row + axes[1] * pitch_row + axes[2] * yaw_row;
        Turned { angles, rotation, flexibility }
    }
}
