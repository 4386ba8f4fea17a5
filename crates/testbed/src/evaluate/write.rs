//! Tables by instant of a trial at the first noise level and seed.

use std::path::Path;

use files::write_atomically;
use whisker::events::{DETECTORS, TouchConfig};

use super::contours::vertex_rows;
use super::job::Replayed;
use super::sense::Sensed;
use super::tables;
use crate::contour::Contour;
use crate::metrics::Trial;
use crate::replay::signals;
use crate::results::csv_bytes;
use crate::results::files::{BOUND, ESTIMATES, EVENTS, TRACE_CONTOUR};

/// Writes the tables that are independent of the estimators: bound and contact events.
///
/// # Errors
/// If a table cannot be written.
pub(super) fn sensed(folder: &Path, sensed: &Sensed<'_>, touch: TouchConfig) -> anyhow::Result<()> {
    let trace = &sensed.trace;
    let name = &trace.sidecar.name;
    let rows = sensed.bound.map_or_else(Vec::new, |bound| tables::bound_rows(trace, bound));
    write_atomically(&BOUND.path_of(folder, &[name]), &csv_bytes(&rows)?)?;
    for row in DETECTORS {
        let touch = if touch.is_of(row) { touch } else { (row.config)() };
        let signals = signals(touch, &sensed.knowledge, &sensed.samples);
        let rows = tables::event_rows(trace, &sensed.readings_n_m, &signals);
        write_atomically(&EVENTS.path_of(folder, &[name, row.name]), &csv_bytes(&rows)?)?;
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
    write_atomically(&ESTIMATES.path_of(folder, &values), &csv_bytes(&rows)?)?;
    write_atomically(&TRACE_CONTOUR.path_of(folder, &values), &csv_bytes(&vertex_rows(contour))?)?;
    Ok(())
}
