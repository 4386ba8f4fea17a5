//! Scenes in space: convergence of the chain and of whole scenes, and errors of the suite's traces.

use anyhow::Result;
use serde::Deserialize;

use super::data::{Data, names};
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Align, Canvas, Picture};
use crate::style::{CURVE_PX, INK, LABEL, LegendEntry, Look, MUTED, legend};

/// Arrangement of the joints that the generator uses, and one for comparison; the table also has others.
const ARRANGEMENT: &str = "alternating";
const COMPARED: &str = "same order";
/// Height of the row of one trace.
const TRACE_PX: f64 = 15.0;

/// The chain at rest with one number of segments.
#[derive(Deserialize)]
struct ChainRow {
    whisker: String,
    arrangement: String,
    segments: f64,
    moment_error: f64,
    point_error_m: f64,
}

/// Lays out the convergence of the chain.
pub(crate) fn chain(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<ChainRow> = data.table("space_chain")?;
    let whiskers = names(rows.iter().map(|row| row.whisker.as_str()));
    if whiskers.is_empty() {
        return Ok(None);
    }
    let segments = sorted(rows.iter().map(|row| row.segments));
    let lines = |arrangement: &str, error: fn(&ChainRow) -> f64| -> Vec<Vec<(f64, f64)>> {
        let of_one = |whisker: &String| {
            let found = rows.iter().filter(|row| &row.whisker == whisker && row.arrangement == arrangement);
            found.map(|row| (row.segments, error(row))).collect()
        };
        whiskers.iter().map(of_one).collect()
    };
    let moment: fn(&ChainRow) -> f64 = |row| 1e2 * row.moment_error;
    let point: fn(&ChainRow) -> f64 = |row| 1e3 * row.point_error_m;
    let panels = [
        ("base moment", "error (% of range)", lines(ARRANGEMENT, moment), lines(COMPARED, moment)),
        ("contact", "error (mm)", lines(ARRANGEMENT, point), lines(COMPARED, point)),
    ];

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> =
            whiskers.iter().enumerate().map(|(index, name)| LegendEntry::curve(name, Look::of(index))).collect();
        entries.push(LegendEntry::dashes("second order", MUTED));
        entries.push(LegendEntry::line("one order of the joints at every hinge", MUTED, CURVE_PX));
        let below = legend(canvas, (64.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [72.0, below + 40.0, 10.0, 48.0]).columns(&equal(2), 92.0);
        for ((title, label, used, other), frame) in panels.iter().zip(frames) {
            let values = used.iter().chain(other).flatten().map(|(_, error)| *error);
            let error = Axis::logarithmic(label, values);
            let panel = Panel::new(canvas, frame, title, Axis::marked("number of segments", segments.clone()), error)?;
            for line in other {
                panel.line(line.iter().copied(), MUTED, CURVE_PX)?;
            }
            if let [Some(&(first, error)), Some(&(last, _))] = [used[0].first(), used[0].last()] {
                panel.dashes((first, 0.6 * error), (last, 0.6 * error * (first / last).powi(2)), MUTED)?;
            }
            for (index, line) in used.iter().enumerate() {
                panel.line(line.iter().copied(), Look::of(index).color, CURVE_PX)?;
                panel.marks(line, Look::of(index), true)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 440, paint)))
}

/// A run of a scene beside the next finer one.
#[derive(Deserialize)]
struct SceneRow {
    scene: String,
    refined: String,
    coarse: f64,
    change_rms: f64,
}

/// Lays out the convergence of whole scenes.
pub(crate) fn scenes(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<SceneRow> = data.table("space_scenes")?;
    let scenes = names(rows.iter().map(|row| row.scene.as_str()));
    if scenes.is_empty() {
        return Ok(None);
    }
    let panel_of = |refined: &'static str, title: &'static str, label: &'static str, per_unit: f64, order: i32| {
        let lines: Vec<Vec<(f64, f64)>> = scenes
            .iter()
            .map(|scene| {
                let found = rows.iter().filter(|row| &row.scene == scene && row.refined == refined);
                found.map(|row| (per_unit * row.coarse, 1e2 * row.change_rms)).collect()
            })
            .collect();
        (title, label, lines, order)
    };
    let panels = [
        panel_of("segments", "twice the segments", "number of segments", 1.0, -2),
        panel_of("timestep_s", "half the time step", "time step (us)", 1e6, 1),
    ];

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> =
            scenes.iter().enumerate().map(|(index, name)| LegendEntry::curve(name, Look::of(index))).collect();
        entries.push(LegendEntry::dashes("left: second order; right: first order", MUTED));
        let below = legend(canvas, (64.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [72.0, below + 40.0, 10.0, 48.0]).columns(&equal(2), 92.0);
        for ((title, label, lines, order), frame) in panels.iter().zip(frames) {
            let values = sorted(lines.iter().flatten().map(|(value, _)| *value));
            let change = Axis::logarithmic(
                "change of the reading, RMS (% of range)",
                lines.iter().flatten().map(|(_, change)| *change),
            );
            let panel = Panel::new(canvas, frame, title, Axis::marked(label, values), change)?;
            if let [Some(&(first, change)), Some(&(last, _))] = [lines[0].first(), lines[0].last()] {
                panel.dashes((first, 0.7 * change), (last, 0.7 * change * (last / first).powi(*order)), MUTED)?;
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

/// Certificate of a trace.
#[derive(Deserialize)]
struct TraceRow {
    trace: String,
    whisker: String,
    moment_rms: f64,
    surface_rms_m: f64,
    normal_rms_rad: f64,
}

/// Lays out the errors of every trace of the suite.
pub(crate) fn suite(data: &Data) -> Result<Option<Picture>> {
    let rows: Vec<TraceRow> = data.table("space_suite")?;
    let whiskers = names(rows.iter().map(|row| row.whisker.as_str()));
    // A scene has one trace for each whisker; its name ends with that of the whisker.
    let scene_of = |row: &TraceRow| row.trace.trim_end_matches(&format!("_{}", row.whisker)).replace('_', " ");
    let scenes: Vec<String> = rows.iter().map(scene_of).collect();
    let scenes = names(scenes.iter().map(String::as_str));
    if scenes.is_empty() {
        return Ok(None);
    }
    let mut panels = Vec::new();
    for (id, title, label, error) in [
        (
            "space_suite_moment_rms",
            "base moment",
            "RMS (% of range)",
            (|row| 1e2 * row.moment_rms) as fn(&TraceRow) -> f64,
        ),
        ("space_suite_surface_rms_m", "surface contact", "RMS (mm)", |row| 1e3 * row.surface_rms_m),
        ("space_suite_normal_rms_rad", "normal", "RMS (degrees)", |row| row.normal_rms_rad.to_degrees()),
    ] {
        let points: Vec<Vec<(f64, f64)>> = whiskers
            .iter()
            .map(|whisker| {
                let of_whisker = rows.iter().filter(|row| &row.whisker == whisker);
                let place = |row: &TraceRow| scenes.iter().rev().position(|scene| *scene == scene_of(row)).unwrap_or(0);
                of_whisker.map(|row| (error(row), place(row) as f64)).collect()
            })
            .collect();
        panels.push((title, label, points, data.bound(id)?));
    }
    let height_px = (TRACE_PX * scenes.len() as f64 + 120.0) as u32;

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> =
            whiskers.iter().enumerate().map(|(index, name)| LegendEntry::marker(name, Look::of(index), true)).collect();
        entries.push(LegendEntry::dashes("bound", INK));
        legend(canvas, (16.0, 18.0), &entries)?;
        let frames = Rect::inside(canvas, [168.0, 68.0, 16.0, 48.0]).columns(&equal(panels.len()), 28.0);
        for (column, ((title, label, points, bound), frame)) in panels.iter().zip(frames).enumerate() {
            let values = points.iter().flatten().map(|(error, _)| *error).chain([*bound]);
            let panel = Panel::new(canvas, frame, title, Axis::logarithmic(label, values), Axis::places(scenes.len()))?;
            if column == 0 {
                for (row, name) in scenes.iter().rev().enumerate() {
                    let (_, y) = panel.at((0.01, row as f64));
                    canvas.text(name, (frame.left - 12.0, y), LABEL.aligned(Align::Right))?;
                }
            }
            panel.instant(*bound, INK)?;
            for (index, points) in points.iter().enumerate() {
                panel.marks(points, Look::of(index), true)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, height_px, paint)))
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}
