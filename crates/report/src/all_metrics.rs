//! The page's table of every metric, whatever its place in the other tables.

use maud::{Markup, html};
use testbed::metrics::{METRICS, Metric};

use super::run_data::RunData;
use super::style::{plain, three_digits};

/// The table, folded away.
pub(crate) fn details(data: &RunData) -> Markup {
    let noise = data.noise();
    html! {
        details {
            summary { "Every metric" }
            div.scroll tabindex="0" aria-label="Table: every metric" {
                table.blocks {
                    thead {
                        tr {
                            th { "group" }
                            th { "whisker" }
                            th { "estimator" }
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

/// Unit in which a metric is shown to people, the multiple of its SI unit that makes it, and the end of its name.
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
