//! Settings over their defaults, by name.

use anyhow::bail;
use serde_json::Value;
use whisker::estimators::with_defaults;

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
