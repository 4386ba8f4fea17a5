//! Counts of a rotated sensor in the earth's magnetic field, without and with common-mode compensation.

use anyhow::Result;
use testbed::front_end::shift_counts;
use testbed::results::TurnRow;
use testbed::statistics::mean;

use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Picture};
use crate::color::Rgb;
use crate::run_data::RunData;
use crate::style::{BLUE, CURVE_PX, HAIRLINE_PX, INK, LegendEntry, VERMILION, legend, plain, two_digits};

/// Colours of the counts without and with compensation.
const UNCOMPENSATED: Rgb = VERMILION;
const COMPENSATED: Rgb = BLUE;
/// Opacity of the single counts behind their means.
const FAINT: f64 = 0.28;
/// Samples per mean: a fifth of a second.
const AVERAGED: usize = 50;
/// Most sensors in a row.
const COLUMNS: usize = 3;
/// Height of a row, of the gap between two and of the margins.
const ROW_PX: f64 = 448.0;
const GAP_PX: f64 = 76.0;
const MARGINS_PX: f64 = 112.0;

/// The counts of a row.
type Value = fn(&TurnRow) -> f64;

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let mut turns = Vec::new();
    for sensor in &data.run.front_end.sensors {
        let rows = data.turn(sensor)?.filter(|rows| !rows.is_empty());
        turns.extend(rows.map(|rows| (sensor.name.clone(), rows)));
    }
    if turns.is_empty() {
        return Ok(None);
    }
    let rows = || turns.iter().flat_map(|(_, rows)| rows);
    let counts = Axis::around("counts", rows().flat_map(|row| [row.counts, row.compensated_counts]));
    let yaw = Axis::around("yaw (°)", rows().map(|row| row.yaw_rad.to_degrees()));
    let columns = turns.len().min(COLUMNS);
    let lines = turns.len().div_ceil(columns);
    let height_px = MARGINS_PX + lines as f64 * (ROW_PX + GAP_PX) - GAP_PX;
    let paint = move |canvas: &Canvas| {
        let entries = [
            LegendEntry::line("uncompensated", UNCOMPENSATED, CURVE_PX),
            LegendEntry::line("common mode compensated", COMPENSATED, CURVE_PX),
        ];
        legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, 64.0, 16.0, 48.0]);
        let frames = plot.rows(&equal(lines), GAP_PX).into_iter().flat_map(|line| line.columns(&equal(columns), 26.0));
        for (place, ((sensor, rows), frame)) in turns.iter().zip(frames).enumerate() {
            let frames = frame.rows(&[1.0, 0.35], 36.0);
            let axis = |axis: &Axis| if place % columns == 0 { axis.clone() } else { axis.clone().bare() };
            let time = Axis::linear("time (s)", 0.0, rows[rows.len() - 1].t_s);
            let shifts = [|row: &TurnRow| row.counts, |row: &TurnRow| row.compensated_counts]
                .map(|value: Value| shift_counts(rows, value).map_or("unknown".into(), two_digits));
            let title = format!("{}: {} counts, {} compensated", plain(sensor), shifts[0], shifts[1]);
            let panel = Panel::new(canvas, frames[0], &title, time.clone().bare(), axis(&counts))?;
            let series: [(Rgb, Value); 2] =
                [(UNCOMPENSATED, |row| row.counts), (COMPENSATED, |row| row.compensated_counts)];
            for (color, value) in series {
                panel.line(rows.iter().map(|row| (row.t_s, value(row))), color.mix(FAINT), HAIRLINE_PX)?;
            }
            for (color, value) in series {
                panel.line(averaged(rows, value), color, CURVE_PX)?;
            }
            let panel = Panel::new(canvas, frames[1], "yaw of the sensor", time, axis(&yaw))?;
            panel.line(rows.iter().map(|row| (row.t_s, row.yaw_rad.to_degrees())), INK, CURVE_PX)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, height_px as u32, paint)))
}

/// Means over short intervals, each at the middle of its interval.
fn averaged(rows: &[TurnRow], value: Value) -> impl Iterator<Item = (f64, f64)> {
    rows.chunks(AVERAGED)
        .filter_map(move |chunk| Some((mean(chunk.iter().map(|row| row.t_s))?, mean(chunk.iter().map(value))?)))
}
