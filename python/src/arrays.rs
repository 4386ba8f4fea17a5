//! NumPy arrays from and to Rust values.

use nalgebra::{Matrix3, SMatrix, SVector};
use numpy::ndarray::{Array1, Array2, Array3, ArrayD};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyList};
use whisker::frames::Point;

use crate::error::{of_argument, refused};

/// Largest number of coordinates in an array of points.
const MOST_NUMBERS: usize = 100_000_000;

/// Rounding errors of a covariance, relative to its norm.
const ROUNDING: f64 = 1e-9;

/// Expectation in an error about a matrix that is no covariance.
pub(crate) const COVARIANCE: &str = "a symmetric matrix without negative eigenvalues";

/// An array of real numbers, or what NumPy converts to one.
pub(crate) struct Numbers<'py>(PyReadonlyArrayDyn<'py, f64>);

impl<'a, 'py> FromPyObject<'a, 'py> for Numbers<'py> {
    type Error = PyErr;

    /// # Errors
    /// `TypeError` for flags, complex numbers, texts, times and other objects, and for masked arrays, whose masked elements have no
    /// value.
    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let numpy = object.py().import("numpy")?;
        if object.is_instance(&numpy.getattr("ma")?.getattr("MaskedArray")?)? {
            return Err(PyTypeError::new_err("found a masked array, expected an array of real numbers"));
        }
        let array = numpy.call_method1("asarray", (object,))?;
        let dtype = array.getattr("dtype")?;
        let kind: char = dtype.getattr("kind")?.extract()?;
        if !"iuf".contains(kind) {
            return Err(PyTypeError::new_err(format!("found an array of {dtype}, expected one of real numbers")));
        }
        Ok(Self(numpy.call_method1("asarray", (array, "float64"))?.extract()?))
    }
}

impl<'py> Numbers<'py> {
    /// Shape of the array.
    pub(crate) fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    /// The numbers of a part of an argument, which errors name `what`.
    pub(crate) fn of(what: &str, object: &Bound<'py, PyAny>) -> PyResult<Self> {
        object.extract().map_err(|error| of_argument(object.py(), what, error))
    }
}

/// Array of NaN of shape (`rows`, `count`, `coordinates`) for as many points in each row as the argument `count` states.
///
/// # Errors
/// `ValueError` if there are fewer than `least` points, or more than [`MOST_NUMBERS`] coordinates in all.
pub(crate) fn points_of_rows(rows: usize, count: usize, least: usize, coordinates: usize) -> PyResult<Array3<f64>> {
    if count < least {
        return Err(refused("count", count, &format!("at least {least} points")));
    }
    let most = MOST_NUMBERS / (rows.max(1) * coordinates);
    if count > most {
        return Err(refused("count", count, &format!("at most {most} points for an array of {rows} rows")));
    }
    Ok(Array3::from_elem((rows, count, coordinates), f64::NAN))
}

/// Rows of an array of shape (n, `N`), which must be finite.
pub(crate) fn rows<const N: usize>(what: &str, array: &Numbers<'_>) -> PyResult<Vec<[f64; N]>> {
    let shape = array.0.shape();
    if shape.len() != 2 || shape[1] != N {
        return Err(refused(what, format!("an array of shape {shape:?}"), &format!("shape [n, {N}]")));
    }
    let numbers = finite(what, array)?;
    Ok(numbers.chunks_exact(N).map(|row| std::array::from_fn(|i| row[i])).collect())
}

/// Covariances of an array of shape (n, 3, 3), which must be finite, and symmetric without negative eigenvalues but for rounding.
pub(crate) fn covariances(what: &str, array: &Numbers<'_>) -> PyResult<Vec<Matrix3<f64>>> {
    let shape = array.0.shape();
    if shape.len() != 3 || shape[1..] != [3, 3] {
        return Err(refused(what, format!("an array of shape {shape:?}"), "shape [n, 3, 3]"));
    }
    let numbers = finite(what, array)?;
    let covariance = |(row, matrix): (usize, Matrix3<f64>)| {
        if !is_covariance(&matrix) {
            let found = format!("{:?}", <[[f64; 3]; 3]>::from(matrix.transpose()));
            return Err(refused(&format!("{what}[{row}]"), found, COVARIANCE));
        }
        Ok(matrix)
    };
    numbers.chunks_exact(9).map(Matrix3::from_row_slice).enumerate().map(covariance).collect()
}

/// Whether a finite matrix is symmetric and has no negative eigenvalues, but for rounding.
pub(crate) fn is_covariance(matrix: &Matrix3<f64>) -> bool {
    let error = ROUNDING * matrix.norm();
    (matrix - matrix.transpose()).amax() <= error && matrix.symmetric_eigenvalues().min() >= -error
}

/// Numbers of an array of shape (n), which must be finite.
pub(crate) fn numbers(what: &str, array: &Numbers<'_>) -> PyResult<Vec<f64>> {
    if array.0.shape().len() != 1 {
        return Err(refused(what, format!("an array of shape {:?}", array.0.shape()), "shape [n]"));
    }
    finite(what, array)
}

/// Numbers of an array in the order of its indices.
fn finite(what: &str, array: &Numbers<'_>) -> PyResult<Vec<f64>> {
    let numbers: Vec<f64> = array.0.as_array().iter().copied().collect();
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(place) => {
            let per_row: usize = array.0.shape().iter().skip(1).product();
            let row = place / per_row.max(1);
            Err(refused(&format!("{what}[{row}]"), numbers[place], "finite numbers"))
        }
        None => Ok(numbers),
    }
}

/// Function of each number of an array of any shape, which must be finite: a number for a number, else an array of this shape.
pub(crate) fn mapped<'py>(
    py: Python<'py>,
    what: &str,
    array: &Numbers<'_>,
    of: impl Fn(f64) -> f64,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = array.0.shape();
    let numbers: Vec<f64> = finite(what, array)?.into_iter().map(of).collect();
    if shape.is_empty() {
        return Ok(PyFloat::new(py, numbers[0]).into_any());
    }
    Ok(ArrayD::from_shape_vec(shape, numbers).expect("a number for each number").into_pyarray(py).into_any())
}

/// Points of an array of shape (n, 2).
pub(crate) fn points<F>(what: &str, array: &Numbers<'_>) -> PyResult<Vec<Point<F>>> {
    Ok(rows(what, array)?.into_iter().map(|[x_m, y_m]| Point::new(x_m, y_m)).collect())
}

/// Checks that a second array has as many rows as the first.
pub(crate) fn same_length(what: &str, found: usize, of: &str, expected: usize) -> PyResult<()> {
    if found == expected {
        return Ok(());
    }
    Err(refused(what, format!("{found} rows"), &format!("{expected}, as many as `{of}` has")))
}

/// Times (n) in s, which must be finite and ascend.
pub(crate) fn times(what: &str, array: &Numbers<'_>) -> PyResult<Vec<f64>> {
    let times_s = numbers(what, array)?;
    match times_s.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(row) => {
            let expected = format!("more than the last, {}", times_s[row]);
            Err(refused(&format!("{what}[{}]", row + 1), times_s[row + 1], &expected))
        }
        None => Ok(times_s),
    }
}

/// Place of a row among `count`, which a negative number counts from the end.
pub(crate) fn place(row: isize, count: usize) -> PyResult<usize> {
    let place = if row < 0 { row.checked_add_unsigned(count) } else { Some(row) };
    let place = place.and_then(|place| usize::try_from(place).ok()).filter(|&place| place < count);
    place.ok_or_else(|| PyIndexError::new_err(format!("row {row} of {count}")))
}

/// Array of shape (n). A missing number is NaN.
pub(crate) fn column<'py>(
    py: Python<'py>,
    numbers: impl IntoIterator<Item = Option<f64>>,
) -> Bound<'py, PyArray1<f64>> {
    numbers.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect::<Array1<f64>>().into_pyarray(py)
}

/// Array of shape (n, `N`). A missing vector is NaN.
pub(crate) fn vectors<'py, const N: usize>(
    py: Python<'py>,
    vectors: impl ExactSizeIterator<Item = Option<SVector<f64, N>>>,
) -> Bound<'py, PyArray2<f64>> {
    let rows = vectors.len();
    let missing = SVector::repeat(f64::NAN);
    let numbers: Vec<f64> = vectors.flat_map(|vector| <[f64; N]>::from(vector.unwrap_or(missing))).collect();
    Array2::from_shape_vec((rows, N), numbers).expect("N numbers a row").into_pyarray(py)
}

/// Array of shape (n, `R`, `C`). A missing matrix is NaN.
pub(crate) fn matrices<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    matrices: impl ExactSizeIterator<Item = Option<SMatrix<f64, R, C>>>,
) -> Bound<'py, PyArray3<f64>> {
    let rows = matrices.len();
    let missing = SMatrix::<f64, R, C>::repeat(f64::NAN);
    let in_rows = |matrix: SMatrix<f64, R, C>| (0..R * C).map(move |place| matrix[(place / C, place % C)]);
    let numbers: Vec<f64> = matrices.flat_map(|matrix| in_rows(matrix.unwrap_or(missing))).collect();
    Array3::from_shape_vec((rows, R, C), numbers).expect("R C numbers a row").into_pyarray(py)
}

/// Array of flags.
pub(crate) fn flags<'py>(py: Python<'py>, flags: impl IntoIterator<Item = bool>) -> Bound<'py, PyArray1<bool>> {
    flags.into_iter().collect::<Array1<bool>>().into_pyarray(py)
}

/// Array of 1 (true), 0 (false) and -1 (unknown).
pub(crate) fn known_flags<'py>(
    py: Python<'py>,
    flags: impl IntoIterator<Item = Option<bool>>,
) -> Bound<'py, PyArray1<i8>> {
    flags.into_iter().map(|flag| flag.map_or(-1, i8::from)).collect::<Array1<i8>>().into_pyarray(py)
}

/// Array of text.
pub(crate) fn texts<'py, T: AsRef<str>>(
    py: Python<'py>,
    texts: impl IntoIterator<Item = T>,
) -> PyResult<Bound<'py, PyAny>> {
    let texts: Vec<String> = texts.into_iter().map(|text| text.as_ref().to_owned()).collect();
    // Without text NumPy would return an array of numbers.
    let width = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
    py.import("numpy")?.call_method1("array", (PyList::new(py, texts)?, format!("U{width}")))
}

/// Read-only structured array of columns, each with a name and `count` values.
pub(crate) fn structured<'py>(
    py: Python<'py>,
    count: usize,
    columns: &[(&str, Bound<'py, PyAny>)],
) -> PyResult<Bound<'py, PyAny>> {
    let kinds: Vec<(&str, Bound<'py, PyAny>)> =
        columns.iter().map(|(name, column)| Ok((*name, column.getattr("dtype")?))).collect::<PyResult<_>>()?;
    let table = py.import("numpy")?.call_method1("empty", (count, kinds))?;
    for (name, column) in columns {
        table.set_item(name, column)?;
    }
    table.call_method1("setflags", (false,))?;
    Ok(table)
}
