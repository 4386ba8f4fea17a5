//! Sensitivity of the reading to time step and number of segments.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use crate::axes::{Axis, Panel, Rect};
use crate::canvas::{Align, Canvas, Picture};
use crate::style::{INK, LABEL, LegendEntry, Look, legend};

/// One stroke beside the same with the defaults.
#[derive(Deserialize)]
struct Row {
    case: String,
    segments: u32,
    timestep_s: f64,
    change_worst: f64,
}

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("steps")?;
    let cases = names(rows.iter().map(|row| row.case.as_str()));
    // Rows of the defaults have a change of zero.
    let changed: Vec<&Row> = rows.iter().filter(|row| row.change_worst > 0.0).collect();
    let variant = |row: &Row| format!("{} segments, {} ms", row.segments, 1e3 * row.timestep_s);
    let variants: Vec<String> = changed.iter().map(|row| variant(row)).collect();
    let variants = names(variants.iter().map(String::as_str));
    if variants.is_empty() {
        return Ok(None);
    }
    let points: Vec<Vec<(f64, f64)>> = cases
        .iter()
        .map(|case| {
            let of_case = changed.iter().filter(|row| &row.case == case);
            let place = |row: &Row| variants.iter().rev().position(|name| *name == variant(row)).unwrap_or(0);
            of_case.map(|row| (1e2 * row.change_worst, place(row) as f64)).collect()
        })
        .collect();
    let bound = data.bound("step_halved")?;
    let change = Axis::linear("largest change of the reading (% of range)", 0.0, {
        1.1 * points.iter().flatten().map(|(change, _)| *change).fold(bound, f64::max)
    });

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> =
            cases.iter().enumerate().map(|(index, case)| LegendEntry::marker(case, Look::of(index), true)).collect();
        entries.push(LegendEntry::dashes("bound", INK));
        legend(canvas, (16.0, 18.0), &entries)?;
        let frame = Rect::inside(canvas, [168.0, 44.0, 16.0, 48.0]);
        let panel = Panel::new(canvas, frame, "", change.clone(), Axis::places(variants.len()))?;
        for (row, name) in variants.iter().rev().enumerate() {
            let (_, y) = panel.at((0.0, row as f64));
            canvas.text(name, (frame.left - 12.0, y), LABEL.aligned(Align::Right))?;
        }
        panel.instant(bound, INK)?;
        for (index, points) in points.iter().enumerate() {
            panel.marks(points, Look::of(index), true)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(900, 250, paint)))
}
