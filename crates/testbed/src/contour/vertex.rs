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

impl Contour {
    /// Length of the lines between neighbouring vertices that were both touched (m).
    pub fn touched_length_m(&self) -> f64 {
        let lines = self.vertices.windows(2).filter(|line| line[0].touched && line[1].touched);
        lines.map(|line| line[0].at.distance(&line[1].at)).sum()
    }
}

/// Unit vector at an angle.
pub(crate) fn direction(angle_rad: f64) -> Vector2<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Vector2::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_bridges_are_no_touched_length() {
        let vertex = |x_m: f64, touched: bool| Vertex {
            at: Point::new(x_m, 0.0),
            normal_rad: 0.0,
            covariance_m2: None,
            touched,
        };
        let vertices =
            vec![vertex(0.0, true), vertex(1e-3, true), vertex(3e-3, false), vertex(7e-3, true), vertex(9e-3, true)];
        assert!((Contour { vertices }.touched_length_m() - 3e-3).abs() < 1e-15);
        assert_eq!(Contour::default().touched_length_m(), 0.0);
    }
}
