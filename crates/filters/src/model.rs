//! What a filter needs to know of the world: how the state moves and what a reading says about it.

use nalgebra::{SMatrix, SVector};

use crate::StateArray;

/// Step of the central differences, relative to the larger of 1 and the component: the cube root of the machine's
/// precision balances truncation against rounding.
const RELATIVE_STEP: f64 = 6.055e-6;

/// How the state moves from one instant to the next: `x' = f(x) + w`, `w ~ N(0, Q)`.
pub trait Process<const N: usize> {
    /// The state one step later, `f(x)`.
    fn predict(&self, x: &SVector<f64, N>) -> SVector<f64, N>;

    /// Covariance `Q` that the step adds.
    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// Covariance `Q` where it is the same at every state; nothing unless given.
    fn even_noise(&self) -> Option<SMatrix<f64, N, N>> {
        None
    }

    /// `F = df/dx`; by central differences unless given.
    fn jacobian(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let mut jacobian = SMatrix::<f64, N, N>::zeros();
        for i in 0..N {
            let (low, high, span) = bracket(x, i);
            jacobian.set_column(i, &((self.predict(&high) - self.predict(&low)) / span));
        }
        jacobian
    }

    /// The state one step later, the Jacobian `F` and the covariance `Q`, for filters that need all three; one after the other unless given.
    fn linearised(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
        (self.predict(x), self.jacobian(x), self.noise(x))
    }

    /// Moves many states one step on; one by one unless given.
    fn predict_each(&self, states: &mut StateArray<N>) {
        for index in 0..states.len() {
            states.set(index, &self.predict(&states.get(index)));
        }
    }
}

/// What a reading says about the state: `z = h(x) + v`, `v ~ N(0, R)`.
pub trait Measurement<const N: usize, const M: usize> {
    /// The reading expected at `x`, or nothing where the model does not know.
    fn predict(&self, x: &SVector<f64, N>) -> Option<SVector<f64, M>>;

    /// Covariance `R` of the reading at `x`.
    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, M, M>;

    /// `H = dh/dx`; by central differences unless given.
    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, M, N>> {
        let mut jacobian = SMatrix::<f64, M, N>::zeros();
        for i in 0..N {
            let (low, high, span) = bracket(x, i);
            jacobian.set_column(i, &((self.predict(&high)? - self.predict(&low)?) / span));
        }
        Some(jacobian)
    }

    /// The reading expected at `x` and its Jacobian `H`, for filters that need both; one after the other unless given.
    fn linearised(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>)> {
        Some((self.predict(x)?, self.jacobian(x)?))
    }

    /// That with `R`, for filters that ask for all three at one state; one after the other unless given.
    fn linearised_with_noise(
        &self,
        x: &SVector<f64, N>,
    ) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>, SMatrix<f64, M, M>)> {
        let (expected, jacobian) = self.linearised(x)?;
        Some((expected, jacobian, self.noise(x)))
    }

    /// Writes the readings expected at many states, not-a-number where the model does not know; one by one unless given.
    fn predict_each(&self, states: &StateArray<N>, expected: &mut StateArray<M>) {
        for (index, state) in states.iter().enumerate() {
            expected.set(index, &self.predict(&state).unwrap_or_else(|| SVector::repeat(f64::NAN)));
        }
    }

    /// Covariance `R` where it is the same at every state; nothing unless given.
    fn even_noise(&self) -> Option<SMatrix<f64, M, M>> {
        None
    }

    /// Difference between a reading and the expected one; angles override it to wrap.
    #[inline(always)]
    fn residual(&self, z: &SVector<f64, M>, expected: &SVector<f64, M>) -> SVector<f64, M> {
        z - expected
    }
}

/// A measurement whose noise is everywhere what it is at one state, as a Gaussian filter takes it.
#[derive(Clone, Copy, Debug)]
pub struct ConstantNoise<Model, const M: usize> {
    model: Model,
    noise: SMatrix<f64, M, M>,
}

impl<Model, const M: usize> ConstantNoise<Model, M> {
    /// The measurement with its noise at a state.
    pub fn new<const N: usize>(model: Model, state: &SVector<f64, N>) -> Self
    where
        Model: Measurement<N, M>,
    {
        let noise = model.noise(state);
        Self { model, noise }
    }
}

impl<const N: usize, const M: usize, Model: Measurement<N, M>> Measurement<N, M> for ConstantNoise<Model, M> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<SVector<f64, M>> {
        self.model.predict(x)
    }

    fn noise(&self, _: &SVector<f64, N>) -> SMatrix<f64, M, M> {
        self.noise
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, M, N>> {
        self.model.jacobian(x)
    }

    fn linearised(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>)> {
        self.model.linearised(x)
    }

    fn predict_each(&self, states: &StateArray<N>, expected: &mut StateArray<M>) {
        self.model.predict_each(states, expected);
    }

    fn even_noise(&self) -> Option<SMatrix<f64, M, M>> {
        Some(self.noise)
    }

    #[inline(always)]
    fn residual(&self, z: &SVector<f64, M>, expected: &SVector<f64, M>) -> SVector<f64, M> {
        self.model.residual(z, expected)
    }
}

fn bracket<const N: usize>(x: &SVector<f64, N>, i: usize) -> (SVector<f64, N>, SVector<f64, N>, f64) {
    let step = RELATIVE_STEP * x[i].abs().max(1.0);
    let (mut low, mut high) = (*x, *x);
    low[i] -= step;
    high[i] += step;
    (low, high, high[i] - low[i])
}
