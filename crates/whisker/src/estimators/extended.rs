//! The extended Kalman filter on the contact's place.

use filters::{Gaussian, Innovation, Skipped, extended};
use nalgebra::Vector1;
use serde::{Deserialize, Serialize};

use super::gaussian::GaussianFilter;
use super::model::{ContactReading, StaticContact};
use super::settings::{ContactSettings, Settings, SettingsError};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Ekf {
    /// Fading memory: the prior covariance is scaled by it at each step.
    fading: f64,
    /// How far the contact may wander in the world, as the standard deviation after one second, in m.
    wander_m_sqrt_s: f64,
    /// Standard deviation of the contact's distance from the undeflected whisker at the touch.
    start_away_sd_m: f64,
}

impl Default for Ekf {
    fn default() -> Self {
        Self { fading: 1.004, wander_m_sqrt_s: 1e-4, start_away_sd_m: 1e-3 }
    }
}

impl Settings for Ekf {
    fn validate(&self) -> Result<(), SettingsError> {
        self.contact().validate()
    }
}

impl GaussianFilter for Ekf {
    fn contact(&self) -> ContactSettings {
        let Self { fading, wander_m_sqrt_s, start_away_sd_m } = *self;
        ContactSettings { fading, wander_m_sqrt_s, start_away_sd_m }
    }

    fn predict(&self, belief: &mut Gaussian<2>, process: &StaticContact<'_>) -> Result<(), Skipped> {
        extended::predict(belief, process);
        Ok(())
    }

    fn update(
        &self,
        belief: &mut Gaussian<2>,
        measurement: &ContactReading<'_>,
        reading_n_m: f64,
    ) -> Result<Innovation<1>, Skipped> {
        extended::update(belief, measurement, &Vector1::new(reading_n_m))
    }
}
