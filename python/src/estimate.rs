//! The class `Estimate`, and estimates that Python code returns.

use std::sync::Arc;

use ::testbed::protocol::{BadValue, StatedEstimate};
use ::whisker::estimators::{self, Knowledge};
use ::whisker::frames::{Base, Point};
use ::whisker::sensor::Face;
use nalgebra::{Matrix2, SMatrix, Vector2};
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Numbers, numbers, rows};
use crate::error::refused;

/// Estimate of the contact at one instant, in Base.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Estimate {
    pub(crate) estimate: estimators::Estimate,
    reading_n_m: f64,
    knowledge: Arc<Knowledge>,
}

impl Estimate {
    pub(crate) fn new(estimate: estimators::Estimate, reading_n_m: f64, knowledge: &Arc<Knowledge>) -> Self {
        Self { estimate, reading_n_m, knowledge: knowledge.clone() }
    }
}

#[pymethods]
impl Estimate {
    /// Contact (2) on the centre line, in Base (m).
    #[getter]
    fn contact<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.estimate.contact)
    }

    /// Posterior covariance of the contact (2, 2), in Base (m2). `None` for methods without one.
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        Some(square(py, &self.estimate.covariance_m2?))
    }

    /// Point (2) of the object's surface, in Base (m): the contact shifted by the wire's radius towards the object.
    #[getter]
    fn surface<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array(py, self.knowledge.surface(&self.estimate, self.reading_n_m))
    }

    /// Side of the whisker on which the object lies: `left` or `right`.
    #[getter]
    fn face(&self) -> &'static str {
        self.estimate.face.name()
    }

    /// Whether the contact lies in the calibrated domain of the sensor model.
    #[getter]
    fn calibrated(&self) -> bool {
        self.estimate.calibrated
    }

    /// Whether the contact may lie at the tip, where the reading has another meaning.
    #[getter]
    fn at_tip(&self) -> bool {
        self.estimate.at_tip
    }

    /// Whether the readings contradict the models of the method, so that its covariance may be too small. Always false for methods
    /// that average no models.
    #[getter]
    fn model_doubtful(&self) -> bool {
        self.estimate.model_doubtful
    }

    /// Whether the readings, or the shape of the whisker, show that a second contact has taken load within the last instants.
    /// Always false for methods that average no models.
    #[getter]
    fn second_contact(&self) -> bool {
        self.estimate.second_contact
    }

    /// Radius of the object at the contact, without the wire's (m). `None` if the method does not estimate it.
    #[getter]
    fn radius_m(&self) -> Option<f64> {
        self.estimate.radius.map(|radius| radius.radius_m)
    }

    /// Standard deviation of `radius_m` (m).
    #[getter]
    fn radius_sd_m(&self) -> Option<f64> {
        self.estimate.radius.map(|radius| radius.sd_m)
    }

    /// Coefficient of friction between whisker and object. `None` if the method does not estimate it or the readings do not
    /// determine it.
    #[getter]
    fn friction(&self) -> Option<f64> {
        self.estimate.friction.map(|friction| friction.coefficient)
    }

    /// Standard deviation of `friction`.
    #[getter]
    fn friction_sd(&self) -> Option<f64> {
        self.estimate.friction.map(|friction| friction.sd)
    }

    /// Velocity of the object relative to the world (2), in Base (m/s), under the assumption that it moves. `None` if the method
    /// does not estimate it, or holds it improbable that the object moves.
    #[getter]
    fn velocity_m_s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        Some(PyArray1::from_slice(py, self.estimate.velocity?.velocity_m_s.as_slice()))
    }

    /// Covariance of `velocity_m_s` (2, 2), in m2/s2.
    #[getter]
    fn velocity_covariance_m2_s2<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        Some(square(py, &self.estimate.velocity?.covariance_m2_s2))
    }

    /// Deviation of the sensor from its calibration, under the assumption that gain and mounting deviate: value and standard
    /// deviation by name. `gain` is the relative error of the gain; `mount_rad`, `mount_x_m` and `mount_y_m` are the pose of the
    /// calibrated Base in the actual one. `None` if the method does not estimate it, or holds it improbable that the sensor
    /// deviates.
    #[getter]
    fn deviation<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(found) = self.estimate.installation else { return Ok(None) };
        let deviation = PyDict::new(py);
        found.by_name().into_iter().try_for_each(|(name, found)| deviation.set_item(name, (found.value, found.sd)))?;
        Ok(Some(deviation))
    }

    /// Probabilities of the competing models by name, in descending order. `None` if the method has one model only.
    #[getter]
    fn models<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(shares) = self.estimate.models else { return Ok(None) };
        let models = PyDict::new(py);
        shares.iter().try_for_each(|(name, share)| models.set_item(name, share))?;
        Ok(Some(models))
    }

    /// Innovation of the last update (N m): reading minus predicted reading. `None` for methods without one.
    #[getter]
    fn innovation_n_m(&self) -> Option<f64> {
        self.estimate.innovation.map(|innovation| innovation.residual[0])
    }

    /// Variance of the innovation (N2 m2).
    #[getter]
    fn innovation_variance_n2_m2(&self) -> Option<f64> {
        self.estimate.innovation.map(|innovation| innovation.covariance[(0, 0)])
    }

    fn __repr__(&self) -> String {
        let (at, face) = (self.estimate.contact, self.face());
        let sd_m = self.estimate.covariance_m2.map(|covariance| covariance.trace().sqrt());
        let sd = sd_m.map_or_else(String::new, |sd_m| format!(", sd {:.3} mm", 1e3 * sd_m));
        format!("<Estimate: contact ({:.3}, {:.3}) mm on the {face}{sd}>", 1e3 * at.x(), 1e3 * at.y())
    }
}

fn array<'py>(py: Python<'py>, point: Point<Base>) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, &[point.x(), point.y()])
}

fn square<'py>(py: Python<'py>, p: &Matrix2<f64>) -> Bound<'py, PyArray2<f64>> {
    numpy::ndarray::arr2(&[[p[(0, 0)], p[(0, 1)]], [p[(1, 0)], p[(1, 1)]]]).to_pyarray(py)
}

/// Estimate that an estimator written in Python returned: `None`, an `Estimate`, or an object with the attributes
/// `contact` (2) and, optionally, `covariance_m2` (2, 2), `innovation_n_m` and `innovation_variance_n2_m2`.
pub(crate) fn returned(
    object: &Bound<'_, PyAny>,
    face: Face,
    knowledge: &Knowledge,
) -> PyResult<Option<estimators::Estimate>> {
    if object.is_none() {
        return Ok(None);
    }
    if let Ok(estimate) = object.cast::<Estimate>() {
        return Ok(Some(estimate.get().estimate));
    }
    let contact = attribute(object, "contact")?.ok_or_else(|| {
        let found = object.repr().map_or_else(|_| "an object".into(), |text| text.to_string());
        refused("estimate", found, "None or an object with the attribute `contact` of shape [2]")
    })?;
    let contact = numbers("contact", &Numbers::of("contact", &contact)?)?;
    let &[x_m, y_m] = contact.as_slice() else {
        return Err(refused("contact", format!("{} numbers", contact.len()), "2, in Base (m)"));
    };
    let number = |name| attribute(object, name)?.map(|number| number.extract::<f64>()).transpose();
    let innovation = match (number("innovation_n_m")?, number("innovation_variance_n2_m2")?) {
        (None, None) => None,
        (Some(residual), Some(variance)) => Some((residual, variance)),
        _ => {
            return Err(refused(
                "innovation",
                "one number",
                "innovation_n_m and innovation_variance_n2_m2, or neither",
            ));
        }
    };
    let stated =
        StatedEstimate { contact_m: Vector2::new(x_m, y_m), covariance_m2: covariance_m2(object)?, innovation };
    stated.checked(face, knowledge).map(Some).map_err(|bad| bad_attribute(object, &bad))
}

/// The attribute `covariance_m2`, a square matrix. `None` if it is missing.
pub(crate) fn covariance_m2<const N: usize>(object: &Bound<'_, PyAny>) -> PyResult<Option<SMatrix<f64, N, N>>> {
    const NAME: &str = "covariance_m2";
    let Some(stated) = attribute(object, NAME)? else { return Ok(None) };
    let stated: Vec<[f64; N]> = rows(NAME, &Numbers::of(NAME, &stated)?)?;
    if stated.len() != N {
        return Err(refused(NAME, format!("{} rows", stated.len()), &format!("a matrix, {N} x {N}, in Base (m2)")));
    }
    Ok(Some(SMatrix::from_fn(|row, column| stated[row][column])))
}

/// An exception for an attribute whose value cannot be used.
pub(crate) fn bad_attribute(object: &Bound<'_, PyAny>, bad: &BadValue) -> PyErr {
    let found = object.getattr(bad.of).and_then(|value| value.str());
    let found = found.map_or_else(|_| "another value".into(), |text| text.to_string().replace('\n', ""));
    refused(bad.of, found, &bad.expected)
}

/// An attribute that is there and not `None`.
pub(crate) fn attribute<'py>(object: &Bound<'py, PyAny>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
    Ok(object.getattr_opt(name)?.filter(|value| !value.is_none()))
}
