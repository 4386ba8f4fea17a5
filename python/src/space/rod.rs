//! The classes `Rod` and `SpatialContacts`: the exact quasi-static whisker in space, for many contacts at once.

use ::whisker::rod::{self, SpatialContact, Suspension};
use ::whisker::space::sensor::SpatialWhisker;
use nalgebra::Vector3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::arrays::{Numbers, column, matrices, points_of_rows, rows, vectors};
use crate::error::raised;
use crate::interrupt;
use crate::whisker::Whisker;

/// The whisker as a Kirchhoff rod: bending in two directions and twist, on a root with a spring about each axis.
///
/// `yaw_n_m_rad`, `pitch_n_m_rad` and `twist_n_m_rad` are the stiffnesses of the root about z, y and x of Base (N m/rad), by
/// default that of the whisker in its plane; `poisson_ratio` is that of the wire, which gives its stiffness in twist.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Rod {
    pub(super) whisker: SpatialWhisker,
    pub(super) rod: rod::Rod,
}

#[pymethods]
impl Rod {
    #[new]
    #[pyo3(signature = (whisker, *, yaw_n_m_rad=None, pitch_n_m_rad=None, twist_n_m_rad=None, poisson_ratio=0.33))]
    fn new(
        whisker: &Whisker,
        yaw_n_m_rad: Option<f64>,
        pitch_n_m_rad: Option<f64>,
        twist_n_m_rad: Option<f64>,
        poisson_ratio: f64,
    ) -> PyResult<Self> {
        let or_planar =
            |stiffness_n_m_rad: Option<f64>| stiffness_n_m_rad.unwrap_or(whisker.whisker.root_stiffness_n_m_rad);
        let suspension = Suspension {
            yaw_n_m_rad: or_planar(yaw_n_m_rad),
            pitch_n_m_rad: or_planar(pitch_n_m_rad),
            twist_n_m_rad: or_planar(twist_n_m_rad),
        };
        let whisker = SpatialWhisker { whisker: whisker.whisker.clone(), suspension, poisson_ratio };
        let rod = whisker.rod().map_err(raised)?;
        Ok(Self { whisker, rod })
    }

    /// Deflection of the whisker whose centre line passes through given contacts (n, 3) in Base (m), by a force across it: moment,
    /// force and shape, with their derivatives.
    ///
    /// A contact without an equilibrium is a row of NaN with its reason in `failures`; with `strict` it raises `ValueError`.
    #[pyo3(signature = (points, strict=false))]
    fn deflect(&self, py: Python<'_>, points: Numbers<'_>, strict: bool) -> PyResult<SpatialContacts> {
        let points = rows::<3>("points", &points)?;
        let mut contacts = Vec::with_capacity(points.len());
        interrupt::each(py, points.len(), |row| {
            let solved = self.rod.at_point(Vector3::from(points[row])).map_err(|failure| failure.to_string());
            if let (true, Err(reason)) = (strict, &solved) {
                anyhow::bail!("points[{row}]: {reason}");
            }
            contacts.push(solved);
            Ok(())
        })?;
        Ok(SpatialContacts { rod: self.rod.clone(), length_m: self.whisker.whisker.length_m, contacts })
    }
}

/// Contacts of a whisker in space in equilibrium, one row each. NaN where there is no equilibrium.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialContacts {
    rod: rod::Rod,
    length_m: f64,
    contacts: Vec<Result<SpatialContact, String>>,
}

impl SpatialContacts {
    fn map<T>(&self, value: impl Fn(&SpatialContact) -> T) -> impl ExactSizeIterator<Item = Option<T>> {
        self.contacts.iter().map(move |contact| contact.as_ref().ok().map(&value))
    }
}

#[pymethods]
impl SpatialContacts {
    /// Contacts (n, 3) on the centre line, in Base (m).
    #[getter]
    fn point<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|contact| contact.deflection.point))
    }

    /// Moments at the root (n, 3), in Base (N m): torsion about x, bending about y and z.
    #[getter]
    fn moment_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|contact| contact.deflection.moment_n_m))
    }

    /// Forces on the whisker (n, 3), in Base (N).
    #[getter]
    fn force_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|contact| contact.deflection.force_n))
    }

    /// Arc lengths of the contacts from the root (n), in m.
    #[getter]
    fn arc_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.map(|contact| contact.load.arc_m))
    }

    /// Unit tangents of the whisker at the contacts (n, 3), towards the tip, in Base.
    #[getter]
    fn tangent<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.map(|contact| contact.deflection.directors.column(0).into_owned()))
    }

    /// Derivatives (n, 3, 3) of the moments by the contact's coordinates, in N (N m per m).
    #[getter]
    fn moment_gradient_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.map(|contact| contact.moment_gradient_n))
    }

    /// Rows without an equilibrium, each with its reason.
    #[getter]
    fn failures(&self) -> Vec<(usize, &str)> {
        let rows = self.contacts.iter().enumerate();
        rows.filter_map(|(row, contact)| Some((row, contact.as_ref().err()?.as_str()))).collect()
    }

    /// Shapes (n, count, 3) of the deflected centre lines at evenly spaced arc lengths from root to tip, in Base (m). The array has
    /// at most 1e8 numbers.
    #[pyo3(signature = (count=101))]
    fn shape<'py>(&self, py: Python<'py>, count: usize) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let mut shapes = points_of_rows(self.contacts.len(), count, 2, 3)?;
        interrupt::each(py, self.contacts.len(), |row| {
            let Ok(contact) = &self.contacts[row] else { return Ok(()) };
            let line = self.rod.line(contact.load)?;
            for i in 0..count {
                let point = line.at(self.length_m * i as f64 / (count - 1) as f64);
                (0..3).for_each(|axis| shapes[[row, i, axis]] = point[axis]);
            }
            Ok(())
        })?;
        Ok(shapes.into_pyarray(py))
    }

    fn __len__(&self) -> usize {
        self.contacts.len()
    }
}
