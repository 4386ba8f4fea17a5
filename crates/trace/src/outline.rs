//! Outlines of objects as closed polylines.

use std::path::Path;

use files::Error;
use files::read_table;
use files::table::{cell_error, number, reader};
use nalgebra::Vector2;
use whisker::frames::{Point, World};

use crate::table::FARTHEST_M;

/// Sine of the angle below which an outline turns only by the rounding of its vertices.
const LEAST_TURN: f64 = 1e-4;

const COLUMNS: [&str; 2] = ["x_m", "y_m"];

/// Outline of an object in World: a closed, counter-clockwise polyline whose first vertex is repeated at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    vertices: Vec<Point<World>>,
}

impl Outline {
    /// Closed outline through these vertices. `None` unless there are at least three and the last equals the first.
    pub fn new(vertices: Vec<Point<World>>) -> Option<Self> {
        (vertices.len() >= 4 && vertices.first() == vertices.last()).then_some(Self { vertices })
    }

    /// Reads an outline file.
    ///
    /// # Errors
    /// [`Error`] with file, line and column.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::parse(path, &read_table(path)?)
    }

    /// Parses the contents of an outline file. `path` is used in error messages.
    ///
    /// # Errors
    /// [`Error`] with file, line and column.
    pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let mut vertices = Vec::new();
        for row in reader(path, bytes, &COLUMNS)? {
            let (line, record) = row?;
            let x = number(path, line, &record, &COLUMNS, 0)?;
            let y = number(path, line, &record, &COLUMNS, 1)?;
            if let Some(column) = [x, y].iter().position(|place| place.abs() > FARTHEST_M) {
                return Err(cell_error(
                    path,
                    line,
                    &record,
                    &COLUMNS,
                    column,
                    &format!("a coordinate of at most {FARTHEST_M} m"),
                ));
            }
            vertices.push(Point::new(x, y));
        }
        let found = vertices.len();
        Self::new(vertices).ok_or_else(|| {
            Error::value(
                path,
                "vertices",
                format!("{found}"),
                "a closed outline: at least three, the first repeated at the end",
            )
        })
    }

    /// Contents of the outline file in CSV.
    pub fn to_csv(&self) -> String {
        let rows = self.vertices.iter().map(|vertex| format!("{:.10},{:.10}\n", vertex.x(), vertex.y()));
        std::iter::once(format!("{}\n", COLUMNS.join(","))).chain(rows).collect()
    }

    /// Vertices; the first is repeated at the end.
    pub fn vertices(&self) -> &[Point<World>] {
        &self.vertices
    }

    /// Mean of the distinct vertices.
    pub fn middle(&self) -> Point<World> {
        let vertices = &self.vertices[1..];
        Point::from_vector(vertices.iter().map(|vertex| vertex.vector()).sum::<Vector2<f64>>() / vertices.len() as f64)
    }

    /// Whether the outline is convex: it nowhere turns to the other side by more than rounding explains.
    pub fn is_convex(&self) -> bool {
        let sides: Vec<Vector2<f64>> = self
            .vertices
            .windows(2)
            .map(|edge| edge[1].vector() - edge[0].vector())
            .filter(|side| *side != Vector2::zeros())
            .collect();
        let turns = (0..sides.len()).map(|i| {
            let (side, next) = (sides[i], sides[(i + 1) % sides.len()]);
            side.perp(&next) / (side.norm() * next.norm())
        });
        let (low, high) = turns.fold((0.0_f64, 0.0_f64), |(low, high), turn| (low.min(turn), high.max(turn)));
        low.abs().min(high) < LEAST_TURN
    }

    /// Unsigned distance from a point to the outline.
    pub fn distance_m(&self, point: Point<World>) -> f64 {
        self.vertices
            .windows(2)
            .map(|edge| squared_distance_to_segment(point.vector(), edge[0].vector(), edge[1].vector()))
            .fold(f64::INFINITY, f64::min)
            .sqrt()
    }
}

fn squared_distance_to_segment(p: Vector2<f64>, a: Vector2<f64>, b: Vector2<f64>) -> f64 {
    let edge = b - a;
    let length2 = edge.norm_squared();
    let part = if length2 > 0.0 { ((p - a).dot(&edge) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (p - a - edge * part).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_notch_is_not_convex() {
        let closed =
            |corners: &[(f64, f64)]| Outline::new(corners.iter().map(|&(x, y)| Point::new(x, y)).collect()).unwrap();
        let square = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
        let notched = [(0.0, 0.0), (0.5, 0.2), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
        assert!(closed(&square).is_convex() && !closed(&notched).is_convex());
        let reversed: Vec<_> = square.into_iter().rev().collect();
        assert!(closed(&reversed).is_convex());
    }

    #[test]
    fn verif_distance_to_a_square() {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
        let square = Outline::new(corners.iter().map(|&(x, y)| Point::new(x, y)).collect()).unwrap();
        assert_eq!(square.distance_m(Point::new(0.5, 0.2)), 0.2);
        assert_eq!(square.distance_m(Point::new(4.0, 5.0)), 5.0);
        assert_eq!(square.distance_m(Point::new(1.0, 0.5)), 0.0);
    }
}
