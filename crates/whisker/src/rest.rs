//! The undeflected centre line: a chain of circular arcs and straight pieces, tangent to +x at the root.

use nalgebra::Vector2;

use crate::Curvature;
use crate::frames::{Base, Point};

/// Length by which a search continues the line beyond each end, relative to the length of the line.
const CONTINUED: f64 = 0.1;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    start_m: f64,
    length_m: f64,
    curvature_per_m: f64,
    origin: Vector2<f64>,
    angle_rad: f64,
    /// Direction of the tangent at the piece's start.
    tangent: Vector2<f64>,
}

/// The undeflected centre line of a whisker, in Base.
#[derive(Clone, Debug, PartialEq)]
pub struct RestShape {
    pieces: Vec<Piece>,
    /// Distance of the tip from the root.
    tip_radius_m: f64,
}

/// Foot of the perpendicular from a point of the plane to the undeflected whisker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Arc length of the nearest point.
    pub arc_m: f64,
    /// Signed distance, positive to the left of the whisker. Beyond an end the sign is that of the side.
    pub left_m: f64,
}

impl Piece {
    fn angle_rad(&self, along_m: f64) -> f64 {
        self.angle_rad + self.curvature_per_m * along_m
    }

    /// A vector written along and to the left of the tangent at the piece's start, in Base.
    fn turned(&self, along: f64, left: f64) -> Vector2<f64> {
        let t = self.tangent;
        Vector2::new(t.x * along - t.y * left, t.y * along + t.x * left)
    }

    /// Point and direction of the tangent at `along_m` from the piece's start.
    #[inline]
    fn frame(&self, along_m: f64) -> (Vector2<f64>, Vector2<f64>) {
        let curvature = self.curvature_per_m;
        if curvature == 0.0 {
            return (self.origin + self.tangent * along_m, self.tangent);
        }
        // The half angle keeps the digits of a slight curvature, which 1 - cos would lose.
        let (sin, cos) = (0.5 * curvature * along_m).sin_cos();
        let point = self.origin + self.turned(2.0 * sin * cos / curvature, 2.0 * sin * sin / curvature);
        (point, self.turned(1.0 - 2.0 * sin * sin, 2.0 * sin * cos))
    }

    /// The nearest point of the piece.
    #[inline]
    fn foot(&self, p: Vector2<f64>) -> Foot {
        let offset = p - self.origin;
        let along = self.tangent.dot(&offset);
        let left = self.tangent.x * offset.y - self.tangent.y * offset.x;
        let curvature = self.curvature_per_m;
        let (arc_m, left_m) = if curvature == 0.0 {
            (along, left)
        } else {
            // In units of the radius, relative to the centre of curvature; near one or a little more, so nothing can
            // overflow.
            let (ahead, inwards) = (curvature * along, 1.0 - curvature * left);
            let radii = (ahead * ahead + inwards * inwards).sqrt();
            let left_m = (2.0 * left - curvature * (along * along + left * left)) / (1.0 + radii);
            (ahead.atan2(inwards) / curvature, left_m)
        };
        if (0.0..=self.length_m).contains(&arc_m) {
            return Foot { arc_m: self.start_m + arc_m, left_m };
        }
        let end = arc_m.clamp(0.0, self.length_m);
        let (point, tangent) = self.frame(end);
        let offset = p - point;
        let left = tangent.x * offset.y - tangent.y * offset.x;
        Foot { arc_m: self.start_m + end, left_m: offset.norm().copysign(left) }
    }
}

impl RestShape {
    /// The centre line with these pieces, from root to tip.
    pub fn new(curvature: &[Curvature]) -> Self {
        let mut pieces: Vec<Piece> = Vec::with_capacity(curvature.len());
        let (mut start_m, mut origin, mut angle_rad) = (0.0, Vector2::zeros(), 0.0);
        for &Curvature { length_m, curvature_per_m } in curvature {
            let tangent = direction(angle_rad);
            let piece = Piece { start_m, length_m, curvature_per_m, origin, angle_rad, tangent };
            (start_m, origin, angle_rad) = (start_m + length_m, piece.frame(length_m).0, piece.angle_rad(length_m));
            pieces.push(piece);
        }
        Self { pieces, tip_radius_m: origin.norm() }
    }

    #[inline]
    fn piece(&self, arc_m: f64) -> &Piece {
        let index = self.pieces.partition_point(|piece| piece.start_m <= arc_m);
        &self.pieces[index.saturating_sub(1)]
    }

    /// Length from root to tip.
    pub fn length_m(&self) -> f64 {
        self.pieces.last().map_or(0.0, |last| last.start_m + last.length_m)
    }

    /// The point at arc length `arc_m`; beyond the ends the line is continued.
    pub fn point(&self, arc_m: f64) -> Point<Base> {
        let piece = self.piece(arc_m);
        Point::from_vector(piece.frame(arc_m - piece.start_m).0)
    }

    /// Direction of the tangent at arc length `arc_m`, a unit vector.
    pub fn tangent(&self, arc_m: f64) -> Vector2<f64> {
        let piece = self.piece(arc_m);
        piece.frame(arc_m - piece.start_m).1
    }

    /// Angle of the tangent at arc length `arc_m`.
    pub fn tangent_rad(&self, arc_m: f64) -> f64 {
        let piece = self.piece(arc_m);
        piece.angle_rad(arc_m - piece.start_m)
    }

    /// Curvature at arc length `arc_m`, positive if the whisker bends to the left.
    pub fn curvature_per_m(&self, arc_m: f64) -> f64 {
        self.piece(arc_m).curvature_per_m
    }

    /// The nearest point of the undeflected whisker. `point(foot.arc_m)` plus `foot.left_m` along the left normal is
    /// `p` again, unless the foot is an end.
    #[inline]
    pub fn foot(&self, p: Point<Base>) -> Foot {
        let mut best = Foot { arc_m: 0.0, left_m: f64::INFINITY };
        for piece in &self.pieces {
            let foot = piece.foot(p.vector());
            if foot.left_m.abs() < best.left_m.abs() {
                best = foot;
            }
        }
        best
    }

    /// The point that lies `left_m` to the left of the whisker at arc length `arc_m`.
    pub fn beside(&self, arc_m: f64, left_m: f64) -> Point<Base> {
        self.beside_with_tangent(arc_m, left_m).0
    }

    /// As [`Self::beside`], with the direction of the whisker's tangent.
    pub fn beside_with_tangent(&self, arc_m: f64, left_m: f64) -> (Point<Base>, Vector2<f64>) {
        let (point, tangent) = self.frame(arc_m);
        (Point::from_vector(point + Vector2::new(-tangent.y, tangent.x) * left_m), tangent)
    }

    /// Arc length of the point at distance `radius_m` from the root, the first one from the root outwards; the length
    /// if the whisker does not reach so far.
    pub fn arc_at_radius(&self, radius_m: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.length_m());
        if self.tip_radius_m <= radius_m {
            return high;
        }
        // The distance from the root grows along a whisker that turns by less than half a circle: Newton's method, held
        // between bounds.
        let close_enough = 4.0 * f64::EPSILON * high;
        let mut arc_m = radius_m;
        for _ in 0..60 {
            let (point, tangent) = self.frame(arc_m);
            let found_m = point.norm();
            if found_m < radius_m {
                low = arc_m;
            } else {
                high = arc_m;
            }
            let step_m = (radius_m - found_m) * found_m / point.dot(&tangent);
            if step_m.abs() <= close_enough {
                break;
            }
            let next_m = arc_m + step_m;
            arc_m = if low < next_m && next_m < high { next_m } else { 0.5 * (low + high) };
        }
        arc_m
    }

    /// Arc length of the point whose projection onto `direction`, a unit vector, is `projection_m`. The whisker must turn by less
    /// than a right angle from this direction. Beyond each end, the line is continued by up to a tenth of its length.
    pub fn arc_at_projection(&self, direction: Vector2<f64>, projection_m: f64) -> f64 {
        let length_m = self.length_m();
        let (mut low, mut high) = (-CONTINUED * length_m, (1.0 + CONTINUED) * length_m);
        let close_enough = 4.0 * f64::EPSILON * length_m;
        let mut arc_m = projection_m.clamp(low, high);
        for _ in 0..60 {
            let (point, tangent) = self.frame(arc_m);
            let missing_m = projection_m - point.dot(&direction);
            if missing_m > 0.0 {
                low = arc_m;
            } else {
                high = arc_m;
            }
            // Newton's method, held between bounds.
            let step_m = missing_m / tangent.dot(&direction);
            if step_m.abs() <= close_enough {
                break;
            }
            let next_m = arc_m + step_m;
            arc_m = if low < next_m && next_m < high { next_m } else { 0.5 * (low + high) };
        }
        arc_m
    }

    /// Whether the tangent is everywhere at less than a right angle to `direction`.
    pub fn advances_along(&self, direction: Vector2<f64>) -> bool {
        self.pieces.iter().all(|piece| {
            let turns_less = (piece.curvature_per_m * piece.length_m).abs() < std::f64::consts::PI;
            turns_less && [0.0, piece.length_m].iter().all(|end_m| piece.frame(*end_m).1.dot(&direction) > 0.0)
        })
    }

    /// Largest absolute curvature.
    pub fn largest_curvature_per_m(&self) -> f64 {
        self.pieces.iter().map(|piece| piece.curvature_per_m.abs()).fold(0.0, f64::max)
    }

    /// Point and tangent at an arc length.
    fn frame(&self, arc_m: f64) -> (Vector2<f64>, Vector2<f64>) {
        let piece = self.piece(arc_m);
        piece.frame(arc_m - piece.start_m)
    }
}

pub(crate) fn direction(angle_rad: f64) -> Vector2<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Vector2::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hook() -> RestShape {
        RestShape::new(&[
            Curvature { length_m: 0.02, curvature_per_m: 0.0 },
            Curvature { length_m: 0.03, curvature_per_m: 1.0 / 0.018 },
        ])
    }

    #[test]
    fn val_arc_of_known_radius() {
        let shape = RestShape::new(&[Curvature { length_m: 0.08, curvature_per_m: 1.0 / 0.08 }]);
        let tip = shape.point(0.08);
        assert!((tip.x() - 0.08 * 1.0_f64.sin()).abs() < 1e-15);
        assert!((tip.y() - 0.08 * (1.0 - 1.0_f64.cos())).abs() < 1e-15);
        assert!((shape.tangent_rad(0.04) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn verif_foot_inverts_beside() {
        let shape = hook();
        for arc_m in [0.001, 0.012, 0.02, 0.021, 0.035, 0.049] {
            for left_m in [-0.02, -0.003, 0.0, 0.004, 0.01] {
                let foot = shape.foot(shape.beside(arc_m, left_m));
                assert!((foot.arc_m - arc_m).abs() < 1e-12, "{arc_m} {left_m} {foot:?}");
                assert!((foot.left_m - left_m).abs() < 1e-12, "{arc_m} {left_m} {foot:?}");
            }
        }
    }

    #[test]
    fn verif_projection_is_inverted() {
        let shape = hook();
        let chord = shape.point(shape.length_m()).vector().normalize();
        for arc_m in [-0.002, 0.0, 0.012, 0.02, 0.033, 0.05, 0.052] {
            let found_m = shape.arc_at_projection(chord, shape.point(arc_m).vector().dot(&chord));
            assert!((found_m - arc_m).abs() < 1e-12, "{arc_m} {found_m}");
        }
    }

    #[test]
    fn verif_radius_is_inverted() {
        let shape = hook();
        let arc_m = shape.arc_at_radius(shape.point(0.033).vector().norm());
        assert!((arc_m - 0.033).abs() < 1e-12);
    }
}
