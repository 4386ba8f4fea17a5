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

/// Checks what the filters of a resting contact have in common: memory, wander and start.
pub(super) fn check_contact(fading: f64, wander_m_sqrt_s: f64, start_away_sd_m: f64) -> Result<(), SettingsError> {
    within("fading", fading, 1.0..=2.0)?;
    // Without any wander a covariance can lose its last digits; a whisker's length in a second forgets everything at once.
    within("wander_m_sqrt_s", wander_m_sqrt_s, 1e-9..=0.1)?;
    within("start_away_sd_m", start_away_sd_m, 1e-6..=0.1)
}
