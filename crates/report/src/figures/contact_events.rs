//! Contact detection: one trial with the signals, thresholds and detections of each detector.

use anyhow::Result;
use testbed::metrics::contact_events::LOST_RECALL;
use testbed::results::EventRow;
use whisker::events::DETECTORS;

use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Picture};
use crate::color::Rgb;
use crate::run_data::{RunData, spans};
use crate::style::{BLUE, DETECTED, LegendEntry, TRUE_CONTACT, VERMILION, legend, plain};

/// Colour of the reading, paler than the signal in front of it.
const PALE_READING: Rgb = Rgb(150, 158, 168);
/// Colour of the signal that a detector compares with its thresholds.
const WATCHED: Rgb = BLUE;
/// Colour of its thresholds.
const THRESHOLD: Rgb = VERMILION;
/// Height of the bars of the contacts detected and of the gap below them, relative to that of the panel.
const BAR: f64 = 0.04;

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    // A trial without a lost contact shows little. A whisker snaps off a pin and rolls off rounder objects.
    let lost = || data.trials.iter().filter(|trial| trial.get(&LOST_RECALL).is_some());
    let Some(trial) = lost().find(|trial| trial.head.object == "pin").or(lost().next()) else {
        return Ok(None);
    };
    let mut seen = Vec::new();
    for row in DETECTORS {
        seen.extend(data.events(&trial.head.trace, row.name)?.map(|rows| (row, rows)));
    }
    if seen.is_empty() {
        return Ok(None);
    }
    let trace = trial.head.trace.clone();
    let paint = move |canvas: &Canvas| {
        let entries = [
            LegendEntry::line("reading", PALE_READING, 1.75),
            LegendEntry::line("detection signal", WATCHED, 1.75),
            LegendEntry::line("thresholds", THRESHOLD, 1.75),
            LegendEntry::line("contact detected", DETECTED, 6.0),
            LegendEntry::bands("true contact", vec![TRUE_CONTACT]),
        ];
        legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, 64.0, 16.0, 48.0]);
        let last = seen.len() - 1;
        for (place, ((detector, rows), frame)) in seen.iter().zip(plot.rows(&equal(seen.len()), 40.0)).enumerate() {
            let title = format!("{}, {}: {}", plain(&trace), detector.name, detector.about);
            paint_detector(canvas, frame, &title, rows, place == last)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 760, paint)))
}

fn paint_detector(canvas: &Canvas, frame: Rect, title: &str, rows: &[EventRow], is_last: bool) -> Result<()> {
    let micro = |value_n_m: f64| 1e6 * value_n_m;
    let end_s = rows[rows.len() - 1].t_s;
    let largest = rows.iter().map(|row| micro(row.reading_n_m.abs())).fold(0.0, f64::max);
    let top = 1.2 * largest;
    let time = Axis::linear("time (s)", 0.0, end_s);
    let time = if is_last { time } else { time.bare() };
    let panel = Panel::new(canvas, frame, title, time, Axis::linear("reading (µN·m)", -top, top))?;
    for (from_s, to_s) in spans(rows, |row| row.t_s, |row| row.truth_touching == Some(true)) {
        panel.area([(from_s, -top), (to_s, -top), (to_s, top), (from_s, top)], TRUE_CONTACT)?;
    }
    let (bar_top, bar_bottom) = (top * (1.0 - 2.0 * BAR), top * (1.0 - 4.0 * BAR));
    for (from_s, to_s) in spans(rows, |row| row.t_s, |row| row.touched) {
        let corners = [(from_s, bar_bottom), (to_s, bar_bottom), (to_s, bar_top), (from_s, bar_top)];
        panel.area(corners, DETECTED)?;
    }
    panel.line(rows.iter().map(|row| (row.t_s, micro(row.reading_n_m))), PALE_READING, 1.0)?;
    for sign in [1.0, -1.0] {
        panel.line(rows.iter().map(|row| (row.t_s, sign * micro(row.threshold_n_m))), THRESHOLD, 1.0)?;
    }
    panel.line(rows.iter().map(|row| (row.t_s, micro(row.watched_n_m))), WATCHED, 1.5)?;
    Ok(())
}
