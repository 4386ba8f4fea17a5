//! Structure of arrays for many states.

use nalgebra::SVector;

use crate::simd::{self, Column};

/// States of `N` components as a structure of arrays: the first components of all states, then the second ones. A loop
/// over one component of all states reads contiguous memory.
#[derive(Clone, Debug)]
pub struct StateArray<const N: usize> {
    values: Column,
    count: usize,
    /// Distance between the starts of two columns, which are padded and aligned to a cache line.
    stride: usize,
}

impl<const N: usize> StateArray<N> {
    /// Array of `count` zero states.
    pub fn zeros(count: usize) -> Self {
        let stride = simd::padded(count);
        Self { values: simd::column(N * stride, 0.0), count, stride }
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are no states.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// State at `index`.
    pub fn get(&self, index: usize) -> SVector<f64, N> {
        SVector::from_fn(|number, _| self.values[number * self.stride + index])
    }

    /// Sets the state at `index`.
    pub fn set(&mut self, index: usize, state: &SVector<f64, N>) {
        for (number, value) in state.iter().enumerate() {
            self.values[number * self.stride + index] = *value;
        }
    }

    /// Iterator over the states.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = SVector<f64, N>> {
        (0..self.count).map(|index| self.get(index))
    }

    /// Component `number` of all states.
    pub fn column(&self, number: usize) -> &[f64] {
        &self.values[number * self.stride..][..self.count]
    }

    /// Columns of all components.
    pub fn columns_mut(&mut self) -> [&mut [f64]; N] {
        let count = self.count;
        self.padded_columns_mut().map(|column| &mut column[..count])
    }

    /// Columns of all components, [padded](simd::padded).
    pub(crate) fn padded_columns(&self) -> [&[f64]; N] {
        std::array::from_fn(|number| &self.values[number * self.stride..][..self.stride])
    }

    /// Columns of all components, [padded](simd::padded).
    pub(crate) fn padded_columns_mut(&mut self) -> [&mut [f64]; N] {
        let mut rest = self.values.as_mut_slice();
        std::array::from_fn(|_| rest.split_off_mut(..self.stride).expect("there are N columns"))
    }
}

/// Compares the states; ignores the padding.
impl<const N: usize> PartialEq for StateArray<N> {
    fn eq(&self, other: &Self) -> bool {
        self.count == other.count && (0..N).all(|number| self.column(number) == other.column(number))
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
