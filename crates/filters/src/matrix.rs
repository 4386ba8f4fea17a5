//! Products of small matrices. The unrolled loops are several times faster than nalgebra's products for any size, and a
//! filter step takes dozens of them.

use nalgebra::SMatrix;

/// Matrix product `a b`. Neither matrix may be empty.
#[inline]
pub fn product<const R: usize, const K: usize, const C: usize>(
    a: &SMatrix<f64, R, K>,
    b: &SMatrix<f64, K, C>,
) -> SMatrix<f64, R, C> {
    let mut product = SMatrix::zeros();
    for column in 0..C {
        for row in 0..R {
            let first = a[(row, 0)] * b[(0, column)];
            product[(row, column)] = (1..K).fold(first, |sum, k| sum + a[(row, k)] * b[(k, column)]);
        }
    }
    product
}

/// Congruence `a p a'`: the covariance `p` after the linear map `a`.
#[inline]
pub fn congruence<const R: usize, const K: usize>(
    a: &SMatrix<f64, R, K>,
    p: &SMatrix<f64, K, K>,
) -> SMatrix<f64, R, R> {
    product(&product(a, p), &a.transpose())
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2x3, Matrix3, Matrix3x4};

    use super::*;

    #[test]
    fn val_products_equal_nalgebras() {
        let a = Matrix2x3::from_fn(|i, j| 0.3 + i as f64 - 0.7 * (j * j) as f64);
        let b = Matrix3x4::from_fn(|i, j| 1.0 / (1.0 + i as f64 + 2.0 * j as f64));
        let p = Matrix3::from_fn(|i, j| 1.0 / (1.0 + (i + j) as f64));
        assert_eq!(product(&a, &b), a * b);
        assert_eq!(congruence(&a, &p), a * p * a.transpose());
    }
}
