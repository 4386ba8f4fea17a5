//! Linear least squares in square-root form.
//!
//! For a reading `y = x' c + e` with regressors `x`, coefficients `c` and white noise `e` of variance `v`, the triangle
//! `R`, `z`, `rho` of a QR decomposition of the rows `[x' | y]` is a sufficient statistic of `n` samples: `|y - X c|^2
//! = |z - R c|^2 + rho^2`. It is built up block by block, without the normal equations, which would square the
//! condition number (Golub and Van Loan, "Matrix Computations", 5.3). A penalty `w |D c|^2` corresponds to further rows
//! `[sqrt(w) D | 0]`.

use nalgebra::{DMatrix, DVector};

/// Number of rows that are reduced at a time.
const BLOCK: usize = 512;

/// Smallest diagonal element of a triangle that determines its coefficients, relative to the largest.
const DETERMINED: f64 = 1e-12;

/// Sufficient statistic of some samples for the coefficients.
#[derive(Clone, Debug)]
pub(crate) struct Triangle {
    /// `[R z; 0 rho]`.
    reduced: DMatrix<f64>,
    samples: usize,
}

/// Coefficients and their covariance.
#[derive(Clone, Debug)]
pub(crate) struct Estimate {
    pub(crate) coefficients: DVector<f64>,
    /// Variance of the noise.
    pub(crate) noise_variance: f64,
    /// Effective degrees of freedom of the coefficients: their number, reduced by a penalty.
    pub(crate) freedom: f64,
    /// `v^(1/2) R^-T`: the covariance of the coefficients is its transpose times itself.
    scatter: DMatrix<f64>,
}

fn reduce(rows: DMatrix<f64>) -> DMatrix<f64> {
    let columns = rows.ncols();
    rows.qr().unpack_r().resize_vertically(columns, 0.0)
}

impl Triangle {
    /// Samples with `count` regressors; `fill` writes those of a sample into a row of zeros and returns the reading.
    pub(crate) fn new<Sample>(count: usize, samples: &[Sample], fill: impl Fn(&Sample, &mut [f64]) -> f64) -> Self {
        let mut reduced = DMatrix::zeros(count + 1, count + 1);
        let mut row = vec![0.0; count + 1];
        for block in samples.chunks(BLOCK) {
            let mut stacked = reduced.resize_vertically(count + 1 + block.len(), 0.0);
            for (i, sample) in block.iter().enumerate() {
                row.fill(0.0);
                row[count] = fill(sample, &mut row[..count]);
                stacked.row_mut(count + 1 + i).copy_from_slice(&row);
            }
            reduced = reduce(stacked);
        }
        Self { reduced, samples: samples.len() }
    }

    fn count(&self) -> usize {
        self.reduced.ncols() - 1
    }

    /// The coefficients under a penalty `sum |D c|^2` with the rows `penalty`, which may be empty. `None` if they are
    /// not determined, or no degrees of freedom remain to estimate the noise.
    pub(crate) fn estimate(&self, penalty: &DMatrix<f64>) -> Option<Estimate> {
        let count = self.count();
        let held = penalty.nrows();
        let mut stacked = self.reduced.clone().resize_vertically(count + 1 + held, 0.0);
        stacked.view_mut((count + 1, 0), (held, count)).copy_from(penalty);
        let reduced = if held == 0 { stacked } else { reduce(stacked) };
        let square = reduced.view((0, 0), (count, count));
        let diagonal = square.diagonal().abs();
        // Samples without extent have no scale, and a diagonal of NaN, for which the comparison is false too.
        let is_determined = diagonal.min() > DETERMINED * diagonal.max();
        if !is_determined {
            return None;
        }
        let coefficients =
            square.solve_upper_triangular(&reduced.view((0, count), (count, 1)).column(0).into_owned())?;
        let inverse = square.solve_upper_triangular(&DMatrix::identity(count, count))?;

        let own = self.reduced.view((0, 0), (count, count));
        let misses = own * &coefficients - self.reduced.view((0, count), (count, 1));
        let squares = misses.norm_squared() + self.reduced[(count, count)].powi(2);
        let freedom = (own * &inverse).norm_squared();
        let left = self.samples as f64 - freedom;
        if left < 0.5 {
            return None;
        }
        let noise_variance = squares / left;
        Some(Estimate { coefficients, noise_variance, freedom, scatter: inverse.transpose() * noise_variance.sqrt() })
    }
}

impl Estimate {
    /// Variance of `x' c` for the regressors `x`.
    pub(crate) fn variance(&self, regressors: &DVector<f64>) -> f64 {
        (&self.scatter * regressors).norm_squared()
    }
}
