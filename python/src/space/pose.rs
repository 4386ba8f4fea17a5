//! Poses in space from Python.

use ::whisker::space::frames::Pose;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use pyo3::prelude::*;

use crate::error::refused;

/// Largest deviation of the norm of a quaternion from 1, as in a trace.
const NORM_TOLERANCE: f64 = 1e-6;

/// The pose with this position (m) and unit quaternion (w, x, y, z).
pub(super) fn pose<From, To>(what: &str, numbers: [f64; 7]) -> PyResult<Pose<From, To>> {
    let [x, y, z, qw, qx, qy, qz] = numbers;
    if !numbers.iter().all(|number| number.is_finite()) {
        return Err(refused(what, format!("{numbers:?}"), "finite numbers"));
    }
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    if (quaternion.norm() - 1.0).abs() > NORM_TOLERANCE {
        let found = format!("a quaternion of norm {}", quaternion.norm());
        return Err(refused(what, found, "x, y, z (m) and a unit quaternion w, x, y, z"));
    }
    let rotation = Rotation3::from(UnitQuaternion::new_normalize(quaternion));
    Ok(Pose::new(Vector3::new(x, y, z), rotation))
}
