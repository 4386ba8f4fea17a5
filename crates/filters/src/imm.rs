//! Jump Markov systems: one of several modes is active at a time and may switch at any step.
//!
//! [`Imm`] is the interacting-multiple-model estimator (Blom and Bar-Shalom, "The interacting multiple model algorithm
//! for systems with Markovian switching coefficients", IEEE Transactions on Automatic Control 33(8), 1988; Bar-Shalom,
//! Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 11.6.6). The active
//! mode is a Markov chain: mode `i` is followed by mode `j` with probability `p_ij` ([`Transition`]). Each mode has its
//! own belief; with the mode probabilities `mu_i`, a cycle is
//!
//! 1. *mix*: `c_j = sum_i p_ij mu_i`; mode `j` starts from the mixture of all beliefs with the weights
//!    `p_ij mu_i / c_j`, approximated by a Gaussian of the same mean and covariance;
//! 2. *predict* and *update*: each mode by its own process and measurement model, with the marginal likelihood `L_j` of
//!    the reading;
//! 3. *reweight*: `mu_j` is proportional to `L_j c_j`.
//!
//! [`Modes`] holds the probabilities alone, for estimators whose states differ and therefore cannot be mixed.

use nalgebra::DMatrix;

use crate::bank::Belief;
use crate::{Gaussian, Innovation, Update, UpdateError};

/// Transition probabilities of the modes over one step.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// `p_ij`; each row sums to 1.
    matrix: DMatrix<f64>,
}

impl Transition {
    /// Transition with the probabilities `p_ij`, row by row. Each row is normalised.
    ///
    /// # Panics
    /// If the matrix is not square, an entry is negative or a row has no positive entry.
    pub fn new(rows: &[&[f64]]) -> Self {
        assert!(rows.iter().all(|row| row.len() == rows.len()), "a transition matrix must be square");
        let mut matrix = DMatrix::from_fn(rows.len(), rows.len(), |i, j| rows[i][j]);
        assert!(matrix.iter().all(|p| *p >= 0.0), "transition probabilities must not be negative");
        for mut row in matrix.row_iter_mut() {
            let total = row.sum();
            assert!(total > 0.0, "each row of a transition matrix must have a positive entry");
            row /= total;
        }
        Self { matrix }
    }

    /// Transition over a step of `dt_s` for modes with the mean sojourn times `sojourn_s`. The next mode is drawn from
    /// the others in proportion to `weights`. The time until a switch is exponentially distributed.
    ///
    /// # Panics
    /// As [`Self::new`], or if the numbers of weights and modes differ.
    pub fn from_sojourns(dt_s: f64, sojourn_s: &[f64], weights: &[f64]) -> Self {
        let rows: Vec<Vec<f64>> = (0..sojourn_s.len())
            .map(|i| {
                let stay = (-dt_s / sojourn_s[i]).exp();
                // A difference from the total would lose a small weight beside a large one.
                let others: f64 = weights.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, weight)| weight).sum();
                let to = |(j, weight): (usize, &f64)| match (i == j, others > 0.0) {
                    (true, true) => stay,
                    (true, false) => 1.0,
                    (false, true) => (1.0 - stay) * weight / others,
                    (false, false) => 0.0,
                };
                weights.iter().enumerate().map(to).collect()
            })
            .collect();
        Self::new(&rows.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }
}

/// Mode probabilities.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    probabilities: Vec<f64>,
}

impl Modes {
    /// Modes with the given weights, which need not be normalised.
    ///
    /// # Panics
    /// If a weight is negative or none is positive.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut probabilities: Vec<f64> = weights.into_iter().collect();
        let total: f64 = probabilities.iter().sum();
        assert!(total > 0.0 && probabilities.iter().all(|p| *p >= 0.0), "weights must not be negative, nor all zero");
        probabilities.iter_mut().for_each(|p| *p /= total);
        Self { probabilities }
    }

    /// Normalised probabilities.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities
    }

    /// Propagates the probabilities by one step of the Markov chain.
    pub fn predict(&mut self, transition: &Transition) {
        let before = &self.probabilities;
        let after = |j| before.iter().enumerate().map(|(i, p)| p * transition.matrix[(i, j)]).sum();
        self.probabilities = (0..before.len()).map(after).collect();
    }

    /// Multiplies the probabilities by the marginal likelihoods of a reading, given as logarithms, and returns the
    /// logarithm of the total marginal likelihood. A mode with `None` gets probability zero. If all are `None`, the
    /// probabilities are unchanged and `None` is returned.
    pub fn reweight(&mut self, log_evidence: &[Option<f64>]) -> Option<f64> {
        let logs = self.probabilities.iter().zip(log_evidence).map(|(p, evidence)| evidence.map(|e| p.ln() + e));
        let logs: Vec<f64> = logs.map(|log| log.unwrap_or(f64::NEG_INFINITY)).collect();
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !largest.is_finite() {
            return None;
        }
        let total: f64 = logs.iter().map(|log| (log - largest).exp()).sum();
        self.probabilities = logs.iter().map(|log| (log - largest).exp() / total).collect();
        Some(largest + total.ln())
    }
}

/// Interacting-multiple-model estimator: mode probabilities and one belief per mode.
#[derive(Clone, Debug, PartialEq)]
pub struct Imm<const N: usize> {
    modes: Modes,
    beliefs: Vec<Gaussian<N>>,
}

impl<const N: usize> Imm<N> {
    /// Estimator with the given belief and weight of each mode. The weights need not be normalised.
    ///
    /// # Panics
    /// As [`Modes::new`].
    pub fn new(parts: impl IntoIterator<Item = (Gaussian<N>, f64)>) -> Self {
        let (beliefs, weights): (Vec<_>, Vec<f64>) = parts.into_iter().unzip();
        Self { modes: Modes::new(weights), beliefs }
    }

    /// Mode probabilities.
    pub fn probabilities(&self) -> &[f64] {
        self.modes.probabilities()
    }

    /// Beliefs, one per mode.
    pub fn beliefs(&self) -> &[Gaussian<N>] {
        &self.beliefs
    }

    /// Applies `change` to every belief, for example to enforce bounds.
    pub fn map(&mut self, change: impl FnMut(&mut Gaussian<N>)) {
        self.beliefs.iter_mut().for_each(change);
    }

    /// Mixes the beliefs according to the transition probabilities. A belief that passes to another mode is converted
    /// by `enter(from, to, belief)`, which sets the components that only the new mode uses.
    pub fn mix(&mut self, transition: &Transition, enter: impl Fn(usize, usize, &Gaussian<N>) -> Gaussian<N>) {
        let before = self.modes.probabilities.clone();
        self.modes.predict(transition);
        self.beliefs = (0..before.len())
            .map(|j| {
                let passed = before.iter().enumerate().map(|(i, p)| (i, p * transition.matrix[(i, j)]));
                let passed = passed
                    .filter(|(_, weight)| *weight > 0.0)
                    .map(|(i, weight)| (if i == j { self.beliefs[j] } else { enter(i, j, &self.beliefs[i]) }, weight));
                // A mode that cannot be entered keeps its belief.
                Gaussian::of_mixture(passed).unwrap_or(self.beliefs[j])
            })
            .collect();
    }

    /// Propagates the belief of each mode through its process: `predict(mode, belief)`.
    ///
    /// # Errors
    /// First error of a mode. The beliefs of the preceding modes are already propagated.
    pub fn predict(
        &mut self,
        mut predict: impl FnMut(usize, &mut Gaussian<N>) -> Result<(), UpdateError>,
    ) -> Result<(), UpdateError> {
        self.beliefs.iter_mut().enumerate().try_for_each(|(mode, belief)| predict(mode, belief))
    }

    /// Conditions the belief of each mode on a reading by its measurement model, `update(mode, belief)`, and reweights
    /// the modes. The returned innovation and marginal likelihood are those of the mixture. A mode that cannot be
    /// updated gets probability zero if at least one other can.
    ///
    /// # Errors
    /// [`UpdateError`] if no mode could be updated; the estimator is unchanged.
    pub fn update<const M: usize>(
        &mut self,
        mut update: impl FnMut(usize, &mut Gaussian<N>) -> Result<Update<M>, UpdateError>,
    ) -> Result<Update<M>, UpdateError> {
        let mut why = UpdateError::NoPrediction;
        let mut updated = self.beliefs.clone();
        let mut found = Vec::with_capacity(updated.len());
        for (mode, belief) in updated.iter_mut().enumerate() {
            found.push(update(mode, belief).map_err(|skipped| why = skipped).ok().filter(|_| belief.is_finite()));
        }
        let known =
            found.iter().zip(self.probabilities()).filter_map(|(found, p)| Some((found.as_ref()?.innovation, *p)));
        let innovation = Innovation::of_mixture(known).ok_or(why)?;
        let evidence: Vec<Option<f64>> = found.iter().map(|found| Some(found.as_ref()?.log_evidence)).collect();
        let log_evidence = self.modes.reweight(&evidence).ok_or(why)?;
        for ((belief, updated), found) in self.beliefs.iter_mut().zip(updated).zip(found) {
            if found.is_some() {
                *belief = updated;
            }
        }
        Ok(Update { innovation, log_evidence })
    }
}

impl<const N: usize> Belief<N> for Imm<N> {
    fn moments(&self) -> Gaussian<N> {
        let parts = self.beliefs.iter().copied().zip(self.probabilities().iter().copied());
        Gaussian::of_mixture(parts).expect("normalised probabilities")
    }

    /// Merges mode by mode.
    fn merged(&self, weight: f64, other: &Self, other_weight: f64) -> Self {
        let parts = (0..self.beliefs.len()).map(|mode| {
            let (one, two) = (weight * self.probabilities()[mode], other_weight * other.probabilities()[mode]);
            let both = Gaussian::of_mixture([(self.beliefs[mode], one), (other.beliefs[mode], two)]);
            (both.unwrap_or(self.beliefs[mode]), one + two)
        });
        Self::new(parts)
    }
}
