//! Coordinates of a contact about the undeflected whisker.

use nalgebra::{Matrix3, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::frames::{self, Base};
use crate::space::frames::Point;
use crate::{RestShape, Whisker};

/// Largest distance (m) between a contact and the point at its coordinates, for coordinates that count as unique.
const UNIQUE_M: f64 = 1e-6;

/// Direction in the whisker's plane in which coordinates displace a contact from the undeflected whisker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Across {
    /// The left normal of the whisker. Coordinates are unique at distances below the whisker's smallest radius of curvature.
    #[default]
    Normal,
    /// The left normal of the line from root to tip. Coordinates are unique at all distances if the whisker turns by less than a
    /// right angle from this line.
    Chord,
}

impl Across {
    /// The direction for which more of these contacts have unique coordinates; the normal if their numbers are equal.
    pub fn of(whisker: &Whisker, contacts: &[Point<Base>]) -> Self {
        let ambiguous = |across: Self| {
            let axis = Axis::new(whisker, across);
            contacts.iter().filter(|contact| !axis.is_unique(**contact)).count()
        };
        if ambiguous(Self::Chord) < ambiguous(Self::Normal) { Self::Chord } else { Self::Normal }
    }

    /// Whether this is the default.
    pub(crate) fn is_normal(&self) -> bool {
        *self == Self::Normal
    }
}

/// The undeflected whisker, which lies in the plane `z = 0` of Base, as the axis of coordinates about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    rest: RestShape,
    /// Direction of the chord, the line from root to tip. `None` if contacts are displaced along the normal.
    chord: Option<Vector2<f64>>,
}

impl Axis {
    /// The axis of a whisker.
    pub fn new(whisker: &Whisker, across: Across) -> Self {
        let rest = whisker.rest_shape();
        let chord = match across {
            Across::Normal => None,
            Across::Chord => Some(rest.point(rest.length_m()).vector().normalize()),
        };
        Self { rest, chord }
    }

    /// The undeflected whisker.
    pub fn rest(&self) -> &RestShape {
        &self.rest
    }

    /// Whether contacts have coordinates. Across the chord, they do only if the whisker turns by less than a right angle from it.
    pub fn is_usable(&self) -> bool {
        self.chord.is_none_or(|chord| self.rest.advances_along(chord))
    }

    /// Whether the coordinates of the contact are unique, with a point between root and tip.
    pub fn is_unique(&self, contact: Point<Base>) -> bool {
        let at = Around::of(self, contact);
        let is_near = self.chord.is_some() || at.away_m() * self.rest.largest_curvature_per_m() < 1.0;
        self.is_usable()
            && is_near
            && (0.0..=self.rest.length_m()).contains(&at.along_m)
            && at.contact(self).distance(&contact) < UNIQUE_M
    }
}

/// Left normal of a direction in the plane.
fn left(direction: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-direction.y, direction.x)
}

/// Coordinates of a contact about the undeflected whisker ([`Axis`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// Arc length of the point of the undeflected whisker from which the contact is displaced, from the root (m).
    pub along_m: f64,
    /// Displacement from that point to the left (m), in the direction of [`Across`].
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
    pub fn of(axis: &Axis, contact: Point<Base>) -> Self {
        let [x, y, z] = contact.vector().into();
        let Some(chord) = axis.chord else {
            let foot = axis.rest.foot(frames::Point::new(x, y));
            return Self::new(foot.arc_m, foot.left_m, z);
        };
        let contact = Vector2::new(x, y);
        let along_m = axis.rest.arc_at_projection(chord, contact.dot(&chord));
        Self::new(along_m, left(chord).dot(&(contact - axis.rest.point(along_m).vector())), z)
    }

    /// The contact with these coordinates, and its derivatives by them, 3x3.
    pub fn contact_with_jacobian(self, axis: &Axis) -> (Point<Base>, Matrix3<f64>) {
        let (contact, along, across) = match axis.chord {
            None => {
                let (contact, tangent) = axis.rest.beside_with_tangent(self.along_m, self.left_m);
                let stretch = 1.0 - axis.rest.curvature_per_m(self.along_m) * self.left_m;
                (contact.vector(), tangent * stretch, left(tangent))
            }
            Some(chord) => (self.beside(axis, chord), axis.rest.tangent(self.along_m), left(chord)),
        };
        let columns = [Vector3::new(along.x, along.y, 0.0), Vector3::new(across.x, across.y, 0.0), Vector3::z()];
        (Point::new(contact.x, contact.y, self.up_m), Matrix3::from_columns(&columns))
    }

    /// The contact with these coordinates.
    pub fn contact(self, axis: &Axis) -> Point<Base> {
        let contact = match axis.chord {
            None => axis.rest.beside(self.along_m, self.left_m).vector(),
            Some(chord) => self.beside(axis, chord),
        };
        Point::new(contact.x, contact.y, self.up_m)
    }

    /// Position in the plane of a contact that is displaced across the chord.
    fn beside(self, axis: &Axis, chord: Vector2<f64>) -> Vector2<f64> {
        axis.rest.point(self.along_m).vector() + left(chord) * self.left_m
    }

    /// Distance from the undeflected whisker (m).
    pub fn away_m(self) -> f64 {
        self.left_m.hypot(self.up_m)
    }

    /// Direction of the displacement about the whisker: 0 to the left, a quarter turn upwards.
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
    use crate::Curvature;
    use crate::space::sensor::testing::hook;

    #[test]
    fn verif_coordinates_are_inverted_and_derivatives_are_those_of_differences() {
        let axes = [Whisker::straight(), Whisker::curved()]
            .into_iter()
            .flat_map(|whisker| [Across::Normal, Across::Chord].map(|across| Axis::new(&whisker, across)));
        for axis in axes {
            for at in [Around::new(0.03, 2e-3, -1e-3), Around::new(0.051, -4e-3, 3e-3)] {
                let (contact, jacobian) = at.contact_with_jacobian(&axis);
                assert!((Around::of(&axis, contact).vector() - at.vector()).norm() < 1e-12);
                for entry in 0..3 {
                    let step = 1e-7 * Vector3::ith(entry, 1.0);
                    let [after, before] =
                        [at.vector() + step, at.vector() - step].map(|x| Around::of_state(&x).contact(&axis).vector());
                    assert!(((after - before) / 2e-7 - jacobian.column(entry)).norm() < 1e-7, "{at:?} {entry}");
                }
            }
        }
    }

    #[test]
    fn verif_contacts_beyond_the_radius_of_curvature_are_unique_across_the_chord() {
        let whisker = hook();
        let [normal, chord] = [Across::Normal, Across::Chord].map(|across| Axis::new(&whisker, across));
        let far = Around::new(0.045, 25e-3, 1e-3).contact(&chord);
        assert!(!normal.is_unique(far) && chord.is_unique(far));
        assert_eq!(Across::of(&whisker, &[far]), Across::Chord);
        let near = Around::new(0.045, 5e-3, 1e-3).contact(&normal);
        assert_eq!(Across::of(&whisker, &[near]), Across::Normal);
        for along_m in [-1e-3, 0.054] {
            let beyond = Around::new(along_m, 0.0, 0.0).contact(&chord);
            assert!(!normal.is_unique(beyond) && !chord.is_unique(beyond), "{along_m}");
        }
        // Tangents at 120 degrees to the chord at both ends.
        let coil = Curvature { length_m: 0.053, curvature_per_m: 80.0 };
        let coiled = Axis::new(&Whisker { curvature: [coil].into(), ..whisker }, Across::Chord);
        assert!(!coiled.is_usable() && !coiled.is_unique(Around::new(0.02, 1e-3, 0.0).contact(&coiled)));
    }
}
