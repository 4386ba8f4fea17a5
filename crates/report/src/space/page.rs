//! The page of a run in space: summary, interactive replay, figures and provenance in one HTML file that loads no other file.

use anyhow::Result;
use maud::{Markup, html};
use serde_json::json;
use testbed::space::rows::SpatialSummaryRow;
use whisker::space::estimators::{MethodClass, spatial_estimator};

use super::Data;
use super::replay;
use crate::figure::Figures;
use crate::page::{Section, document, figure_content, left_out_entry};
use crate::run_data::counted;
use crate::style::plain;

/// A column of the summary table: heading, unit, definition, value, number of decimals, and whether the smallest value is the best.
struct Column {
    heading: &'static str,
    unit: &'static str,
    meaning: &'static str,
    value: fn(&SpatialSummaryRow) -> Option<f64>,
    decimals: usize,
    is_ranked: bool,
}

impl Column {
    fn printed(&self, row: &SpatialSummaryRow) -> Option<String> {
        (self.value)(row).map(|value| format!("{value:.*}", self.decimals))
    }

    /// The smallest value of the rows that are compared, as printed. `None` if all rows print the same.
    fn best(&self, rows: &[&SpatialSummaryRow]) -> Option<String> {
        let ranked = rows.iter().filter(|row| self.is_ranked && is_compared(row));
        let values = ranked.filter_map(|row| Some(((self.value)(row)?, self.printed(row)?)));
        let (_, best) = values.min_by(|a, b| a.0.total_cmp(&b.0))?;
        rows.iter().any(|row| self.printed(row).as_ref() != Some(&best)).then_some(best)
    }
}

const COLUMNS: [Column; 15] = [
    Column {
        heading: "RMSE",
        unit: "mm",
        meaning: "root mean square over trials and instants of the distance from the true contact",
        value: |row| row.rmse_m.map(|value| 1e3 * value),
        decimals: 3,
        is_ranked: true,
    },
    Column {
        heading: "out of plane",
        unit: "mm",
        meaning: "root mean square error out of the plane of wire and force at the contact",
        value: |row| row.out_of_plane_m.map(|value| 1e3 * value),
        decimals: 3,
        is_ranked: true,
    },
    Column {
        heading: "bound",
        unit: "mm",
        meaning: "posterior Cramér–Rao bound given the readings so far and the true sliding of the contact",
        value: |row| row.bound_m.map(|value| 1e3 * value),
        decimals: 3,
        is_ranked: false,
    },
    Column {
        heading: "NEES",
        unit: "per degree of freedom",
        meaning: "normalised estimation error squared, mean over instants and trials; 1 for a consistent method; the verdict is based on it",
        value: |row| row.nees_mean,
        decimals: 2,
        is_ranked: false,
    },
    Column {
        heading: "coverage",
        unit: "%",
        meaning: "share of the instants at which the 95 % ellipsoid contains the true contact",
        value: |row| row.coverage.map(|value| 100.0 * value),
        decimals: 0,
        is_ranked: false,
    },
    Column {
        heading: "coverage, first second",
        unit: "%",
        meaning: "share of the estimates in the first second of each touch whose 95 % ellipsoid contains the true contact",
        value: |row| row.early_coverage.map(|value| 100.0 * value),
        decimals: 0,
        is_ranked: false,
    },
    Column {
        heading: "no answer",
        unit: "%",
        meaning: "share of the scored instants in the calibrated domain without an estimate",
        value: |row| Some(100.0 * (1.0 - row.answered?)),
        decimals: 1,
        is_ranked: false,
    },
    Column {
        heading: "surface",
        unit: "mm",
        meaning: "mean distance of the estimated points of the surface from the true solid, inside or outside; a dash for meshes",
        value: |row| row.surface_m.map(|value| 1e3 * value),
        decimals: 3,
        is_ranked: true,
    },
    Column {
        heading: "normal",
        unit: "degrees",
        meaning: "root mean square angle between the estimated and the true normal",
        value: |row| row.normal_rad.map(f64::to_degrees),
        decimals: 2,
        is_ranked: true,
    },
    Column {
        heading: "direction",
        unit: "degrees",
        meaning: "root mean square angle between the estimated and the true direction of the edge or rod",
        value: |row| row.direction_rad.map(f64::to_degrees),
        decimals: 2,
        is_ranked: true,
    },
    Column {
        heading: "radius",
        unit: "%",
        meaning: "root mean square error of the last estimated radius of a sphere or cylinder, relative to the true one",
        value: |row| row.radius_error.map(|value| 100.0 * value),
        decimals: 1,
        is_ranked: true,
    },
    Column {
        heading: "radius covered",
        unit: "%",
        meaning: "share of the replays whose 95 % interval of the radius contains the true one",
        value: |row| row.radius_coverage.map(|value| 100.0 * value),
        decimals: 0,
        is_ranked: false,
    },
    Column {
        heading: "edge",
        unit: "mm",
        meaning: "mean distance of the estimated points of the surface from the touched edge of a box",
        value: |row| row.edge_m.map(|value| 1e3 * value),
        decimals: 3,
        is_ranked: true,
    },
    Column {
        heading: "corner",
        unit: "mm",
        meaning: "mean distance of the estimated points of the surface from the touched corner of a box",
        value: |row| row.corner_m.map(|value| 1e3 * value),
        decimals: 3,
        is_ranked: true,
    },
    Column {
        heading: "doubted",
        unit: "%",
        meaning: "share of the estimates, from the touch on, at which the readings contradict the models of the method; a dash for \
            methods that do not judge them",
        value: |row| row.doubted.map(|value| 100.0 * value),
        decimals: 1,
        is_ranked: false,
    },
];

/// Definition of the verdict.
const VERDICT: &str = "whether the stated covariances agree with the errors, by normalised squared error and coverage over trials and \
    scored instants, with intervals for as many samples as are independent";

/// The whole page.
///
/// # Errors
/// When a picture cannot be painted, or a file of the run is damaged.
pub(crate) fn html(data: &Data, figures: &Figures) -> Result<String> {
    let title = format!("Whisker contact localisation in space: {}", data.run.name);
    let mut sections = vec![Section { id: "summary", title: "Summary", content: summary(data) }];
    let replay = replay::section(data)?;
    sections.extend(replay.map(|content| Section { id: "replay", title: "Interactive replay", content }));
    for figure in &figures.drawn {
        sections.push(Section { id: figure.name, title: figure.title, content: figure_content(figure)? });
    }
    let lead = html! {
        p {
            (counted(data.run.trials.len(), "trial")) ", "
            (counted(data.estimators().len(), "estimator")) ", "
            (counted(data.run.seeds.len(), "noise seed")) ", measurement noise of each bending moment "
            (100.0 * data.run.noise) " % of the largest moment of the group"
            @if let Some(front_end) = &data.run.front_end { ", in addition to that of the front end " (front_end.name) }
            ". Errors are distances from the true contact, without "
            "alignment, from one second after the touch."
        }
    };
    Ok(document(&title, lead, &sections, provenance(data, &figures.left_out)))
}

fn summary(data: &Data) -> Markup {
    html! {
        p {
            "The best value of each block and column is " b.best { "marked" } " among the causal estimators that have an estimate wherever one is expected. Hindsight methods (†) use all readings of a "
            "touch; the bounds do not apply to them. "
            "As data: "
            @for file in ["space_summary.csv", "space_trials.csv", "space_maps.csv"] { a href=(file) { (file) } " " }
        }
        div.scroll tabindex="0" aria-label="Table: summary" {
            table.blocks {
                thead {
                    tr {
                        @for name in ["group", "whisker", "estimator"] { th { (name) } }
                        @for Column { heading, unit, meaning, .. } in &COLUMNS {
                            th.number title=(meaning) { (heading) br; small { (unit) } }
                        }
                        th.number { "trials" }
                        th title=(VERDICT) { "verdict" }
                    }
                }
                @for group in data.groups() {
                    @for whisker in data.whiskers() {
                        tbody { (block(&data.scores(group, whisker).collect::<Vec<_>>())) }
                    }
                }
            }
        }
        dl.meanings {
            @for column in &COLUMNS { dt { (column.heading) } dd { (column.meaning) } }
            dt { "trials" } dd { "number of trials, each counted once for every noise seed" }
            dt { "verdict" } dd { (VERDICT) }
        }
    }
}

/// Whether an estimator is compared with the others: it is causal, and has an estimate wherever one is expected.
fn is_compared(row: &SpatialSummaryRow) -> bool {
    row.answered == Some(1.0) && !looks_back(&row.estimator)
}

/// Whether an estimator is a hindsight method.
fn looks_back(estimator: &str) -> bool {
    spatial_estimator(estimator).is_some_and(|row| row.class() == MethodClass::Hindsight)
}

/// The rows of one group and whisker.
fn block(rows: &[&SpatialSummaryRow]) -> Markup {
    let best: Vec<Option<String>> = COLUMNS.iter().map(|column| column.best(rows)).collect();
    html! {
        @for row in rows {
            tr {
                td { (plain(&row.group)) }
                td { (row.whisker) }
                td { (row.estimator) @if looks_back(&row.estimator) { " †" } }
                @for (column, best) in COLUMNS.iter().zip(&best) {
                    td.number {
                        @match column.printed(row) {
                            Some(text) if is_compared(row) && Some(&text) == best.as_ref() => b.best { (text) },
                            Some(text) => (text),
                            None => "–",
                        }
                    }
                }
                td.number { (row.trials) }
                td { (row.verdict.as_deref().unwrap_or("–")) }
            }
        }
    }
}

fn provenance(data: &Data, left_out: &[&str]) -> Markup {
    let (run, mark) = (&data.run, &data.run.watermark);
    let seeds: Vec<String> = run.seeds.iter().map(u64::to_string).collect();
    html! {
        footer #provenance {
            h2 { "Provenance" }
            dl {
                dt { "written by" } dd { (mark.tool) " " (mark.version) }
                dt { "commit" } dd { code { (mark.git_commit.as_deref().unwrap_or("unknown")) } }
                dt { "inputs, SHA-256" } dd { code { (mark.inputs_sha256) } }
                dt { "measurement noise" } dd { (100.0 * run.noise) " % of the largest moment of each group" }
                dt { "seeds of the noise" } dd { (seeds.join(", ")) }
                @if let Some(front_end) = &run.front_end {
                    dt { "front end" }
                    dd { (front_end.name) pre { (format!("{:#}", front_end.config)) } }
                }
                (left_out_entry(left_out))
            }
            details {
                summary { "Estimators and their settings" }
                dl { @for (name, config) in &run.estimators { dt { (name) } dd { pre { (format!("{:#}", json!(config))) } } } }
            }
        }
    }
}
