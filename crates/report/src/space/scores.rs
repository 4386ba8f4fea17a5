//! Scores of every group of trials, as rows of markers.

use anyhow::Result;
use testbed::space::rows::SpatialSummaryRow;

use super::Data;
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Align, Canvas, Picture};
use crate::style::{INK, LABEL, LegendEntry, Look, MARKER_PX, MUTED, legend, plain};

/// Height of the row of one group.
const GROUP_PX: f64 = 30.0;

/// Smallest height of a picture.
const LEAST_PX: f64 = 300.0;

/// Smallest distance of the panels from the left border, which holds the names of the groups.
const LEAST_LEFT_PX: f64 = 110.0;

/// Distance of the name of a group from its panel, and its smallest distance from the border of the figure.
const NAME_GAP_PX: f64 = 12.0;

/// Share of the height of a row over which the markers of the estimators are spread.
const SPREAD: f64 = 0.6;

/// A score that a panel shows.
struct Score {
    title: &'static str,
    axis: fn(&str, Vec<f64>) -> Axis,
    label: &'static str,
    value: fn(&SpatialSummaryRow) -> Option<f64>,
}

/// A limit beside a score.
struct Limit {
    name: &'static str,
    value: fn(&SpatialSummaryRow) -> Option<f64>,
}

/// Lays out the errors of the contact beside their bound.
pub(crate) fn errors(data: &Data) -> Result<Option<Picture>> {
    let score = Score {
        title: "contact",
        axis: |label, values| Axis::logarithmic(label, values),
        label: "RMS error (mm)",
        value: |row| row.rmse_m.map(|error_m| 1e3 * error_m),
    };
    let limit = Limit { name: "posterior Cramér–Rao bound", value: |row| row.bound_m.map(|bound_m| 1e3 * bound_m) };
    picture(data, score, limit)
}

/// Lays out the distances of the estimated surface from the true solid.
pub(crate) fn surfaces(data: &Data) -> Result<Option<Picture>> {
    let score = Score {
        title: "surface",
        axis: |label, values| Axis::logarithmic(label, values),
        label: "mean distance from the true solid (mm)",
        value: |row| row.surface_m.map(|distance_m| 1e3 * distance_m),
    };
    picture(data, score, Limit { name: "", value: |_| None })
}

/// Lays out the coverage of the ellipsoids.
pub(crate) fn coverage(data: &Data) -> Result<Option<Picture>> {
    let score = Score {
        title: "95 % ellipsoids",
        axis: |label, _| Axis::linear(label, 0.0, 100.0),
        label: "instants at which the ellipsoid contains the true contact (%)",
        value: |row| row.coverage.map(|share| 100.0 * share),
    };
    picture(data, score, Limit { name: "95 %", value: |_| Some(95.0) })
}

/// Lays out the errors of the normal.
pub(crate) fn normals(data: &Data) -> Result<Option<Picture>> {
    angles(data, "normal", "RMS angle to the true normal (degrees)", |row| row.normal_rad.map(f64::to_degrees))
}

/// Lays out the errors of the direction of edges and rods.
pub(crate) fn directions(data: &Data) -> Result<Option<Picture>> {
    let value = |row: &SpatialSummaryRow| row.direction_rad.map(f64::to_degrees);
    angles(data, "edge or rod", "RMS angle to the true direction (degrees)", value)
}

fn angles(
    data: &Data,
    title: &'static str,
    label: &'static str,
    value: fn(&SpatialSummaryRow) -> Option<f64>,
) -> Result<Option<Picture>> {
    let score = Score { title, axis: |label, values| Axis::logarithmic(label, values), label, value };
    picture(data, score, Limit { name: "", value: |_| None })
}

/// A panel for each whisker, a row for each group with the score, a marker for each estimator.
fn picture(data: &Data, score: Score, limit: Limit) -> Result<Option<Picture>> {
    let shown = |group: &&str| data.summary.iter().any(|row| row.group == **group && (score.value)(row).is_some());
    let groups: Vec<&str> = data.groups().into_iter().filter(shown).collect();
    if groups.is_empty() {
        return Ok(None);
    }
    let estimators: Vec<String> = data.estimators().into_iter().map(Into::into).collect();
    let mut values = Vec::new();
    let mut panels = Vec::new();
    for whisker in data.whiskers() {
        let (mut marks, mut limits) = (vec![Vec::new(); estimators.len()], Vec::new());
        for (from_top, group) in groups.iter().enumerate() {
            let row = (groups.len() - 1 - from_top) as f64;
            for scores in data.scores(group, whisker) {
                let Some(index) = estimators.iter().position(|name| *name == scores.estimator) else { continue };
                if let Some(value) = (score.value)(scores) {
                    let shift = SPREAD * (0.5 - (index as f64 + 0.5) / estimators.len() as f64);
                    marks[index].push((value, row + shift));
                    values.push(value);
                    limits.extend((limit.value)(scores).map(|value| (row, value)));
                }
            }
        }
        limits.dedup_by(|a, b| a.0 == b.0);
        values.extend(limits.iter().map(|(_, value)| *value));
        panels.push((format!("{whisker} whisker: {}", score.title), marks, limits));
    }
    let axis = (score.axis)(score.label, values);
    let groups: Vec<String> = groups.into_iter().map(plain).collect();
    let height_px = (GROUP_PX * groups.len() as f64 + 130.0).max(LEAST_PX);

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> = estimators
            .iter()
            .enumerate()
            .map(|(index, name)| LegendEntry::marker(name, Look::of(index), true))
            .collect();
        if !limit.name.is_empty() {
            entries.push(LegendEntry::line(limit.name, INK, 2.0));
        }
        let below = legend(canvas, (16.0, 18.0), &entries)?;
        let widest_px = groups.iter().map(|name| canvas.text_width_px(name, LABEL)).fold(0.0, f64::max);
        let left_px = LEAST_LEFT_PX.max(widest_px + 2.0 * NAME_GAP_PX);
        let frames = Rect::inside(canvas, [left_px, below + 44.0, 18.0, 48.0]).columns(&equal(panels.len()), 28.0);
        for (column, ((title, marks, limits), frame)) in panels.iter().zip(frames).enumerate() {
            let panel = Panel::new(canvas, frame, title, axis.clone(), Axis::places(groups.len()))?;
            for (row, name) in groups.iter().rev().enumerate() {
                let (_, y) = panel.at((1.0, row as f64));
                if column == 0 {
                    canvas.text(name, (frame.left - NAME_GAP_PX, y + 4.0), LABEL.aligned(Align::Right))?;
                }
                if row > 0 {
                    let (_, border) = panel.at((1.0, row as f64 - 0.5));
                    canvas.line(&[(frame.left, border), (frame.right, border)], MUTED.mix(0.25), 1.0)?;
                }
            }
            for (row, limit) in limits {
                let ends = [0.5 * SPREAD, -0.5 * SPREAD].map(|shift| panel.at((*limit, row + shift)));
                canvas.line(&ends, INK, 2.0)?;
            }
            for (index, points) in marks.iter().enumerate() {
                for point in points {
                    Look::of(index).mark(canvas, panel.at(*point), MARKER_PX, true)?;
                }
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, height_px as u32, paint)))
}
