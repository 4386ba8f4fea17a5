//! The page: tables, figures and the watermark in one HTML file that fetches nothing.

use anyhow::Result;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::results::{RunCalibration, SummaryRow};

use super::Drawn;
use super::canvas::font_face_css;
use super::compare::{Phase, factor_over_baseline, format_factor};
use super::run_data::RunData;
use super::style::two_digits;

/// Data files that the page links to.
const DATA_FILES: [&str; 4] = ["summary.csv", "trials.csv", "error_over_time.csv", "run.json"];

/// A column of the summary table: heading, unit, what it means, the number and how it is printed. Smaller is better.
struct Column {
    heading: &'static str,
    unit: &'static str,
    meaning: &'static str,
    value: fn(&SummaryRow) -> Option<f64>,
    decimals: usize,
}

const COLUMNS: [Column; 8] = [
    Column {
        heading: "RMSE",
        unit: "mm",
        meaning: "median over trials of the root mean square contact error after the first 2 s of contact",
        value: |row| row.rmse_m.map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "median",
        unit: "mm",
        meaning: "median over trials of the median contact error",
        value: |row| row.median_m.map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "95 %",
        unit: "mm",
        meaning: "median over trials of the 95th percentile of the contact error",
        value: |row| row.p95_m.map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "worst",
        unit: "mm",
        meaning: "largest contact error of any trial",
        value: |row| row.worst_m.map(|value| 1e3 * value),
        decimals: 2,
    },
    Column {
        heading: "to 1 mm",
        unit: "s",
        meaning: "median time from the touch until the error stays below 1 mm; a dash where most trials never do",
        value: |row| row.time_to_1mm_s,
        decimals: 2,
    },
    Column {
        heading: "to 0.3 mm",
        unit: "s",
        meaning: "median time from the touch until the error stays below 0.3 mm; a dash where most trials never do",
        value: |row| row.time_to_0p3mm_s,
        decimals: 2,
    },
    Column {
        heading: "never 1 mm",
        unit: "%",
        meaning: "share of the trials that never stay below 1 mm",
        value: |row| Some(100.0 * row.never_1mm),
        decimals: 0,
    },
    Column {
        heading: "step",
        unit: "µs",
        meaning: "mean wall-clock time of one step of the estimator",
        value: |row| Some(1e-3 * row.step_ns),
        decimals: 1,
    },
];

/// The whole page.
///
/// # Errors
/// When a picture cannot be painted.
pub(super) fn html(data: &RunData, drawn: &[Drawn]) -> Result<String> {
    let run = &data.run;
    let traces = data.run.sets.iter().map(|set| set.traces.len()).sum::<usize>();
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Whisker contact localisation: " (run.name) }
                link rel="icon" href="data:,";
                style { (PreEscaped(font_face_css())) (PreEscaped(include_str!("page.css"))) }
            }
            body {
                header {
                    h1 { "Whisker contact localisation: " (run.name) }
                    p {
                        (traces) " traces in " (run.sets.len()) " sets, " (run.estimators.len()) " estimators, "
                        "measurement noise " (percent_list(&run.noise)) " of each set's largest reading, "
                        (run.seeds.len()) @if run.seeds.len() == 1 { " seed" } @else { " seeds" } " of it. "
                        "All errors are distances from the simulated truth, unaligned."
                    }
                    nav {
                        a href="#baseline" { "Against the baseline" }
                        @for (figure, _) in drawn { a href={ "#" (figure.name) } { (figure.title) } }
                        a href="#summary" { "Summary" }
                        a href="#provenance" { "Provenance" }
                    }
                }
                main {
                    (factor_table(data))
                    @for (figure, picture) in drawn {
                        section id=(figure.name) {
                            h2 { (figure.title) }
                            @if let Some(picture) = picture {
                                figure {
                                    div.scroll tabindex="0" aria-label={ "Figure: " (figure.title) } {
                                        (PreEscaped(picture.to_inline_svg(figure.title)?))
                                    }
                                    figcaption {
                                        (figure.caption) " "
                                        span.files {
                                            a href={ "figures/" (figure.name) ".svg" } { "SVG" } " "
                                            a href={ "figures/" (figure.name) ".png" } { "PNG" }
                                        }
                                    }
                                }
                            } @else {
                                p.absent { "Left out: this run holds no data for it." }
                            }
                        }
                    }
                    (summary_table(data))
                }
                (provenance(data))
            }
        }
    };
    Ok(page.into_string())
}

fn percent_list(fractions: &[f64]) -> String {
    let percents: Vec<String> =
        fractions.iter().map(|noise| format!("{} %", round_significant(100.0 * noise))).collect();
    percents.join(", ")
}

/// The number to nine digits, without the traces of binary arithmetic.
fn round_significant(value: f64) -> f64 {
    format!("{value:.8e}").parse().unwrap_or(value)
}

/// By which factor each filter beats the better baseline, start and steady state apart.
fn factor_table(data: &RunData) -> Markup {
    let sets = data.leading_sets();
    let filters: Vec<&str> = data.filters().collect();
    let cell = |estimator: &str, phase: Phase, index: usize| {
        factor_over_baseline(data, sets[index], estimator, phase).map_or_else(|| "–".to_owned(), format_factor)
    };
    html! {
        section #baseline {
            h2 { "Filters against the baseline" }
            p {
                "Error of the better Euler-Bernoulli baseline over that of the filter"
                @if let Some(set) = sets.first() { ", group " b { (set.group) } }
                ", at the times at which every trial has an estimate of both: above 1, the filter is the more exact one."
            }
            div.scroll tabindex="0" aria-label="Table: filters against the baseline" {
                table {
                    thead {
                        tr {
                            th { "whisker" }
                            th { "part" }
                            @for filter in &filters { th.number { (filter) } }
                        }
                    }
                    tbody {
                        @for (index, set) in sets.iter().enumerate() {
                            @for phase in Phase::ALL {
                                tr {
                                    td { (set.whisker) }
                                    td { (phase.words()) }
                                    @for filter in &filters { td.number { (cell(filter, phase, index)) } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn summary_table(data: &RunData) -> Markup {
    let mut rows: Vec<&SummaryRow> = data.summary.iter().collect();
    rows.sort_by(|a, b| {
        let names = |row: &SummaryRow| (row.group.clone(), row.whisker.clone());
        names(a).cmp(&names(b)).then(a.noise.total_cmp(&b.noise)).then_with(|| a.estimator.cmp(&b.estimator))
    });
    let several_levels = data.run.noise.len() > 1;
    let blocks = rows.chunk_by(|a, b| a.group == b.group && a.whisker == b.whisker && a.noise == b.noise);
    html! {
        section #summary {
            h2 { "Summary" }
            p {
                "Steady state: after the first two seconds of contact. The best value of each block and column is "
                b.best { "marked" }
                ". As data: "
                @for file in DATA_FILES { a href=(file) { (file) } " " }
            }
            div.scroll tabindex="0" aria-label="Table: summary" {
                table.blocks {
                    thead {
                        tr {
                            th { "group" }
                            th { "whisker" }
                            th { "estimator" }
                            @if several_levels { th.number { "noise" br; small { "%" } } }
                            @for column in &COLUMNS {
                                th.number title=(column.meaning) { (column.heading) br; small { (column.unit) } }
                            }
                            th.number { "trials" }
                        }
                    }
                    @for block in blocks { tbody { (summary_block(block, several_levels)) } }
                }
            }
            dl.meanings {
                @for column in &COLUMNS { dt { (column.heading) } dd { (column.meaning) } }
            }
        }
    }
}

fn summary_block(rows: &[&SummaryRow], several_levels: bool) -> Markup {
    let printed =
        |column: &Column, row: &SummaryRow| (column.value)(row).map(|value| format!("{value:.*}", column.decimals));
    let best = |column: &Column| {
        let values = || rows.iter().filter_map(|row| (column.value)(row));
        let print = |value| format!("{value:.*}", column.decimals);
        let (best, last) = (values().min_by(f64::total_cmp)?, values().max_by(f64::total_cmp)?);
        // Where all are equal none is the best.
        (print(best) != print(last) || values().count() == 1).then(|| print(best))
    };
    let best: Vec<Option<String>> = COLUMNS.iter().map(best).collect();
    html! {
        @for row in rows {
            tr {
                td { (row.group) }
                td { (row.whisker) }
                td { (row.estimator) }
                @if several_levels { td.number { (round_significant(100.0 * row.noise)) } }
                @for (column, best) in COLUMNS.iter().zip(&best) {
                    @match printed(column, row) {
                        Some(text) if Some(&text) == best.as_ref() => td.number { b.best { (text) } },
                        Some(text) => td.number { (text) },
                        None => td.number { "–" },
                    }
                }
                td.number { (row.trials) }
            }
        }
    }
}

fn provenance(data: &RunData) -> Markup {
    let run = &data.run;
    let mark = &run.watermark;
    let seeds: Vec<String> = run.seeds.iter().map(u64::to_string).collect();
    html! {
        footer #provenance {
            h2 { "Provenance" }
            dl {
                dt { "written by" } dd { (mark.tool) " " (mark.version) }
                dt { "commit" } dd { code { (mark.git_commit.as_deref().unwrap_or("unknown")) } }
                dt { "inputs, SHA-256" } dd { code { (mark.inputs_sha256) } }
                dt { "measurement noise" } dd { (percent_list(&run.noise)) " of each set's largest reading" }
                dt { "seeds of the noise" } dd { (seeds.join(", ")) }
                @for calibration in &run.calibrations { (calibration_entry(calibration)) }
                dt { "data" }
                dd { @for file in DATA_FILES { a href=(file) { (file) } " " } }
            }
            details {
                summary { "Estimators and their settings" }
                dl {
                    @for estimator in &run.estimators {
                        dt { (estimator.name) }
                        dd { (estimator.about) pre { (format!("{:#}", estimator.config)) } }
                    }
                }
            }
        }
    }
}

fn calibration_entry(calibration: &RunCalibration) -> Markup {
    html! {
        dt { "calibration, " (calibration.whisker) " " (calibration.face) }
        dd {
            (calibration.model) "; held-out residuals "
            (two_digits(100.0 * calibration.heldout_rms_n_m / calibration.largest_reading_n_m)) " % RMS, "
            (two_digits(100.0 * calibration.heldout_worst_n_m / calibration.largest_reading_n_m)) " % worst"
            " of the largest reading; " code { (calibration.sha256) }
        }
    }
}
