//! The class `SpatialReplay`.

use ::whisker::frames::{Base, World};
use ::whisker::space::estimators::{Estimate, Radius};
use ::whisker::space::frames::Pose;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use super::estimator::SpatialEstimate;
use crate::arrays::{column, flags, matrices, place, vectors};

/// Estimates of a recording in space, one row per sample. NaN while the estimator has no contact.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialReplay {
    pub(super) times_s: Vec<f64>,
    pub(super) bases: Vec<Pose<Base, World>>,
    pub(super) estimates: Vec<Option<Estimate>>,
}

impl SpatialReplay {
    /// A value of each estimate, computed with the pose of the base.
    fn map<T>(&self, value: impl Fn(&Pose<Base, World>, &Estimate) -> T) -> impl ExactSizeIterator<Item = Option<T>> {
        let rows = self.bases.iter().zip(&self.estimates);
        rows.map(move |(base, estimate)| estimate.as_ref().map(|estimate| value(base, estimate)))
    }

    /// Radius of each estimate.
    fn radii(&self) -> impl ExactSizeIterator<Item = Option<Radius>> {
        self.estimates.iter().map(|estimate| estimate.and_then(|estimate| estimate.radius))
    }
}

#[pymethods]
impl SpatialReplay {
    /// Times (n), in s.
    #[getter]
    fn t_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.times_s)
    }

    /// Whether there is an estimate (n).
    #[getter]
    fn touching<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.estimates.iter().map(Option::is_some))
    }

    /// Contacts (n, 3) on the centre line, in Base (m).
    #[getter]
    fn contact<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|_, estimate| estimate.contact.vector()))
    }

    /// Contacts (n, 3) in World (m).
    #[getter]
    fn contact_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|base, estimate| base.apply(estimate.contact).vector()))
    }

    /// Posterior covariances of the contacts (n, 3, 3), in Base (m2).
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|_, estimate| estimate.covariance_m2))
    }

    /// Standard deviations of the contacts (n), in m: square root of the trace of the covariance.
    #[getter]
    fn sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.map(|_, estimate| estimate.covariance_m2.trace().sqrt()))
    }

    /// Unit normals (n, 3) of the touched surface out of the object, in World.
    #[getter]
    fn normal_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|base, estimate| base.turn_vector(estimate.normal)))
    }

    /// Radii (n) of a sphere, or of a rod across its axis, in m. NaN also where the method does not estimate it.
    #[getter]
    fn radius_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.radii().map(|radius| radius.map(|radius| radius.radius_m)))
    }

    /// Standard deviations (n) of `radius_m`, in m.
    #[getter]
    fn radius_sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.radii().map(|radius| radius.map(|radius| radius.sd_m)))
    }

    /// Whether the readings contradict the models of the method (n), see `SpatialEstimate.model_doubtful`.
    #[getter]
    fn model_doubtful<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let is_doubtful = |estimate: &Option<Estimate>| estimate.is_some_and(|one| one.model_doubtful == Some(true));
        flags(py, self.estimates.iter().map(is_doubtful))
    }

    fn __len__(&self) -> usize {
        self.times_s.len()
    }

    /// Estimate of a row.
    fn __getitem__(&self, row: isize) -> PyResult<Option<SpatialEstimate>> {
        Ok(self.estimates[place(row, self.estimates.len())?].map(|estimate| SpatialEstimate { estimate }))
    }

    fn __repr__(&self) -> String {
        let estimates = self.estimates.iter().flatten().count();
        format!("<SpatialReplay of {} rows, {estimates} with an estimate>", self.times_s.len())
    }
}
