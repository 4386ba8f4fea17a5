//! Counts of one or several channels, continued across wraps of the counter, and their zero.

use nalgebra::SVector;

/// Zero of `N` channels.
#[derive(Clone, Debug)]
pub(super) struct Zeroing<const N: usize> {
    /// Number of values of a counter that wraps. `None` if it does not wrap.
    modulo: Option<f64>,
    last: Option<SVector<f64, N>>,
    /// Sum and number of the counts at rest so far, while the zero is determined.
    at_rest: (SVector<f64, N>, u32),
    zero: Option<SVector<f64, N>>,
}

impl<const N: usize> Zeroing<N> {
    pub(super) fn new(modulo: Option<f64>) -> Self {
        Self { modulo, last: None, at_rest: (SVector::zeros(), 0), zero: None }
    }

    /// Mean of the counts at rest. `None` while it is determined.
    pub(super) fn zero(&self) -> Option<SVector<f64, N>> {
        self.zero
    }

    /// Counts continued across wraps of the counter.
    pub(super) fn unwrapped(&mut self, counts: SVector<f64, N>) -> SVector<f64, N> {
        let continued = match (self.modulo, self.last) {
            (Some(modulo), Some(last)) => {
                counts.zip_map(&last, |found, last| found - modulo * ((found - last) / modulo).round())
            }
            _ => counts,
        };
        self.last = Some(continued);
        continued
    }

    /// Takes counts at rest; the last ones determine the zero.
    pub(super) fn rest(&mut self, counts: SVector<f64, N>, is_last: bool) {
        let (sum, number) = &mut self.at_rest;
        *sum += counts;
        *number += 1;
        if is_last {
            self.zero = Some(*sum / f64::from(*number));
        }
    }

    /// Determines the zero anew.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.modulo);
    }
}
