//! Convex outlines, described by their support: the point that lies farthest in a direction.
//!
//! To add an outline: implement [`Outline::support`], and [`Outline::flats`] if it has straight sides.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use crate::frames::{Point, World};
use crate::rest::direction;

/// The point of an outline that lies farthest in a direction, which is the outward normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Support {
    /// The point.
    pub point: Point<World>,
    /// Radius of curvature of the outline there: zero at a corner.
    pub radius_m: f64,
}

/// A straight side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flat {
    /// Angle of the outward normal, in World.
    pub normal_rad: f64,
    /// First end, counter-clockwise.
    pub from: Point<World>,
    /// Second end.
    pub to: Point<World>,
}

/// A closed convex curve.
pub trait Outline {
    /// The point that lies farthest in the direction `normal_rad` (an angle in World, any number of turns). Across the
    /// normal of a straight side it jumps from one end to the other; everywhere else its derivative by the normal is
    /// `radius_m`.
    fn support(&self, normal_rad: f64) -> Support;

    /// The straight sides, by ascending angle of their normals, from 0 to one turn.
    fn flats(&self) -> &[Flat] {
        &[]
    }
}

/// A circle of any radius; of radius zero, a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub center: Point<World>,
    /// Its radius.
    pub radius_m: f64,
}

impl Outline for Circle {
    fn support(&self, normal_rad: f64) -> Support {
        Support { point: self.center.shifted(self.radius_m * direction(normal_rad)), radius_m: self.radius_m }
    }
}

/// An ellipse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// Its centre.
    pub center: Point<World>,
    /// Half its size along its own x and y axes.
    pub semi_axes_m: [f64; 2],
    /// Angle of its x axis in World.
    pub yaw_rad: f64,
}

impl Outline for Ellipse {
    /// With the normal `n` in the ellipse's axes and `h = sqrt(a^2 n_x^2 + b^2 n_y^2)`: `(a^2 n_x, b^2 n_y) / h`,
    /// radius `a^2 b^2 / h^3`.
    fn support(&self, normal_rad: f64) -> Support {
        let [a, b] = self.semi_axes_m;
        let normal = direction(normal_rad - self.yaw_rad);
        let height_m = (a * normal.x).hypot(b * normal.y);
        let local = Vector2::new(a * a * normal.x, b * b * normal.y) / height_m;
        let axis = direction(self.yaw_rad);
        let offset = Vector2::new(axis.x * local.x - axis.y * local.y, axis.y * local.x + axis.x * local.y);
        Support { point: self.center.shifted(offset), radius_m: (a * b).powi(2) / height_m.powi(3) }
    }
}

/// A convex polygon.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    flats: Vec<Flat>,
}

/// Error of vertices that do not form a convex polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "vertex {vertex}: found a straight or clockwise turn, expected three or more vertices counter-clockwise around a convex polygon"
)]
pub struct NotConvex {
    /// Index of the vertex, from 0.
    pub vertex: usize,
}

impl Polygon {
    /// The polygon with these vertices, counter-clockwise.
    ///
    /// # Errors
    /// [`NotConvex`] if they are not those of a convex polygon.
    pub fn new(vertices: &[Point<World>]) -> Result<Self, NotConvex> {
        let count = vertices.len();
        let side = |i: usize| vertices[(i + 1) % count].vector() - vertices[i % count].vector();
        let mut turned_rad = 0.0;
        for i in 0..count {
            let (before, after) = (side(i + count - 1), side(i));
            let turn_rad = before.perp(&after).atan2(before.dot(&after));
            if turn_rad <= 0.0 || turn_rad.is_nan() {
                return Err(NotConvex { vertex: i });
            }
            turned_rad += turn_rad;
        }
        // A star turns to the left at every vertex as well, but more than once around.
        if count < 3 || turned_rad > 1.5 * TAU {
            return Err(NotConvex { vertex: 0 });
        }
        let flat = |i: usize| {
            let along = side(i);
            let normal_rad = (-along.x).atan2(along.y).rem_euclid(TAU);
            Flat { normal_rad, from: vertices[i], to: vertices[(i + 1) % count] }
        };
        let mut flats: Vec<Flat> = (0..count).map(flat).collect();
        flats.sort_by(|a, b| a.normal_rad.total_cmp(&b.normal_rad));
        Ok(Self { flats })
    }
}

impl Outline for Polygon {
    fn support(&self, normal_rad: f64) -> Support {
        let normal_rad = normal_rad.rem_euclid(TAU);
        let next = self.flats.partition_point(|flat| flat.normal_rad < normal_rad) % self.flats.len();
        Support { point: self.flats[next].from, radius_m: 0.0 }
    }

    fn flats(&self) -> &[Flat] {
        &self.flats
    }
}
