//! Native part of the Python package `whisker_contact`: classes and functions over the crates `whisker`, `trace` and `testbed`.
//!
//! The doc comments of the items exported to Python are their docstrings: shapes in brackets, SI units, the unit as the end
//! of a name. Arrays of numbers are accepted as anything that NumPy converts to `float64` and are returned as NumPy arrays.
//! Long calls release the interpreter lock and check for signals (`interrupt`); every error is a Python exception with the
//! message of the Rust error (`error`).

mod arrays;
mod calibration;
mod convert;
mod dataset;
mod elastica;
mod error;
mod estimate;
mod estimator;
mod interrupt;
mod map;
mod outline;
mod registries;
mod replay;
mod sampling;
mod sensor;
mod shape;
mod simulate;
mod space;
mod tables;
mod trace;
mod trial;
mod whisker;

use pyo3::prelude::*;

/// Whisker mechanics, sensor models and contact estimators.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::calibration::{Calibration, Prediction, fit_calibration, load_calibration};
    #[pymodule_export]
    use crate::dataset::{Dataset, Recording};
    #[pymodule_export]
    use crate::elastica::{Contacts, deflect, press};
    #[pymodule_export]
    use crate::estimate::Estimate;
    #[pymodule_export]
    use crate::estimator::Estimator;
    #[pymodule_export]
    use crate::map::{MappedObject, SceneMap, scene_map};
    #[pymodule_export]
    use crate::outline::Outline;
    #[pymodule_export]
    use crate::registries::{detectors, estimators, front_ends, metrics, sensor_models, spatial_front_ends};
    #[pymodule_export]
    use crate::replay::Replay;
    #[pymodule_export]
    use crate::sensor::Sensor;
    #[pymodule_export]
    use crate::shape::Shape;
    #[pymodule_export]
    use crate::simulate::simulate;
    #[pymodule_export]
    use crate::space::{
        BendingSensor, Rod, SpatialCalibration, SpatialContacts, SpatialEstimate, SpatialEstimator, SpatialPrediction,
        SpatialReplay, SpatialSurface, SpatialTrace, SpatialTrial, fit_spatial_calibration, load_spatial_calibration,
        spatial_cramer_rao_bound, spatial_estimators,
    };
    #[pymodule_export]
    use crate::tables::{check_run, check_table};
    #[pymodule_export]
    use crate::trace::Trace;
    #[pymodule_export]
    use crate::trial::{Trial, cramer_rao_bound};
    #[pymodule_export]
    use crate::whisker::Whisker;
}
