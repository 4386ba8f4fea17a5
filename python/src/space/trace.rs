//! The class `SpatialTrace`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::trace::{SpatialInstant, SpatialTruthInstant};
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::arrays::{column, known_flags, structured};
use crate::convert::from_json;
use crate::error::raised;
use crate::whisker::Whisker;

/// Recording of one sweep in space with its ground truth, free of measurement noise.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialTrace {
    pub(crate) trace: Arc<::trace::SpatialTrace>,
    recording: PyOnceLock<Py<PyAny>>,
    truth: PyOnceLock<Py<PyAny>>,
}

impl SpatialTrace {
    /// Reads a trace.
    pub(crate) fn of(path: &Path) -> Result<Self, files::Error> {
        let trace = Arc::new(::trace::SpatialTrace::read(path)?);
        Ok(Self { trace, recording: PyOnceLock::new(), truth: PyOnceLock::new() })
    }
}

#[pymethods]
impl SpatialTrace {
    /// Reads the trace with this CSV or sidecar path and checks it against its sidecar.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Self::of(&path)).map_err(raised)
    }

    /// Name of the trace.
    #[getter]
    fn name(&self) -> &str {
        &self.trace.sidecar.name
    }

    /// Group of trials that are scored together.
    #[getter]
    fn group(&self) -> &str {
        &self.trace.sidecar.group
    }

    /// Purpose of the trace: `trial` or `calibration`.
    #[getter]
    fn role(&self) -> &str {
        self.trace.sidecar.role.name()
    }

    /// Sampling rate (Hz).
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.trace.sidecar.rate_hz
    }

    /// The whisker.
    #[getter]
    fn whisker(&self) -> Whisker {
        Whisker { whisker: self.trace.sidecar.whisker.clone() }
    }

    /// The sidecar: description and provenance, with the keys of `datasets/FORMAT.md`.
    #[getter]
    fn sidecar<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.trace.sidecar)
    }

    /// Quantities available to an estimator, a read-only structured array (n): `t_s`, pose of the base in World (`base_x_m` to
    /// `base_z_m`, unit quaternion `base_qw` to `base_qz`), and the moments at the root in Base, `moment_x_n_m` (NaN if it was
    /// not recorded), `moment_y_n_m` and `moment_z_n_m`.
    #[getter]
    fn recording<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let make = || Ok::<_, PyErr>(recording(py, &self.trace.recording.instants)?.unbind());
        Ok(self.recording.get_or_try_init(py, make)?.bind(py).clone())
    }

    /// Ground truth, a read-only structured array (n): `touching` (1 true, 0 false, -1 unknown), and in World `contact_x_m` to
    /// `contact_z_m` on the centre line, `surface_x_m` to `surface_z_m`, `normal_x` to `normal_z` out of the solid, `force_x_n` to
    /// `force_z_n`, and `arc_m`. NaN while the whisker is free or where the truth is unknown.
    #[getter]
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let make = || Ok::<_, PyErr>(truth(py, &self.trace.truth.instants)?.unbind());
        Ok(self.truth.get_or_try_init(py, make)?.bind(py).clone())
    }

    fn __len__(&self) -> usize {
        self.trace.recording.instants.len()
    }

    fn __repr__(&self) -> String {
        format!("<SpatialTrace {}: {} rows at {} Hz>", self.name(), self.__len__(), self.rate_hz())
    }
}

fn recording<'py>(py: Python<'py>, instants: &[SpatialInstant]) -> PyResult<Bound<'py, PyAny>> {
    let numbers = |number: fn(&SpatialInstant) -> Option<f64>| column(py, instants.iter().map(number)).into_any();
    structured(
        py,
        instants.len(),
        &[
            ("t_s", numbers(|now| Some(now.t_s))),
            ("base_x_m", numbers(|now| Some(now.base.position.x))),
            ("base_y_m", numbers(|now| Some(now.base.position.y))),
            ("base_z_m", numbers(|now| Some(now.base.position.z))),
            ("base_qw", numbers(|now| Some(now.base.rotation.w))),
            ("base_qx", numbers(|now| Some(now.base.rotation.i))),
            ("base_qy", numbers(|now| Some(now.base.rotation.j))),
            ("base_qz", numbers(|now| Some(now.base.rotation.k))),
            ("moment_x_n_m", numbers(|now| now.moment_x_n_m)),
            ("moment_y_n_m", numbers(|now| Some(now.moment_y_n_m))),
            ("moment_z_n_m", numbers(|now| Some(now.moment_z_n_m))),
        ],
    )
}

fn truth<'py>(py: Python<'py>, instants: &[SpatialTruthInstant]) -> PyResult<Bound<'py, PyAny>> {
    type Part = fn(&::trace::SpatialContactTruth) -> Vector3<f64>;
    let along = |part: Part, axis: usize| {
        column(py, instants.iter().map(|now| Some(part(now.contact.as_ref()?)[axis]))).into_any()
    };
    let place = |axis: usize| column(py, instants.iter().map(|now| now.contact_m().map(|at| at[axis]))).into_any();
    let surface: Part = |at| at.surface;
    let (normal, force): (Part, Part) = (|at| at.normal, |at| at.force);
    structured(
        py,
        instants.len(),
        &[
            ("touching", known_flags(py, instants.iter().map(|now| now.touching)).into_any()),
            ("contact_x_m", place(0)),
            ("contact_y_m", place(1)),
            ("contact_z_m", place(2)),
            ("surface_x_m", along(surface, 0)),
            ("surface_y_m", along(surface, 1)),
            ("surface_z_m", along(surface, 2)),
            ("normal_x", along(normal, 0)),
            ("normal_y", along(normal, 1)),
            ("normal_z", along(normal, 2)),
            ("force_x_n", along(force, 0)),
            ("force_y_n", along(force, 1)),
            ("force_z_n", along(force, 2)),
            ("arc_m", column(py, instants.iter().map(|now| Some(now.contact?.arc_m))).into_any()),
        ],
    )
}
