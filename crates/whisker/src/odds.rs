//! Odds that something which was left is there again.

/// Odds by Shiryaev's statistic (Shiryaev, "On optimum methods in quickest detection problems", Theory of Probability and its
/// Applications 8(1), 1963): with the ratio `L` of the likelihoods of a reading and the prior probability `p` of a return since the
/// last one, they are `(odds + p) L`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Odds(f64);

impl Odds {
    /// Takes the ratio of the likelihoods of a reading, with and without a return.
    pub(crate) fn advance(&mut self, prior: f64, likelihood_ratio: f64) {
        self.0 = (self.0 + prior) * likelihood_ratio;
    }

    /// Whether a return is more probable than none.
    pub(crate) fn are_favourable(&self) -> bool {
        self.0 > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_odds_are_those_of_a_return_at_any_reading() {
        let mut odds = Odds::default();
        for ratio in [2.0, 3.0, 0.5] {
            odds.advance(0.1, ratio);
        }
        // Returns before the first, second and third reading.
        assert!((odds.0 - 0.1 * (2.0 * 3.0 * 0.5 + 3.0 * 0.5 + 0.5)).abs() < 1e-15);
        assert!(!odds.are_favourable());
        odds.advance(0.1, 2.0);
        assert!(odds.are_favourable());
    }
}
