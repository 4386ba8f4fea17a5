//! Poses in space from Python.

use std::fmt::Display;

use ::trace::SpatialPose;
use ::whisker::frames::Base;
use ::whisker::space::frames::Pose;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use pyo3::prelude::*;

use crate::convert::check_position;
use crate::error::refused;

/// The pose of the base in World with this position (m) and unit quaternion (w, x, y, z).
pub(super) fn placed(what: impl Display, numbers: [f64; 7]) -> PyResult<SpatialPose> {
    let [x, y, z, qw, qx, qy, qz] = numbers;
    check_position(&what, &[x, y, z])?;
    SpatialPose::new(Vector3::new(x, y, z), Quaternion::new(qw, qx, qy, qz)).map_err(|norm| {
        let found = format!("a quaternion of norm {norm}");
        refused(&what.to_string(), found, "x, y, z (m) and a unit quaternion w, x, y, z")
    })
}

/// Motion of the base: the pose of its earlier frame in its later one.
pub(super) fn motion(numbers: [f64; 7]) -> PyResult<Pose<Base, Base>> {
    let SpatialPose { position, rotation } = placed("motion", numbers)?;
    Ok(Pose::new(position, Rotation3::from(UnitQuaternion::new_normalize(rotation.into_inner()))))
}
