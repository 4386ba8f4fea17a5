//! The class `Trace`.

use std::path::{Path, PathBuf};

use ::trace::{Instant, TruthInstant};
use ::whisker::frames::{Point, World};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::arrays::{column, known_flags, structured, vectors};
use crate::convert::from_json;
use crate::error::raised;
use crate::whisker::Whisker;

/// Recording of one sweep with its ground truth.
///
/// A trace comes from `Trace.read` or `simulate`. Its readings are free of measurement noise, which a `Trial` adds.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Trace {
    pub(crate) trace: ::trace::Trace,
    pub(crate) outline: Option<::trace::Outline>,
    /// Folder that the trace was read from, which contains the other traces of its recording.
    pub(crate) folder: Option<PathBuf>,
    recording: PyOnceLock<Py<PyAny>>,
    truth: PyOnceLock<Py<PyAny>>,
}

impl Trace {
    pub(crate) fn new(trace: ::trace::Trace, outline: Option<::trace::Outline>) -> Self {
        Self { trace, outline, folder: None, recording: PyOnceLock::new(), truth: PyOnceLock::new() }
    }

    /// Reads a trace and the outline of its object.
    pub(crate) fn of(path: &Path) -> Result<Self, files::Error> {
        let trace = ::trace::Trace::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let outline = trace.outline(folder)?;
        Ok(Self { folder: Some(folder.into()), ..Self::new(trace, outline) })
    }
}

#[pymethods]
impl Trace {
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

    /// Side of the whisker on which the object lies: `left` or `right`.
    #[getter]
    fn face(&self) -> &str {
        self.trace.sidecar.face.name()
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

    /// Quantities available to an estimator, a read-only structured array (n): `t_s`, pose of the base in World (`base_x_m`,
    /// `base_y_m`, `base_yaw_rad`), its twist in Base (`base_vx_m_s`, `base_vy_m_s`, `base_wz_rad_s`), `moment_z_n_m` and
    /// `rotation_z_rad` of the root. NaN where a quantity was not recorded.
    #[getter]
    fn recording<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let make = || Ok::<_, PyErr>(recording(py, &self.trace.recording.instants)?.unbind());
        Ok(self.recording.get_or_try_init(py, make)?.bind(py).clone())
    }

    /// Ground truth, a read-only structured array (n): `touching`, `tip`, `split` (1 true, 0 false, -1 unknown), `contact_x_m`,
    /// `contact_y_m` (on the centre line) and `surface_x_m`, `surface_y_m` in World, `arc_m`, `force_n`, `tangent_rad`. NaN
    /// while the whisker is free or where the truth is unknown.
    #[getter]
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let make = || Ok::<_, PyErr>(truth(py, &self.trace.truth.instants)?.unbind());
        Ok(self.truth.get_or_try_init(py, make)?.bind(py).clone())
    }

    /// True outline of the object (k, 2) in World (m), counter-clockwise and closed. `None` if it is unknown.
    #[getter]
    fn outline<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        let vertices = self.outline.as_ref()?.vertices();
        Some(vectors(py, vertices.iter().map(|vertex| Some(vertex.vector()))))
    }

    fn __len__(&self) -> usize {
        self.trace.recording.instants.len()
    }

    fn __repr__(&self) -> String {
        format!("<Trace {}: {} rows at {} Hz>", self.name(), self.__len__(), self.rate_hz())
    }
}

fn recording<'py>(py: Python<'py>, instants: &[Instant]) -> PyResult<Bound<'py, PyAny>> {
    let numbers = |number: fn(&Instant) -> Option<f64>| column(py, instants.iter().map(number)).into_any();
    structured(
        py,
        instants.len(),
        &[
            ("t_s", numbers(|now| Some(now.t_s))),
            ("base_x_m", numbers(|now| Some(now.base.origin().x()))),
            ("base_y_m", numbers(|now| Some(now.base.origin().y()))),
            ("base_yaw_rad", numbers(|now| Some(now.base.yaw_rad()))),
            ("base_vx_m_s", numbers(|now| now.twist.map(|twist| twist.vx_m_s))),
            ("base_vy_m_s", numbers(|now| now.twist.map(|twist| twist.vy_m_s))),
            ("base_wz_rad_s", numbers(|now| now.twist.map(|twist| twist.wz_rad_s))),
            ("moment_z_n_m", numbers(|now| Some(now.moment_z_n_m))),
            ("rotation_z_rad", numbers(|now| now.rotation_z_rad)),
        ],
    )
}

fn truth<'py>(py: Python<'py>, instants: &[TruthInstant]) -> PyResult<Bound<'py, PyAny>> {
    let numbers = |number: fn(&TruthInstant) -> Option<f64>| column(py, instants.iter().map(number)).into_any();
    let flags = |flag: fn(&TruthInstant) -> Option<bool>| known_flags(py, instants.iter().map(flag)).into_any();
    let x = |point: Option<Point<World>>| point.map(|point| point.x());
    let y = |point: Option<Point<World>>| point.map(|point| point.y());
    let along =
        |coordinate: &dyn Fn(&TruthInstant) -> Option<f64>| column(py, instants.iter().map(coordinate)).into_any();
    structured(
        py,
        instants.len(),
        &[
            ("touching", flags(|truth| truth.touching)),
            ("tip", flags(|truth| truth.tip)),
            ("split", flags(|truth| truth.split)),
            ("contact_x_m", along(&|truth| x(truth.contact))),
            ("contact_y_m", along(&|truth| y(truth.contact))),
            ("surface_x_m", along(&|truth| x(truth.surface))),
            ("surface_y_m", along(&|truth| y(truth.surface))),
            ("arc_m", numbers(|truth| truth.arc_m)),
            ("force_n", numbers(|truth| truth.force_n)),
            ("tangent_rad", numbers(|truth| truth.tangent_rad)),
        ],
    )
}
