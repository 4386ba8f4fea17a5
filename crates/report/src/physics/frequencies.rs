//! Error of the natural frequencies against the number of segments.

use anyhow::Result;
use serde::Deserialize;

use super::data::Data;
use super::panels::{Lines, falling_errors, falling_legend};
use crate::axes::{Axis, Panel, Rect};
use crate::canvas::{Canvas, Picture};

/// One natural frequency of one chain.
#[derive(Deserialize)]
struct Row {
    segments: f64,
    mode: usize,
    beam_hz: f64,
    error: f64,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("frequencies")?;
    let mut modes: Vec<(usize, f64)> = rows.iter().map(|row| (row.mode, row.beam_hz)).collect();
    modes.sort_by_key(|mode| mode.0);
    modes.dedup_by_key(|mode| mode.0);
    if modes.is_empty() {
        return Ok(None);
    }
    let names: Vec<String> = modes.iter().map(|(mode, hz)| format!("mode {mode}, {hz:.1} Hz")).collect();
    let lines: Lines = modes
        .iter()
        .map(|(mode, _)| {
            let of_mode = rows.iter().filter(|row| row.mode == *mode);
            of_mode.map(|row| (row.segments, 1e2 * row.error.abs())).collect()
        })
        .collect();
    let bound = data.bound("frequency_1")?;
    let segments: Vec<f64> = rows.iter().map(|row| row.segments).collect();
    let errors = lines.iter().flatten().map(|(_, error)| *error).chain([bound]);
    let error = Axis::logarithmic("error of the frequency (%)", errors);

    let paint = move |canvas: &Canvas| {
        falling_legend(canvas, (64.0, 18.0), &names)?;
        let frame = Rect::inside(canvas, [72.0, 44.0, 16.0, 48.0]);
        let chains = Axis::marked("number of segments", segments.clone());
        let panel = Panel::new(canvas, frame, "", chains, error.clone())?;
        falling_errors(&panel, &lines, Some(bound))
    };
    Ok(Some(Picture::new(900, 420, paint)))
}
