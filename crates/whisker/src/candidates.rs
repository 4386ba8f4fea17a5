//! Candidates of model averages, common to those of the plane and of space.

use crate::settings::{SettingsError, within};

/// Least probability of the candidates with an estimate for which there is one of the mixture.
pub(crate) const LEAST_KNOWN: f64 = 0.5;

/// Key of the settings of the candidates.
pub(crate) const CANDIDATES: &str = "candidates";

/// Error of a method at a key of the settings that cannot be averaged over.
pub(crate) fn refused(key: &str, name: &str, why: &str) -> SettingsError {
    SettingsError::Parse(format!("`{key}`: `{name}` is {why}"))
}

/// Error of a method at a key of the settings that is not one of the registry's names.
pub(crate) fn unknown<'a>(key: &str, name: &str, known: impl Iterator<Item = &'a str>) -> SettingsError {
    refused(key, name, &format!("unknown, expected one of: {}", known.collect::<Vec<_>>().join(", ")))
}

/// Checks names and prior weights of up to `most` candidates.
///
/// # Errors
/// [`SettingsError`] if their number or a weight is out of range, or a name occurs twice.
pub(crate) fn check(candidates: &[(&str, f64)], most: usize) -> Result<(), SettingsError> {
    within(CANDIDATES, candidates.len() as f64, 1.0..=most as f64)?;
    for (place, (name, weight)) in candidates.iter().enumerate() {
        within("candidates.weight", *weight, 1e-9..=1e9)?;
        if candidates[..place].iter().any(|(other, _)| other == name) {
            return Err(refused(CANDIDATES, name, "named twice, expected each name once"));
        }
    }
    Ok(())
}
