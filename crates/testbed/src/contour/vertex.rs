//! Vertices of an outline.

use nalgebra::{Matrix2, Vector2};
use whisker::frames::{Point, World};

/// One vertex of a contour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Point of the surface in World.
    pub at: Point<World>,
    /// Direction of the outward normal in World.
    pub normal_rad: f64,
    /// Covariance of the point. `None` if the estimator states none.
    pub covariance_m2: Option<Matrix2<f64>>,
    /// Whether it was touched; otherwise it bridges two touched stretches.
    pub touched: bool,
}

impl Vertex {
    /// Standard deviation across the outline.
    pub fn sd_m(&self) -> Option<f64> {
        let normal = direction(self.normal_rad);
        Some(normal.dot(&(self.covariance_m2? * normal)).sqrt())
    }
}

/// Part of an outline: vertices counter-clockwise around the object, joined by straight lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contour {
    /// Vertices.
    pub vertices: Vec<Vertex>,
}

/// Unit vector at an angle.
pub(crate) fn direction(angle_rad: f64) -> Vector2<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Vector2::new(cos, sin)
}
