//! Quantities of a mapping: a column or a constant, with its unit and sign.

use std::path::Path;

use files::Error;
use serde::{Deserialize, Serialize};

use super::units::{Angle, Length, Unit};

/// Column, or a constant value, with its unit and sign.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Quantity<U> {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) column: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    unit: U,
    #[serde(default = "positive")]
    sign: f64,
}

pub(crate) fn positive() -> f64 {
    1.0
}

impl Quantity<Length> {
    pub(crate) fn zero() -> Self {
        Self { column: None, value: Some(0.0), unit: Length::M, sign: 1.0 }
    }

    /// Constant value in the unit of the mapping, with the sign. `None` for a column.
    fn stated(&self) -> Option<String> {
        let unit = serde_json::to_value(self.unit).expect("a unit serialises");
        self.value.map(|value| format!("{} {}", self.sign * value, unit.as_str().unwrap_or_default()))
    }

    /// Checks a constant radius.
    pub(crate) fn validate_radius(&self, path: &Path, key: &str, most_m: f64) -> Result<(), Error> {
        self.validate_constant(path, key, most_m)?;
        if self.constant().is_none_or(|radius_m| radius_m <= 0.0) {
            return Err(Error::value(path, key, self.stated().unwrap_or_default(), "a positive radius"));
        }
        Ok(())
    }
}

impl Default for Quantity<Angle> {
    fn default() -> Self {
        Self { column: None, value: Some(0.0), unit: Angle::Rad, sign: 1.0 }
    }
}

impl<U: Unit> Quantity<U> {
    /// SI units per unit of the column, with the sign.
    pub(crate) fn factor(&self) -> f64 {
        self.sign * self.unit.si()
    }

    /// Constant value in SI units. `None` for a column.
    pub(crate) fn constant(&self) -> Option<f64> {
        self.value.map(|value| self.factor() * value)
    }

    /// Checks that one of `column` and `value` is stated, the latter with a magnitude of at most `most` in SI units.
    pub(crate) fn validate(&self, path: &Path, key: &str, most: f64) -> Result<(), Error> {
        check_sign(path, key, self.sign)?;
        match (&self.column, self.constant()) {
            (Some(_), None) => Ok(()),
            (None, Some(value)) if value.abs() <= most => Ok(()),
            (None, Some(value)) => {
                Err(Error::value(path, key, format!("{value} in SI units"), format!("a magnitude of at most {most}")))
            }
            (Some(_), Some(_)) => Err(Error::value(path, key, "`column` and `value`", "one of them")),
            (None, None) => Err(Error::value(path, key, "neither `column` nor `value`", "one of them")),
        }
    }

    /// As [`Self::validate`], for a constant.
    pub(crate) fn validate_constant(&self, path: &Path, key: &str, most: f64) -> Result<(), Error> {
        self.validate(path, key, most)?;
        if self.column.is_some() {
            return Err(Error::value(path, key, "`column`", "a constant `value`"));
        }
        Ok(())
    }
}

pub(crate) fn check_sign(path: &Path, key: &str, sign: f64) -> Result<(), Error> {
    if sign.abs() != 1.0 {
        return Err(Error::value(path, format!("{key}.sign"), sign, "1 or -1"));
    }
    Ok(())
}
