//! The page's table of every metric.

use maud::{Markup, html};
use testbed::metrics::{METRICS, Metric};

use super::run_data::RunData;
use super::style::{plain, three_digits};

/// The table, folded away.
pub(crate) fn details(data: &RunData) -> Markup {
    let noise = data.noise();
    html! {
        details {
            summary { "All metrics of all methods" }
            div.scroll tabindex="0" aria-label="Table: all metrics" {
                table.blocks {
                    thead {
                        tr {
                            @for name in ["group", "whisker", "estimator"] { th { (name) } }
                            @for metric in METRICS {
                                th.number title=(metric.about) { (heading(metric)) br; small { (unit(metric).0) } }
                            }
                        }
                    }
                    @for set in &data.run.sets {
                        tbody {
                            @for estimator in &data.run.estimators {
                                @if let Some(row) = data.summary_at(set, &estimator.name, noise) {
                                    tr {
                                        td { (plain(&set.group)) }
                                        td { (set.whisker) }
                                        td { (estimator.label()) }
                                        @for metric in METRICS {
                                            td.number { (printed(metric, row.get(metric))) }
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
            }
            dl.meanings {
                @for metric in METRICS {
                    dt { (heading(metric)) } dd { (metric.about) "; " (metric.summary.name()) " over trials" }
                }
            }
        }
    }
}

/// Unit in which a metric is printed, its multiple of the SI unit, and the suffix of the metric's name.
fn unit(metric: &Metric) -> (&'static str, f64, &'static str) {
    let units = [("mm", 1e3, "_m"), ("s", 1.0, "_s")];
    units.into_iter().find(|(.., end)| metric.name.ends_with(end)).unwrap_or(("", 1.0, ""))
}

fn heading(metric: &Metric) -> String {
    plain(metric.name.trim_end_matches(unit(metric).2))
}

fn printed(metric: &Metric, value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| three_digits(unit(metric).1 * value))
}
