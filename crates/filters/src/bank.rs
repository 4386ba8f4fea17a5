//! Gaussian-sum filter: a bank of weighted hypotheses, each filtered on its own and weighted by the marginal likelihood
//! of the readings (Alspach and Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", IEEE
//! Transactions on Automatic Control 17(4), 1972). Improbable hypotheses are pruned; similar ones are merged in the
//! order of the least Kullback-Leibler loss (Runnalls, "Kullback-Leibler approach to Gaussian mixture reduction", IEEE
//! Transactions on Aerospace and Electronic Systems 43(3), 2007).

use nalgebra::SVector;

use crate::gaussian::{Mixture, log_determinant};
use crate::{Gaussian, Innovation, Update, UpdateError};

/// Belief of a hypothesis, summarised by mean and covariance.
pub trait Belief<const N: usize>: Clone {
    /// Mean and covariance.
    fn moments(&self) -> Gaussian<N>;

    /// One belief with the mean and covariance of the mixture of two.
    fn merged(&self, weight: f64, other: &Self, other_weight: f64) -> Self;

    /// Whether mean and covariance are finite.
    fn is_finite(&self) -> bool {
        self.moments().is_finite()
    }
}

impl<const N: usize> Belief<N> for Gaussian<N> {
    fn moments(&self) -> Self {
        *self
    }

    fn merged(&self, weight: f64, other: &Self, other_weight: f64) -> Self {
        Self::of_mixture([(*self, weight), (*other, other_weight)]).unwrap_or(*self)
    }

    fn is_finite(&self) -> bool {
        self.is_finite()
    }
}

/// Weighted component of the mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hypothesis<Part> {
    /// Belief.
    pub belief: Part,
    /// Logarithm of the probability.
    log_weight: f64,
    /// Logarithm of the marginal likelihood of the current reading. `None` if the hypothesis could not be updated.
    log_evidence: Option<f64>,
}

impl<Part> Hypothesis<Part> {
    /// Probability.
    pub fn weight(&self) -> f64 {
        self.log_weight.exp()
    }
}

/// Mixture of beliefs, by default Gaussian, with normalised weights. It may become empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Bank<const N: usize, Part = Gaussian<N>> {
    hypotheses: Vec<Hypothesis<Part>>,
    /// Shapes of the hypotheses, and for all pairs the merging loss or a lower bound of it, and whether it is the loss; and for
    /// each hypothesis the later one with the least of these. Buffers, so that merging does not allocate.
    shapes: Vec<Shape<N>>,
    losses: Vec<f64>,
    is_loss: Vec<bool>,
    nearest: Vec<Nearest>,
    /// Hypotheses before an update, restored if it fails. A buffer too.
    before: Vec<Hypothesis<Part>>,
}

/// Of the hypotheses after another one, the one with which merging it loses least, and that loss or its lower bound.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Nearest {
    other: usize,
    loss: f64,
}

/// Weight, mean and variances of a hypothesis, from which the losses of merging it are bounded.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shape<const N: usize> {
    weight: f64,
    mean: SVector<f64, N>,
    variances: SVector<f64, N>,
    /// The weight times the log-determinant of the covariance.
    width: f64,
}

impl<const N: usize> Shape<N> {
    fn of<Part: Belief<N>>(hypothesis: &Hypothesis<Part>) -> Self {
        let (weight, Gaussian { mean, covariance }) = (hypothesis.weight(), hypothesis.belief.moments());
        Self { weight, mean, variances: covariance.diagonal(), width: weight * log_determinant(&covariance) }
    }

    /// Lower bound of the loss, cheaper than the loss: with the weighted mean `P` of the covariances, the difference `d`
    /// of the means and the shares `u` and `v` of the weights, the merged covariance is `P + u v d d'`. Its determinant is
    /// `det P (1 + u v d' P^-1 d)`, of which `d' P^-1 d >= d_i^2 / P_ii` for every `i`, and `ln det P` is at least the
    /// weighted mean of those of the parts.
    ///
    /// Infinity as soon as an `i` shows that the bound is at least `most`, without a logarithm: with `x = u v d_i^2 / P_ii` and `l`
    /// the value that `ln(1 + x)` must reach, `1 + x >= (1 - l / 32)^-32 >= exp(l)`.
    fn least_loss(&self, other: &Self, most: f64) -> f64 {
        let total = self.weight + other.weight;
        let both = self.weight * other.weight / total;
        let falls = (1.0 - most / (16.0 * total)).max(0.0).powi(32);
        let mut apart = 0.0_f64;
        for i in 0..N {
            let variance = self.weight * self.variances[i] + other.weight * other.variances[i];
            let squared = both * (self.mean[i] - other.mean[i]).powi(2);
            if (variance + squared) * falls > variance {
                return f64::INFINITY;
            }
            apart = apart.max(squared / variance);
        }
        0.5 * total * apart.ln_1p()
    }
}

impl<const N: usize, Part: Belief<N>> Bank<N, Part> {
    /// Bank of beliefs with the logarithms of their weights, which need not be normalised.
    pub fn new(parts: impl IntoIterator<Item = (Part, f64)>) -> Self {
        let parts = parts.into_iter();
        let hypothesis = |(belief, log_weight)| Hypothesis { belief, log_weight, log_evidence: None };
        let hypotheses: Vec<_> = parts.map(hypothesis).collect();
        let shapes = Vec::with_capacity(hypotheses.len());
        let pairs = hypotheses.len().pow(2);
        let (losses, is_loss) = (Vec::with_capacity(pairs), Vec::with_capacity(pairs));
        let nearest = Vec::with_capacity(hypotheses.len());
        let before = Vec::with_capacity(hypotheses.len());
        let mut bank = Self { hypotheses, shapes, losses, is_loss, nearest, before };
        bank.normalise();
        bank
    }

    /// Takes the hypotheses of another bank. Allocates only if they are more than this bank had room for.
    pub fn copy_from(&mut self, other: &Self) {
        self.hypotheses.clone_from(&other.hypotheses);
    }

    /// Hypotheses, in no particular order.
    pub fn hypotheses(&self) -> &[Hypothesis<Part>] {
        &self.hypotheses
    }

    /// Applies `change` to every belief, for example to enforce bounds.
    pub fn map(&mut self, mut change: impl FnMut(&mut Part)) {
        self.hypotheses.iter_mut().for_each(|hypothesis| change(&mut hypothesis.belief));
    }

    /// Propagates every hypothesis by a filter's `predict`. Hypotheses for which it fails or yields non-finite moments are dropped.
    pub fn predict(&mut self, mut predict: impl FnMut(&mut Part) -> Result<(), UpdateError>) {
        let before = self.hypotheses.len();
        self.hypotheses
            .retain_mut(|hypothesis| predict(&mut hypothesis.belief).is_ok() && hypothesis.belief.is_finite());
        if self.hypotheses.len() < before {
            self.normalise();
        }
    }

    /// Conditions every hypothesis on a reading by a filter's `update` and multiplies its weight by the marginal
    /// likelihood `N(y; 0, S)`. The returned innovation is that of the mixture. A hypothesis that cannot be updated is
    /// dropped if at least one other can.
    ///
    /// # Errors
    /// [`UpdateError`] if no hypothesis with a weight above zero could be updated, or the covariance of the mixture's innovation is
    /// not positive definite; the bank is unchanged.
    pub fn update<const M: usize>(
        &mut self,
        mut update: impl FnMut(&mut Part) -> Result<Update<M>, UpdateError>,
    ) -> Result<Innovation<M>, UpdateError> {
        self.before.clone_from(&self.hypotheses);
        let mut why = UpdateError::NoPrediction;
        let mut found = Mixture::empty();
        for hypothesis in &mut self.hypotheses {
            let weight = hypothesis.weight();
            hypothesis.log_evidence = match update(&mut hypothesis.belief) {
                Ok(_) if !hypothesis.belief.is_finite() => None,
                Ok(Update { innovation, log_evidence }) => {
                    found.add(&innovation.gaussian(), weight);
                    Some(log_evidence)
                }
                Err(skipped) => {
                    why = skipped;
                    None
                }
            };
        }
        let innovation = found.moments().and_then(|together| Innovation::of(together.mean, together.covariance));
        let Some(innovation) = innovation else {
            std::mem::swap(&mut self.hypotheses, &mut self.before);
            return Err(why);
        };
        self.hypotheses.retain_mut(|hypothesis| {
            hypothesis.log_evidence.inspect(|evidence| hypothesis.log_weight += evidence).is_some()
        });
        self.normalise();
        Ok(innovation)
    }

    /// Drops the hypotheses whose weight is below `share` of the largest weight.
    pub fn prune(&mut self, share: f64) {
        let before = self.hypotheses.len();
        let heaviest = self.hypotheses.iter().map(|hypothesis| hypothesis.log_weight).fold(f64::NEG_INFINITY, f64::max);
        self.hypotheses.retain(|hypothesis| hypothesis.log_weight >= heaviest + share.ln());
        if self.hypotheses.len() < before {
            self.normalise();
        }
    }

    /// Merges pairs of hypotheses in the order of least loss while the loss is below `most_loss`. The loss is an upper
    /// bound of the Kullback-Leibler divergence between the mixtures before and after (Runnalls 2007, equation 21).
    pub fn merge(&mut self, most_loss: f64) {
        let columns = self.hypotheses.len();
        self.shapes.clear();
        self.shapes.extend(self.hypotheses.iter().map(Shape::of));
        self.losses.clear();
        self.losses.resize(columns * columns, f64::INFINITY);
        self.is_loss.clear();
        self.is_loss.resize(columns * columns, false);
        self.nearest.clear();
        for i in 0..columns {
            (i + 1..columns).for_each(|j| self.bound(i, j, columns, most_loss));
            self.nearest.push(self.nearest_to(i, columns));
        }
        while let Some((i, j)) = self.closest(most_loss, columns) {
            self.join(i, j);
            self.update_losses(i, j, columns, most_loss);
        }
    }

    /// Merges a pair `i < j`. The last hypothesis takes the place of `j`.
    fn join(&mut self, i: usize, j: usize) {
        let other = self.hypotheses.swap_remove(j);
        let one = &mut self.hypotheses[i];
        let weight = one.weight() + other.weight();
        one.belief = one.belief.merged(one.weight(), &other.belief, other.weight());
        one.log_weight = weight.ln();
        self.shapes.swap_remove(j);
        self.shapes[i] = Shape::of(&self.hypotheses[i]);
    }

    /// The losses after [`Self::join`], in rows of `columns`.
    fn update_losses(&mut self, i: usize, j: usize, columns: usize, most_loss: f64) {
        let last = self.shapes.len();
        for k in (0..last).filter(|k| *k != j) {
            let (to, from) = (k.min(j) * columns + k.max(j), k * columns + last);
            (self.losses[to], self.is_loss[to]) = (self.losses[from], self.is_loss[from]);
        }
        (0..i).for_each(|k| self.bound(k, i, columns, most_loss));
        (i + 1..last).for_each(|k| self.bound(i, k, columns, most_loss));
        self.nearest.truncate(last);
        for k in 0..last {
            let Nearest { other, loss } = self.nearest[k];
            if k == i || k == j || [i, j, last].contains(&other) {
                self.nearest[k] = self.nearest_to(k, columns);
            } else if k < i && self.losses[k * columns + i] < loss {
                self.nearest[k] = Nearest { other: i, loss: self.losses[k * columns + i] };
            }
        }
    }

    /// Loss of merging a pair.
    fn loss(&self, i: usize, j: usize) -> f64 {
        let (one, other) = (&self.shapes[i], &self.shapes[j]);
        let [belief, other_belief] = [i, j].map(|k| self.hypotheses[k].belief.moments());
        let together = belief.merged(one.weight, &other_belief, other.weight);
        0.5 * ((one.weight + other.weight) * log_determinant(&together.covariance) - one.width - other.width)
    }

    /// Computes a lower bound of the loss of a pair `i < j`.
    fn bound(&mut self, i: usize, j: usize, columns: usize, most_loss: f64) {
        self.losses[i * columns + j] = self.shapes[i].least_loss(&self.shapes[j], most_loss);
        self.is_loss[i * columns + j] = false;
    }

    /// The least loss or bound of `i` with a later hypothesis, the first of several.
    fn nearest_to(&self, i: usize, columns: usize) -> Nearest {
        let mut nearest = Nearest { other: i, loss: f64::INFINITY };
        let losses = &self.losses[i * columns..][..self.shapes.len()];
        for (other, &loss) in losses.iter().enumerate().skip(i + 1) {
            if loss < nearest.loss {
                nearest = Nearest { other, loss };
            }
        }
        nearest
    }

    /// Pair `i < j` with the least merging loss, the first of several. `None` unless that is below `most_loss`.
    fn closest(&mut self, most_loss: f64, columns: usize) -> Option<(usize, usize)> {
        loop {
            let rows = self.nearest.iter().enumerate().filter(|(_, nearest)| nearest.loss < most_loss);
            let (i, &Nearest { other: j, .. }) = rows.min_by(|a, b| a.1.loss.total_cmp(&b.1.loss))?;
            let pair = i * columns + j;
            if self.is_loss[pair] {
                return Some((i, j));
            }
            (self.losses[pair], self.is_loss[pair]) = (self.loss(i, j), true);
            self.nearest[i] = self.nearest_to(i, columns);
        }
    }

    /// Mean and covariance of the mixture. `None` if it is empty.
    pub fn moments(&self) -> Option<Gaussian<N>> {
        Gaussian::of_mixture(self.hypotheses.iter().map(|one| (one.belief.moments(), one.weight())))
    }

    /// Mean and covariance of the mixture without the hypotheses whose weight is below `ignored`. `None` if it is empty.
    pub fn moments_above(&self, ignored: f64) -> Option<Gaussian<N>> {
        let parts = self.hypotheses.iter().filter(|one| one.weight() >= ignored);
        Gaussian::of_mixture(parts.map(|one| (one.belief.moments(), one.weight())))
    }

    /// Adds hypotheses, given with the logarithms of their relative weights, which together have the probability `share`.
    pub fn add(&mut self, parts: impl IntoIterator<Item = (Part, f64)>, share: f64) {
        for one in &mut self.hypotheses {
            one.log_weight += (1.0 - share).ln();
        }
        let first = self.hypotheses.len();
        let hypothesis = |(belief, log_weight)| Hypothesis { belief, log_weight, log_evidence: None };
        self.hypotheses.extend(parts.into_iter().map(hypothesis));
        let added = &mut self.hypotheses[first..];
        normalise(added);
        added.iter_mut().for_each(|one| one.log_weight += share.ln());
    }

    /// Splits each hypothesis whose weight is at least `least` and for which `branch` returns a new belief and a share: a
    /// hypothesis with the new belief takes this share of the weight. The share must be greater than 0 and less than 1. Stops once
    /// there are `most` hypotheses. A hypothesis whose new belief is not finite is not split.
    pub fn split(&mut self, least: f64, most: usize, mut branch: impl FnMut(&Part) -> Option<(Part, f64)>) {
        for i in 0..self.hypotheses.len() {
            if self.hypotheses.len() >= most {
                return;
            }
            let one = &mut self.hypotheses[i];
            if one.weight() < least {
                continue;
            }
            let Some((belief, share)) = branch(&one.belief).filter(|(belief, _)| belief.is_finite()) else { continue };
            let log_weight = one.log_weight + share.ln();
            one.log_weight += (-share).ln_1p();
            self.hypotheses.push(Hypothesis { belief, log_weight, log_evidence: None });
        }
    }

    /// Most probable hypothesis. `None` if the mixture is empty.
    pub fn most_probable(&self) -> Option<&Hypothesis<Part>> {
        self.hypotheses.iter().max_by(|a, b| a.log_weight.total_cmp(&b.log_weight))
    }

    /// Normalises the weights.
    fn normalise(&mut self) {
        normalise(&mut self.hypotheses);
    }
}

/// Normalises the weights.
fn normalise<Part>(hypotheses: &mut [Hypothesis<Part>]) {
    let heaviest = hypotheses.iter().map(|hypothesis| hypothesis.log_weight).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = hypotheses.iter().map(|hypothesis| (hypothesis.log_weight - heaviest).exp()).sum();
    for hypothesis in hypotheses {
        hypothesis.log_weight -= heaviest + total.ln();
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{matrix, vector};

    use super::*;

    #[test]
    fn verif_the_least_loss_is_a_lower_bound() {
        let one = Gaussian::new(vector![0.0, 1.0], matrix![2.0, 0.3; 0.3, 0.5]);
        for (i, apart) in [0.0, 0.1, 1.0, 10.0, 1e3].into_iter().enumerate() {
            let other = Gaussian::new(vector![apart, 1.0 - 0.4 * apart], matrix![0.4, -0.1; -0.1, 0.1 + i as f64]);
            let mut bank = Bank::new([(one, 0.0), (other, -1.0)]);
            bank.shapes.extend(bank.hypotheses.iter().map(Shape::of));
            let (least, loss) = (bank.shapes[0].least_loss(&bank.shapes[1], f64::INFINITY), bank.loss(0, 1));
            assert!(least <= loss + 1e-12, "{apart}: {least} {loss}");
            for most in [1e-3, 1e-2, 0.1, 1.0] {
                let found = bank.shapes[0].least_loss(&bank.shapes[1], most);
                assert!(found == least || found == f64::INFINITY && least >= most, "{apart} {most}: {found} {least}");
            }
        }
    }

    #[test]
    fn verif_a_split_keeps_the_probability_together() {
        let at = |x: f64| Gaussian::new(vector![x], matrix![1.0]);
        let mut bank = Bank::new([(at(0.0), 0.9_f64.ln()), (at(1.0), 0.06_f64.ln()), (at(2.0), 0.04_f64.ln())]);
        let branch = |belief: &Gaussian<1>| Some((at(belief.mean[0] + 5.0), 0.25));
        let mut limited = bank.clone();
        limited.split(0.0, 4, branch);
        assert_eq!(limited.hypotheses().len(), 4);
        bank.split(0.05, 100, branch);
        let found: Vec<_> = bank.hypotheses().iter().map(|one| (one.belief.mean[0], one.weight())).collect();
        let expected = [(0.0, 0.675), (1.0, 0.045), (2.0, 0.04), (5.0, 0.225), (6.0, 0.015)];
        assert_eq!(found.len(), expected.len());
        for ((place, weight), (expected_place, expected_weight)) in found.iter().zip(expected) {
            assert!(*place == expected_place && (weight - expected_weight).abs() < 1e-12, "{found:?}");
        }
    }

    #[test]
    fn verif_added_hypotheses_have_the_given_probability() {
        let at = |x: f64| Gaussian::new(vector![x], matrix![1.0]);
        let mut bank = Bank::new([(at(0.0), 0.0), (at(1.0), 0.0)]);
        bank.add([(at(5.0), -3.0), (at(6.0), -3.0)], 0.2);
        let weights: Vec<f64> = bank.hypotheses().iter().map(Hypothesis::weight).collect();
        for (weight, expected) in weights.iter().zip([0.4, 0.4, 0.1, 0.1]) {
            assert!((weight - expected).abs() < 1e-12, "{weights:?}");
        }
        assert!((bank.moments_above(0.2).unwrap().mean[0] - 0.5).abs() < 1e-12);
    }
}
