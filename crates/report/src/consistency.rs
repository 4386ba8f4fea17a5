//! The page's tables of consistency: NEES, NIS and coverage with verdicts.

use maud::{Markup, html};
use testbed::consistency::{Average, Verdict};
use testbed::metrics::consistency;
use testbed::results::{ConsistencyRow, RunEstimator, RunSet, SummaryRow};
use whisker::estimators::MethodClass;

use super::methods::with_all_methods;
use super::run_data::RunData;
use super::style::plain;

/// Three columns of the table: an average, its verdict, and the share of times inside the interval.
struct Columns {
    heading: &'static str,
    /// The average over the contact, and the verdict. `None` if there is no such average.
    judge: fn(&RunData, &RunSet, &str) -> Option<(Average, Verdict)>,
    /// The average at one time with its interval.
    at: fn(&ConsistencyRow) -> Option<[f64; 3]>,
}

const COLUMNS: [Columns; 2] = [
    Columns {
        heading: "NEES",
        judge: |data, set, estimator| {
            let errors = data.errors_of(set, estimator)?;
            Some((errors.nees, errors.verdict()))
        },
        at: |row| Some([row.anees?, row.anees_low?, row.anees_high?]),
    },
    Columns {
        heading: "NIS",
        judge: |data, set, estimator| data.nis_of(set, estimator).map(|nis| (nis, nis.verdict())),
        at: |row| Some([row.anis?, row.anis_low?, row.anis_high?]),
    },
];

/// The content of the section. `None` if no estimator states a covariance on a leading set.
pub(crate) fn section(data: &RunData) -> Option<Markup> {
    let sets = data.leading_sets();
    let table = with_all_methods(data, |estimators| table(data, &sets, estimators))?;
    let models = with_all_methods(data, |estimators| models(data, estimators));
    Some(html! {
        p {
            @if let Some(set) = sets.first() { "Group " b { (plain(&set.group)) } ". " }
            "NEES: squared contact error normalised by the stated covariance, with expectation 2 for a consistent "
            "estimator; NIS: squared innovation normalised by its expected variance, with expectation 1. Average over "
            "the whole contact, with its 95 % interval in brackets, from the chi-square distribution (Bar-Shalom, Li "
            "and Kirubarajan 2001, section 5.4.2) with the number of independent samples estimated from the scatter of "
            "the trials' averages and, for the NEES, from its autocorrelation. The verdict beside the NEES is on the "
            "errors: an estimator is overconfident if its NEES lies above the interval or its 95 % ellipses contain "
            "the contact too rarely. Times inside: share of the times at which the average over trials lies in the "
            "interval for one time."
        }
        (table)
        @if let Some(models) = models {
            h3 { "Model probabilities and verdicts by set" }
            p {
                "Probabilities of the models that an estimator averages over, mean over contact and trials. The "
                "verdict is on the errors, by NEES and coverage. The verdict on the innovations (NIS) requires no "
                "truth; it does not detect errors that the readings do not show, such as those of gain and mount."
            }
            (models)
        }
    })
}

fn table(data: &RunData, sets: &[&RunSet], estimators: &[&RunEstimator]) -> Option<Markup> {
    let rows_of = |set: &RunSet| -> Vec<(String, &SummaryRow)> {
        let own = estimators.iter().filter(|estimator| estimator.class != MethodClass::Baseline);
        let rows = own.filter_map(|estimator| Some((estimator.label(), data.summary_of(set, &estimator.name)?)));
        rows.filter(|(_, row)| row.get(&consistency::NEES).is_some()).collect()
    };
    let blocks: Vec<(&RunSet, Vec<(String, &SummaryRow)>)> =
        sets.iter().map(|set| (*set, rows_of(set))).filter(|(_, rows)| !rows.is_empty()).collect();
    (!blocks.is_empty()).then(|| {
        html! {
            div.scroll tabindex="0" aria-label="Table: consistency" {
                table.blocks {
                    thead {
                        tr {
                            @for name in ["whisker", "estimator"] { th { (name) } }
                            @for columns in &COLUMNS {
                                th.number { (columns.heading) }
                                th { "verdict" }
                                th.number { "times inside" br; small { "%" } }
                            }
                            th.number { "95 % ellipses that" br; "contain the contact" br; small { "%" } }
                        }
                    }
                    @for (set, rows) in &blocks {
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
        }
    })
}

/// Model probabilities and verdicts on every set. `None` without a verdict.
fn models(data: &RunData, estimators: &[&RunEstimator]) -> Option<Markup> {
    let rows = data.run.sets.iter().flat_map(|set| {
        estimators.iter().filter_map(move |estimator| {
            let head = &data.summary_of(set, &estimator.name)?.head;
            Some((set, estimator.label(), head.models.as_deref().unwrap_or("–"), head))
        })
    });
    let rows: Vec<_> = rows.filter(|(.., head)| head.verdict.is_some() || head.nis_verdict.is_some()).collect();
    (!rows.is_empty()).then(|| {
        html! {
            div.scroll tabindex="0" aria-label="Table: models and verdicts" {
                table.blocks {
                    thead {
                        tr {
                            th { "group" } th { "whisker" } th { "estimator" } th { "models" } th { "verdict" }
                            th { "by innovations" }
                        }
                    }
                    tbody {
                        @for (set, label, models, head) in &rows {
                            tr {
                                td { (plain(&set.group)) }
                                td { (set.whisker) }
                                td { (label) }
                                td { (models) }
                                td { (head.verdict.as_deref().unwrap_or("–")) }
                                td { (head.nis_verdict.as_deref().unwrap_or("–")) }
                            }
                        }
                    }
                }
            }
        }
    })
}

impl Columns {
    fn cells(&self, data: &RunData, set: &RunSet, row: &SummaryRow) -> Markup {
        let Some((average, verdict)) = (self.judge)(data, set, &row.head.estimator) else {
            return html! { td.number { "–" } td { "–" } td.number { "–" } };
        };
        let (low, high) = average.interval;
        let times = data.consistency_of(set, &row.head.estimator);
        let inside: Vec<bool> =
            times.into_iter().filter_map(self.at).map(|[average, low, high]| (low..=high).contains(&average)).collect();
        let share = inside.iter().filter(|is_inside| **is_inside).count() as f64 / inside.len() as f64;
        html! {
            td.number { (format!("{:.2} [{low:.2}, {high:.2}]", average.value)) }
            td { (verdict.word()) }
            td.number { (percent(Some(share).filter(|share| share.is_finite()))) }
        }
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |share| format!("{:.0}", 100.0 * share))
}
