//! Weighted linear least squares.

use nalgebra::{DMatrix, DVector};

/// Smallest singular value, relative to the largest, at which the coefficients are determined.
const DETERMINED: f64 = 1e-9;

/// Coefficients `c` that minimise the sum of `weights * (rows c - values)^2`, by the singular value decomposition.
/// `None` if they are not determined, or a number is not finite.
///
/// Shapes: `rows` n x p, `values` and `weights` n, the coefficients p.
pub(super) fn solve(rows: &DMatrix<f64>, values: &DVector<f64>, weights: &DVector<f64>) -> Option<DVector<f64>> {
    let roots = weights.map(f64::sqrt);
    let mut scaled = rows.clone();
    for (mut row, root) in scaled.row_iter_mut().zip(&roots) {
        row *= *root;
    }
    let right = values.component_mul(&roots);
    // The iteration of the decomposition does not end on numbers that are not finite.
    if !scaled.iter().chain(&right).all(|number| number.is_finite()) {
        return None;
    }
    let svd = scaled.svd(true, true);
    let largest = svd.singular_values.max();
    let determined = svd.singular_values.len() == rows.ncols() && svd.singular_values.min() > DETERMINED * largest;
    determined.then(|| svd.solve(&right, 0.0).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_numbers_that_are_not_finite_determine_nothing() {
        let rows = DMatrix::from_fn(4, 2, |i, power| (i as f64).powi(power as i32));
        let (values, equal) = (DVector::from_fn(4, |i, _| 3.0 - i as f64), DVector::repeat(4, 1.0));
        let found = solve(&rows, &values, &equal).expect("determined");
        assert!((found - DVector::from_vec(vec![3.0, -1.0])).norm() < 1e-12);
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut of_rows = rows.clone();
            of_rows[(2, 1)] = wrong;
            assert_eq!(solve(&of_rows, &values, &equal), None);
            for vectors in [0, 1].map(|place| {
                let mut vectors = [values.clone(), equal.clone()];
                vectors[place][1] = wrong;
                vectors
            }) {
                assert_eq!(solve(&rows, &vectors[0], &vectors[1]), None);
            }
        }
    }
}
