//! Several modes of which one holds at a time, and may give way to another at any step.
//!
//! [`Imm`] is the interacting-multiple-model estimator (Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian
//! switching coefficients", IEEE Transactions on Automatic Control 33(8), 1988; Bar-Shalom, Li and Kirubarajan 2001, section 11.6.6). Which
//! mode holds is a Markov chain: mode `i` is followed by mode `j` with the probability `p_ij` ([`Transition`]). Each mode has a belief of its own;
//! with `mu_i` the probability of mode `i`, a cycle is
//!
//! 1. *mix*: `c_j = sum_i p_ij mu_i`; mode `j` begins the step from the mixture of all beliefs with the weights `p_ij mu_i / c_j`,
//!    as one Gaussian of the same mean and covariance;
//! 2. *predict* and *update*: each mode by its own process and measurement, which gives the evidence `L_j` of the reading;
//! 3. *weigh*: `mu_j` is proportional to `L_j c_j`.
//!
//! [`Modes`] are the probabilities alone, for estimators that do not share a state and so cannot be mixed.

use nalgebra::DMatrix;

use crate::bank::Belief;
use crate::{Gaussian, Innovation, UpdateError, Weighed};

/// How the modes follow on one another in one step.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// `p_ij`; every row adds up to 1.
    matrix: DMatrix<f64>,
}

impl Transition {
    /// From the probabilities `p_ij`, row by row; rows are scaled to add up to 1.
    ///
    /// # Panics
    /// Unless there are as many rows as columns, each with something positive in it and nothing negative.
    pub fn new(rows: &[&[f64]]) -> Self {
        assert!(rows.iter().all(|row| row.len() == rows.len()), "a transition has as many rows as columns");
        let mut matrix = DMatrix::from_fn(rows.len(), rows.len(), |i, j| rows[i][j]);
        assert!(matrix.iter().all(|p| *p >= 0.0), "probabilities are not negative");
        for mut row in matrix.row_iter_mut() {
            let total = row.sum();
            assert!(total > 0.0, "every mode is followed by one");
            row /= total;
        }
        Self { matrix }
    }

    /// For a step of `dt_s` of modes that last for `sojourn_s` on average; the next is chosen by the weights of the others.
    ///
    /// # Panics
    /// As [`Self::new`], or unless there are as many weights as modes.
    pub fn of_sojourns(dt_s: f64, sojourn_s: &[f64], weights: &[f64]) -> Self {
        let rows: Vec<Vec<f64>> = (0..sojourn_s.len())
            .map(|i| {
                let stay = (-dt_s / sojourn_s[i]).exp();
                let others: f64 = weights.iter().sum::<f64>() - weights[i];
                let to = |(j, weight): (usize, &f64)| {
                    let is_alone = others <= 0.0;
                    if i == j { if is_alone { 1.0 } else { stay } } else { (1.0 - stay) * weight / others }
                };
                weights.iter().enumerate().map(to).collect()
            })
            .collect();
        Self::new(&rows.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }
}

/// How probable each of some modes is.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    probabilities: Vec<f64>,
}

impl Modes {
    /// Modes with these weights, which need not add up to 1.
    ///
    /// # Panics
    /// Unless at least one weight is positive and none negative.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut probabilities: Vec<f64> = weights.into_iter().collect();
        let total: f64 = probabilities.iter().sum();
        assert!(total > 0.0 && probabilities.iter().all(|p| *p >= 0.0), "weights are not negative, and not all zero");
        probabilities.iter_mut().for_each(|p| *p /= total);
        Self { probabilities }
    }

    /// The probabilities, adding up to 1.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities
    }

    /// One step of the chain.
    pub fn predict(&mut self, transition: &Transition) {
        let before = &self.probabilities;
        let after = |j| before.iter().enumerate().map(|(i, p)| p * transition.matrix[(i, j)]).sum();
        self.probabilities = (0..before.len()).map(after).collect();
    }

    /// Weighs the modes by the logarithms of their evidence, and returns that of all together. A mode without evidence is ruled out; where none has any,
    /// nothing changes and there is none.
    pub fn weigh(&mut self, log_evidence: &[Option<f64>]) -> Option<f64> {
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

/// Modes with a belief each.
#[derive(Clone, Debug, PartialEq)]
pub struct Imm<const N: usize> {
    modes: Modes,
    beliefs: Vec<Gaussian<N>>,
}

impl<const N: usize> Imm<N> {
    /// Beliefs of the modes with their weights, which need not add up to 1.
    ///
    /// # Panics
    /// As [`Modes::new`].
    pub fn new(parts: impl IntoIterator<Item = (Gaussian<N>, f64)>) -> Self {
        let (beliefs, weights): (Vec<_>, Vec<f64>) = parts.into_iter().unzip();
        Self { modes: Modes::new(weights), beliefs }
    }

    /// The probabilities of the modes.
    pub fn probabilities(&self) -> &[f64] {
        self.modes.probabilities()
    }

    /// The beliefs of the modes.
    pub fn beliefs(&self) -> &[Gaussian<N>] {
        &self.beliefs
    }

    /// Changes every belief, for example to hold it within bounds.
    pub fn map(&mut self, change: impl FnMut(&mut Gaussian<N>)) {
        self.beliefs.iter_mut().for_each(change);
    }

    /// Mixes the beliefs as the modes may have given way to one another. A belief that passes from one mode to another goes through
    /// `enter(from, to, belief)`, which puts in what the new mode knows and the old one does not.
    pub fn mix(&mut self, transition: &Transition, enter: impl Fn(usize, usize, &Gaussian<N>) -> Gaussian<N>) {
        let before = self.modes.probabilities.clone();
        self.modes.predict(transition);
        self.beliefs = (0..before.len())
            .map(|j| {
                let passed = before.iter().enumerate().map(|(i, p)| (i, p * transition.matrix[(i, j)]));
                let passed = passed
                    .filter(|(_, weight)| *weight > 0.0)
                    .map(|(i, weight)| (if i == j { self.beliefs[j] } else { enter(i, j, &self.beliefs[i]) }, weight));
                // A mode that none can give way to keeps what it believes.
                Gaussian::of_mixture(passed).unwrap_or(self.beliefs[j])
            })
            .collect();
    }

    /// Carries the belief of each mode by its process: `predict(mode, belief)`.
    ///
    /// # Errors
    /// The first that a mode met; the beliefs before it are carried already.
    pub fn predict(
        &mut self,
        mut predict: impl FnMut(usize, &mut Gaussian<N>) -> Result<(), UpdateError>,
    ) -> Result<(), UpdateError> {
        self.beliefs.iter_mut().enumerate().try_for_each(|(mode, belief)| predict(mode, belief))
    }

    /// Conditions the belief of each mode on a reading by its measurement, `update(mode, belief)`, and weighs the modes. The innovation and the evidence are
    /// those of all modes together. A mode that cannot be updated is ruled out if another can.
    ///
    /// # Errors
    /// [`UpdateError`] leaves everything as it was: no mode could be updated.
    pub fn update<const M: usize>(
        &mut self,
        mut update: impl FnMut(usize, &mut Gaussian<N>) -> Result<Weighed<M>, UpdateError>,
    ) -> Result<Weighed<M>, UpdateError> {
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
        let log_evidence = self.modes.weigh(&evidence).ok_or(why)?;
        for ((belief, updated), found) in self.beliefs.iter_mut().zip(updated).zip(found) {
            if found.is_some() {
                *belief = updated;
            }
        }
        Ok(Weighed { innovation, log_evidence })
    }
}

impl<const N: usize> Belief<N> for Imm<N> {
    fn moments(&self) -> Gaussian<N> {
        let parts = self.beliefs.iter().copied().zip(self.probabilities().iter().copied());
        Gaussian::of_mixture(parts).expect("probabilities add up to 1")
    }

    /// Mode by mode.
    fn merged(&self, weight: f64, other: &Self, other_weight: f64) -> Self {
        let parts = (0..self.beliefs.len()).map(|mode| {
            let (one, two) = (weight * self.probabilities()[mode], other_weight * other.probabilities()[mode]);
            let both = Gaussian::of_mixture([(self.beliefs[mode], one), (other.beliefs[mode], two)]);
            (both.unwrap_or(self.beliefs[mode]), one + two)
        });
        Self::new(parts)
    }
}
