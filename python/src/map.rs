//! Maps of scenes with several objects.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use testbed::map::{self, MapConfig, View};

use crate::arrays::{column, structured, vectors};
use crate::error::{raised, refused};
use crate::outline::Outline;
use crate::replay::Replay;
use crate::trial::Trial;

/// Map of a scene: objects and an occupancy grid.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SceneMap {
    map: map::SceneMap,
}

/// Object of a map.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct MappedObject {
    object: map::FoundObject,
}

/// Combines the replays of several whiskers into a map. `replays` holds one pair of `Trial` and `Replay` for each whisker; the
/// estimates have the common frame World.
///
/// `cell_m` is the side length of a cell of the occupancy grid, `least_points` the smallest number of points of a touch that
/// contributes to objects. No ground truth is used.
#[pyfunction]
#[pyo3(signature = (replays, cell_m=2e-3, least_points=10))]
pub(crate) fn scene_map(
    py: Python<'_>,
    replays: Vec<(Py<Trial>, Py<Replay>)>,
    cell_m: f64,
    least_points: usize,
) -> PyResult<SceneMap> {
    let config = MapConfig { cell_m, least_points };
    config.validate().map_err(raised)?;
    if replays.is_empty() {
        return Err(refused("replays", "none", "a pair of trial and replay for each whisker"));
    }
    let mut views = Vec::with_capacity(replays.len());
    for (whisker, (trial, replay)) in replays.iter().enumerate() {
        let (trial, replay) = (trial.get(), replay.get());
        trial.check(replay)?;
        let view = py.detach(|| View::new(&trial.scored(replay), &replay.replay, whisker, &config));
        views.push(view.map_err(raised)?);
        py.check_signals()?;
    }
    let map = py.detach(|| map::SceneMap::new(&views.iter().collect::<Vec<_>>(), &config));
    Ok(SceneMap { map })
}

#[pymethods]
impl SceneMap {
    /// Objects, in descending order of the number of their points.
    #[getter]
    fn objects(&self) -> Vec<MappedObject> {
        self.map.objects.iter().map(|object| MappedObject { object: object.clone() }).collect()
    }

    /// Observed cells of the occupancy grid, a structured array: centre `x_m`, `y_m` in World, numbers of scans `swept` and
    /// `touched`, and the probability `occupied`. Cells that are missing are unknown.
    #[getter]
    fn grid<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let cells: Vec<_> = self.map.grid.cells().collect();
        let counts = |count: fn(&map::Cell) -> u32| {
            PyArray1::from_vec(py, cells.iter().map(|(_, cell)| count(cell)).collect()).into_any()
        };
        let columns = [
            ("x_m", column(py, cells.iter().map(|(at, _)| Some(at.x()))).into_any()),
            ("y_m", column(py, cells.iter().map(|(at, _)| Some(at.y()))).into_any()),
            ("swept", counts(|cell| cell.swept)),
            ("touched", counts(|cell| cell.touched)),
            ("occupied", column(py, cells.iter().map(|(_, cell)| Some(cell.occupied()))).into_any()),
        ];
        structured(py, cells.len(), &columns)
    }

    fn __repr__(&self) -> String {
        format!("<SceneMap of {} objects>", self.map.objects.len())
    }
}

#[pymethods]
impl MappedObject {
    /// Touched points of the surface (n, 2), in World (m).
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.object.points.iter().map(|(_, seen)| Some(seen.point.at)))
    }

    /// Index of the whisker that touched each point (n), in the order of the replays.
    #[getter]
    fn whiskers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_vec(py, self.object.points.iter().map(|(whisker, _)| *whisker as u32).collect())
    }

    /// Outline in World.
    #[getter]
    fn outline(&self) -> Outline {
        Outline::of_contour(self.object.contour.clone())
    }

    fn __repr__(&self) -> String {
        format!("<MappedObject of {} points>", self.object.points.len())
    }
}
