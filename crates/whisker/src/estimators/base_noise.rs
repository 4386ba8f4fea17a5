//! Noise of the measured pose of a whisker's base.

use filters::congruence;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2};

use crate::frames::{Base, Point};

/// Covariance of the error of the base's measured pose: its x, y and yaw in Base, in m2, m rad and rad2. Zero for an
/// exact pose.
///
/// A pose from joint encoders has an independent error at each instant and does not drift. An estimator carries the
/// contact along by the differences of such poses, so its error is that of the present pose alone and does not
/// depend on earlier errors. It is therefore measurement noise, not process noise: the reading is that of a contact
/// displaced by the base's error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BaseNoise(pub Matrix3<f64>);

impl BaseNoise {
    /// Whether the pose is exact.
    pub fn is_none(&self) -> bool {
        self.0 == Matrix3::zeros()
    }

    /// Covariance (m2) in Base of the position of a point at rest in World that the error of the base's pose causes. A
    /// base displaced by `(x, y)` and rotated by `yaw` displaces the point `p` by `-(x, y) - yaw x p`.
    pub fn of_point_m2(&self, point: Point<Base>) -> Matrix2<f64> {
        let by_pose = Matrix2x3::new(1.0, 0.0, -point.y(), 0.0, 1.0, point.x());
        congruence(&by_pose, &self.0)
    }

    /// Variance that the error adds to the reading of a contact whose reading has the gradient `gradient_n` by the
    /// contact's position.
    pub fn of_reading_n2_m2(&self, contact: Point<Base>, gradient_n: &Vector2<f64>) -> f64 {
        gradient_n.dot(&(self.of_point_m2(contact) * gradient_n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Pose, World};

    /// Compares with small displacements of the base itself.
    #[test]
    fn verif_covariance_of_a_point_is_that_of_a_displaced_base() {
        let base: Pose<Base, World> = Pose::new(0.3, -0.2, 0.7);
        let seen: Point<Base> = Point::new(0.06, -0.01);
        let error = nalgebra::vector![2e-6, -1e-6, 3e-5];
        let off: Pose<Base, Base> = Pose::new(error.x, error.y, error.z);
        let shift = off.then(&base).inverse().apply(base.apply(seen)).vector() - seen.vector();
        let noise = BaseNoise(error * error.transpose());
        assert!((noise.of_point_m2(seen) - shift * shift.transpose()).norm() < 1e-3 * shift.norm_squared());
        let gradient_n = nalgebra::vector![1e-3, -4e-3];
        let expected = gradient_n.dot(&shift).powi(2);
        assert!((noise.of_reading_n2_m2(seen, &gradient_n) - expected).abs() < 1e-3 * expected);
    }
}
