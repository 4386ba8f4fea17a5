//! The extended Kalman filter on the contact.

use filters::{Gaussian, Innovation, Measurement, Process, UpdateError, extended};
use nalgebra::{SMatrix, Vector1};
use serde::{Deserialize, Serialize};

use super::gaussian::GaussianFilter;

/// The filter; it has no settings of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Extended {}

impl GaussianFilter for Extended {
    fn predict<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        process: &impl Process<N>,
    ) -> Result<Option<SMatrix<f64, N, N>>, UpdateError> {
        Ok(Some(extended::predict(belief, process)))
    }

    fn update<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError> {
        extended::update(belief, measurement, z)
    }
}
