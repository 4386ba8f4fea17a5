//! The class `SpatialReplay`.

use std::sync::Arc;

use ::trace::{SpatialInstant, SpatialTruthInstant};
use ::whisker::frames::{Base, World};
use ::whisker::space::estimators::{Estimate, Knowledge};
use ::whisker::space::frames::Pose;
use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use testbed::space::{SpatialEstimateRow, spatial_estimate_row, to_world};

use super::estimator::SpatialEstimate;
use crate::arrays::{column, flags, known_flags, matrices, place, structured, vectors};

/// Estimates of a recording in space, one row per sample. NaN while the estimator has no contact.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialReplay {
    knowledge: Arc<Knowledge>,
    pub(super) instants: Vec<SpatialInstant>,
    /// Poses of the base in World.
    bases: Vec<Pose<Base, World>>,
    /// Ground truth of a trace.
    truths: Option<Vec<SpatialTruthInstant>>,
    pub(super) readings_n_m: Vec<Vector2<f64>>,
    pub(super) estimates: Vec<Option<Estimate>>,
}

impl SpatialReplay {
    pub(super) fn new(
        knowledge: Arc<Knowledge>,
        instants: Vec<SpatialInstant>,
        truths: Option<Vec<SpatialTruthInstant>>,
        readings_n_m: Vec<Vector2<f64>>,
        estimates: Vec<Option<Estimate>>,
    ) -> Self {
        let bases = instants.iter().map(|now| to_world(&now.base)).collect();
        Self { knowledge, instants, bases, truths, readings_n_m, estimates }
    }

    /// A value of each estimate, computed with the pose of the base.
    fn map<T>(
        &self,
        value: impl Fn(&Pose<Base, World>, &Estimate) -> Option<T>,
    ) -> impl ExactSizeIterator<Item = Option<T>> {
        let rows = self.bases.iter().zip(&self.estimates);
        rows.map(move |(base, estimate)| estimate.as_ref().and_then(|estimate| value(base, estimate)))
    }

    fn column<'py>(&self, py: Python<'py>, number: impl Fn(&Estimate) -> Option<f64>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.map(|_, estimate| number(estimate)))
    }

    /// Whether a condition holds for the estimate of each row.
    fn flags<'py>(&self, py: Python<'py>, flag: impl Fn(&Estimate) -> bool) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.estimates.iter().map(|estimate| estimate.as_ref().is_some_and(&flag)))
    }

    fn rows(&self) -> Vec<SpatialEstimateRow> {
        let (unknown, calibrated) = (SpatialTruthInstant::default(), &self.knowledge.calibrated);
        let row = |(i, now): (usize, &SpatialInstant)| {
            let truth = self.truths.as_ref().map_or(&unknown, |truths| &truths[i]);
            spatial_estimate_row(now, truth, calibrated, self.readings_n_m[i], self.estimates[i].as_ref())
        };
        self.instants.iter().enumerate().map(row).collect()
    }
}

#[pymethods]
impl SpatialReplay {
    /// Times (n), in s.
    #[getter]
    fn t_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.instants.iter().map(|now| Some(now.t_s)))
    }

    /// Bending moments (n, 2) about y and z of Base that the estimator was given, in N m; through a front end with a sensor, about
    /// the axes of the suspension's springs.
    #[getter]
    fn readings_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.readings_n_m.iter().map(|reading_n_m| Some(*reading_n_m)))
    }

    /// Whether there is an estimate (n).
    #[getter]
    fn touching<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.flags(py, |_| true)
    }

    /// Contacts (n, 3) on the centre line, in Base (m).
    #[getter]
    fn contact<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|_, estimate| Some(estimate.contact.vector())))
    }

    /// Contacts (n, 3) in World (m).
    #[getter]
    fn contact_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|base, estimate| Some(base.apply(estimate.contact).vector())))
    }

    /// Points (n, 3) of the object's surface in World (m): the contacts shifted by the wire's radius towards the object.
    #[getter]
    fn surface_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let surface = |estimate: &Estimate| self.knowledge.calibrated.surface(estimate.contact, estimate.normal);
        vectors(py, self.map(|base, estimate| Some(base.apply(surface(estimate)).vector())))
    }

    /// Posterior covariances of the contacts (n, 3, 3), in Base (m2).
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|_, estimate| Some(estimate.covariance_m2)))
    }

    /// Posterior covariances of the contacts (n, 3, 3), in World (m2).
    #[getter]
    fn covariance_world_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|base, estimate| Some(base.turn(estimate.covariance_m2))))
    }

    /// Standard deviations of the contacts (n), in m: square root of the trace of the covariance.
    #[getter]
    fn sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.covariance_m2.trace().sqrt()))
    }

    /// Unit normals (n, 3) of the touched surface out of the object, in Base.
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|_, estimate| Some(estimate.normal)))
    }

    /// Unit normals (n, 3) of the touched surface out of the object, in World.
    #[getter]
    fn normal_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|base, estimate| Some(base.turn_vector(estimate.normal))))
    }

    /// Posterior covariances of the normals (n, 3, 3), in Base (rad2), singular along the normals themselves.
    #[getter]
    fn normal_covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|_, estimate| Some(estimate.normal_covariance)))
    }

    /// Unit directions (n, 3) of the edge or rod in Base, of either sign. NaN also where the method does not estimate it.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|_, estimate| Some(estimate.direction?.along)))
    }

    /// Unit directions (n, 3) of the edge or rod in World, of either sign. NaN also where the method does not estimate it.
    #[getter]
    fn direction_world<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|base, estimate| Some(base.turn_vector(estimate.direction?.along))))
    }

    /// Standard deviations of the angles of `direction` in the tangent planes of the contacts (n), in rad.
    #[getter]
    fn direction_sd_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.direction?.sd_rad))
    }

    /// Radii (n) of a sphere, or of a rod across its axis, in m. NaN also where the method does not estimate it.
    #[getter]
    fn radius_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.radius?.radius_m))
    }

    /// Standard deviations (n) of `radius_m`, in m.
    #[getter]
    fn radius_sd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.radius?.sd_m))
    }

    /// Whether the contacts lie in the calibrated domain of the sensor model (n). False without an estimate.
    #[getter]
    fn calibrated<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.flags(py, |estimate| estimate.calibrated)
    }

    /// Whether the readings contradict the models of the method (n), see `SpatialEstimate.model_doubtful`.
    #[getter]
    fn model_doubtful<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.flags(py, |estimate| estimate.model_doubtful == Some(true))
    }

    /// Normalised innovations squared (n), which have two degrees of freedom. NaN where there is no innovation.
    #[getter]
    fn nis<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |estimate| Some(estimate.innovation?.nis))
    }

    /// Probabilities (n) of the competing models by name. Empty for methods with one model only.
    #[getter]
    fn models<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let models = PyDict::new(py);
        let Some(first) = self.estimates.iter().flatten().find_map(|estimate| estimate.models) else {
            return Ok(models);
        };
        let mut names: Vec<&str> = first.iter().map(|(name, _)| name).collect();
        names.sort_unstable();
        for name in names {
            models.set_item(name, self.column(py, |estimate| estimate.models?.of(name)))?;
        }
        Ok(models)
    }

    /// The columns of `whisker replay`, a structured array (n): base, contact, surface, covariance, normal, direction and truth in
    /// World, moments in Base. NaN, and -1 for the flags `calibrated` and `model_doubtful`, where there is no value.
    #[getter]
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows = self.rows();
        let known = |number: fn(&SpatialEstimateRow) -> f64| column(py, rows.iter().map(|row| Some(number(row))));
        let numbers = |number: fn(&SpatialEstimateRow) -> Option<f64>| column(py, rows.iter().map(number)).into_any();
        let flags = |flag: fn(&SpatialEstimateRow) -> Option<bool>| known_flags(py, rows.iter().map(flag)).into_any();
        let columns = [
            ("t_s", known(|row| row.t_s).into_any()),
            ("base_x_m", known(|row| row.base_x_m).into_any()),
            ("base_y_m", known(|row| row.base_y_m).into_any()),
            ("base_z_m", known(|row| row.base_z_m).into_any()),
            ("base_qw", known(|row| row.base_qw).into_any()),
            ("base_qx", known(|row| row.base_qx).into_any()),
            ("base_qy", known(|row| row.base_qy).into_any()),
            ("base_qz", known(|row| row.base_qz).into_any()),
            ("moment_y_n_m", known(|row| row.moment_y_n_m).into_any()),
            ("moment_z_n_m", known(|row| row.moment_z_n_m).into_any()),
            ("contact_x_m", numbers(|row| row.contact_x_m)),
            ("contact_y_m", numbers(|row| row.contact_y_m)),
            ("contact_z_m", numbers(|row| row.contact_z_m)),
            ("surface_x_m", numbers(|row| row.surface_x_m)),
            ("surface_y_m", numbers(|row| row.surface_y_m)),
            ("surface_z_m", numbers(|row| row.surface_z_m)),
            ("cov_xx_m2", numbers(|row| row.cov_xx_m2)),
            ("cov_xy_m2", numbers(|row| row.cov_xy_m2)),
            ("cov_xz_m2", numbers(|row| row.cov_xz_m2)),
            ("cov_yy_m2", numbers(|row| row.cov_yy_m2)),
            ("cov_yz_m2", numbers(|row| row.cov_yz_m2)),
            ("cov_zz_m2", numbers(|row| row.cov_zz_m2)),
            ("normal_x", numbers(|row| row.normal_x)),
            ("normal_y", numbers(|row| row.normal_y)),
            ("normal_z", numbers(|row| row.normal_z)),
            ("normal_sd_rad", numbers(|row| row.normal_sd_rad)),
            ("direction_x", numbers(|row| row.direction_x)),
            ("direction_y", numbers(|row| row.direction_y)),
            ("direction_z", numbers(|row| row.direction_z)),
            ("direction_sd_rad", numbers(|row| row.direction_sd_rad)),
            ("calibrated", flags(|row| row.calibrated)),
            ("model_doubtful", flags(|row| row.model_doubtful)),
            ("truth_contact_x_m", numbers(|row| row.truth_contact_x_m)),
            ("truth_contact_y_m", numbers(|row| row.truth_contact_y_m)),
            ("truth_contact_z_m", numbers(|row| row.truth_contact_z_m)),
            ("truth_surface_x_m", numbers(|row| row.truth_surface_x_m)),
            ("truth_surface_y_m", numbers(|row| row.truth_surface_y_m)),
            ("truth_surface_z_m", numbers(|row| row.truth_surface_z_m)),
        ];
        structured(py, rows.len(), &columns)
    }

    fn __len__(&self) -> usize {
        self.instants.len()
    }

    /// Estimate of a row.
    fn __getitem__(&self, row: isize) -> PyResult<Option<SpatialEstimate>> {
        let estimate = self.estimates[place(row, self.estimates.len())?];
        Ok(estimate.map(|estimate| SpatialEstimate::new(estimate, &self.knowledge)))
    }

    fn __repr__(&self) -> String {
        let estimates = self.estimates.iter().flatten().count();
        format!("<SpatialReplay of {} rows, {estimates} with an estimate>", self.instants.len())
    }
}
