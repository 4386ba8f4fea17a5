//! The exact quasi-static whisker, for many loads at once.

use ::whisker::elastica::{CenterLine, Deflection, Elastica, Load, PointContact};
use ::whisker::frames::Base;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::arrays::{Numbers, column, numbers, points, points_of_rows, same_length, vectors};
use crate::interrupt;
use crate::whisker::Whisker;

/// Contacts of a whisker in equilibrium, one row each. NaN where there is no equilibrium.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Contacts {
    elastica: Elastica,
    length_m: f64,
    contacts: Vec<Result<PointContact, String>>,
}

/// Deflection of a whisker whose centre line passes through given contacts (n, 2) in Base (m), by a force across the
/// whisker: moment, force and shape, with their derivatives.
///
/// The whisker is the exact elastica on a compliant root. A contact without an equilibrium, out of the whisker's reach or
/// beyond buckling, is a row of NaN with its reason in `failures`; with `strict` it raises `ValueError`.
#[pyfunction]
#[pyo3(signature = (whisker, points, strict=false))]
pub(crate) fn deflect(py: Python<'_>, whisker: &Whisker, points: Numbers<'_>, strict: bool) -> PyResult<Contacts> {
    let goals = self::points::<Base>("points", &points)?;
    Contacts::new(py, whisker, goals.len(), strict.then_some("points"), |elastica, row| elastica.at_point(goals[row]))
}

/// Deflection of a whisker by forces (n) across it at arc lengths (n) from the root, positive to its left: the forward map.
///
/// A load beyond the capacity of the whisker is a row of NaN with its reason in `failures`; with `strict` it raises
/// `ValueError`.
#[pyfunction]
#[pyo3(signature = (whisker, arc_m, force_n, strict=false))]
pub(crate) fn press(
    py: Python<'_>,
    whisker: &Whisker,
    arc_m: Numbers<'_>,
    force_n: Numbers<'_>,
    strict: bool,
) -> PyResult<Contacts> {
    let (arcs_m, forces_n) = (whisker.arcs_m(&arc_m)?, numbers("force_n", &force_n)?);
    same_length("force_n", forces_n.len(), "arc_m", arcs_m.len())?;
    Contacts::new(py, whisker, arcs_m.len(), strict.then_some("arc_m"), |elastica, row| {
        let load = Load { arc_m: arcs_m[row], along_n: 0.0, left_n: forces_n[row], couple_n_m: 0.0 };
        let pressed = elastica.deflect(load)?;
        elastica.at_point_near(pressed.point, &load)
    })
}

impl Contacts {
    /// Solves the contacts row by row. `strict` is the name of the argument that an error of a row names.
    fn new(
        py: Python<'_>,
        whisker: &Whisker,
        count: usize,
        strict: Option<&str>,
        solve: impl Fn(&Elastica, usize) -> Result<PointContact, ::whisker::elastica::Failure> + Sync,
    ) -> PyResult<Self> {
        let elastica = whisker.elastica()?;
        let mut contacts = Vec::with_capacity(count);
        interrupt::each(py, count, |row| {
            let solved = solve(&elastica, row).map_err(|failure| failure.to_string());
            if let (Some(what), Err(reason)) = (strict, &solved) {
                anyhow::bail!("{what}[{row}]: {reason}");
            }
            contacts.push(solved);
            Ok(())
        })?;
        Ok(Self { elastica, length_m: whisker.whisker.length_m, contacts })
    }

    fn column<'py>(&self, py: Python<'py>, number: impl Fn(&PointContact) -> f64) -> Bound<'py, PyArray1<f64>> {
        column(py, self.contacts.iter().map(|contact| contact.as_ref().ok().map(&number)))
    }

    fn vectors<'py>(
        &self,
        py: Python<'py>,
        vector: impl Fn(&PointContact) -> nalgebra::Vector2<f64>,
    ) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.contacts.iter().map(|contact| contact.as_ref().ok().map(&vector)))
    }

    fn of<'py>(&self, py: Python<'py>, number: impl Fn(&Deflection) -> f64) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |contact| number(&contact.deflection))
    }
}

#[pymethods]
impl Contacts {
    /// Contacts (n, 2) on the centre line, in Base (m).
    #[getter]
    fn point<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.vectors(py, |contact| contact.deflection.point.vector())
    }

    /// Bending moments at the root (n), the readings (N m): negative if the object lies on the left.
    #[getter]
    fn moment_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of(py, |deflection| deflection.moment_n_m)
    }

    /// Forces (n) across the whisker, positive to its left (N).
    #[getter]
    fn force_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |contact| contact.load.left_n)
    }

    /// Arc lengths of the contacts from the root (n), in m.
    #[getter]
    fn arc_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |contact| contact.load.arc_m)
    }

    /// Tangent angles of the whisker at the contacts (n), in Base (rad).
    #[getter]
    fn tangent_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of(py, |deflection| deflection.tangent_rad)
    }

    /// Rotations of the root against the base (n), in rad.
    #[getter]
    fn rotation_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of(py, |deflection| deflection.rotation_rad)
    }

    /// Tips (n, 2), in Base (m).
    #[getter]
    fn tip<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.vectors(py, |contact| contact.deflection.tip.vector())
    }

    /// Derivatives (n, 2) of the moments by the contact's coordinates, in N (N m per m).
    #[getter]
    fn moment_gradient_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.vectors(py, |contact| contact.moment_gradient_n)
    }

    /// Derivatives (n, 2) of the forces by the contact's coordinates, in N/m.
    #[getter]
    fn force_gradient_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.vectors(py, |contact| contact.force_gradient_n_m)
    }

    /// Derivatives (n, 2) of the tangent angles by the contact's coordinates, in rad/m.
    #[getter]
    fn tangent_gradient_rad_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.vectors(py, |contact| contact.tangent_gradient_rad_m)
    }

    /// Derivatives (n, 2) of the arc lengths by the contact's coordinates.
    #[getter]
    fn arc_gradient<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.vectors(py, |contact| contact.arc_gradient)
    }

    /// Rows without an equilibrium, each with its reason.
    #[getter]
    fn failures(&self) -> Vec<(usize, &str)> {
        let rows = self.contacts.iter().enumerate();
        rows.filter_map(|(row, contact)| Some((row, contact.as_ref().err()?.as_str()))).collect()
    }

    /// Shapes (n, count, 2) of the deflected centre lines at evenly spaced arc lengths from root to tip, in Base (m). The array has
    /// at most 1e8 numbers.
    #[pyo3(signature = (count=101))]
    fn shape<'py>(&self, py: Python<'py>, count: usize) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let mut shapes = points_of_rows(self.contacts.len(), count, 2, 2)?;
        interrupt::each(py, self.contacts.len(), |row| {
            let Ok(contact) = &self.contacts[row] else { return Ok(()) };
            let line: CenterLine = self.elastica.line(contact.load)?;
            for i in 0..count {
                let (point, _) = line.at(self.length_m * i as f64 / (count - 1) as f64);
                shapes[[row, i, 0]] = point.x();
                shapes[[row, i, 1]] = point.y();
            }
            Ok(())
        })?;
        Ok(shapes.into_pyarray(py))
    }

    fn __len__(&self) -> usize {
        self.contacts.len()
    }
}
