//! The class `Shape`: a convex object in the plane.

use ::whisker::elastica::{Circle, Ellipse, Outline, Polygon};
use ::whisker::frames::Point;
use numpy::ndarray::Axis;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use std::f64::consts::TAU;

use crate::arrays::{Numbers, points, points_of_rows};
use crate::error::{raised, refused};
use crate::interrupt;

/// Convex object in World, against which `simulate` presses a whisker.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Shape {
    pub(crate) name: &'static str,
    pub(crate) outline: Box<dyn Outline + Send + Sync>,
}

#[pymethods]
impl Shape {
    /// Thin pin with this centre and radius (m).
    #[staticmethod]
    #[pyo3(signature = (center, radius_m=0.5e-3))]
    fn pin(center: [f64; 2], radius_m: f64) -> PyResult<Self> {
        Ok(Self { name: "pin", ..Self::circle(center, radius_m)? })
    }

    /// Circle with this centre and radius (m).
    #[staticmethod]
    fn circle(center: [f64; 2], radius_m: f64) -> PyResult<Self> {
        positive("radius_m", radius_m)?;
        Ok(Self { name: "circle", outline: Box::new(Circle { center: point(center)?, radius_m }) })
    }

    /// Ellipse with this centre and semi-axes along its own x and y (m), turned by `yaw_rad`.
    #[staticmethod]
    #[pyo3(signature = (center, semi_axes_m, yaw_rad=0.0))]
    fn ellipse(center: [f64; 2], semi_axes_m: [f64; 2], yaw_rad: f64) -> PyResult<Self> {
        for semi_axis_m in semi_axes_m {
            positive("semi_axes_m", semi_axis_m)?;
        }
        if !yaw_rad.is_finite() {
            return Err(refused("yaw_rad", yaw_rad, "a finite number"));
        }
        Ok(Self { name: "ellipse", outline: Box::new(Ellipse { center: point(center)?, semi_axes_m, yaw_rad }) })
    }

    /// Convex polygon with these vertices (n, 2), counter-clockwise (m).
    #[staticmethod]
    fn polygon(vertices: Numbers<'_>) -> PyResult<Self> {
        let vertices = points("vertices", &vertices)?;
        Ok(Self { name: "polygon", outline: Box::new(Polygon::new(&vertices).map_err(raised)?) })
    }

    /// Points (count, 2) of the outline, counter-clockwise, evenly spaced by the angle of the normal (m). The array has at most
    /// 1e8 numbers.
    #[pyo3(signature = (count=361))]
    fn points<'py>(&self, py: Python<'py>, count: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut points = points_of_rows(1, count, 1, 2)?.remove_axis(Axis(0));
        interrupt::each(py, count, |i| {
            let point = self.outline.support(TAU * i as f64 / (count - 1).max(1) as f64).point;
            (points[[i, 0]], points[[i, 1]]) = (point.x(), point.y());
            Ok(())
        })?;
        Ok(points.into_pyarray(py))
    }

    fn __repr__(&self) -> String {
        format!("<Shape: {}>", self.name)
    }
}

fn point<F>([x_m, y_m]: [f64; 2]) -> PyResult<Point<F>> {
    if x_m.is_finite() && y_m.is_finite() {
        return Ok(Point::new(x_m, y_m));
    }
    Err(refused("center", format!("{:?}", [x_m, y_m]), "finite numbers"))
}

fn positive(what: &str, number: f64) -> PyResult<()> {
    if number.is_finite() && number > 0.0 { Ok(()) } else { Err(refused(what, number, "a positive number")) }
}
