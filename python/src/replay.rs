//! The class `Replay`.

use std::sync::Arc;

use ::trace::{Instant, TruthInstant};
use ::whisker::estimators::{self, CarriedOutline, Knowledge};
use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use testbed::results::{EstimateRow, estimate_row};

use crate::arrays::{column, flags, known_flags, matrices, place, structured, texts, vectors};
use crate::estimate::Estimate;
use crate::outline::Outline;

/// Estimates of a recording, one row per sample. NaN while the estimator has no contact.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Replay {
    pub(crate) knowledge: Arc<Knowledge>,
    pub(crate) instants: Vec<Instant>,
    /// Ground truth of a trace.
    truths: Option<Vec<TruthInstant>>,
    pub(crate) readings_n_m: Vec<f64>,
    pub(crate) replay: testbed::replay::Replay,
}

impl Replay {
    pub(crate) fn new(
        knowledge: Arc<Knowledge>,
        instants: Vec<Instant>,
        truths: Option<Vec<TruthInstant>>,
        readings_n_m: Vec<f64>,
        estimates: Vec<Option<estimators::Estimate>>,
        outline: Option<CarriedOutline>,
    ) -> Self {
        let replay = testbed::replay::Replay { estimates, outline, elapsed_ns: 0, failure: None };
        Self { knowledge, instants, truths, readings_n_m, replay }
    }

    fn map<T>(&self, value: impl Fn(&estimators::Estimate) -> Option<T>) -> impl ExactSizeIterator<Item = Option<T>> {
        self.replay.estimates.iter().map(move |estimate| estimate.as_ref().and_then(&value))
    }

    fn column<'py>(
        &self,
        py: Python<'py>,
        number: impl Fn(&estimators::Estimate) -> Option<f64>,
    ) -> Bound<'py, PyArray1<f64>> {
        column(py, self.map(number))
    }

    fn rows(&self) -> Vec<EstimateRow> {
        let unknown = TruthInstant::default();
        let row = |(i, estimate): (usize, &Option<estimators::Estimate>)| {
            let truth = self.truths.as_ref().map_or(&unknown, |truths| &truths[i]);
            estimate_row(&self.knowledge, &self.instants[i], truth, self.readings_n_m[i], estimate.as_ref())
        };
        self.replay.estimates.iter().enumerate().map(row).collect()
    }
}

#[pymethods]
impl Replay {
    /// Times (n), in s.
    #[getter]
    fn t_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.instants.iter().map(|now| Some(now.t_s)))
    }

    /// Readings (n) that the estimator was given, in N m.
    #[getter]
    fn readings_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.readings_n_m)
    }

    /// Whether there is an estimate (n).
    #[getter]
    fn touching<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.replay.estimates.iter().map(Option::is_some))
    }

    /// Contacts (n, 2) on the centre line, in Base (m).
    #[getter]
    fn contact<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|estimate| Some(estimate.contact.vector())))
    }

    /// Contacts (n, 2) in World (m).
    #[getter]
    fn contact_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let placed = self.instants.iter().zip(&self.replay.estimates);
        let world: Vec<Option<Vector2<f64>>> =
            placed.map(|(now, estimate)| estimate.map(|estimate| now.base.apply(estimate.contact).vector())).collect();
        vectors(py, world.into_iter())
    }

    /// Posterior covariances of the contacts (n, 2, 2), in Base (m2). NaN for methods without one.
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|estimate| estimate.covariance_m2))
    }

    /// Standard deviations of the contacts (n), in m: square root of the trace of the covariance.
    #[getter]
    fn sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.covariance_m2?.trace().sqrt()))
    }

    /// Whether the readings contradict the models of the method (n), see `Estimate.model_doubtful`.
    #[getter]
    fn model_doubtful<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.replay.estimates.iter().map(|estimate| estimate.is_some_and(|estimate| estimate.model_doubtful)))
    }

    /// Whether the readings, or the shape of the whisker, show that a second contact has taken load (n), see
    /// `Estimate.second_contact`.
    #[getter]
    fn second_contact<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.replay.estimates.iter().map(|estimate| estimate.is_some_and(|estimate| estimate.second_contact)))
    }

    /// Radii of the object at the contacts (n), in m. NaN if the method does not estimate them.
    #[getter]
    fn radius_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.radius?.radius_m))
    }

    /// Standard deviations of the radii (n), in m.
    #[getter]
    fn radius_sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.radius?.sd_m))
    }

    /// Coefficients of friction between whisker and object (n). NaN where none is stated.
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.friction?.coefficient))
    }

    /// Standard deviations of the coefficients of friction (n).
    #[getter]
    fn friction_sd<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.friction?.sd))
    }

    /// Normalised innovations squared (n). NaN for methods without an innovation.
    #[getter]
    fn nis<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.innovation?.nis))
    }

    /// Probabilities (n) of the competing models by name. Empty for methods with one model only.
    #[getter]
    fn models<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let models = PyDict::new(py);
        let Some(first) = self.replay.estimates.iter().flatten().find_map(|estimate| estimate.models) else {
            return Ok(models);
        };
        let mut names: Vec<&str> = first.iter().map(|(name, _)| name).collect();
        names.sort_unstable();
        for name in names {
            models.set_item(name, self.column(py, |estimate| estimate.models?.of(name)))?;
        }
        Ok(models)
    }

    /// The columns of `whisker replay`, a structured array (n): base, contact and surface in World, covariance, radius, friction,
    /// velocity of the object, deviation of the sensor and truth. NaN, empty text, and -1 for the flags `calibrated`, `at_tip`,
    /// `model_doubtful` and `second_contact`, where there is no value.
    #[getter]
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows = self.rows();
        let known = |number: fn(&EstimateRow) -> f64| column(py, rows.iter().map(|row| Some(number(row)))).into_any();
        let numbers = |number: fn(&EstimateRow) -> Option<f64>| column(py, rows.iter().map(number)).into_any();
        let flags = |flag: fn(&EstimateRow) -> Option<bool>| known_flags(py, rows.iter().map(flag)).into_any();
        let columns = [
            ("t_s", known(|row| row.t_s)),
            ("base_x_m", known(|row| row.base_x_m)),
            ("base_y_m", known(|row| row.base_y_m)),
            ("base_yaw_rad", known(|row| row.base_yaw_rad)),
            ("reading_n_m", known(|row| row.reading_n_m)),
            ("contact_x_m", numbers(|row| row.contact_x_m)),
            ("contact_y_m", numbers(|row| row.contact_y_m)),
            ("surface_x_m", numbers(|row| row.surface_x_m)),
            ("surface_y_m", numbers(|row| row.surface_y_m)),
            ("cov_xx_m2", numbers(|row| row.cov_xx_m2)),
            ("cov_xy_m2", numbers(|row| row.cov_xy_m2)),
            ("cov_yy_m2", numbers(|row| row.cov_yy_m2)),
            ("calibrated", flags(|row| row.calibrated)),
            ("at_tip", flags(|row| row.at_tip)),
            ("radius_m", numbers(|row| row.radius_m)),
            ("radius_sd_m", numbers(|row| row.radius_sd_m)),
            ("friction", numbers(|row| row.friction)),
            ("friction_sd", numbers(|row| row.friction_sd)),
            ("object_vx_m_s", numbers(|row| row.object_vx_m_s)),
            ("object_vx_sd_m_s", numbers(|row| row.object_vx_sd_m_s)),
            ("object_vy_m_s", numbers(|row| row.object_vy_m_s)),
            ("object_vy_sd_m_s", numbers(|row| row.object_vy_sd_m_s)),
            ("gain", numbers(|row| row.gain)),
            ("gain_sd", numbers(|row| row.gain_sd)),
            ("mount_rad", numbers(|row| row.mount_rad)),
            ("mount_sd_rad", numbers(|row| row.mount_sd_rad)),
            ("mount_x_m", numbers(|row| row.mount_x_m)),
            ("mount_x_sd_m", numbers(|row| row.mount_x_sd_m)),
            ("mount_y_m", numbers(|row| row.mount_y_m)),
            ("mount_y_sd_m", numbers(|row| row.mount_y_sd_m)),
            ("models", texts(py, rows.iter().map(|row| row.models.as_deref().unwrap_or("")))?),
            ("model_doubtful", flags(|row| row.model_doubtful)),
            ("second_contact", flags(|row| row.second_contact)),
            ("truth_contact_x_m", numbers(|row| row.truth_contact_x_m)),
            ("truth_contact_y_m", numbers(|row| row.truth_contact_y_m)),
            ("truth_surface_x_m", numbers(|row| row.truth_surface_x_m)),
            ("truth_surface_y_m", numbers(|row| row.truth_surface_y_m)),
        ];
        structured(py, rows.len(), &columns)
    }

    /// Final outline that the estimator carries, in Start. `None` for methods that estimate contacts only; see
    /// `Trial.outline` for the outline through the contacts of any method.
    #[getter]
    fn outline(&self) -> Option<Outline> {
        self.replay.outline.as_ref().map(|outline| Outline::carried(&outline.points))
    }

    fn __len__(&self) -> usize {
        self.instants.len()
    }

    /// Estimate of a row.
    fn __getitem__(&self, row: isize) -> PyResult<Option<Estimate>> {
        let place = place(row, self.instants.len())?;
        let estimate = self.replay.estimates[place];
        Ok(estimate.map(|estimate| Estimate::new(estimate, self.readings_n_m[place], &self.knowledge)))
    }

    fn __repr__(&self) -> String {
        let estimates = self.replay.estimates.iter().flatten().count();
        format!("<Replay of {} rows, {estimates} with an estimate>", self.instants.len())
    }
}
