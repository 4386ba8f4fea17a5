//! Settings over their defaults, by name.

use anyhow::{Context, bail};
use serde_json::Value;

/// Settings over their defaults. Keys that the defaults lack are kept, so that parsing rejects them by name.
///
/// # Errors
/// If the settings are not a JSON object.
pub fn merged(mut defaults: Value, overrides: &Value) -> anyhow::Result<Value> {
    let Some(overrides) = overrides.as_object() else {
        bail!("settings: found {overrides}, expected a JSON object");
    };
    defaults.as_object_mut().context("defaults are a JSON object")?.extend(overrides.clone());
    Ok(defaults)
}
