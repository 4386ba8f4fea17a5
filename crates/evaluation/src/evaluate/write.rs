//! Tables by instant of a trial at the first noise level and seed.

use std::path::Path;

use testbed::contour::Contour;
use testbed::metrics::Trial;
use testbed::replay::signals;
use testbed::results::files::{BOUND, ESTIMATES, EVENTS, TRACE_CONTOUR};
use testbed::results::write_rows;
use whisker::events::{DETECTORS, TouchConfig};

use super::contours::vertex_rows;
use super::job::Replayed;
use super::sense::Sensed;
use super::tables;

/// Writes the tables that are independent of the estimators: bound and contact events.
///
/// # Errors
/// If a table cannot be written.
pub(super) fn sensed(folder: &Path, sensed: &Sensed<'_>, touch: TouchConfig) -> anyhow::Result<()> {
    let trace = &sensed.trace;
    let name = &trace.sidecar.name;
    let rows = sensed.bound.into_iter().flat_map(|bound| tables::bound_rows(trace, bound));
    write_rows(&BOUND.path_of(folder, &[name]), rows)?;
    for row in DETECTORS {
        let touch = if touch.is_of(row) { touch } else { (row.config)() };
        let signals = signals(touch, &sensed.knowledge, &sensed.samples);
        let rows = tables::event_rows(trace, &sensed.readings_n_m, &signals);
        write_rows(&EVENTS.path_of(folder, &[name, row.name]), rows)?;
    }
    Ok(())
}

/// Writes the tables of one estimator: estimates and outline.
///
/// # Errors
/// If a table cannot be written.
pub(super) fn replayed(
    folder: &Path,
    trial: &Trial<'_>,
    replayed: &Replayed<'_>,
    contour: Option<&Contour>,
) -> anyhow::Result<()> {
    let values = [trial.trace.sidecar.name.as_str(), replayed.estimator];
    let rows = tables::estimate_rows(trial, &replayed.replay.estimates);
    write_rows(&ESTIMATES.path_of(folder, &values), rows)?;
    write_rows(&TRACE_CONTOUR.path_of(folder, &values), vertex_rows(contour))
}
