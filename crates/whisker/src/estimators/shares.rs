//! Probabilities of competing models of a contact.

use std::fmt;

/// Maximum number of models that a method may average over.
pub(crate) const MOST_MODELS: usize = 8;

/// Probabilities of competing models, which add up to 1, in descending order. Displayed as `sliding=0.970 ekf=0.030`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModelShares {
    /// Entries from `count` on are empty.
    entries: [(&'static str, f64); MOST_MODELS],
    count: usize,
}

impl ModelShares {
    /// The probabilities of models by name; equally probable ones keep the given order.
    ///
    /// # Panics
    /// If there are more than eight.
    pub fn new(shares: impl IntoIterator<Item = (&'static str, f64)>) -> Self {
        let mut found = Self::default();
        for share in shares {
            found.entries[found.count] = share;
            found.count += 1;
        }
        found.entries[..found.count].sort_by(|a, b| b.1.total_cmp(&a.1));
        found
    }

    /// The probability of a model. `None` if it is not among them.
    pub fn of(&self, name: &str) -> Option<f64> {
        self.iter().find(|(known, _)| *known == name).map(|(_, share)| share)
    }

    /// Names and probabilities in descending order of probability.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.entries[..self.count].iter().copied()
    }
}

impl fmt::Display for ModelShares {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, (name, share)) in self.iter().enumerate() {
            write!(out, "{}{name}={share:.3}", if place == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}
