//! Cholesky factorisation of matrices whose size is known at run time only, with the widest registers of the processor, and the
//! inverse by blocks.

use nalgebra::{Cholesky, DMatrix, DMatrixView, Dyn};

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

/// Largest number of rows of a matrix that is not divided into blocks: smaller products would spend most of their time on copies.
const UNDIVIDED: usize = 64;

/// Inverse of a symmetric matrix, of which only the lower triangle is read. `None` unless it is positive definite. Most of the work
/// is done by products of blocks, so that large matrices take a fraction of the time of nalgebra's `Cholesky::inverse`.
///
/// # Panics
/// If the matrix is not square.
pub fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    assert!(matrix.is_square(), "a matrix with an inverse is square");
    let inverse_factor = inverse_factor(matrix.as_view())?;
    // `tr_mul` does not work by blocks.
    Some(inverse_factor.transpose() * inverse_factor)
}

/// Inverse of the lower triangular Cholesky factor. If the matrix has the blocks `A` and `D` on the diagonal and `B` below it, the
/// factor has the blocks `L_A` and `L_S` on the diagonal and `C = B L_A^-T` below it. `L_A` is the factor of `A`, and `L_S` that of
/// `S = D - C C^T`.
fn inverse_factor(matrix: DMatrixView<'_, f64>) -> Option<DMatrix<f64>> {
    let size = matrix.nrows();
    if size <= UNDIVIDED {
        let mut inverse = DMatrix::identity(size, size);
        cholesky(matrix.into_owned())?.l_dirty().solve_lower_triangular_mut(&mut inverse);
        return Some(inverse);
    }
    let first = size / 2;
    let second = size - first;
    let upper = inverse_factor(matrix.view((0, 0), (first, first)))?;
    let below = matrix.view((first, 0), (second, first)) * upper.transpose();
    let mut remainder = matrix.view((first, first), (second, second)).into_owned();
    remainder.gemm(-1.0, &below, &below.transpose(), 1.0);
    let lower = inverse_factor(remainder.as_view())?;
    let mut inverse = DMatrix::zeros(size, size);
    inverse.view_mut((first, 0), (second, first)).gemm(-1.0, &lower, &(below * &upper), 0.0);
    inverse.view_mut((0, 0), (first, first)).copy_from(&upper);
    inverse.view_mut((first, first), (second, second)).copy_from(&lower);
    Some(inverse)
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
    fn verif_the_inverse_by_blocks_is_the_inverse() {
        for size in [0, 1, 7, UNDIVIDED, UNDIVIDED + 1, 3 * UNDIVIDED + 5] {
            let (mut matrix, whole) = (matrix(size), matrix(size));
            matrix.fill_upper_triangle(f64::NAN, 1);
            let found = inverse(&matrix).unwrap();
            assert!((&found * whole - DMatrix::identity(size, size)).amax() < 1e-9, "{size}");
            assert_eq!(found, found.transpose(), "{size}");
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
        for row in [5, 2 * UNDIVIDED] {
            let mut indefinite = matrix(2 * UNDIVIDED + 9);
            indefinite[(row, row)] = -1.0;
            assert!(inverse(&indefinite).is_none());
        }
    }
}
