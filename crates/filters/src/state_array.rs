//! Many states at once, number by number.

use nalgebra::SVector;

use crate::wide::{self, Column};

/// StateArray of `N` numbers each: all the first numbers, then all the second ones, so that a loop over one number of every state reads on and on.
#[derive(Clone, Debug, PartialEq)]
pub struct StateArray<const N: usize> {
    values: Column,
    count: usize,
    /// From one column to the next: each begins where a cache line does.
    stride: usize,
}

impl<const N: usize> StateArray<N> {
    /// So many states of zeros.
    pub fn zeros(count: usize) -> Self {
        let stride = count.next_multiple_of(wide::LINE);
        Self { values: wide::column(N * stride, 0.0), count, stride }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// One state.
    pub fn get(&self, index: usize) -> SVector<f64, N> {
        SVector::from_fn(|number, _| self.values[number * self.stride + index])
    }

    /// Changes one state.
    pub fn set(&mut self, index: usize, state: &SVector<f64, N>) {
        for (number, value) in state.iter().enumerate() {
            self.values[number * self.stride + index] = *value;
        }
    }

    /// The states one by one.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = SVector<f64, N>> {
        (0..self.count).map(|index| self.get(index))
    }

    /// The same number of every state.
    pub fn column(&self, number: usize) -> &[f64] {
        &self.values[number * self.stride..][..self.count]
    }

    /// Each number of every state.
    pub fn columns_mut(&mut self) -> [&mut [f64]; N] {
        let mut rest = self.values.as_mut_slice();
        std::array::from_fn(|_| {
            let column = rest.split_off_mut(..self.stride).expect("there are N columns");
            &mut column[..self.count]
        })
    }

    /// All numbers, column by column, and what lies between the columns.
    pub(crate) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }
}

impl<const N: usize> FromIterator<SVector<f64, N>> for StateArray<N> {
    fn from_iter<Source: IntoIterator<Item = SVector<f64, N>>>(states: Source) -> Self {
        let states: Vec<_> = states.into_iter().collect();
        let mut found = Self::zeros(states.len());
        states.iter().enumerate().for_each(|(index, state)| found.set(index, state));
        found
    }
}
