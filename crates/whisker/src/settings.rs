//! Settings of methods, parsed and validated before a run.

use std::ops::RangeInclusive;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
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

/// Key that names the variant of a settings object.
const KIND: &str = "kind";

/// Settings merged with their defaults at every depth: a key that is absent takes its default. An object whose `kind` differs from that
/// of its default replaces the default as a whole. Keys that have no default are kept, so that parsing rejects them by name.
pub fn with_defaults(settings: &Map<String, Value>, mut defaults: Value) -> Value {
    let Some(all) = defaults.as_object_mut() else { return Value::Object(settings.clone()) };
    if settings.get(KIND).is_some_and(|kind| all.get(KIND) != Some(kind)) {
        return Value::Object(settings.clone());
    }
    for (key, value) in settings {
        match (all.get_mut(key), value) {
            (Some(default @ Value::Object(_)), Value::Object(own)) => *default = with_defaults(own, default.take()),
            _ => _ = all.insert(key.clone(), value.clone()),
        }
    }
    defaults
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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn verif_absent_keys_take_their_defaults_at_any_depth() {
        let defaults = json!({"gate": 5, "filter": {"share": 0.8, "start": {"kind": "several", "count": 16}}});
        let with = |settings: Value| with_defaults(settings.as_object().unwrap(), defaults.clone());
        assert_eq!(with(json!({})), defaults);
        assert_eq!(
            with(json!({"filter": {"start": {"count": 4}}})),
            json!({"gate": 5, "filter": {"share": 0.8, "start": {"kind": "several", "count": 4}}})
        );
        assert_eq!(
            with(json!({"filter": {"start": {"kind": "one"}, "unknown": 1}})),
            json!({"gate": 5, "filter": {"share": 0.8, "start": {"kind": "one"}, "unknown": 1}})
        );
        assert_eq!(with(json!({"filter": 3})), json!({"gate": 5, "filter": 3}));
    }
}
