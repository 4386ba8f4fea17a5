//! A curve that falls everywhere: the farther out a whisker is pushed, the less its root turns.
//!
//! A Bernstein polynomial falls where its coefficients do. Written as a first coefficient less steps `t_k >= 0`, `d(u) = c - sum_k t_k S_k(u)`
//! with `S_k = sum_{j >= k} B_j`, it is a problem of least squares with signs, which Lawson and Hanson's active set solves (*Solving Least Squares
//! Problems*, 1974, chapter 23).

use nalgebra::{DMatrix, DVector};

use super::{Regressor, Scale, log_slope};
use crate::calibration::least_squares::solve;
use crate::calibration::{Error, Features, LabelledPress};

const NAME: &str = "monotone";
const ORDER: usize = 6;

#[derive(Clone, Debug)]
struct Monotone {
    scale: Scale,
    first_m: f64,
    steps_m: DVector<f64>,
}

/// `S_1 .. S_ORDER` at `u`; beyond 0 .. 1 they go on straight.
fn sums(u: f64) -> [f64; ORDER] {
    let inside = u.clamp(0.0, 1.0);
    let term = |order: usize, j: usize| {
        let choose = (0..j).fold(1.0, |product, i| product * (order - i) as f64 / (i + 1) as f64);
        choose * inside.powi(j as i32) * (1.0 - inside).powi((order - j) as i32)
    };
    // The derivative of S_k is that of its first term's rise: ORDER times the Bernstein polynomial k - 1 of one order less.
    std::array::from_fn(|i| {
        let k = i + 1;
        let value: f64 = (k..=ORDER).map(|j| term(ORDER, j)).sum();
        value + (u - inside) * ORDER as f64 * term(ORDER - 1, k - 1)
    })
}

impl Regressor for Monotone {
    fn distance_m(&self, features: &Features) -> f64 {
        let u = 0.5 * (1.0 + self.scale.scaled(log_slope(features)));
        self.first_m - sums(u).iter().zip(&self.steps_m).map(|(sum, step)| sum * step).sum::<f64>()
    }
}

pub(super) fn fit(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    let undetermined = Error::Undetermined(NAME);
    let scale = Scale::of(presses.iter().map(|press| log_slope(&press.features))).ok_or(undetermined.clone())?;
    let rows = DMatrix::from_row_iterator(
        presses.len(),
        ORDER + 1,
        presses.iter().flat_map(|press| {
            let u = 0.5 * (1.0 + scale.scaled(log_slope(&press.features)));
            std::iter::once(1.0).chain(sums(u).map(|sum| -sum))
        }),
    );
    let distances_m = DVector::from_iterator(presses.len(), presses.iter().map(|press| press.distance_m));
    // The first coefficient is a distance and so positive as well.
    let coefficients = non_negative(&rows, &distances_m).ok_or(undetermined)?;
    Ok(Box::new(Monotone { scale, first_m: coefficients[0], steps_m: coefficients.rows(1, ORDER).into() }))
}

/// Least squares with coefficients that are zero or positive.
fn non_negative(rows: &DMatrix<f64>, values: &DVector<f64>) -> Option<DVector<f64>> {
    let columns = rows.ncols();
    let tolerance = 1e-10 * (rows.transpose() * values).amax();
    let mut free: Vec<usize> = Vec::new();
    let mut coefficients = DVector::zeros(columns);
    let equal = DVector::repeat(rows.nrows(), 1.0);
    for _ in 0..10 * columns {
        let descent = rows.transpose() * (values - rows * &coefficients);
        let steepest = (0..columns).filter(|i| !free.contains(i)).max_by(|&a, &b| descent[a].total_cmp(&descent[b]));
        let Some(next) = steepest.filter(|&i| descent[i] > tolerance) else { return Some(coefficients) };
        free.push(next);
        loop {
            let Some(best) = solve(&rows.select_columns(&free), values, &equal) else {
                // Presses too few to tell this step from its neighbours: what there is, is as good.
                return (free.len() > 1).then_some(coefficients);
            };
            let reach = |(&i, &target): (&usize, &f64)| coefficients[i] / (coefficients[i] - target);
            let shortest =
                free.iter().zip(&best).filter(|(_, target)| **target <= 0.0).map(reach).min_by(f64::total_cmp);
            let share = shortest.unwrap_or(1.0);
            for (&i, &target) in free.iter().zip(&best) {
                coefficients[i] += share * (target - coefficients[i]);
            }
            if shortest.is_none() {
                break;
            }
            free.retain(|&i| coefficients[i] > 1e-15);
            for i in (0..columns).filter(|i| !free.contains(i)) {
                coefficients[i] = 0.0;
            }
        }
    }
    Some(coefficients)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::regression::exam::presses;

    #[test]
    fn verif_it_falls_whatever_the_labels_are_inside_and_outside() {
        let mut presses = presses(25);
        for (i, press) in presses.iter_mut().enumerate() {
            press.distance_m += 0.03 * (11.0 * i as f64).sin();
        }
        let fitted = fit(&presses).unwrap();
        let at = |slope_counts_per_s| {
            fitted.distance_m(&Features { slope_counts_per_s, peak_counts: None, slope_ratio: None })
        };
        let curve: Vec<f64> = (0..400).map(|i| at(5e3 * 1.01_f64.powi(i))).collect();
        assert!(curve.windows(2).all(|pair| pair[1] <= pair[0] + 1e-12));
        assert!(curve[0] > curve[399]);
    }
}
