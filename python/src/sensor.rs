//! The class `Sensor`: moments from counts.

use ::trace::SensorFile;
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::arrays::{Numbers, column, mapped};

/// Sensor of a calibration: its counts as a function of the moment at the root.
///
/// A sensor comes from `Calibration.sensor`. The counts above those at rest are the polynomial `c1 M + c2 M^2 + ...` of the
/// moment M.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Sensor {
    pub(crate) file: SensorFile,
}

#[pymethods]
impl Sensor {
    /// Name in the calibration, `array.sensor`.
    #[getter]
    fn name(&self) -> String {
        self.file.label()
    }

    /// Coefficients `c1, c2, ...` of the polynomial (k), in counts per power of N m.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.file.characteristic.coefficients.iter().copied().map(Some))
    }

    /// Smallest and largest moment of the calibration (N m), between which the polynomial is monotone.
    #[getter]
    fn range_n_m(&self) -> (f64, f64) {
        self.file.characteristic.range_n_m.into()
    }

    /// Standard deviation of the noise in the readings (N m), the `noise_sd_n_m` of an `Estimator`.
    #[getter]
    fn noise_sd_n_m(&self) -> f64 {
        self.file.noise_sd_n_m
    }

    /// Moments (N m) of counts above those at rest: a number for a number, an array for an array of any shape.
    ///
    /// The counts at rest are those of the free whisker, for example their mean over a second. From the counts of a sensor with a
    /// common mode or a cross-talk, these must be removed first. Beyond `range_n_m` the polynomial is continued linearly. Raises
    /// `ValueError` for numbers that are not finite.
    fn moment_n_m<'py>(&self, py: Python<'py>, counts: Numbers<'_>) -> PyResult<Bound<'py, PyAny>> {
        mapped(py, "counts", &counts, |counts| self.file.characteristic.moment_n_m(counts))
    }

    fn __repr__(&self) -> String {
        format!("<Sensor {}>", self.file.label())
    }
}
