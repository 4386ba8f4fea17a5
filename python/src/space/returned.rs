//! Estimates in space that Python code returns.

use ::trace::FARTHEST_M;
use ::whisker::space::estimators::{Direction, Estimate, Knowledge, Radius};
use ::whisker::space::frames::Point;
use nalgebra::{Matrix3, Vector3};
use pyo3::prelude::*;

use super::estimator::SpatialEstimate;
use crate::arrays::{Numbers, numbers, rows};
use crate::error::refused;
use crate::estimate::attribute;

/// Largest relative difference of a stated unit vector's length from 1.
const UNIT: f64 = 1e-3;

/// Largest difference of two entries of a covariance that are equal but for rounding, relative to the largest variance.
const SYMMETRIC: f64 = 1e-9;

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
    let calibrated = &*knowledge.calibrated;
    let contact_m = vector(object, "contact", "3, in Base (m)")?.ok_or_else(|| {
        let found = object.repr().map_or_else(|_| "an object".into(), |text| text.to_string());
        refused("estimate", found, "None or an object with the attributes `contact` of shape [3] and `covariance_m2`")
    })?;
    if contact_m.amax() > FARTHEST_M {
        let expected = format!("a point within {FARTHEST_M} m of the base, in Base");
        return Err(refused("contact", format!("{:?}", contact_m.as_slice()), &expected));
    }
    let contact = Point::from_vector(contact_m);
    let at = calibrated.around(contact);
    let direction = unit(object, "direction")?;
    let direction = both(object, "direction", direction, "direction_sd_rad")?;
    let radius = both(object, "radius_m", number(object, "radius_m")?, "radius_sd_m")?;
    if let Some((radius_m, _)) = radius.filter(|(radius_m, _)| *radius_m < 0.0) {
        return Err(refused("radius_m", radius_m, "a number of 0 or more"));
    }
    Ok(Some(Estimate {
        contact,
        covariance_m2: covariance(object)?,
        normal: unit(object, "normal")?.unwrap_or_else(|| calibrated.normal(at)),
        normal_covariance: Matrix3::zeros(),
        direction: direction.map(|(along, sd_rad)| Direction { along, sd_rad }),
        radius: radius.map(|(radius_m, sd_m)| Radius { radius_m, sd_m }),
        calibrated: calibrated.domain.contains(at),
        innovation: None,
        models: None,
        model_doubtful: attribute(object, "model_doubtful")?.map(|flag| flag.is_truthy()).transpose()?,
    }))
}

fn covariance(object: &Bound<'_, PyAny>) -> PyResult<Matrix3<f64>> {
    let expected = "a positive definite matrix, 3 x 3, in Base (m2)";
    let stated = attribute(object, "covariance_m2")?.ok_or_else(|| refused("covariance_m2", "none", expected))?;
    let stated: Vec<[f64; 3]> = rows("covariance_m2", &Numbers::of("covariance_m2", &stated)?)?;
    if let [x, y, z] = stated[..] {
        let matrix = Matrix3::from_rows(&[x.into(), y.into(), z.into()]);
        let is_symmetric = (matrix - matrix.transpose()).amax() <= SYMMETRIC * matrix.diagonal().amax();
        if is_symmetric && matrix.cholesky().is_some() {
            return Ok(0.5 * (matrix + matrix.transpose()));
        }
    }
    Err(refused("covariance_m2", format!("{stated:?}"), expected))
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

/// Attribute of a unit vector, which is normalised. `None` if it is missing.
fn unit(object: &Bound<'_, PyAny>, name: &str) -> PyResult<Option<Vector3<f64>>> {
    let Some(vector) = vector(object, name, "3, a unit vector in Base")? else { return Ok(None) };
    if (vector.norm() - 1.0).abs() > UNIT {
        return Err(refused(
            name,
            format!("{:?} of length {}", vector.as_slice(), vector.norm()),
            "a unit vector in Base",
        ));
    }
    Ok(Some(vector.normalize()))
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
        (Some(value), Some(of_value)) if of_value > 0.0 => Ok(Some((value, of_value))),
        (Some(_), Some(of_value)) => Err(refused(sd, of_value, "a positive number")),
        (Some(_), None) => Err(refused(sd, "none", &format!("a positive number beside `{name}`"))),
        (None, Some(_)) => Err(refused(name, "none", &format!("a value beside `{sd}`"))),
    }
}
