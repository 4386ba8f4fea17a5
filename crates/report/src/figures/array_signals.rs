//! The readings of all whiskers of a recording, on its clock.

use anyhow::Result;

use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::run_data::{RunData, spans};
use crate::style::{DETECTED, LegendEntry, READING, TRUE_CONTACT, legend, plain};

/// Margin below the readings relative to their range; above them it is twice as large, for the bars of the contacts detected.
const SPARE: f64 = 0.1;
/// Height of a panel and of the gap between two.
const PANEL_PX: f64 = 100.0;
const GAP_PX: f64 = 30.0;

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let recordings = &data.run.recordings;
    let exact = recordings.iter().find(|recording| recording.encoders.are_perfect());
    let (Some(recording), Some(estimator)) = (exact.or(recordings.first()), data.filters().next()) else {
        return Ok(None);
    };
    let mut signals = Vec::new();
    for whisker in &recording.whiskers {
        let rows = data.estimates(&whisker.trace, estimator)?;
        signals.extend(rows.filter(|rows| !rows.is_empty()).map(|rows| (plain(&whisker.name), rows)));
    }
    if signals.is_empty() {
        return Ok(None);
    }
    let height_px = 64.0 + 48.0 + signals.len() as f64 * (PANEL_PX + GAP_PX) - GAP_PX;
    let note = format!("Detections: {estimator}.");
    let paint = move |canvas: &Canvas| {
        let entries = [
            LegendEntry::line("reading", READING, 1.5),
            LegendEntry::line("contact detected", DETECTED, 6.0),
            LegendEntry::bands("true contact", vec![TRUE_CONTACT]),
        ];
        legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, 64.0, 16.0, 48.0]);
        let all = signals.iter().flat_map(|(_, rows)| rows);
        let (low, high) = extent(all.map(|row| 1e6 * row.reading_n_m)).unwrap_or((-1.0, 1.0));
        let spare = SPARE * (high - low);
        let (bottom, top) = (low - spare, high + 2.0 * spare);
        let last = signals.len() - 1;
        for (place, ((title, rows), frame)) in signals.iter().zip(plot.rows(&equal(signals.len()), GAP_PX)).enumerate()
        {
            let time = Axis::linear("time (s)", 0.0, rows[rows.len() - 1].t_s);
            let time = if place == last { time } else { time.bare() };
            let name = if 2 * place == last || 2 * place + 1 == last { "reading (µN·m)" } else { "" };
            let panel = Panel::new(canvas, frame, title, time, Axis::linear(name, bottom, top))?;
            for (from_s, to_s) in spans(rows, |row| row.t_s, |row| row.truth_surface_x_m.is_some()) {
                panel.area([(from_s, bottom), (to_s, bottom), (to_s, top), (from_s, top)], TRUE_CONTACT)?;
            }
            let (bar_top, bar_bottom) = (top - 0.4 * spare, top - 1.3 * spare);
            for (from_s, to_s) in spans(rows, |row| row.t_s, |row| row.contact_x_m.is_some()) {
                let corners = [(from_s, bar_bottom), (to_s, bar_bottom), (to_s, bar_top), (from_s, bar_top)];
                panel.area(corners, DETECTED)?;
            }
            panel.line(rows.iter().map(|row| (row.t_s, 1e6 * row.reading_n_m)), READING, 1.0)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, height_px as u32, paint).noted(note)))
}
