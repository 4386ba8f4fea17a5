//! The page: tables, figures and the watermark in one HTML file that fetches nothing.

use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::json;
use testbed::metrics::{bound, error};
use testbed::results::files::Writer;
use testbed::results::{RUN_FILES, RunCalibration, RunEstimator, SummaryRow};
use whisker::estimators::MethodClass;

use super::all_metrics;
use super::animations::Animation;
use super::canvas::font_face_css;
use super::compare::{Phase, factor_over_baseline, format_factor};
use super::consistency;
use super::contours;
use super::figure::Drawn;
use super::replay;
use super::run_data::{RunData, counted};
use super::style::{plain, two_digits};

/// Data files that the page links to.
fn data_files() -> impl Iterator<Item = &'static str> {
    RUN_FILES.iter().filter(|file| file.is_single() && file.writer == Writer::Evaluate).map(|file| file.name)
}

/// A column of the summary table: heading, unit, what it means, the number and how it is printed. Smaller is better.
struct Column {
    heading: &'static str,
    unit: &'static str,
    meaning: &'static str,
    value: fn(&SummaryRow) -> Option<f64>,
    decimals: usize,
}

const COLUMNS: [Column; 9] = [
    Column {
        heading: "RMSE",
        unit: "mm",
        meaning: "median over trials of the root mean square contact error after the first 2 s of contact",
        value: |row| row.get(&error::RMSE).map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "over bound",
        unit: "times",
        meaning: "root mean square over trials of that error over the least that the readings so far allow, the posterior \
                  Cramer-Rao bound of one who knows how the contact slides; 1 is the physical limit",
        value: |row| row.get(&bound::RATIO),
        decimals: 2,
    },
    Column {
        heading: "median",
        unit: "mm",
        meaning: "median over trials of the median contact error",
        value: |row| row.get(&error::MEDIAN).map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "95 %",
        unit: "mm",
        meaning: "median over trials of the 95th percentile of the contact error",
        value: |row| row.get(&error::P95).map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "worst",
        unit: "mm",
        meaning: "largest contact error of any trial",
        value: |row| row.get(&error::WORST).map(|value| 1e3 * value),
        decimals: 2,
    },
    Column {
        heading: "to 1 mm",
        unit: "s",
        meaning: "median time from the touch until the error stays below 1 mm; a dash where most trials never do",
        value: |row| row.get(&error::TIME_TO_1MM),
        decimals: 2,
    },
    Column {
        heading: "to 0.3 mm",
        unit: "s",
        meaning: "median time from the touch until the error stays below 0.3 mm; a dash where most trials never do",
        value: |row| row.get(&error::TIME_TO_0P3MM),
        decimals: 2,
    },
    Column {
        heading: "never 1 mm",
        unit: "%",
        meaning: "share of the trials that never stay below 1 mm",
        value: |row| row.get(&error::NEVER_1MM).map(|value| 100.0 * value),
        decimals: 0,
    },
    Column {
        heading: "step",
        unit: "µs",
        meaning: "mean wall-clock time of one step of the estimator",
        value: |row| Some(1e-3 * row.head.step_ns),
        decimals: 1,
    },
];

/// The whole page.
///
/// # Errors
/// When a picture cannot be painted, or a file of the run is damaged.
pub(crate) fn html(data: &RunData, animations: &[Animation], drawn: &[Drawn]) -> Result<String> {
    let run = &data.run;
    let traces = data.run.sets.iter().map(|set| set.traces.len()).sum::<usize>();
    let consistent = consistency::section(data);
    let replay = replay::section(data)?;
    let outlines = contours::section(data);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            (head(&format!("Whisker contact localisation: {}", run.name)))
            body {
                header {
                    h1 { "Whisker contact localisation: " (run.name) }
                    p {
                        (counted(traces, "trial")) " in " (counted(run.sets.len(), "set")) ", "
                        (counted(run.estimators.len(), "estimator")) ", "
                        "measurement noise " (percent_list(&run.noise)) " of each set's largest reading"
                        @if !run.front_end.sensors.is_empty() { " on top of that of the front end " (run.front_end.name) }
                        ", "
                        (counted(run.seeds.len(), "seed")) " of it. "
                        "All errors are distances from the true contact, unaligned."
                    }
                    nav {
                        @if !animations.is_empty() { a href="#sweeps" { "The sweeps" } }
                        @if replay.is_some() { a href="#replay" { "Watching it think" } }
                        a href="#baseline" { "Against the baseline" }
                        @for figure in drawn { a href={ "#" (figure.name) } { (figure.title) } }
                        @if outlines.is_some() { a href="#outlines" { "Outlines found" } }
                        @if consistent.is_some() { a href="#consistent" { "How sure, and how right" } }
                        a href="#summary" { "Summary" }
                        a href="#provenance" { "Provenance" }
                    }
                }
                main {
                    @if !animations.is_empty() { (sweeps(animations)) }
                    @if let Some(section) = &replay { (section) }
                    (factor_table(data))
                    @for figure in drawn { (figure_section(figure)?) }
                    @if let Some(section) = &outlines { (section) }
                    @if let Some(section) = &consistent { (section) }
                    (summary_table(data))
                }
                (provenance(data))
            }
        }
    };
    Ok(page.into_string())
}

/// The head of a page that fetches nothing.
pub(crate) fn head(title: &str) -> Markup {
    html! {
        head {
            meta charset="utf-8";
            meta name="viewport" content="width=device-width, initial-scale=1";
            title { (title) }
            link rel="icon" href="data:,";
            style { (PreEscaped(font_face_css())) (PreEscaped(include_str!("page.css"))) (PreEscaped(include_str!("replay.css"))) }
        }
    }
}

/// A figure with its heading and caption.
///
/// # Errors
/// When the picture cannot be painted.
pub(crate) fn figure_section(figure: &Drawn) -> Result<Markup> {
    let svg = figure.picture.as_ref().map(|picture| picture.to_inline_svg(figure.title)).transpose()?;
    Ok(html! {
        section id=(figure.name) {
            h2 { (figure.title) }
            @if let Some(svg) = svg {
                figure {
                    div.scroll tabindex="0" aria-label={ "Figure: " (figure.title) } { (PreEscaped(svg)) }
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
    })
}

/// A still picture of each set, which leads to its animation.
fn sweeps(animations: &[Animation]) -> Markup {
    html! {
        section #sweeps {
            h2 { "The sweeps" }
            p {
                "One trial of each set, seen from above, as simulated: the base (black) carries the whisker along the object "
                "(grey). The ring marks the contact, the arrow the force of the object on the whisker, the dots the contacts so "
                "far. Each picture shows the largest reading and leads to the sweep in real time."
            }
            div.sweeps {
                @for animation in animations {
                    @let name = format!("{}, {} whisker", plain(&animation.group), animation.whisker);
                    a href=(animation.address) {
                        img src={ "data:image/png;base64," (BASE64.encode(&animation.still)) } loading="lazy"
                            alt={ "Plan view at the largest reading: " (name) ", with the object, the contact and the force" };
                        span { (name) ": play (" (animation.bytes.div_ceil(1000)) " kB)" }
                    }
                }
            }
        }
    }
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
                @if let Some(set) = sets.first() { ", group " b { (plain(&set.group)) } }
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
    let several_levels = data.run.noise.len() > 1;
    let blocks = summary_blocks(data);
    let silent = blocks.iter().flatten().any(|line| line.silent_share > 0.0);
    html! {
        section #summary {
            h2 { "Summary" }
            p {
                "Steady state: after the first two seconds of contact. The best value of each block and column is "
                b.best { "marked" }
                ". "
                @if silent {
                    "An estimator that was silent for a part of a trial's steady state is scored on the rest, beyond a "
                    "tenth not at all, and is not ranked. "
                }
                @if data.run.estimators.iter().any(|estimator| estimator.class == MethodClass::Hindsight) {
                    "Hindsight knows the readings that were still to come: it shows what could be known in the end, and is not ranked. "
                }
                "As data: "
                @for file in data_files() { a href=(file) { (file) } " " }
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
                    @for block in &blocks { tbody { (summary_block(block, several_levels)) } }
                }
            }
            dl.meanings {
                @for column in &COLUMNS { dt { (column.heading) } dd { (column.meaning) } }
                dt { "trials" } dd { "number of trials, each counted once for every noise seed" }
            }
            (all_metrics::details(data))
        }
    }
}

/// One row of the summary table.
struct SummaryLine<'a> {
    estimator: &'a RunEstimator,
    scores: &'a SummaryRow,
    /// Share of the samples in steady contact that are without an estimate.
    silent_share: f64,
}

impl SummaryLine<'_> {
    /// Whether it takes part in the contest: whoever was silent for a part, or looks back, has it easier.
    fn is_ranked(&self) -> bool {
        self.silent_share == 0.0 && self.estimator.class != MethodClass::Hindsight
    }

    fn printed(&self, column: &Column) -> Option<String> {
        (column.value)(self.scores).map(|value| format!("{value:.*}", column.decimals))
    }
}

/// The rows in the order of the run, a block for each set and noise level.
fn summary_blocks(data: &RunData) -> Vec<Vec<SummaryLine<'_>>> {
    let blocks = data.run.sets.iter().flat_map(|set| data.run.noise.iter().map(move |noise| (set, noise)));
    let blocks = blocks
        .map(|(set, noise)| -> Vec<SummaryLine> {
            let lines = data.run.estimators.iter().filter_map(|estimator| {
                Some(SummaryLine {
                    estimator,
                    scores: data.summary_at(set, &estimator.name, *noise)?,
                    silent_share: data.silent_share(set, &estimator.name, *noise),
                })
            });
            lines.collect()
        })
        .filter(|lines| !lines.is_empty());
    blocks.collect()
}

/// What the best row of a block shows in a column: of those that are ranked the smallest, where not all rows show the same.
fn best_of(lines: &[SummaryLine<'_>], column: &Column) -> Option<String> {
    let ranked = lines.iter().filter(|line| line.is_ranked());
    let (best, _) = ranked
        .filter_map(|line| Some((line.printed(column)?, (column.value)(line.scores)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    lines.iter().any(|line| line.printed(column).as_ref() != Some(&best)).then_some(best)
}

fn summary_block(lines: &[SummaryLine<'_>], several_levels: bool) -> Markup {
    let best: Vec<Option<String>> = COLUMNS.iter().map(|column| best_of(lines, column)).collect();
    html! {
        @for line in lines {
            @let row = line.scores;
            tr {
                td { (plain(&row.head.group)) }
                td { (row.head.whisker) }
                td {
                    (line.estimator.label())
                    @if line.silent_share > 0.0 { " " small { "silent " (two_digits(100.0 * line.silent_share)) " %" } }
                }
                @if several_levels { td.number { (round_significant(100.0 * row.head.noise)) } }
                @for (column, best) in COLUMNS.iter().zip(&best) {
                    @match line.printed(column) {
                        Some(text) if line.is_ranked() && Some(&text) == best.as_ref() => {
                            td.number { b.best { (text) } }
                        }
                        Some(text) => td.number { (text) },
                        None => td.number { "–" },
                    }
                }
                td.number { (row.head.trials) }
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
                dd { @for file in data_files() { a href=(file) { (file) } " " } }
            }
            details {
                summary { "Front end, estimators and their settings" }
                dl {
                    dt { "front end" }
                    dd { (run.front_end.name) pre { (format!("{:#}", run.front_end.config)) } }
                    dt { "touch detection" }
                    dd { "thresholds and times, the same for all" pre { (format!("{:#}", json!(run.touch))) } }
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

#[cfg(test)]
mod tests {
    use super::*;
    use testbed::metrics::Scores;
    use testbed::results::SummaryHead;

    fn scores(rmse_m: Option<f64>) -> SummaryRow {
        let head = SummaryHead {
            group: "pin".to_owned(),
            whisker: "straight".to_owned(),
            object: "pin".to_owned(),
            estimator: "ekf".to_owned(),
            noise: 0.01,
            trials: 1,
            step_ns: 500.0,
            models: None,
            verdict: None,
        };
        SummaryRow {
            head,
            scores: Scores::from_fn(|metric| if metric.name == error::RMSE.name { rmse_m } else { Some(0.0) }),
        }
    }

    fn estimator(class: MethodClass) -> RunEstimator {
        let (name, about) = ("ekf".to_owned(), "one line".to_owned());
        RunEstimator { name, about, class, sensor_model: None, config: json!({}) }
    }

    #[test]
    fn verif_the_best_row_was_never_silent_never_looked_back_and_shows_another_value_than_some() {
        let rows = [Some(1e-4), Some(2e-4), Some(3e-4), None].map(scores);
        let [recursive, hindsight] = [MethodClass::Recursive, MethodClass::Hindsight].map(estimator);
        let block = |silent_share: f64, first| -> Vec<SummaryLine> {
            let lines = rows.iter().map(|scores| SummaryLine { estimator: &recursive, scores, silent_share: 0.0 });
            let mut lines: Vec<SummaryLine> = lines.collect();
            (lines[0].silent_share, lines[0].estimator) = (silent_share, first);
            lines
        };
        let [rmse, .., never, _] = &COLUMNS;
        assert_eq!(best_of(&block(0.0, &recursive), rmse).as_deref(), Some("0.100"));
        assert_eq!(best_of(&block(0.01, &recursive), rmse).as_deref(), Some("0.200"));
        assert_eq!(best_of(&block(0.0, &hindsight), rmse).as_deref(), Some("0.200"));
        assert_eq!(best_of(&block(0.0, &recursive), never), None, "all tie");
        assert_eq!(best_of(&block(0.0, &recursive)[3..], rmse), None, "no value");
    }
}
