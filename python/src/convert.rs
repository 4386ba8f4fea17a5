//! Settings and descriptions as Python objects, and arguments with a fixed meaning.

use std::fmt::Display;

use ::trace::{FARTHEST_M, RATES_HZ};
use ::whisker::estimators::{BaseNoise, ContactPrior};
use ::whisker::frames::{Base, Point, Pose};
use ::whisker::sensor::Face;
use anyhow::Context;
use nalgebra::Matrix3;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyTuple};
use serde::Serialize;
use serde_json::Value;
use testbed::settings::merged;

use crate::arrays::{COVARIANCE, Numbers, is_covariance, rows};
use crate::error::{raised, refused};

/// A Python object as JSON.
pub(crate) fn to_json(what: &str, object: &Bound<'_, PyAny>) -> PyResult<Value> {
    let py = object.py();
    let text: String = py
        .import("json")?
        .call_method1("dumps", (object,))
        .and_then(|text| text.extract())
        .map_err(|error| PyTypeError::new_err(format!("{what}: {}", error.value(py))))?;
    serde_json::from_str(&text).map_err(|error| refused(what, error, "finite numbers, text, lists and dictionaries"))
}

/// A description as Python dictionaries, lists, numbers and text.
pub(crate) fn from_json<'py>(py: Python<'py>, description: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(description).map_err(raised)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Side of the whisker by its name.
pub(crate) fn face(name: &str) -> PyResult<Face> {
    match name {
        "left" => Ok(Face::Left),
        "right" => Ok(Face::Right),
        _ => Err(refused("face", format!("`{name}`"), "`left` or `right`")),
    }
}

/// Checks that a number is finite and not negative.
pub(crate) fn check_not_negative(what: &str, number: f64) -> PyResult<()> {
    if number.is_finite() && number >= 0.0 {
        return Ok(());
    }
    Err(refused(what, number, "a number of 0 or more"))
}

/// Checks the coordinates of a position (m): finite, with magnitudes that a trace allows.
pub(crate) fn check_position(what: impl Display, position_m: &[f64]) -> PyResult<()> {
    if position_m.iter().all(|coordinate_m| coordinate_m.abs() <= FARTHEST_M) {
        return Ok(());
    }
    Err(refused(
        &what.to_string(),
        format!("{position_m:?}"),
        &format!("finite coordinates with magnitudes of at most {FARTHEST_M} m"),
    ))
}

/// Poses (n, 3) of the base in World: x (m), y (m) and yaw (rad).
pub(crate) fn poses(base: &Numbers<'_>) -> PyResult<Vec<[f64; 3]>> {
    let poses = rows::<3>("base", base)?;
    for (row, pose) in poses.iter().enumerate() {
        check_position(format_args!("base[{row}]"), &pose[..2])?;
    }
    Ok(poses)
}

/// Checks a sampling rate (Hz).
pub(crate) fn check_rate(rate_hz: f64) -> PyResult<()> {
    let [least, most] = RATES_HZ;
    if (least..=most).contains(&rate_hz) {
        return Ok(());
    }
    Err(refused("rate_hz", rate_hz, &format!("{least} to {most}")))
}

/// Checks that a number is finite.
pub(crate) fn check_finite(what: &str, number: f64) -> PyResult<()> {
    if number.is_finite() { Ok(()) } else { Err(refused(what, number, "a finite number")) }
}

/// Settings of an estimator from its default ones and a dictionary over them.
pub(crate) fn settings_over(name: &str, defaults: Value, settings: Option<&Bound<'_, PyAny>>) -> PyResult<Value> {
    let Some(settings) = settings else { return Ok(defaults) };
    let merged = merged(defaults, &to_json("settings", settings)?).with_context(|| format!("settings of `{name}`"));
    merged.map_err(raised)
}

/// Motion of the base: x, y and yaw of its earlier frame in its later one.
pub(crate) struct Motion(pub(crate) Pose<Base, Base>);

impl<'a, 'py> FromPyObject<'a, 'py> for Motion {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let [x_m, y_m, yaw_rad] = triple("motion", object)?;
        Ok(Self(Pose::new(x_m, y_m, yaw_rad)))
    }
}

/// Pose of the base in World: x, y and yaw.
pub(crate) struct Placed(pub(crate) [f64; 3]);

impl<'a, 'py> FromPyObject<'a, 'py> for Placed {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        triple("base", object).map(Self)
    }
}

/// Three finite numbers from a tuple, the fastest, or from any other sequence.
fn triple(what: &str, object: Borrowed<'_, '_, PyAny>) -> PyResult<[f64; 3]> {
    let numbers = match object.cast::<PyTuple>() {
        Ok(tuple) if tuple.len() == 3 => {
            let number = |i| -> PyResult<f64> {
                let item = tuple.get_borrowed_item(i)?;
                match item.cast::<PyFloat>() {
                    Ok(number) => Ok(number.value()),
                    Err(_) => item.extract(),
                }
            };
            [number(0)?, number(1)?, number(2)?]
        }
        _ => object
            .extract::<[f64; 3]>()
            .map_err(|_| refused(what, object.to_string(), "three numbers: x (m), y (m) and yaw (rad)"))?,
    };
    check_position(what, &numbers[..2])?;
    if !numbers[2].is_finite() {
        return Err(refused(what, format!("{numbers:?}"), "finite numbers"));
    }
    Ok(numbers)
}

/// Prior of the first contact: x, y (m, in Base) and the standard deviation in every direction (m).
pub(crate) fn contact_prior(prior: Option<[f64; 3]>) -> PyResult<Option<ContactPrior>> {
    let Some([x_m, y_m, sd_m]) = prior else { return Ok(None) };
    if !(x_m.is_finite() && y_m.is_finite() && sd_m.is_finite() && sd_m > 0.0) {
        let expected = "finite x (m), y (m) and a positive standard deviation (m)";
        return Err(refused("contact_prior", format!("{:?}", [x_m, y_m, sd_m]), expected));
    }
    Ok(Some(ContactPrior { contact: Point::new(x_m, y_m), sd_m }))
}

/// Noise of the base's measured pose from its covariance (3, 3).
pub(crate) fn base_noise(covariance: Option<&Numbers<'_>>) -> PyResult<BaseNoise> {
    let Some(covariance) = covariance else { return Ok(BaseNoise::default()) };
    let rows: Vec<[f64; 3]> = rows("base_noise", covariance)?;
    if rows.len() != 3 {
        return Err(refused("base_noise", format!("{} rows", rows.len()), "a covariance of x, y and yaw, 3 x 3"));
    }
    let matrix = Matrix3::from_fn(|i, j| rows[i][j]);
    if !is_covariance(&matrix) {
        return Err(refused("base_noise", format!("{rows:?}"), COVARIANCE));
    }
    Ok(BaseNoise(matrix))
}
