//! Coordinates of a contact about the undeflected whisker.

use nalgebra::{Matrix3, SVector, Vector2, Vector3};

use crate::RestShape;
use crate::frames::{self, Base};
use crate::space::frames::Point;

/// Coordinates of a contact about the undeflected whisker, which lies in the plane `z = 0` of Base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// Arc length of the nearest point of the undeflected whisker, from the root (m).
    pub along_m: f64,
    /// Displacement from that point along its left normal (m).
    pub left_m: f64,
    /// Displacement along z of Base (m).
    pub up_m: f64,
}

impl Around {
    /// The coordinates with these values, all in m.
    pub fn new(along_m: f64, left_m: f64, up_m: f64) -> Self {
        Self { along_m, left_m, up_m }
    }

    /// The coordinates of a contact.
    pub fn of(rest: &RestShape, contact: Point<Base>) -> Self {
        let [x, y, z] = contact.vector().into();
        let foot = rest.foot(frames::Point::new(x, y));
        Self::new(foot.arc_m, foot.left_m, z)
    }

    /// The contact with these coordinates, and its derivatives by them, 3x3.
    pub fn contact_with_jacobian(self, rest: &RestShape) -> (Point<Base>, Matrix3<f64>) {
        let (contact, tangent) = rest.beside_with_tangent(self.along_m, self.left_m);
        let stretch = 1.0 - rest.curvature_per_m(self.along_m) * self.left_m;
        let columns =
            [Vector3::new(tangent.x, tangent.y, 0.0) * stretch, Vector3::new(-tangent.y, tangent.x, 0.0), Vector3::z()];
        (Point::new(contact.x(), contact.y(), self.up_m), Matrix3::from_columns(&columns))
    }

    /// The contact with these coordinates.
    pub fn contact(self, rest: &RestShape) -> Point<Base> {
        let contact = rest.beside(self.along_m, self.left_m);
        Point::new(contact.x(), contact.y(), self.up_m)
    }

    /// Distance from the undeflected whisker (m).
    pub fn away_m(self) -> f64 {
        self.left_m.hypot(self.up_m)
    }

    /// Direction of the displacement about the whisker's tangent: 0 to the left, a quarter turn upwards.
    pub fn azimuth_rad(self) -> f64 {
        self.up_m.atan2(self.left_m)
    }

    /// The displacement, to the left and upwards (m), 2x1.
    pub(crate) fn displacement(self) -> Vector2<f64> {
        Vector2::new(self.left_m, self.up_m)
    }

    /// The first three entries of a state vector.
    pub fn of_state<const N: usize>(x: &SVector<f64, N>) -> Self {
        Self::new(x[0], x[1], x[2])
    }

    /// The coordinates as a vector, 3x1.
    pub fn vector(self) -> Vector3<f64> {
        Vector3::new(self.along_m, self.left_m, self.up_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Whisker;

    #[test]
    fn verif_coordinates_are_inverted_and_derivatives_are_those_of_differences() {
        for whisker in [Whisker::straight(), Whisker::curved()] {
            let rest = whisker.rest_shape();
            for at in [Around::new(0.03, 2e-3, -1e-3), Around::new(0.051, -4e-3, 3e-3)] {
                let (contact, jacobian) = at.contact_with_jacobian(&rest);
                assert!((Around::of(&rest, contact).vector() - at.vector()).norm() < 1e-12);
                for axis in 0..3 {
                    let step = 1e-7 * Vector3::ith(axis, 1.0);
                    let [after, before] =
                        [at.vector() + step, at.vector() - step].map(|x| Around::of_state(&x).contact(&rest).vector());
                    assert!(((after - before) / 2e-7 - jacobian.column(axis)).norm() < 1e-7, "{at:?} {axis}");
                }
            }
        }
    }
}
