//! Dynamic part of the reading at several speeds of the base.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Canvas, Picture};
use crate::style::{CURVE_PX, INK, LegendEntry, Look, legend};

/// A stroke at one speed.
#[derive(Deserialize)]
struct Row {
    case: String,
    speed_m_s: f64,
    first_rms: f64,
    settled_rms: f64,
}

/// A line a case: (speed in mm/s, dynamic part in per cent of the range).
type Lines = Vec<Vec<(f64, f64)>>;

/// Lays the figure out.
pub(crate) fn draw(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<Row> = data.table("speeds")?;
    let cases = names(rows.iter().map(|row| row.case.as_str()));
    if cases.is_empty() {
        return Ok(None);
    }
    let mut speeds: Vec<f64> = rows.iter().map(|row| 1e3 * row.speed_m_s).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.dedup();
    let bounds: Vec<(f64, f64)> = speeds
        .iter()
        .map(|speed| Ok((*speed, data.bound(&format!("dynamic_{}", speed.round()))?)))
        .collect::<Result<_>>()?;
    let lines = |share: fn(&Row) -> f64| -> Lines {
        let of_case = |case: &String| {
            rows.iter().filter(|row| &row.case == case).map(|row| (1e3 * row.speed_m_s, 1e2 * share(row))).collect()
        };
        cases.iter().map(of_case).collect()
    };
    let panels = [("first 0.1 s of contact", lines(|row| row.first_rms)), ("settled", lines(|row| row.settled_rms))];
    let values = panels.iter().flat_map(|(_, lines)| lines.iter().flatten()).chain(&bounds).map(|(_, share)| *share);
    let share = Axis::logarithmic("dynamic part, RMS (% of range)", values);

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> =
            cases.iter().enumerate().map(|(index, case)| LegendEntry::curve(case, Look::of(index))).collect();
        entries.push(LegendEntry::line("bound", INK, CURVE_PX));
        legend(canvas, (64.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [72.0, 68.0, 10.0, 48.0]).columns(&equal(panels.len()), 28.0);
        for (column, ((title, lines), frame)) in panels.iter().zip(frames).enumerate() {
            let share = if column == 0 { share.clone() } else { share.clone().bare() };
            let speed = Axis::marked("largest speed of the base (mm/s)", speeds.clone());
            let panel = Panel::new(canvas, frame, title, speed, share)?;
            if column == 1 {
                for &(speed, bound) in &bounds {
                    panel.line([(0.9 * speed, bound), (speed / 0.9, bound)], INK, CURVE_PX)?;
                }
            }
            for (index, line) in lines.iter().enumerate() {
                panel.line(line.iter().copied(), Look::of(index).color, CURVE_PX)?;
                panel.marks(line, Look::of(index), true)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 440, paint)))
}
