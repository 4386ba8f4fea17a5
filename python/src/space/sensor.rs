//! The class `BendingSensor`: both bending moments from counts.

use ::trace::BendingSensor as File;
use nalgebra::Vector2;
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays::{Numbers, column, numbers, rows, vectors};

/// Sensor with two channels of a calibration in space: its counts as a function of the bending moments at the root.
///
/// A sensor comes from `SpatialCalibration.sensor`. The counts above those at rest are `C M`, with the moments M about y and z of
/// Base.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct BendingSensor {
    pub(super) file: File,
}

#[pymethods]
impl BendingSensor {
    /// The matrix C (2, 2), in counts per N m: a row for each channel.
    #[getter]
    fn counts_per_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.file.counts_per_n_m.counts_per_n_m.map(|row| Some(Vector2::from(row))).into_iter())
    }

    /// Standard deviation of the noise in the moments (N m), the `noise_sd_n_m` of a `SpatialEstimator`.
    #[getter]
    fn noise_sd_n_m(&self) -> f64 {
        self.file.noise_sd_n_m
    }

    /// Bending moments about y and z of Base (N m) of the counts of both channels above those at rest, (2) or (n, 2).
    ///
    /// The counts at rest are those of the free whisker, for example their mean over a second. Raises `ValueError` for numbers that
    /// are not finite.
    fn moments_n_m<'py>(&self, py: Python<'py>, counts: Numbers<'_>) -> PyResult<Bound<'py, PyAny>> {
        let moments_n_m = |counts: Vector2<f64>| self.file.counts_per_n_m.moment_n_m(counts);
        if counts.shape() == [2] {
            let counts = Vector2::from_vec(numbers("counts", &counts)?);
            return Ok(column(py, moments_n_m(counts).iter().copied().map(Some)).into_any());
        }
        let counts = rows::<2>("counts", &counts)?;
        Ok(vectors(py, counts.into_iter().map(|counts| Some(moments_n_m(counts.into())))).into_any())
    }

    fn __repr__(&self) -> String {
        format!("<BendingSensor {:?}>", self.file.counts_per_n_m.counts_per_n_m)
    }
}
