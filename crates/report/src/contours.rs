//! The page's tables of the outlines found.

use maud::{Markup, html};
use testbed::results::ContourTrialRow;

use super::run_data::RunData;
use super::style::plain;

/// The section of the page; nothing where no object has an outline.
pub(crate) fn section(data: &RunData) -> Option<Markup> {
    let rows: Vec<_> = data.contours.iter().filter(|row| row.noise == data.noise()).collect();
    if rows.is_empty() {
        return None;
    }
    let sweeps: Vec<&ContourTrialRow> = data
        .unscored_sets()
        .into_iter()
        .flat_map(|set| &set.traces)
        .flat_map(|trace| data.contours_of(trace))
        .filter(|row| row.mean_m.is_some() || row.radius_m.is_some())
        .collect();
    let label = |estimator: &str| {
        let known = data.run.estimators.iter().find(|row| row.name == estimator);
        known.map_or_else(|| estimator.to_owned(), |row| row.label())
    };
    Some(html! {
        section #outlines {
            h2 { "Outlines found" }
            p {
                "The outline that an estimator carries, or the surface points of all contacts and strokes, merged into one, with a 95 % band. Contact: root "
                "mean square error after the first second. Mean and 95 %: distance of the outline from the true one. Hausdorff: the largest of those distances and of the "
                "distances of the touched part of the true outline from the one found. In the band: share of the outline through "
                "whose 95 % ellipses the true one runs. Medians over trials, the share a mean. Nothing is aligned. As data: "
                a href="contours.csv" { "contours.csv" } " " a href="contour_trials.csv" { "contour_trials.csv" }
            }
            div.scroll tabindex="0" aria-label="Table: outlines found" {
                table {
                    thead {
                        tr {
                            th { "group" }
                            th { "whisker" }
                            th { "estimator" }
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
                                td { (label(&row.estimator)) }
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
            @if !sweeps.is_empty() { (sweep_table(&sweeps, &label)) }
        }
    })
}

/// What is known of each sweep over an object of which nobody knows where it was touched.
fn sweep_table(rows: &[&ContourTrialRow], label: &dyn Fn(&str) -> String) -> Markup {
    html! {
        h3 { "Sweep by sweep, where the true contact is not known" }
        p {
            "Mean and 95 %: distance from the object's own outline, where that could be placed. Radius: of the circle through the outline, with the interval "
            "that holds it with 95 % if the outline's band is right; residual: root mean square distance of the outline from it."
        }
        div.scroll tabindex="0" aria-label="Table: sweep by sweep" {
            table {
                thead {
                    tr {
                        th { "trace" }
                        th { "estimator" }
                        @for heading in ["mean", "95 %", "radius", "from", "to", "residual"] {
                            th.number { (heading) br; small { "mm" } }
                        }
                    }
                }
                tbody {
                    @for row in rows {
                        tr {
                            td { (row.trace) }
                            td { (label(&row.estimator)) }
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
