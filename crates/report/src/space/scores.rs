//! Scores of every group of trials, as rows of markers, or of many groups as distributions.

use anyhow::Result;
use testbed::space::rows::SpatialSummaryRow;

use super::Data;
use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Align, Canvas, Picture};
use crate::style::{CURVE_PX, INK, LABEL, LegendEntry, Look, MARKER_PX, MUTED, legend, plain};

/// Largest number of groups that have a row each.
pub(super) const MOST_ROWS: usize = 24;

/// Height of the row of one group.
const GROUP_PX: f64 = 30.0;

/// Height of a picture with distributions.
const DISTRIBUTION_PX: u32 = 420;

/// Width of the line of a limit.
const LIMIT_PX: f64 = 2.0;

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

/// The scores of all groups with one whisker, which a panel shows.
struct PanelScores {
    title: String,
    /// For each estimator, the number of a group, counted from the last one, and its score.
    of_estimators: Vec<Vec<(usize, f64)>>,
    /// The same for the limit.
    limits: Vec<(usize, f64)>,
}

/// A panel for each whisker: rows of markers, or distributions if there are many groups.
fn picture(data: &Data, score: Score, limit: Limit) -> Result<Option<Picture>> {
    let shown = |group: &&str| data.summary.iter().any(|row| row.group == **group && (score.value)(row).is_some());
    let groups: Vec<&str> = data.groups().into_iter().filter(shown).collect();
    if groups.is_empty() {
        return Ok(None);
    }
    let estimators: Vec<String> = data.estimators().into_iter().map(Into::into).collect();
    let mut panels = Vec::new();
    for whisker in data.whiskers() {
        let (mut of_estimators, mut limits) = (vec![Vec::new(); estimators.len()], Vec::new());
        for (number, group) in groups.iter().rev().enumerate() {
            for scores in data.scores(group, whisker) {
                let Some(index) = estimators.iter().position(|name| *name == scores.estimator) else { continue };
                if let Some(value) = (score.value)(scores) {
                    of_estimators[index].push((number, value));
                    limits.extend((limit.value)(scores).map(|value| (number, value)));
                }
            }
        }
        limits.dedup_by(|a, b| a.0 == b.0);
        panels.push(PanelScores { title: format!("{whisker} whisker: {}", score.title), of_estimators, limits });
    }
    let all = panels.iter().flat_map(|panel| panel.of_estimators.iter().flatten().chain(&panel.limits));
    let axis = (score.axis)(score.label, all.map(|(_, value)| *value).collect());
    let groups: Vec<String> = groups.into_iter().map(plain).collect();
    Ok(Some(if groups.len() > MOST_ROWS {
        distributions(panels, axis, estimators, limit.name, groups.len())
    } else {
        rows(panels, axis, estimators, limit.name, groups)
    }))
}

/// The legend of estimators and limit. Returns its lower border.
fn paint_legend(canvas: &Canvas, estimators: &[String], limit: &str) -> Result<f64> {
    let mut entries: Vec<_> =
        estimators.iter().enumerate().map(|(index, name)| LegendEntry::marker(name, Look::of(index), true)).collect();
    if !limit.is_empty() {
        entries.push(LegendEntry::line(limit, INK, LIMIT_PX));
    }
    legend(canvas, (16.0, 18.0), &entries)
}

/// A row for each group, with a marker for each estimator.
fn rows(
    panels: Vec<PanelScores>,
    axis: Axis,
    estimators: Vec<String>,
    limit: &'static str,
    groups: Vec<String>,
) -> Picture {
    let height_px = (GROUP_PX * groups.len() as f64 + 130.0).max(LEAST_PX);
    let paint = move |canvas: &Canvas| {
        let below = paint_legend(canvas, &estimators, limit)?;
        let widest_px = groups.iter().map(|name| canvas.text_width_px(name, LABEL)).fold(0.0, f64::max);
        let left_px = LEAST_LEFT_PX.max(widest_px + 2.0 * NAME_GAP_PX);
        let frames = Rect::inside(canvas, [left_px, below + 44.0, 18.0, 48.0]).columns(&equal(panels.len()), 28.0);
        for (column, (scores, frame)) in panels.iter().zip(frames).enumerate() {
            let panel = Panel::new(canvas, frame, &scores.title, axis.clone(), Axis::places(groups.len()))?;
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
            for (row, limit) in &scores.limits {
                let ends = [0.5 * SPREAD, -0.5 * SPREAD].map(|shift| panel.at((*limit, *row as f64 + shift)));
                canvas.line(&ends, INK, LIMIT_PX)?;
            }
            for (index, of_groups) in scores.of_estimators.iter().enumerate() {
                let shift = SPREAD * (0.5 - (index as f64 + 0.5) / estimators.len() as f64);
                for (row, value) in of_groups {
                    Look::of(index).mark(canvas, panel.at((*value, *row as f64 + shift)), MARKER_PX, true)?;
                }
            }
        }
        Ok(())
    };
    Picture::new(1200, height_px as u32, paint)
}

/// The share of the groups with at most each value.
fn distributions(
    panels: Vec<PanelScores>,
    axis: Axis,
    estimators: Vec<String>,
    limit: &'static str,
    groups: usize,
) -> Picture {
    let paint = move |canvas: &Canvas| {
        let below = paint_legend(canvas, &estimators, limit)?;
        let frames = Rect::inside(canvas, [64.0, below + 44.0, 18.0, 48.0]).columns(&equal(panels.len()), 64.0);
        for (scores, frame) in panels.iter().zip(frames) {
            let shares = Axis::linear("groups with at most this value (%)", 0.0, 100.0);
            let panel = Panel::new(canvas, frame, &scores.title, axis.clone(), shares)?;
            panel.line(steps(&scores.limits), INK, LIMIT_PX)?;
            for (index, of_groups) in scores.of_estimators.iter().enumerate() {
                panel.marked_line(&steps(of_groups), Look::of(index), CURVE_PX, (20.0, 80.0))?;
            }
        }
        Ok(())
    };
    Picture::new(1200, DISTRIBUTION_PX, paint)
        .noted(format!("Distributions over up to {groups} groups: those with the score."))
}

/// The steps of the cumulative distribution of the values of some groups (%).
fn steps(of_groups: &[(usize, f64)]) -> Vec<(f64, f64)> {
    let mut values: Vec<f64> = of_groups.iter().map(|(_, value)| *value).collect();
    values.sort_by(f64::total_cmp);
    let percent = |rank: usize| 100.0 * rank as f64 / values.len() as f64;
    values.iter().enumerate().flat_map(|(rank, value)| [(*value, percent(rank)), (*value, percent(rank + 1))]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_distribution_has_a_step_at_each_value() {
        let of_groups = [(0, 3.0), (1, 1.0), (2, 2.0), (3, 2.0)];
        let expected =
            [(1.0, 0.0), (1.0, 25.0), (2.0, 25.0), (2.0, 50.0), (2.0, 50.0), (2.0, 75.0), (3.0, 75.0), (3.0, 100.0)];
        assert_eq!(steps(&of_groups), expected);
        assert!(steps(&[]).is_empty());
    }
}
