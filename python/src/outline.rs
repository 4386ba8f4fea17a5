//! The class `Outline`.

use ::whisker::estimators::OutlinePoint;
use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use testbed::contour::{Circle, Contour, Vertex};

use crate::arrays::{column, flags, matrices, vectors};

/// Estimated outline of an object: k points counter-clockwise, each with its uncertainty.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Outline {
    frame: &'static str,
    vertices: Vec<Vertex>,
    circle: Option<Circle>,
}

impl Outline {
    /// Outline in World, with a circle if it is round.
    pub(crate) fn of_contour(contour: Contour) -> Self {
        let circle = Circle::round(&contour);
        Self { frame: "World", vertices: contour.vertices, circle }
    }

    /// Outline that an estimator carries, in Start.
    pub(crate) fn carried(points: &[OutlinePoint]) -> Self {
        let vertex = |point: &OutlinePoint| Vertex {
            at: ::whisker::frames::Point::from_vector(point.surface.vector()),
            normal_rad: point.normal.y.atan2(point.normal.x),
            covariance_m2: Some(point.covariance_m2),
            touched: true,
        };
        Self { frame: "Start", vertices: points.iter().map(vertex).collect(), circle: None }
    }

    fn map<T>(&self, value: impl Fn(&Vertex) -> T) -> impl ExactSizeIterator<Item = T> {
        self.vertices.iter().map(value)
    }
}

#[pymethods]
impl Outline {
    /// Frame of the points: `World`, or `Start`, the base's frame at the first sample.
    #[getter]
    fn frame(&self) -> &str {
        self.frame
    }

    /// Points of the surface (k, 2), in m.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|vertex| Some(vertex.at.vector())))
    }

    /// Outward unit normals (k, 2).
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|vertex| Some(Vector2::new(vertex.normal_rad.cos(), vertex.normal_rad.sin()))))
    }

    /// Covariances of the points (k, 2, 2), in m2. NaN for estimators without a covariance.
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|vertex| vertex.covariance_m2))
    }

    /// Standard deviations across the outline (k), in m.
    #[getter]
    fn sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.map(Vertex::sd_m))
    }

    /// Whether each point was touched (k); otherwise it bridges two touched stretches.
    #[getter]
    fn touched<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.map(|vertex| vertex.touched))
    }

    /// Circle fitted to the outline: `center_x_m`, `center_y_m`, `radius_m`, the ends `low_m` and `high_m` of the 95 % interval
    /// of the radius (`None` if it includes a straight line) and `residual_rms_m`. `None` unless the outline is round.
    #[getter]
    fn circle<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(circle) = &self.circle else { return Ok(None) };
        let fields = PyDict::new(py);
        fields.set_item("center_x_m", circle.center.x())?;
        fields.set_item("center_y_m", circle.center.y())?;
        fields.set_item("radius_m", circle.radius_m)?;
        fields.set_item("low_m", circle.low_m)?;
        fields.set_item("high_m", circle.high_m)?;
        fields.set_item("residual_rms_m", circle.residual_rms_m)?;
        Ok(Some(fields))
    }

    fn __len__(&self) -> usize {
        self.vertices.len()
    }

    fn __repr__(&self) -> String {
        format!("<Outline of {} points in {}>", self.vertices.len(), self.frame)
    }
}
