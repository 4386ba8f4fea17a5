//! The iterated extended Kalman filter on the contact.

use filters::iterated::{self, Search};
use filters::{Gaussian, Innovation, Measurement, Process, UpdateError};
use nalgebra::{SMatrix, Vector1};
use serde::{Deserialize, Serialize};

use super::gaussian::GaussianFilter;
use crate::settings::{SettingsError, within};

/// Settings of this filter alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Iterated {
    /// Maximum number of steps of an update.
    iterations: usize,
    /// Step, in standard deviations of the prior, below which the update ends.
    tolerance_sds: f64,
}

impl Default for Iterated {
    fn default() -> Self {
        Self { iterations: 5, tolerance_sds: 1e-2 }
    }
}

impl GaussianFilter for Iterated {
    fn validate(&self) -> Result<(), SettingsError> {
        within("filter.iterations", self.iterations as f64, 1.0..=1000.0)?;
        within("filter.tolerance_sds", self.tolerance_sds, 0.0..=1.0)
    }

    fn predict<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        process: &impl Process<N>,
    ) -> Result<Option<SMatrix<f64, N, N>>, UpdateError> {
        Ok(Some(iterated::predict(belief, process)))
    }

    fn update<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError> {
        let search = Search { iterations: self.iterations, tolerance_sds: self.tolerance_sds };
        iterated::update(belief, measurement, &search, z)
    }
}
