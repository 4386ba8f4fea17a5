//! Error of a sensor model over its calibrated domain.
//!
//! It has two parts: the misfit of the formula, estimated from the residuals on held-out data, and the uncertainty due
//! to noise and the number of samples, which the fit gives as a variance. The residuals contain both, the second as
//! that of the fits without the held-out data; it is subtracted, and that of the fit to all samples is added, which
//! gives the map of the final model.

use serde::{Deserialize, Serialize};

use super::Shares;
use super::domain::node_below;

/// Nodes along and away.
const NODES: (usize, usize) = (12, 6);

/// Weight of the region's mean at each node, in samples of an average node.
const SHRINKAGE: f64 = 0.5;

/// Standard deviation of the error on nodes spread evenly over the region, along and away; variances are interpolated
/// linearly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorMap {
    /// Nodes along the whisker, from the first calibrated arc length to the last.
    pub along: usize,
    /// Nodes away from it, from the smallest calibrated distance to the largest.
    pub away: usize,
    /// Standard deviations (N m), those of one arc length in sequence.
    pub sd_n_m: Vec<f64>,
}

/// A residual on held-out data.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    /// Position within the region, see [`super::Domain::shares`].
    pub(super) shares: Shares,
    pub(super) squared: f64,
}

/// Indices and weights of the four of `along` x `away` nodes around a position.
#[inline]
pub(crate) fn corners(along: usize, away: usize, shares: Shares) -> [(usize, f64); 4] {
    let split = |share: f64, nodes: usize| node_below(share * (nodes - 1) as f64, nodes);
    let ((i, u), (j, v)) = (split(shares.along, along), split(shares.away, away));
    let index = i * away + j;
    [
        (index, (1.0 - u) * (1.0 - v)),
        (index + 1, (1.0 - u) * v),
        (index + away, u * (1.0 - v)),
        (index + away + 1, u * v),
    ]
}

impl ErrorMap {
    /// Positions of the nodes within the region.
    pub(super) fn nodes() -> Vec<Shares> {
        let (along, away) = NODES;
        let share = |node: usize, nodes: usize| node as f64 / (nodes - 1) as f64;
        (0..along)
            .flat_map(|i| (0..away).map(move |j| Shares { along: share(i, along), away: share(j, away) }))
            .collect()
    }

    /// The map of a fit. `heldout` and `remaining` are the variances at [`Self::nodes`] of the fits without the
    /// held-out data and of the final one, `noise` the variance of the noise in the residuals, `least` the smallest
    /// variance of the misfit.
    pub(super) fn new(residuals: &[Residual], heldout: &[f64], remaining: &[f64], noise: f64, least: f64) -> Self {
        let (along, away) = NODES;
        let mut weights = vec![0.0; along * away];
        let mut sums = vec![0.0; along * away];
        for residual in residuals {
            for (node, weight) in corners(along, away, residual.shares) {
                weights[node] += weight;
                sums[node] += weight * residual.squared;
            }
        }
        // The part of each node's squares that neither noise nor uncertainty explains.
        let excess: Vec<f64> = (0..sums.len()).map(|i| sums[i] - weights[i] * (heldout[i] + noise)).collect();
        let count = residuals.len() as f64;
        let mean = excess.iter().sum::<f64>() / count;
        let prior = SHRINKAGE * count / excess.len() as f64;
        let misfit = |i: usize| ((excess[i] + prior * mean) / (weights[i] + prior)).max(least);
        let sd_n_m = (0..excess.len()).map(|i| (misfit(i) + remaining[i]).sqrt()).collect();
        Self { along, away, sd_n_m }
    }

    /// The map of this error and an independent one with the given variance at a position within the region.
    pub(super) fn beside(&self, variance: impl Fn(Shares) -> f64) -> Self {
        let share = |node: usize, nodes: usize| node as f64 / (nodes - 1) as f64;
        let at = |node: usize| {
            variance(Shares { along: share(node / self.away, self.along), away: share(node % self.away, self.away) })
        };
        let sd_n_m = self.sd_n_m.iter().enumerate().map(|(node, sd_n_m)| sd_n_m.hypot(at(node).sqrt())).collect();
        Self { sd_n_m, ..*self }
    }

    /// Whether the lists describe a map.
    pub fn is_valid(&self) -> bool {
        self.along >= 2
            && self.away >= 2
            && Some(self.sd_n_m.len()) == self.along.checked_mul(self.away)
            && self.sd_n_m.iter().all(|sd| sd.is_finite() && *sd > 0.0)
    }

    /// Variance of the error at a position within the region.
    #[inline]
    pub fn variance_n2_m2(&self, shares: Shares) -> f64 {
        let [(first, a), (_, b), (second, c), (_, d)] = corners(self.along, self.away, shares);
        // One check of bounds for each pair of neighbours.
        let ([near, far], [near_next, far_next]) = (self.pair(first), self.pair(second));
        a * near.powi(2) + b * far.powi(2) + c * near_next.powi(2) + d * far_next.powi(2)
    }

    /// Standard deviations at a node and at the next one.
    #[inline]
    fn pair(&self, node: usize) -> [f64; 2] {
        let pair = &self.sd_n_m[node..node + 2];
        [pair[0], pair[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(along: f64, away: f64) -> Shares {
        Shares { along, away }
    }

    fn residuals(squared: impl Fn(f64, f64) -> f64) -> Vec<Residual> {
        let share = |i: i32| (f64::from(i) + 0.5) / 100.0;
        let places = (0..100).flat_map(|i| (0..100).map(move |j| (share(i), share(j))));
        places.map(|(u, v)| Residual { shares: shares(u, v), squared: squared(u, v) }).collect()
    }

    #[test]
    fn verif_variances_add_up() {
        let flat = |value: f64| vec![value; 72];
        let map = ErrorMap::new(&residuals(|_, _| 10.0), &flat(4.0), &flat(2.0), 1.0, 1e-9);
        assert!((map.variance_n2_m2(shares(0.37, 0.81)) - (10.0 - 4.0 - 1.0 + 2.0)).abs() < 1e-12);
    }

    #[test]
    fn verif_map_follows_the_residuals() {
        let map = ErrorMap::new(&residuals(|u, _| u), &vec![0.0; 72], &vec![0.0; 72], 0.0, 1e-9);
        assert!(map.is_valid());
        assert!(map.variance_n2_m2(shares(0.9, 0.5)) > 3.0 * map.variance_n2_m2(shares(0.1, 0.5)));
    }

    #[test]
    fn verif_an_independent_error_adds_its_variance_at_its_position() {
        let flat = ErrorMap { along: 12, away: 6, sd_n_m: vec![3.0; 72] };
        let both = flat.beside(|Shares { along, away }| 16.0 * along * away);
        assert!((both.variance_n2_m2(shares(1.0, 1.0)) - 25.0).abs() < 1e-12);
        assert!((both.variance_n2_m2(shares(1.0, 0.0)) - 9.0).abs() < 1e-12);
        assert!((both.variance_n2_m2(shares(0.0, 1.0)) - 9.0).abs() < 1e-12);
    }

    #[test]
    fn robust_an_error_below_the_noise_is_not_zero() {
        let map = ErrorMap::new(&residuals(|_, _| 1.0), &vec![3.0; 72], &vec![0.0; 72], 1.0, 0.25);
        assert!((map.variance_n2_m2(shares(0.5, 0.5)) - 0.25).abs() < 1e-12);
    }
}
