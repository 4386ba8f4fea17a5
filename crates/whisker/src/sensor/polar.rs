//! Coordinates in which the region within a whisker's reach is nearly a rectangle, for any pre-curvature.
//!
//! They are polar: the distance `r` from the root, and the polar angle less that of a parabola `b(r)` through the
//! undeflected whisker, positive away from the object. Unlike the coordinates along and away from the undeflected
//! whisker they have no kink where its curvature jumps.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::Region;
use crate::frames::{Base, Point};
use crate::rest::direction;

/// Smallest distance from the root, relative to the whisker's length: at the root the angle is undefined.
const NEAREST: f64 = 0.02;

/// Number of points along the region's border from which its extent is computed.
const BORDER: usize = 65;

/// The coordinates beside one face of a whisker.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// Direction of the middle of the region, from which angles are measured.
    ahead: Vector2<f64>,
    /// +1 if away from the object is to the left, -1 otherwise.
    sign: f64,
    /// `b(r)`, by powers of `r`.
    parabola: Vector3<f64>,
    /// Smallest and largest `r` and angle of the region.
    pub(super) first: [f64; 2],
    pub(super) last: [f64; 2],
}

/// A contact in the coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polar {
    /// Distance from the root and angle.
    pub(super) at: [f64; 2],
    /// Derivatives of both by the position in Base.
    slopes: [Vector2<f64>; 2],
}

impl Frame {
    /// The coordinates beside the region's whisker. `None` if the region has no extent.
    pub(super) fn new(region: &Region<'_>) -> Option<Self> {
        let rest = region.whisker.rest_shape();
        let (low, high) = region.domain.arc_range_m();
        let ahead = rest.point(0.5 * (low + high)).vector().normalize();
        let sign = region.face.away_sign();
        let (first, last) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut frame = Self { ahead, sign, parabola: Vector3::zeros(), first, last };

        let arcs = || (0..BORDER).map(|i| low + (high - low) * i as f64 / (BORDER - 1) as f64);
        let (mut squares, mut products) = (Matrix3::zeros(), Vector3::zeros());
        for arc_m in arcs() {
            let [r_m, angle_rad] = frame.polar(rest.point(arc_m)).at;
            let powers = Vector3::new(1.0, r_m, r_m * r_m);
            squares += powers * powers.transpose();
            products += powers * (sign * angle_rad);
        }
        frame.parabola = squares.cholesky()?.solve(&products);

        for arc_m in arcs() {
            let (lower, upper) = region.domain.away_range_m(arc_m);
            for away_m in [lower, upper] {
                let at = frame.polar(rest.beside(arc_m, away_m * sign)).at;
                for (axis, value) in at.into_iter().enumerate() {
                    frame.first[axis] = frame.first[axis].min(value);
                    frame.last[axis] = frame.last[axis].max(value);
                }
            }
        }
        frame.first[0] = frame.first[0].max(NEAREST * region.whisker.length_m);
        (0..2).all(|axis| frame.last[axis] > frame.first[axis]).then_some(frame)
    }

    /// The coordinates of a contact.
    pub(super) fn polar(&self, contact: Point<Base>) -> Polar {
        let p = contact.vector();
        let (along, left) = (self.ahead.dot(&p), self.ahead.perp(&p));
        let r_m = (along * along + left * left).sqrt();
        let outward = p / r_m;
        let around = Vector2::new(-outward.y, outward.x) / r_m;
        let (bent_rad, slope) = self.bent(r_m);
        Polar {
            at: [r_m, self.sign * (left.atan2(along) - bent_rad)],
            slopes: [outward, self.sign * (around - slope * outward)],
        }
    }

    /// The contact with these coordinates.
    pub(super) fn contact(&self, [r_m, angle_rad]: [f64; 2]) -> Point<Base> {
        let turned = direction(self.sign * angle_rad + self.bent(r_m).0);
        let e = self.ahead;
        Point::from_vector(Vector2::new(e.x * turned.x - e.y * turned.y, e.y * turned.x + e.x * turned.y) * r_m)
    }

    /// `b(r)` and its derivative.
    fn bent(&self, r_m: f64) -> (f64, f64) {
        let [b0, b1, b2] = self.parabola.into();
        (b0 + r_m * (b1 + r_m * b2), b1 + 2.0 * r_m * b2)
    }
}

impl Polar {
    /// Converts a gradient by the position in Base into one by the coordinates.
    pub(super) fn by_coordinates(&self, gradient: Vector2<f64>) -> Vector2<f64> {
        // The transposed inverse of the coordinates' derivatives.
        let [r, angle] = self.slopes;
        Vector2::new(gradient.perp(&angle), r.perp(&gradient)) / r.perp(&angle)
    }

    /// Converts a gradient by the coordinates into one by the position in Base.
    pub(super) fn by_place(&self, slopes: Vector2<f64>) -> Vector2<f64> {
        slopes.x * self.slopes[0] + slopes.y * self.slopes[1]
    }
}
