//! Settings over their defaults, by name.

use std::fmt;

use anyhow::{Context, anyhow, bail};
use serde_json::Value;
use whisker::estimators::with_defaults;

/// Context of an error in the settings of an estimator, of the contact detection or of the map: their name. Commands recognise by
/// it an error that belongs to the file of the settings.
#[derive(Clone, Debug)]
pub struct SettingsOf(pub String);

impl fmt::Display for SettingsOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "settings of `{}`", self.0)
    }
}

/// Settings merged with their defaults ([`with_defaults`]).
///
/// # Errors
/// If the settings are not a JSON object.
pub fn merged(defaults: Value, overrides: &Value) -> anyhow::Result<Value> {
    let Some(overrides) = overrides.as_object() else {
        bail!("settings: found {overrides}, expected a JSON object");
    };
    Ok(with_defaults(overrides, defaults))
}

/// Settings of an estimator merged with their defaults.
///
/// # Errors
/// If the settings are not a JSON object, with the context [`SettingsOf`].
pub fn merged_of(name: &str, defaults: Value, overrides: &Value) -> anyhow::Result<Value> {
    merged(defaults, overrides).with_context(|| SettingsOf(name.into()))
}

/// Checks that settings are given only for estimators of the run.
///
/// # Errors
/// If they are given for another one, with the context [`SettingsOf`].
pub fn check_configured<'a>(mut names: impl Iterator<Item = &'a String>, estimators: &[String]) -> anyhow::Result<()> {
    let Some(name) = names.find(|name| !estimators.contains(name)) else { return Ok(()) };
    let known = estimators.join(", ");
    Err(anyhow!("found for no estimator of the run, expected one of: {known}").context(SettingsOf(name.clone())))
}
