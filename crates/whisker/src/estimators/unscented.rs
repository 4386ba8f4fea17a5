//! The unscented Kalman filter on the contact.

use filters::unscented::{self, Spread};
use filters::{Gaussian, Innovation, Measurement, Process, UpdateError};
use nalgebra::{SMatrix, Vector1};
use serde::{Deserialize, Serialize};

use super::gaussian::GaussianFilter;
use crate::settings::{SettingsError, within};

/// Settings of this filter alone: the spread of the sigma points, see [`Spread`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Unscented {
    /// Scale of the spread.
    alpha: f64,
    /// Prior knowledge of the distribution, 2 for a Gaussian.
    beta: f64,
    /// Secondary scale; state size + kappa is the kurtosis that is matched.
    kappa: f64,
}

impl Default for Unscented {
    fn default() -> Self {
        Self { alpha: 1.0, beta: 2.0, kappa: 0.0 }
    }
}

impl Unscented {
    fn spread(&self) -> Spread {
        Spread { alpha: self.alpha, beta: self.beta, kappa: self.kappa }
    }
}

impl GaussianFilter for Unscented {
    fn validate(&self) -> Result<(), SettingsError> {
        within("filter.alpha", self.alpha, 1e-3..=2.0)?;
        within("filter.beta", self.beta, 0.0..=10.0)?;
        within("filter.kappa", self.kappa, -1.0..=10.0)
    }

    fn predict<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        process: &impl Process<N>,
    ) -> Result<Option<SMatrix<f64, N, N>>, UpdateError> {
        unscented::predict(belief, process, &self.spread())?;
        Ok(None)
    }

    fn update<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError> {
        unscented::update(belief, measurement, &self.spread(), z)
    }
}
