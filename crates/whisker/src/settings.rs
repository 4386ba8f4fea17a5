//! Settings of methods, parsed and validated before a run.

use std::ops::RangeInclusive;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use strict_json::list_for_object;

/// Error of invalid settings.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The settings do not parse.
    #[error("{0}")]
    Parse(String),
    /// A value is out of range.
    #[error("`{key}`: found {found}, expected {expected}")]
    Range {
        /// Key of the value.
        key: &'static str,
        /// Value found.
        found: f64,
        /// Values expected.
        expected: String,
    },
}

/// Settings with a validation of their values.
pub trait Settings: DeserializeOwned + Serialize {
    /// Checks every value.
    ///
    /// # Errors
    /// [`SettingsError`] names the first that is out of range.
    fn validate(&self) -> Result<(), SettingsError>;
}

/// Parses and validates settings from JSON.
///
/// # Errors
/// [`SettingsError`] if they do not parse or a value is out of range.
pub fn parse<T: Settings>(value: &Value) -> Result<T, SettingsError> {
    let not_parsed = |error: serde_json::Error| SettingsError::Parse(error.to_string());
    let settings = T::deserialize(value).map_err(not_parsed)?;
    if let Some(place) = list_for_object(value, &serde_json::to_value(&settings).map_err(not_parsed)?) {
        return Err(SettingsError::Parse(format!("`{place}`: found a list, expected an object")));
    }
    settings.validate()?;
    Ok(settings)
}

/// Checks that a value lies in a range.
///
/// # Errors
/// [`SettingsError::Range`] if it does not.
pub fn within(key: &'static str, found: f64, range: RangeInclusive<f64>) -> Result<(), SettingsError> {
    if range.contains(&found) {
        return Ok(());
    }
    Err(SettingsError::Range { key, found, expected: format!("{} to {}", range.start(), range.end()) })
}
