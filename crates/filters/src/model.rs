//! Process and measurement models. Symbols are those of the crate's front page.

use nalgebra::{SMatrix, SVector};

use crate::StateArray;

/// Step of the central differences, relative to the larger of 1 and the component's magnitude: the cube root of the
/// machine epsilon balances truncation against rounding error (Press et al., *Numerical Recipes*, 2007, section 5.7).
const RELATIVE_STEP: f64 = 6.055e-6;

/// Process model `x' = f(x) + w`, `w ~ N(0, Q)`: the transition of the state from one instant to the next.
pub trait Process<const N: usize> {
    /// Predicted state `f(x)`, one step later.
    fn predict(&self, x: &SVector<f64, N>) -> SVector<f64, N>;

    /// Process noise covariance `Q` of one step from `x`.
    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// Process noise covariance `Q` if it does not depend on the state; `None` by default.
    fn constant_noise(&self) -> Option<SMatrix<f64, N, N>> {
        None
    }

    /// Jacobian `F = df/dx` at `x`; by default by central differences.
    fn jacobian(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let mut jacobian = SMatrix::<f64, N, N>::zeros();
        for i in 0..N {
            let (low, high, span) = bracket(x, i);
            jacobian.set_column(i, &((self.predict(&high) - self.predict(&low)) / span));
        }
        jacobian
    }

    /// Predicted state `f(x)`, Jacobian `F` and process noise covariance `Q` at `x`. Override it if they share computations.
    fn linearised(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
        (self.predict(x), self.jacobian(x), self.noise(x))
    }

    /// Replaces every state by its prediction `f(x)`; by default one by one. Override it with a vectorised loop.
    fn predict_each(&self, states: &mut StateArray<N>) {
        for index in 0..states.len() {
            states.set(index, &self.predict(&states.get(index)));
        }
    }
}

/// Measurement model `z = h(x) + v`, `v ~ N(0, R)`.
pub trait Measurement<const N: usize, const M: usize> {
    /// Predicted reading `h(x)`. `None` if the model is undefined at `x`.
    fn predict(&self, x: &SVector<f64, N>) -> Option<SVector<f64, M>>;

    /// Measurement noise covariance `R` at `x`.
    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, M, M>;

    /// Jacobian `H = dh/dx` at `x`; by default by central differences. `None` if the model is undefined at `x`.
    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, M, N>> {
        let mut jacobian = SMatrix::<f64, M, N>::zeros();
        for i in 0..N {
            let (low, high, span) = bracket(x, i);
            jacobian.set_column(i, &((self.predict(&high)? - self.predict(&low)?) / span));
        }
        Some(jacobian)
    }

    /// Predicted reading `h(x)` and Jacobian `H`. Override it if they share computations.
    fn linearised(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>)> {
        Some((self.predict(x)?, self.jacobian(x)?))
    }

    /// Predicted reading `h(x)` and noise covariance `R` at one state. Override it if they share computations.
    fn predict_with_noise(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, M>)> {
        Some((self.predict(x)?, self.noise(x)))
    }

    /// Predicted reading `h(x)`, Jacobian `H` and noise covariance `R` at one state. Override it if they share computations.
    fn linearised_with_noise(
        &self,
        x: &SVector<f64, N>,
    ) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>, SMatrix<f64, M, M>)> {
        let (expected, jacobian) = self.linearised(x)?;
        Some((expected, jacobian, self.noise(x)))
    }

    /// Writes the predicted reading of every state to `expected`, NaN where the model is undefined; by default one by
    /// one. Override it with a vectorised loop if the noise is [constant](Self::constant_noise); a particle filter calls
    /// [`Self::predict_with_noise`] otherwise.
    fn predict_each(&self, states: &StateArray<N>, expected: &mut StateArray<M>) {
        for (index, state) in states.iter().enumerate() {
            expected.set(index, &self.predict(&state).unwrap_or_else(|| SVector::repeat(f64::NAN)));
        }
    }

    /// Measurement noise covariance `R` if it does not depend on the state; `None` by default.
    fn constant_noise(&self) -> Option<SMatrix<f64, M, M>> {
        None
    }

    /// Residual `z - h(x)` of a reading. Override it to wrap angles.
    #[inline(always)]
    fn residual(&self, z: &SVector<f64, M>, expected: &SVector<f64, M>) -> SVector<f64, M> {
        z - expected
    }
}

/// Measurement model whose noise covariance is held at its value at one state, as a Gaussian filter assumes within one update.
#[derive(Clone, Copy, Debug)]
pub struct ConstantNoise<Model, const M: usize> {
    model: Model,
    noise: SMatrix<f64, M, M>,
}

impl<Model, const M: usize> ConstantNoise<Model, M> {
    /// Measurement model with the noise covariance at `state`.
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

    fn constant_noise(&self) -> Option<SMatrix<f64, M, M>> {
        Some(self.noise)
    }

    #[inline(always)]
    fn residual(&self, z: &SVector<f64, M>, expected: &SVector<f64, M>) -> SVector<f64, M> {
        self.model.residual(z, expected)
    }
}

/// States on either side of `x` along component `i`, and the distance between them.
fn bracket<const N: usize>(x: &SVector<f64, N>, i: usize) -> (SVector<f64, N>, SVector<f64, N>, f64) {
    let step = RELATIVE_STEP * x[i].abs().max(1.0);
    let (mut low, mut high) = (*x, *x);
    low[i] -= step;
    high[i] += step;
    (low, high, high[i] - low[i])
}
