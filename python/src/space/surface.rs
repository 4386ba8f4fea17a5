//! The class `SpatialSurface`: estimate of a surface from oriented points.

use std::ops::RangeInclusive;

use ::whisker::space::frames::Point;
use ::whisker::space::surface::{ImplicitSurface, LENGTHS_M, OrientedPoint, ProjectedPoint};
use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::{Numbers, column, covariances, numbers, rows, same_length, vectors};
use crate::error::refused;
use crate::interrupt;

/// Range of length scales.
const LENGTH_M: RangeInclusive<f64> = 1e-4..=1.0;

/// Values and their standard deviations.
type Values<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Points, their unit normals and standard deviations.
type Points<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// The surface of an object, estimated from touched points and their normals: a Gaussian process implicit surface.
///
/// `length_m` is the length scale, 0.0001 to 1 (m), about twice the radius of curvature of the object. `SpatialSurface.fit` chooses
/// it. Raises `ValueError` for another one.
#[pyclass(module = "whisker_contact")]
pub(crate) struct SpatialSurface {
    surface: ImplicitSurface,
}

/// Contacts as arrays of as many rows.
fn contacts(
    points: &Numbers<'_>,
    normals: &Numbers<'_>,
    covariance_m2: &Numbers<'_>,
    normal_sd_rad: &Numbers<'_>,
    touch: &[usize],
) -> PyResult<Vec<OrientedPoint>> {
    let (points, normals) = (rows::<3>("points", points)?, rows::<3>("normals", normals)?);
    let covariances_m2 = covariances("covariance_m2", covariance_m2)?;
    let normal_sd_rad = numbers("normal_sd_rad", normal_sd_rad)?;
    let lengths = [
        ("normals", normals.len()),
        ("covariance_m2", covariances_m2.len()),
        ("normal_sd_rad", normal_sd_rad.len()),
        ("touch", touch.len()),
    ];
    for (what, found) in lengths {
        same_length(what, found, "points", points.len())?;
    }
    let contact = |row: usize| {
        if normal_sd_rad[row] < 0.0 {
            return Err(refused(&format!("normal_sd_rad[{row}]"), normal_sd_rad[row], "zero or more"));
        }
        let normal = Vector3::from(normals[row]);
        let unit = normal.try_normalize(0.0).filter(|_| (normal.norm() - 1.0).abs() < 1e-3);
        let Some(normal) = unit else {
            return Err(refused(&format!("normals[{row}]"), format!("length {}", normal.norm()), "a unit vector"));
        };
        Ok(OrientedPoint {
            at: Point::from_vector(Vector3::from(points[row])),
            normal,
            covariance_m2: covariances_m2[row],
            normal_sd_rad: normal_sd_rad[row],
            touch: touch[row],
        })
    };
    (0..points.len()).map(contact).collect()
}

#[pymethods]
impl SpatialSurface {
    #[new]
    fn new(length_m: f64) -> PyResult<Self> {
        if !LENGTH_M.contains(&length_m) {
            return Err(refused("length_m", length_m, "0.0001 to 1 (m)"));
        }
        Ok(Self { surface: ImplicitSurface::new(length_m) })
    }

    /// The surface of touched points (n, 3) in World (m), unit normals (n, 3) out of the object, covariances (n, 3, 3) of the
    /// points in World (m2), standard deviations (n) of the normals (rad), and numbers (n) of the touches, with the length scale
    /// that has the largest evidence. A replay has the first three as `surface_world`, `normal_world` and `covariance_world_m2`.
    ///
    /// Errors of one touch are common to its points. Of more than 120 points, the most certain one of each touch in each cell of 1
    /// mm, or more, is used. Raises `ValueError` for arrays of different lengths, matrices that are no covariances, negative
    /// standard deviations, and normals that are no unit vectors.
    #[staticmethod]
    fn fit(
        py: Python<'_>,
        points: Numbers<'_>,
        normals: Numbers<'_>,
        covariance_m2: Numbers<'_>,
        normal_sd_rad: Numbers<'_>,
        touch: Vec<usize>,
    ) -> PyResult<Self> {
        let contacts = contacts(&points, &normals, &covariance_m2, &normal_sd_rad, &touch)?;
        let surface = py.detach(|| ImplicitSurface::fit(&contacts, &LENGTHS_M));
        Ok(Self { surface: surface.expect("there are lengths") })
    }

    /// Adds points, with arguments as for `fit`. A point is not used if another one of its touch is less than 1 mm away and nearly
    /// as certain. The time for each point grows with the square of the number of points used.
    fn add(
        &mut self,
        py: Python<'_>,
        points: Numbers<'_>,
        normals: Numbers<'_>,
        covariance_m2: Numbers<'_>,
        normal_sd_rad: Numbers<'_>,
        touch: Vec<usize>,
    ) -> PyResult<()> {
        let contacts = contacts(&points, &normals, &covariance_m2, &normal_sd_rad, &touch)?;
        interrupt::each(py, contacts.len(), |row| {
            self.surface.add(&contacts[row]);
            Ok(())
        })
    }

    /// Length scale (m).
    #[getter]
    fn length_m(&self) -> f64 {
        self.surface.length_m()
    }

    /// Logarithm of the evidence of the points for the length scale.
    #[getter]
    fn log_evidence(&self) -> f64 {
        self.surface.log_evidence()
    }

    /// Values (n) at points (n, 3) in World (m): zero on the surface, positive outside, near the points the distance (m); and their
    /// standard deviations (n) (m), infinite farther than the length scale from all points.
    fn level<'py>(&self, py: Python<'py>, points: Numbers<'_>) -> PyResult<Values<'py>> {
        let points = rows::<3>("points", &points)?;
        let mut levels = Vec::with_capacity(points.len());
        interrupt::each(py, points.len(), |row| {
            levels.push(self.surface.level(Point::from_vector(Vector3::from(points[row]))));
            Ok(())
        })?;
        let values = column(py, levels.iter().map(|level| Some(level.value_m)));
        Ok((values, column(py, levels.iter().map(|level| Some(level.sd_m)))))
    }

    /// Projections (n, 3) of points (n, 3) in World (m) onto the surface, along its gradient, their unit normals (n, 3) out of the
    /// object, and the standard deviations (n) of the surface along them (m). NaN where there is no surface nearby.
    fn project<'py>(&self, py: Python<'py>, points: Numbers<'_>) -> PyResult<Points<'py>> {
        let points = rows::<3>("points", &points)?;
        let mut found: Vec<Option<ProjectedPoint>> = Vec::with_capacity(points.len());
        interrupt::each(py, points.len(), |row| {
            found.push(self.surface.project(Point::from_vector(Vector3::from(points[row]))));
            Ok(())
        })?;
        let places = vectors(py, found.iter().map(|on| on.map(|on| on.at.vector())));
        let normals = vectors(py, found.iter().map(|on| on.map(|on| on.normal)));
        Ok((places, normals, column(py, found.iter().map(|on| on.map(|on| on.sd_m)))))
    }

    /// Number of points that are used.
    fn __len__(&self) -> usize {
        self.surface.points().len()
    }
}
