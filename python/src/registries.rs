//! Registries as lists of dictionaries.

use ::whisker::estimators::ESTIMATORS;
use ::whisker::events::DETECTORS;
use ::whisker::sensor::MODELS;
use pyo3::prelude::*;
use serde_json::{Value, json};
use testbed::front_end::{FRONT_ENDS, SPATIAL_FRONT_ENDS};
use testbed::metrics::METRICS;

use crate::convert::from_json;

/// Registered estimators: `name`, `about`, `class`, the `sensor_model` that it requires, and default `settings`.
#[pyfunction]
pub(crate) fn estimators(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = ESTIMATORS.iter().map(|row| {
        json!({
            "name": row.name,
            "about": row.about,
            "class": row.class,
            "sensor_model": row.sensor_model,
            "settings": (row.defaults)(),
        })
    });
    from_json(py, &rows.collect::<Vec<Value>>())
}

/// Registered sensor models: `name`, `about` and default `settings`.
#[pyfunction]
pub(crate) fn sensor_models(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = MODELS.iter().map(|row| json!({"name": row.kind, "about": row.about, "settings": (row.defaults)()}));
    from_json(py, &rows.collect::<Vec<Value>>())
}

/// Registered contact detectors: `name`, `about` and default `settings`.
#[pyfunction]
pub(crate) fn detectors(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = DETECTORS.iter().map(|row| json!({"name": row.name, "about": row.about, "settings": (row.config)()}));
    from_json(py, &rows.collect::<Vec<Value>>())
}

/// Registered front ends: `name`, `about`, default `noise` as a fraction of the largest reading, and default `settings`.
#[pyfunction]
pub(crate) fn front_ends(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = FRONT_ENDS
        .iter()
        .map(|row| json!({"name": row.name, "about": row.about, "noise": row.noise, "settings": (row.defaults)()}));
    from_json(py, &rows.collect::<Vec<Value>>())
}

/// Registered front ends of traces in space: `name`, `about`, default `noise` as a fraction of the largest moment, and default
/// `settings`.
#[pyfunction]
pub(crate) fn spatial_front_ends(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = SPATIAL_FRONT_ENDS
        .iter()
        .map(|row| json!({"name": row.name, "about": row.about, "noise": row.noise, "settings": (row.defaults)()}));
    from_json(py, &rows.collect::<Vec<Value>>())
}

/// Registered metrics: `name`, with its unit, and `about`.
#[pyfunction]
pub(crate) fn metrics(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let rows = METRICS.iter().map(|metric| json!({"name": metric.name, "about": metric.about}));
    from_json(py, &rows.collect::<Vec<Value>>())
}
