//! The page's tables of outline accuracy.

use maud::{Markup, html};
use testbed::results::{ContourScoreRow, ContourTrialRow, RunEstimator};

use super::methods::with_all_methods;
use super::run_data::RunData;
use super::style::plain;

/// The content of the section. `None` if no object has an outline.
pub(crate) fn section(data: &RunData) -> Option<Markup> {
    let sweeps: Vec<&ContourTrialRow> = data
        .unscored_sets()
        .into_iter()
        .flat_map(|set| &set.traces)
        .flat_map(|trace| data.contours_of(trace))
        .filter(|row| row.mean_m.is_some() || row.radius_m.is_some())
        .collect();
    let table = with_all_methods(data, |estimators| score_table(data, estimators))?;
    Some(html! {
        p {
            "Outline estimated by the method, or merged from the surface points of all contacts and strokes, with a 95 "
            "% band. Contact: RMS error after the first second. Mean and 95 %: mean and 95th percentile of the "
            "distance of the estimated outline from the true one. Hausdorff: the largest of these distances and of "
            "those of the touched part of the true outline from the estimated one. In the band: share of the outline "
            "whose 95 % ellipses contain the true one. Medians over trials (the share: mean), without alignment. As "
            "data: "
            a href="contours.csv" { "contours.csv" } " " a href="contour_trials.csv" { "contour_trials.csv" }
        }
        (table)
        @if !sweeps.is_empty() { (sweep_table(data, &sweeps)) }
    })
}

fn score_table(data: &RunData, estimators: &[&RunEstimator]) -> Option<Markup> {
    let is_shown = |name: &str| estimators.iter().any(|estimator| estimator.name == name);
    let rows = data.contours.iter().filter(|row| row.noise == data.noise() && is_shown(&row.estimator));
    let rows: Vec<&ContourScoreRow> = rows.collect();
    (!rows.is_empty()).then(|| {
        html! {
            div.scroll tabindex="0" aria-label="Table: outline accuracy" {
                table {
                    thead {
                        tr {
                            @for name in ["group", "whisker", "estimator"] { th { (name) } }
                            @for heading in ["contact", "mean", "95 %", "Hausdorff"] {
                                th.number { (heading) br; small { "mm" } }
                            }
                            th.number { "in the band" br; small { "%" } }
                            th.number { "trials" }
                        }
                    }
                    tbody {
                        @for row in &rows {
                            tr {
                                td { (plain(&row.group)) }
                                td { (row.whisker) }
                                td { (label(data, &row.estimator)) }
                                @for length_m in [row.contact_rmse_m, row.mean_m, row.p95_m, row.hausdorff_m] {
                                    td.number { (number(length_m, 1e3, 3)) }
                                }
                                td.number { (number(row.band_coverage, 1e2, 0)) }
                                td.number { (row.trials) }
                            }
                        }
                    }
                }
            }
        }
    })
}

/// Name of an estimator in tables.
fn label(data: &RunData, name: &str) -> String {
    let known = data.run.estimators.iter().find(|estimator| estimator.name == name);
    known.map_or_else(|| name.to_owned(), RunEstimator::label)
}

/// Scores of single sweeps over objects without known contacts.
fn sweep_table(data: &RunData, rows: &[&ContourTrialRow]) -> Markup {
    html! {
        h3 { "Single sweeps without known contacts" }
        p {
            "Mean and 95 %: distance from the object's own outline, if that could be placed. Radius: of the circle fitted "
            "to the outline, with the 95 % interval that follows from the outline's band; residual: RMS distance of the "
            "outline from the circle. Length: of the touched part of the outline found."
        }
        div.scroll tabindex="0" aria-label="Table: single sweeps" {
            table {
                thead {
                    tr {
                        th { "trace" }
                        th { "estimator" }
                        @for heading in ["length", "mean", "95 %", "radius", "from", "to", "residual"] {
                            th.number { (heading) br; small { "mm" } }
                        }
                    }
                }
                tbody {
                    @for row in rows {
                        tr {
                            td { (row.trace) }
                            td { (label(data, &row.estimator)) }
                            td.number { (number(row.length_m, 1e3, 1)) }
                            @for length_m in [row.mean_m, row.p95_m] { td.number { (number(length_m, 1e3, 3)) } }
                            @for length_m in [row.radius_m, row.radius_low_m, row.radius_high_m] {
                                td.number { (number(length_m, 1e3, 2)) }
                            }
                            td.number { (number(row.residual_rms_m, 1e3, 3)) }
                        }
                    }
                }
            }
        }
    }
}

fn number(value: Option<f64>, multiple: f64, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{:.*}", decimals, multiple * value))
}
