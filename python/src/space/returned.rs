//! Estimates in space that Python code returns.

use ::testbed::protocol::space::StatedSpatialEstimate;
use ::whisker::space::estimators::{Estimate, Knowledge};
use nalgebra::Vector3;
use pyo3::prelude::*;

use super::estimator::SpatialEstimate;
use crate::arrays::{Numbers, numbers};
use crate::error::refused;
use crate::estimate::{attribute, bad_attribute, covariance_m2};

/// Expected value of an attribute that is a unit vector.
const UNIT_VECTOR: &str = "3, a unit vector in Base";

/// Estimate that an estimator written in Python returned: `None`, a `SpatialEstimate`, or an object with the attributes `contact`
/// (3) and `covariance_m2` (3, 3) and, optionally, `normal` (3), `direction` (3) with `direction_sd_rad`, `radius_m` with
/// `radius_sd_m`, and `model_doubtful`.
pub(super) fn returned(object: &Bound<'_, PyAny>, knowledge: &Knowledge) -> PyResult<Option<Estimate>> {
    if object.is_none() {
        return Ok(None);
    }
    if let Ok(estimate) = object.cast::<SpatialEstimate>() {
        return Ok(Some(estimate.get().estimate));
    }
    let contact_m = vector(object, "contact", "3, in Base (m)")?.ok_or_else(|| {
        let found = object.repr().map_or_else(|_| "an object".into(), |text| text.to_string());
        refused("estimate", found, "None or an object with the attributes `contact` of shape [3] and `covariance_m2`")
    })?;
    let covariance_m2 = covariance_m2(object)?
        .ok_or_else(|| refused("covariance_m2", "none", "a positive definite matrix, 3 x 3, in Base (m2)"))?;
    let direction = vector(object, "direction", UNIT_VECTOR)?;
    let stated = StatedSpatialEstimate {
        contact_m,
        covariance_m2,
        normal: vector(object, "normal", UNIT_VECTOR)?,
        direction: both(object, "direction", direction, "direction_sd_rad")?,
        radius: both(object, "radius_m", number(object, "radius_m")?, "radius_sd_m")?,
        model_doubtful: attribute(object, "model_doubtful")?.map(|flag| flag.is_truthy()).transpose()?,
    };
    stated.checked(knowledge).map(Some).map_err(|bad| bad_attribute(object, &bad))
}

/// Attribute of three finite numbers. `None` if it is missing.
fn vector(object: &Bound<'_, PyAny>, name: &str, expected: &str) -> PyResult<Option<Vector3<f64>>> {
    let Some(stated) = attribute(object, name)? else { return Ok(None) };
    let stated = numbers(name, &Numbers::of(name, &stated)?)?;
    let &[x, y, z] = stated.as_slice() else {
        return Err(refused(name, format!("{} numbers", stated.len()), expected));
    };
    Ok(Some(Vector3::new(x, y, z)))
}

/// Attribute of one finite number. `None` if it is missing.
fn number(object: &Bound<'_, PyAny>, name: &str) -> PyResult<Option<f64>> {
    let Some(stated) = attribute(object, name)? else { return Ok(None) };
    let stated: f64 = stated.extract()?;
    if !stated.is_finite() {
        return Err(refused(name, stated, "a finite number"));
    }
    Ok(Some(stated))
}

/// A stated value with its standard deviation, or neither.
fn both<T>(object: &Bound<'_, PyAny>, name: &str, value: Option<T>, sd: &str) -> PyResult<Option<(T, f64)>> {
    match (value, number(object, sd)?) {
        (None, None) => Ok(None),
        (Some(value), Some(of_value)) => Ok(Some((value, of_value))),
        (Some(_), None) => Err(refused(sd, "none", &format!("a positive number beside `{name}`"))),
        (None, Some(_)) => Err(refused(name, "none", &format!("a value beside `{sd}`"))),
    }
}
