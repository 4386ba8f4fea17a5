//! The unscented Kalman filter on the contact's place.

use filters::unscented::{self, Spread};
use filters::{Gaussian, Innovation, Skipped};
use nalgebra::Vector1;
use serde::{Deserialize, Serialize};

use super::gaussian::GaussianFilter;
use super::model::{ContactReading, StaticContact};
use super::settings::{ContactSettings, Settings, SettingsError, within};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Ukf {
    /// Fading memory: the prior covariance is scaled by it at each step.
    fading: f64,
    /// How far the contact may wander in the world, as the standard deviation after one second, in m.
    wander_m_sqrt_s: f64,
    /// Standard deviation of the contact's distance from the undeflected whisker at the touch.
    start_away_sd_m: f64,
    /// Scale of the sigma points' spread; see [`Spread`].
    alpha: f64,
    /// Prior knowledge of the distribution, 2 for a Gaussian.
    beta: f64,
    /// Secondary scale; state size + kappa is the kurtosis that is matched.
    kappa: f64,
}

impl Default for Ukf {
    fn default() -> Self {
        Self { fading: 1.004, wander_m_sqrt_s: 1e-4, start_away_sd_m: 1e-3, alpha: 1.0, beta: 2.0, kappa: 1.0 }
    }
}

impl Ukf {
    fn spread(&self) -> Spread {
        Spread { alpha: self.alpha, beta: self.beta, kappa: self.kappa }
    }
}

impl Settings for Ukf {
    fn validate(&self) -> Result<(), SettingsError> {
        self.contact().validate()?;
        within("alpha", self.alpha, 1e-3..=2.0)?;
        within("beta", self.beta, 0.0..=10.0)?;
        within("kappa", self.kappa, -1.0..=10.0)
    }
}

impl GaussianFilter for Ukf {
    fn contact(&self) -> ContactSettings {
        let Self { fading, wander_m_sqrt_s, start_away_sd_m, .. } = *self;
        ContactSettings { fading, wander_m_sqrt_s, start_away_sd_m }
    }

    fn predict(&self, belief: &mut Gaussian<2>, process: &StaticContact<'_>) -> Result<(), Skipped> {
        unscented::predict(belief, process, &self.spread())
    }

    fn update(
        &self,
        belief: &mut Gaussian<2>,
        measurement: &ContactReading<'_>,
        reading_n_m: f64,
    ) -> Result<Innovation<1>, Skipped> {
        unscented::update(belief, measurement, &self.spread(), &Vector1::new(reading_n_m))
    }
}
