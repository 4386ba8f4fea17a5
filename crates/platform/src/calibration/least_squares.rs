//! Weighted linear least squares.

use nalgebra::{DMatrix, DVector};

/// Smallest singular value, relative to the largest, at which the coefficients are determined.
const DETERMINED: f64 = 1e-9;

/// Coefficients `c` that minimise the sum of `weights * (rows c - values)^2`, by the singular value decomposition.
/// `None` if they are not determined.
///
/// Shapes: `rows` n x p, `values` and `weights` n, the coefficients p.
pub(super) fn solve(rows: &DMatrix<f64>, values: &DVector<f64>, weights: &DVector<f64>) -> Option<DVector<f64>> {
    let roots = weights.map(f64::sqrt);
    let mut scaled = rows.clone();
    for (mut row, root) in scaled.row_iter_mut().zip(&roots) {
        row *= *root;
    }
    let svd = scaled.svd(true, true);
    let largest = svd.singular_values.max();
    let determined = svd.singular_values.len() == rows.ncols() && svd.singular_values.min() > DETERMINED * largest;
    determined.then(|| svd.solve(&values.component_mul(&roots), 0.0).ok()).flatten()
}
