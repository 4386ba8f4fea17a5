//! Cholesky factorisation of matrices whose size is known at run time only, with the widest registers of the processor.

use nalgebra::{Cholesky, DMatrix, Dyn};

use crate::vectorised;

/// Number of earlier columns that are subtracted from a column in one pass over it.
const TOGETHER: usize = 4;

/// Factor of a symmetric matrix, of which only the lower triangle is read. `None` unless it is positive definite. The same bits as
/// by nalgebra, in a fraction of the time.
///
/// # Panics
/// If the matrix is not square.
pub fn cholesky(mut matrix: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    assert!(matrix.is_square(), "a matrix with a Cholesky factor is square");
    let (size, values) = (matrix.nrows(), matrix.as_mut_slice());
    vectorised!(factorise(values, size)).then(|| Cholesky::pack_dirty(matrix))
}

/// Replaces the lower triangle of a matrix, column by column, by its factor. Returns whether the matrix is positive definite.
#[inline(always)]
fn factorise(values: &mut [f64], size: usize) -> bool {
    for j in 0..size {
        let (before, rest) = values.split_at_mut(j * size);
        let column = &mut rest[j..size];
        // Rows from `j` on of an earlier column.
        let rows = |k: usize| &before[k * size + j..(k + 1) * size];
        let mut k = 0;
        while k + TOGETHER <= j {
            let [a, b, c, d] = [rows(k), rows(k + 1), rows(k + 2), rows(k + 3)];
            let [by_a, by_b, by_c, by_d] = [a[0], b[0], c[0], d[0]];
            for ((((entry, a), b), c), d) in column.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *entry = *entry - by_a * a - by_b * b - by_c * c - by_d * d;
            }
            k += TOGETHER;
        }
        for earlier in (k..j).map(rows) {
            let by = earlier[0];
            column.iter_mut().zip(earlier).for_each(|(entry, earlier)| *entry -= by * earlier);
        }
        let is_definite = column[0] > 0.0;
        if !is_definite {
            return false;
        }
        let root = column[0].sqrt();
        column[0] = root;
        column[1..].iter_mut().for_each(|entry| *entry /= root);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A positive definite matrix.
    fn matrix(size: usize) -> DMatrix<f64> {
        let root = DMatrix::from_fn(size, size, |i, j| ((1 + i * i + 3 * j) as f64).sin());
        &root * root.transpose() + DMatrix::identity(size, size)
    }

    #[test]
    fn val_factors_are_nalgebras() {
        for size in [0, 1, 2, 5, 16, 41] {
            let found = cholesky(matrix(size)).unwrap().unpack();
            assert_eq!(found, matrix(size).cholesky().unwrap().unpack(), "{size}");
        }
    }

    #[test]
    fn robust_a_matrix_that_is_not_positive_definite_has_no_factor() {
        let mut indefinite = matrix(7);
        indefinite[(5, 5)] = -1.0;
        let mut undefined = matrix(7);
        undefined[(5, 5)] = f64::NAN;
        assert!(cholesky(indefinite).is_none() && cholesky(undefined).is_none());
        assert!(cholesky(DMatrix::zeros(3, 3)).is_none());
    }
}
