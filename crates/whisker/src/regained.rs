//! Test whether a contact that was lost is there again, on an object at rest that is known.
//!
//! The belief about the object predicts a contact on the whisker's side, and its reading. Otherwise the whisker is free, with a
//! reading about zero, or it oscillates or bears on its tip, and the reading may have any calibrated value. The likelihoods of both
//! give the odds of a contact.

use filters::Innovation;
use nalgebra::{SMatrix, SVector};

use crate::odds::Odds;

/// Prior rate of a return (1/s).
const RATE: f64 = 1.0;

/// Odds that the contact is there again.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Regained {
    odds: Odds,
}

/// A whisker without the contact. A reading consists of `D` moments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unknown<const D: usize> {
    /// Variance of each moment's noise.
    pub(crate) noise_n2_m2: f64,
    /// Probability density of a reading of any calibrated value, per N m of each moment.
    pub(crate) of_any: f64,
}

impl<const D: usize> Unknown<D> {
    /// Probability density of a reading, at most twice that of either case.
    fn density(&self, reading_n_m: &SVector<f64, D>) -> f64 {
        let free = Innovation::of(*reading_n_m, SMatrix::identity() * self.noise_n2_m2);
        free.map_or(0.0, |free| free.log_likelihood().exp()) + self.of_any
    }
}

impl Regained {
    /// Takes a reading, `dt_s` after the last, with its innovation for the predicted contact, `None` if none is predicted. Returns
    /// whether the contact is more probable than none.
    pub(crate) fn next<const D: usize>(
        &mut self,
        dt_s: f64,
        reading_n_m: &SVector<f64, D>,
        predicted: Option<&Innovation<D>>,
        unknown: &Unknown<D>,
    ) -> bool {
        let ratio = predicted.map_or(0.0, |found| found.log_likelihood().exp() / unknown.density(reading_n_m));
        self.odds.advance(RATE * dt_s, ratio);
        self.is_there()
    }

    /// Whether the contact was more probable than none at the last reading.
    pub(crate) fn is_there(&self) -> bool {
        self.odds.are_favourable()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix1, Vector1};

    use super::*;

    const UNKNOWN: Unknown<1> = Unknown { noise_n2_m2: 1e-4, of_any: 1.0 };

    /// Number of readings after which the contact is there again, of at most 100.
    fn found_after(reading: f64, expected: f64) -> Option<usize> {
        let mut regained = Regained::default();
        let innovation = Innovation::of(Vector1::new(reading - expected), Matrix1::new(2.0 * UNKNOWN.noise_n2_m2));
        (1..=100).find(|_| regained.next(5e-3, &Vector1::new(reading), innovation.as_ref(), &UNKNOWN))
    }

    #[test]
    fn verif_a_reading_as_predicted_shows_a_contact_unless_it_is_that_of_a_free_whisker() {
        // Three standard deviations of the noise suffice.
        assert!(found_after(0.03, 0.03).is_some_and(|count| count <= 3));
        assert_eq!(found_after(0.0, 0.0), None);
        assert_eq!(found_after(0.5, 0.3), None);
    }

    #[test]
    fn verif_a_contact_that_is_not_predicted_is_not_there() {
        let mut regained = Regained::default();
        let innovation = Innovation::of(Vector1::new(0.0), Matrix1::new(2.0 * UNKNOWN.noise_n2_m2));
        assert!((0..10).any(|_| regained.next(5e-3, &Vector1::new(0.3), innovation.as_ref(), &UNKNOWN)));
        assert!(!regained.next(5e-3, &Vector1::new(0.3), None, &UNKNOWN));
    }
}
