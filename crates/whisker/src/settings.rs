//! Settings of methods, parsed and validated before a run.

use std::ops::RangeInclusive;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use strict_json::{list_for_object, reason, shown_number};

/// Error of invalid settings.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The settings do not parse.
    #[error("{0}")]
    Parse(String),
    /// A value is out of range.
    #[error("`{key}`: found {}, expected {expected}", shown_number(*found))]
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

/// Settings as JSON.
pub(crate) fn to_json(settings: &impl Serialize) -> Value {
    serde_json::to_value(settings).expect("settings serialise")
}

/// Key that names the variant of a settings object.
const KIND: &str = "kind";

/// Settings merged with their defaults at every depth: a key that is absent takes its default. An object whose `kind` differs from
/// that of its default replaces the default as a whole. Keys that have no default are kept, so that parsing rejects them by name.
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
    let settings: T = typed(value)?;
    let again = serde_json::to_value(&settings).map_err(|error| SettingsError::Parse(reason(&error)))?;
    if let Some(place) = list_for_object(value, &again) {
        return Err(SettingsError::Parse(format!("`{place}`: found a list, expected an object")));
    }
    settings.validate()?;
    Ok(settings)
}

/// Parses settings from JSON without validating their values.
///
/// # Errors
/// [`SettingsError::Parse`], with the key whose value has a wrong type.
pub(crate) fn typed<T: DeserializeOwned>(value: &Value) -> Result<T, SettingsError> {
    T::deserialize(value).map_err(|error| {
        let reason = reason(&error);
        let key = reason.starts_with("found ").then(|| mistyped::<T>(value)).flatten();
        SettingsError::Parse(key.map_or_else(|| reason.clone(), |key| format!("`{key}`: {reason}")))
    })
}

/// The first key whose value has a wrong type. `None` if there is none.
fn mistyped<T: DeserializeOwned>(value: &Value) -> Option<&str> {
    // The values are read in turn, before the absence of keys is noticed.
    let mut settings = Map::new();
    let is_wrong = |(key, value): &(&String, &Value)| {
        settings.insert((*key).clone(), (*value).clone());
        T::deserialize(&Value::Object(settings.clone())).is_err_and(|error| reason(&error).starts_with("found "))
    };
    value.as_object()?.iter().find(is_wrong).map(|(key, _)| key.as_str())
}

/// Checks that a value lies in a range.
///
/// # Errors
/// [`SettingsError::Range`] if it does not.
pub fn within(key: &'static str, found: f64, range: RangeInclusive<f64>) -> Result<(), SettingsError> {
    if range.contains(&found) {
        return Ok(());
    }
    Err(SettingsError::Range {
        key,
        found,
        expected: format!("{} to {}", shown_number(*range.start()), shown_number(*range.end())),
    })
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;
    use serde_json::json;

    use super::*;

    #[derive(Debug, Default, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Config {
        _fading: f64,
        _count: usize,
    }

    #[derive(Debug, Deserialize)]
    struct Stored {
        _degree: usize,
        _center_m: [f64; 2],
    }

    #[test]
    fn robust_a_value_of_a_wrong_type_is_named() {
        let config = |value: Value| typed::<Config>(&value).unwrap_err().to_string();
        assert_eq!(config(json!({"_count": 2, "_fading": "x"})), "`_fading`: found \"x\", expected a number");
        assert_eq!(config(json!({"_count": -1})), "`_count`: found -1, expected a whole number of 0 or more");
        assert_eq!(config(json!({"_cuont": 1})), "unknown field `_cuont`, expected `_fading` or `_count`");
        assert_eq!(config(json!(3)), "found 3, expected an object");
        let stored = |value: Value| typed::<Stored>(&value).unwrap_err().to_string();
        let wrong = json!({"_degree": 2, "_center_m": [1]});
        assert_eq!(stored(wrong), "`_center_m`: found a list of 1, expected a list of 2");
        assert_eq!(stored(json!({"_degree": 2})), "missing field `_center_m`");
    }

    #[test]
    fn robust_a_number_out_of_range_is_shown_with_an_exponent_if_it_is_long() {
        let refused = |found: f64, range| within("gain", found, range).unwrap_err().to_string();
        assert_eq!(refused(1e300, 0.0..=0.5), "`gain`: found 1e300, expected 0 to 0.5");
        assert_eq!(refused(-2.5, 1e-9..=1e6), "`gain`: found -2.5, expected 1e-9 to 1000000");
    }

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
