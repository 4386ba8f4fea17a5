//! Settings of estimators: parsed, and checked before anything runs.

use std::ops::RangeInclusive;

use serde::de::DeserializeOwned;
use serde_json::Value;

/// Why settings cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// They do not parse.
    #[error("{0}")]
    Parse(String),
    /// A value is out of range.
    #[error("`{key}`: found {found}, expected {expected}")]
    Range {
        /// Key of the value.
        key: &'static str,
        /// What stands there.
        found: f64,
        /// What should.
        expected: String,
    },
}

/// Settings that know what they may be.
pub(super) trait Settings: DeserializeOwned {
    /// Checks every value.
    fn validate(&self) -> Result<(), SettingsError>;
}

/// Settings from JSON, checked.
pub(super) fn parse<T: Settings>(value: &Value) -> Result<T, SettingsError> {
    let settings = T::deserialize(value).map_err(|error| SettingsError::Parse(error.to_string()))?;
    settings.validate()?;
    Ok(settings)
}

/// Checks that a value lies in a range.
pub(crate) fn within(key: &'static str, found: f64, range: RangeInclusive<f64>) -> Result<(), SettingsError> {
    if range.contains(&found) {
        return Ok(());
    }
    Err(SettingsError::Range { key, found, expected: format!("{} to {}", range.start(), range.end()) })
}

/// What the filters of a resting contact have in common: memory, wander and start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ContactSettings {
    /// Fading memory: the prior covariance is scaled by it at each step.
    pub fading: f64,
    /// How far the contact may wander in the world, as the standard deviation after one second, in m.
    pub wander_m_sqrt_s: f64,
    /// Standard deviation of the contact's distance from the undeflected whisker at the touch.
    pub start_away_sd_m: f64,
}

impl ContactSettings {
    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("fading", self.fading, 1.0..=2.0)?;
        // Without any wander a covariance can lose its last digits; a whisker's length in a second forgets everything at once.
        within("wander_m_sqrt_s", self.wander_m_sqrt_s, 1e-9..=0.1)?;
        within("start_away_sd_m", self.start_away_sd_m, 1e-6..=0.1)
    }
}
