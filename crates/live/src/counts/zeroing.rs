//! Counts of one or several channels, continued across wraps of the counter, and their zero.

use nalgebra::SVector;

/// Zero of `N` channels.
#[derive(Clone, Debug)]
pub(super) struct Zeroing<const N: usize> {
    /// Number of values of a counter that wraps. `None` if it does not wrap.
    modulo: Option<f64>,
    last: Option<SVector<f64, N>>,
    /// The counts at rest so far, while the zero is determined.
    at_rest: Option<AtRest<N>>,
    zero: Option<SVector<f64, N>>,
}

/// Sum, number, and smallest and largest values of counts at rest.
#[derive(Clone, Debug)]
struct AtRest<const N: usize> {
    sum: SVector<f64, N>,
    number: u32,
    low: SVector<f64, N>,
    high: SVector<f64, N>,
}

impl<const N: usize> Zeroing<N> {
    pub(super) fn new(modulo: Option<f64>) -> Self {
        Self { modulo, last: None, at_rest: None, zero: None }
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

    /// Takes counts at rest.
    pub(super) fn rest(&mut self, counts: SVector<f64, N>) {
        let first = || AtRest { sum: SVector::zeros(), number: 0, low: counts, high: counts };
        let AtRest { sum, number, low, high } = self.at_rest.get_or_insert_with(first);
        *sum += counts;
        *number += 1;
        (*low, *high) = (low.inf(&counts), high.sup(&counts));
    }

    /// Smallest and largest counts at rest so far. `None` without any.
    pub(super) fn range(&self) -> Option<[SVector<f64, N>; 2]> {
        self.at_rest.as_ref().map(|at_rest| [at_rest.low, at_rest.high])
    }

    /// The counts at rest so far determine the zero.
    pub(super) fn end(&mut self) {
        self.zero = self.at_rest.as_ref().map(|at_rest| at_rest.sum / f64::from(at_rest.number));
    }

    /// Discards the counts at rest so far: the whisker was not free.
    pub(super) fn repeat(&mut self) {
        self.at_rest = None;
    }

    /// Determines the zero anew.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.modulo);
    }
}
