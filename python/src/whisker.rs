//! The class `Whisker`.

use ::whisker::RestShape;
use ::whisker::elastica::Elastica;
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays::{Numbers, numbers, vectors};
use crate::convert::{from_json, to_json};
use crate::error::{raised, refused};

/// Parameters of a whisker: a thin, tapered, pre-curved elastic wire on a compliant root.
///
/// Frame Base: origin at the root, +x along the tangent of the undeflected root, +y to the left, angles counter-clockwise.
#[pyclass(frozen, eq, module = "whisker_contact")]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Whisker {
    pub(crate) whisker: ::whisker::Whisker,
}

impl Whisker {
    pub(crate) fn rest(&self) -> RestShape {
        self.whisker.rest_shape()
    }

    /// Arc lengths (n) from the root, which must lie on the whisker (m).
    pub(crate) fn arcs_m(&self, arc_m: &Numbers<'_>) -> PyResult<Vec<f64>> {
        let (arcs_m, length_m) = (numbers("arc_m", arc_m)?, self.whisker.length_m);
        match arcs_m.iter().position(|arc_m| !(0.0..=length_m).contains(arc_m)) {
            Some(row) => {
                let expected = format!("0 to {length_m}, the length of the whisker");
                Err(refused(&format!("arc_m[{row}]"), arcs_m[row], &expected))
            }
            None => Ok(arcs_m),
        }
    }

    /// The exact quasi-static whisker.
    pub(crate) fn elastica(&self) -> PyResult<Elastica> {
        Elastica::new(&self.whisker).map_err(raised)
    }
}

#[pymethods]
impl Whisker {
    /// Whisker with these parameters, a dictionary with the keys of `parameters`. Raises `ValueError` for a parameter of
    /// implausible size, such as a length in mm.
    #[new]
    fn new(parameters: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value = to_json("parameters", parameters)?;
        let whisker: ::whisker::Whisker = serde_json::from_value(value).map_err(raised)?;
        whisker.validate().and_then(|()| whisker.check_plausible()).map_err(raised)?;
        Ok(Self { whisker })
    }

    /// Straight nitinol wire, 80 mm x 0.25 mm, on a compliant root.
    #[staticmethod]
    fn straight() -> Self {
        Self { whisker: ::whisker::Whisker::straight() }
    }

    /// The same wire with a radius of curvature of 80 mm, bent to the left.
    #[staticmethod]
    fn curved() -> Self {
        Self { whisker: ::whisker::Whisker::curved() }
    }

    /// Nitinol wire, 50 mm x 0.2 mm: 20 mm straight, then an arc of radius 18 mm to the left.
    #[staticmethod]
    fn stanford() -> Self {
        Self { whisker: ::whisker::Whisker::stanford() }
    }

    /// Name of the preset or of the sensor.
    #[getter]
    fn name(&self) -> &str {
        &self.whisker.name
    }

    /// Length from root to tip (m).
    #[getter]
    fn length_m(&self) -> f64 {
        self.whisker.length_m
    }

    /// All parameters, in SI units.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.whisker)
    }

    /// Points (n, 2) of the undeflected centre line at arc lengths (n) from the root (m), in Base.
    fn rest_shape<'py>(&self, py: Python<'py>, arc_m: Numbers<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (rest, arcs_m) = (self.rest(), self.arcs_m(&arc_m)?);
        Ok(vectors(py, arcs_m.iter().map(|&arc_m| Some(rest.point(arc_m).vector()))))
    }

    fn __repr__(&self) -> String {
        let ::whisker::Whisker { name, length_m, root_diameter_m, .. } = &self.whisker;
        format!("<Whisker {name}: {:.4} mm x {:.4} mm>", 1e3 * length_m, 1e3 * root_diameter_m)
    }
}
