//! Readers of datasets and of recordings of several whiskers.

use std::path::{Path, PathBuf};

use ::trace::{ArrayRecording, JOINTS, Role, is_spatial};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use testbed::front_end::FRONT_ENDS;

use crate::arrays::{column, structured, vectors};
use crate::calibration::load_calibration;
use crate::convert::from_json;
use crate::error::{raised, refused};
use crate::space::{SpatialTrace, load_spatial_calibration};
use crate::trace::Trace;

/// Traces of a suite or a folder.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Dataset {
    dataset: testbed::dataset::Dataset,
}

#[pymethods]
impl Dataset {
    /// Opens a folder of traces, or a suite (`.json`) whose traces lie in `folder`, by default `datasets/<suite>`.
    #[new]
    #[pyo3(signature = (path, folder=None))]
    fn new(py: Python<'_>, path: PathBuf, folder: Option<PathBuf>) -> PyResult<Self> {
        let dataset = py.detach(|| testbed::dataset::Dataset::open(&path, folder.as_deref())).map_err(raised)?;
        Ok(Self { dataset })
    }

    /// Name of the suite or folder.
    #[getter]
    fn name(&self) -> &str {
        &self.dataset.name
    }

    /// Folder of the traces.
    #[getter]
    fn folder(&self) -> &Path {
        &self.dataset.folder
    }

    /// Paths of the traces with a role: `trial` or `calibration`.
    #[pyo3(signature = (role="trial"))]
    fn paths(&self, py: Python<'_>, role: &str) -> PyResult<Vec<PathBuf>> {
        let role = role_of(role)?;
        let paths = py.detach(|| self.dataset.of_role(role)).map_err(raised)?;
        Ok(paths.into_iter().map(Path::to_path_buf).collect())
    }

    /// Reads the traces with a role, in order: a `Trace` for each planar one, a `SpatialTrace` for each one in space.
    #[pyo3(signature = (role="trial"))]
    fn traces<'py>(&self, py: Python<'py>, role: &str) -> PyResult<Bound<'py, PyList>> {
        let traces = PyList::empty(py);
        for path in self.paths(py, role)? {
            if is_spatial(&path).map_err(raised)? {
                traces.append(Py::new(py, py.detach(|| SpatialTrace::of(&path)).map_err(raised)?)?)?;
            } else {
                traces.append(Py::new(py, py.detach(|| Trace::of(&path)).map_err(raised)?)?)?;
            }
            py.check_signals()?;
        }
        Ok(traces)
    }

    /// Reads the calibration of a whisker, by its name: a `Calibration`, or a `SpatialCalibration` of traces in space.
    fn calibration(&self, py: Python<'_>, whisker: &str) -> PyResult<Py<PyAny>> {
        let path = self.dataset.calibrations(FRONT_ENDS[0].name).join(format!("{whisker}.json"));
        if is_spatial(&path).map_err(raised)? {
            return Ok(Py::new(py, load_spatial_calibration(py, path)?)?.into_any());
        }
        Ok(Py::new(py, load_calibration(py, path)?)?.into_any())
    }

    fn __repr__(&self) -> String {
        format!("<Dataset {}: {} traces>", self.dataset.name, self.dataset.paths.len())
    }
}

fn role_of(role: &str) -> PyResult<Role> {
    let roles = [Role::Trial, Role::Calibration];
    let wrong = || refused("role", format!("`{role}`"), "`trial` or `calibration`");
    roles.into_iter().find(|known| known.name() == role).ok_or_else(wrong)
}

/// Recording of several whiskers on an arm.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Recording {
    recording: ArrayRecording,
    folder: PathBuf,
}

#[pymethods]
impl Recording {
    /// Reads the recording with this sidecar path (`<recording>.json`).
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let recording = py.detach(|| ArrayRecording::read(&path)).map_err(raised)?;
        Ok(Self { recording, folder: path.parent().unwrap_or(Path::new("")).into() })
    }

    /// Name of the recording.
    #[getter]
    fn name(&self) -> &str {
        &self.recording.sidecar.name
    }

    /// Names of the whiskers within the recording.
    #[getter]
    fn whiskers(&self) -> Vec<&str> {
        self.recording.sidecar.whiskers.iter().map(|whisker| whisker.name.as_str()).collect()
    }

    /// The sidecar: description and provenance, with the keys of `datasets/FORMAT.md`.
    #[getter]
    fn sidecar<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.recording.sidecar)
    }

    /// Reads the traces, one for each whisker, and checks them against the arm's kinematics.
    fn traces(&self, py: Python<'_>) -> PyResult<Vec<Trace>> {
        let mut traces = Vec::new();
        for whisker in &self.recording.sidecar.whiskers {
            let path = self.folder.join(format!("{}.csv", whisker.trace));
            let read = || {
                let trace = Trace::of(&path)?;
                self.recording.check(&path, &trace.trace)?;
                Ok::<_, files::Error>(trace)
            };
            traces.push(py.detach(read).map_err(raised)?);
            py.check_signals()?;
        }
        Ok(traces)
    }

    /// Exact joint states, a structured array (n): `t_s`, then the angle `q1_rad` and the rate `dq1_rad_s` of each joint from the
    /// first on.
    #[getter]
    fn joints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let states = &self.recording.joints;
        let mut columns = vec![("t_s".to_owned(), column(py, states.iter().map(|state| Some(state.t_s))).into_any())];
        for joint in 0..JOINTS {
            let angles = column(py, states.iter().map(|state| Some(state.angles_rad[joint])));
            let rates = column(py, states.iter().map(|state| Some(state.rates_rad_s[joint])));
            columns.push((format!("q{}_rad", joint + 1), angles.into_any()));
            columns.push((format!("dq{}_rad_s", joint + 1), rates.into_any()));
        }
        let columns: Vec<_> = columns.iter().map(|(name, column)| (name.as_str(), column.clone())).collect();
        structured(py, states.len(), &columns)
    }

    /// Initial outlines (k, 2) of the objects in World (m), by name.
    #[getter]
    fn outlines<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let outlines = PyDict::new(py);
        for (object, outline) in self.recording.sidecar.objects.iter().zip(&self.recording.outlines) {
            let points = vectors(py, outline.vertices().iter().map(|vertex| Some(vertex.vector())));
            outlines.set_item(&object.name, points)?;
        }
        Ok(outlines)
    }

    fn __repr__(&self) -> String {
        format!("<Recording {}: {}>", self.name(), self.whiskers().join(", "))
    }
}
