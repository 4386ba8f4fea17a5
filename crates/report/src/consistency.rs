//! The page's table of consistency: whether the estimators are as sure as they may be.

use maud::{Markup, html};
use testbed::consistency::{ConsistencyTest, NEES_TEST, NIS_TEST};
use testbed::metrics::consistency;
use testbed::results::{ConsistencyRow, RunSet, SummaryRow};
use whisker::estimators::MethodClass;

use super::run_data::RunData;
use super::style::plain;

/// Three columns: an average that is judged.
struct Columns {
    heading: &'static str,
    judged: ConsistencyTest,
    /// The average at one time with its interval.
    at: fn(&ConsistencyRow) -> Option<[f64; 3]>,
}

const COLUMNS: [Columns; 2] = [
    Columns { heading: "NEES", judged: NEES_TEST, at: |row| Some([row.anees?, row.anees_low?, row.anees_high?]) },
    Columns { heading: "NIS", judged: NIS_TEST, at: |row| Some([row.anis?, row.anis_low?, row.anis_high?]) },
];

/// The section of the page; nothing where no estimator of the leading sets states a covariance.
pub(crate) fn section(data: &RunData) -> Option<Markup> {
    let judges = |set: &RunSet| -> Vec<(String, &SummaryRow)> {
        let recursive = data.run.estimators.iter().filter(|estimator| estimator.class != MethodClass::Baseline);
        let rows = recursive.filter_map(|estimator| Some((estimator.label(), data.summary_of(set, &estimator.name)?)));
        rows.filter(|(_, row)| row.get(&consistency::NEES).is_some()).collect()
    };
    let sets: Vec<(&RunSet, Vec<(String, &SummaryRow)>)> =
        data.leading_sets().into_iter().map(|set| (set, judges(set))).filter(|(_, rows)| !rows.is_empty()).collect();
    let (first, _) = sets.first()?;
    Some(html! {
        section #consistent {
            h2 { "How sure, and how right" }
            p {
                "Group " b { (plain(&first.group)) } ". NEES is the squared contact error in units of the stated covariance, 2 on average if that is "
                "right; NIS the squared innovation in units of the expected one, 1 on average. The verdict is on the average over "
                "the whole contact; in brackets its 95 % interval, from the chi-square distribution "
                "(Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2) with as many independent samples as the scatter of the trials' "
                "own averages shows. What is off by less than a tenth is let pass. Beside it the share of the times at which the average "
                "over the trials lies in the interval for one time."
            }
            div.scroll tabindex="0" aria-label="Table: consistency" {
                table.blocks {
                    thead {
                        tr {
                            th { "whisker" }
                            th { "estimator" }
                            @for columns in &COLUMNS {
                                th.number { (columns.heading) }
                                th { "verdict" }
                                th.number { "times inside" br; small { "%" } }
                            }
                            th.number { "truth in 95 % ellipse" br; small { "%" } }
                        }
                    }
                    @for (set, rows) in &sets {
                        tbody {
                            @for (label, row) in rows {
                                tr {
                                    td { (set.whisker) }
                                    td { (label) }
                                    @for columns in &COLUMNS { (columns.cells(data, set, row)) }
                                    td.number { (percent(row.get(&consistency::COVERAGE))) }
                                }
                            }
                        }
                    }
                }
            }
            (models(data))
        }
    })
}

/// Of every set and estimator that says of its model how probable it is, or of whose model the readings say something.
fn models(data: &RunData) -> Markup {
    let rows = data.run.sets.iter().flat_map(|set| {
        let of_set = data.run.estimators.iter().filter(|estimator| estimator.class != MethodClass::Baseline);
        of_set.filter_map(move |estimator| Some((set, estimator.label(), data.summary_of(set, &estimator.name)?)))
    });
    html! {
        h3 { "Which model holds" }
        p {
            "Where an estimator weighs models against one another, their probabilities, mean over the contact and the trials. The verdict is on the NIS, "
            "which the robot itself can see; of an estimator with hindsight on the NEES. A model that is wrong for an object makes the estimator "
            "overconfident there."
        }
        div.scroll tabindex="0" aria-label="Table: models and verdicts" {
            table.blocks {
                thead { tr { th { "group" } th { "whisker" } th { "estimator" } th { "models" } th { "verdict" } } }
                tbody {
                    @for (set, label, row) in rows {
                        @if let Some(verdict) = &row.head.verdict {
                            tr {
                                td { (plain(&set.group)) }
                                td { (set.whisker) }
                                td { (label) }
                                td { (row.head.models.as_deref().unwrap_or("–")) }
                                td { (verdict) }
                            }
                        }
                    }
                }
            }
        }
    }
}

impl Columns {
    fn cells(&self, data: &RunData, set: &RunSet, row: &SummaryRow) -> Markup {
        let Some(average) = data.average_of(set, &row.head.estimator, &self.judged) else {
            return html! { td.number { "–" } td { "–" } td.number { "–" } };
        };
        let (low, high) = average.interval;
        let times = data.consistency_of(set, &row.head.estimator);
        let inside: Vec<bool> =
            times.into_iter().filter_map(self.at).map(|[average, low, high]| (low..=high).contains(&average)).collect();
        let share = inside.iter().filter(|is_inside| **is_inside).count() as f64 / inside.len() as f64;
        html! {
            td.number { (format!("{:.2} [{low:.2}, {high:.2}]", average.value)) }
            td { (average.verdict().word()) }
            td.number { (percent(Some(share).filter(|share| share.is_finite()))) }
        }
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |share| format!("{:.0}", 100.0 * share))
}
