//! Quantities of object and sensor that an estimate may state beside the contact.

use nalgebra::{Matrix2, Vector2};

use crate::frames::{Base, Pose};

/// A value with its standard deviation, in the same unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertain {
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// Estimated radius of an object, without the wire's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radius {
    /// The radius.
    pub radius_m: f64,
    /// Its standard deviation.
    pub sd_m: f64,
}

/// Estimated coefficient of Coulomb friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionCoefficient {
    /// The coefficient.
    pub coefficient: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// Estimated velocity of an object relative to the world, under the assumption that it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    /// The velocity (m/s), in Base unless [`Self::turned`].
    pub velocity_m_s: Vector2<f64>,
    /// Its covariance (m2/s2) in the same frame, 2x2.
    pub covariance_m2_s2: Matrix2<f64>,
}

impl Velocity {
    /// The velocity in another frame, in which this one has the pose `frame`.
    #[must_use]
    pub fn turned<To>(&self, frame: &Pose<Base, To>) -> Self {
        Self { velocity_m_s: frame.rotation() * self.velocity_m_s, covariance_m2_s2: frame.turn(self.covariance_m2_s2) }
    }

    /// Standard deviations in both directions (m/s).
    pub fn sds_m_s(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.covariance_m2_s2[(axis, axis)].max(0.0).sqrt())
    }
}

/// Estimated deviation of a sensor from its calibration, under the assumption that gain and mounting deviate.
///
/// The mounting is the pose `mount` of the calibrated Base in the actual one, as the keys `mount_rad`, `mount_x_m` and `mount_y_m`
/// of `whisker evaluate --miscalibrate`. A robot computes the pose `nominal` of the calibrated Base; that of the actual one is
/// `nominal * inverse(mount)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Installation {
    /// Relative error `g` of the gain: readings are `1 + g` times those of the calibrated sensor.
    pub gain: Uncertain,
    /// Yaw of the calibrated Base in the actual one (rad).
    pub mount_rad: Uncertain,
    /// Position of the calibrated Base in the actual one (m), x.
    pub mount_x_m: Uncertain,
    /// Position of the calibrated Base in the actual one (m), y.
    pub mount_y_m: Uncertain,
}

impl Installation {
    /// The deviations with their names.
    pub fn by_name(&self) -> [(&'static str, Uncertain); 4] {
        let Self { gain, mount_rad, mount_x_m, mount_y_m } = *self;
        [("gain", gain), ("mount_rad", mount_rad), ("mount_x_m", mount_x_m), ("mount_y_m", mount_y_m)]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::vector;

    use super::*;
    use crate::frames::World;

    #[test]
    fn verif_a_velocity_turns_with_its_frame() {
        let velocity = Velocity {
            velocity_m_s: vector![1e-3, 0.0],
            covariance_m2_s2: Matrix2::from_diagonal(&vector![4e-8, 1e-8]),
        };
        let turned = velocity.turned(&Pose::<Base, World>::new(0.3, -0.2, std::f64::consts::FRAC_PI_2));
        assert!((turned.velocity_m_s - vector![0.0, 1e-3]).norm() < 1e-15, "{turned:?}");
        let expected = Matrix2::from_diagonal(&vector![1e-8, 4e-8]);
        assert!((turned.covariance_m2_s2 - expected).norm() < 1e-20, "{turned:?}");
    }
}
