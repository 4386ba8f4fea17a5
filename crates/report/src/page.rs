//! The page: tables, figures and provenance in one HTML file that loads no other file.

use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::json;
use testbed::metrics::{bound, error};
use testbed::noise::NoiseUnit;
use testbed::results::files::Writer;
use testbed::results::{RUN_FILES, RunCalibration, RunEstimator, SummaryRow};
use whisker::estimators::MethodClass;

use super::all_metrics;
use super::animations::Animation;
use super::compare::{Phase, factor_over_baseline, format_factor};
use super::consistency;
use super::contours;
use super::figure::{ALL_METHODS, Drawn, Figures, numbered};
use super::font;
use super::methods::with_all_methods;
use super::replay;
use super::run_data::{RunData, counted};
use super::style::{plain, two_digits};

/// Data files that the page links to.
fn data_files() -> impl Iterator<Item = &'static str> {
    RUN_FILES.iter().filter(|file| file.is_single() && file.writer == Writer::Evaluate).map(|file| file.name)
}

/// A column of the summary table: heading, unit, definition, value and number of decimals. Smaller is better.
struct Column {
    heading: &'static str,
    unit: &'static str,
    meaning: &'static str,
    value: fn(&SummaryRow) -> Option<f64>,
    decimals: usize,
}

const COLUMNS: [Column; 13] = [
    Column {
        heading: "RMSE",
        unit: "mm",
        meaning: "median over trials of the root mean square contact error after the first 2 s of contact",
        value: |row| row.get(&error::RMSE).map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "mean",
        unit: "mm",
        meaning: "mean over trials of the root mean square contact error after the first 2 s of contact",
        value: |row| row.head.rmse_mean_m.map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "90th percentile",
        unit: "mm",
        meaning: "90th percentile over trials of the root mean square contact error after the first 2 s of contact",
        value: |row| row.head.rmse_p90_m.map(|value| 1e3 * value),
        decimals: 3,
    },
    Column {
        heading: "above 0.5 mm",
        unit: "%",
        meaning: "share of the trials whose root mean square contact error after the first 2 s of contact exceeds 0.5 \
            mm, or which have none",
        value: |row| Some(100.0 * row.head.above_0p5mm),
        decimals: 0,
    },
    Column {
        heading: "no answer",
        unit: "%",
        meaning: "share of the instants of contact without an estimate, mean over trials",
        value: |row| row.get(&error::ANSWERED).map(|value| 100.0 * (1.0 - value)),
        decimals: 1,
    },
    Column {
        heading: "over bound",
        unit: "times",
        meaning: "root mean square error over trials, relative to the posterior Cramér–Rao bound given the readings so far \
                  and the true sliding of the contact; 1 is the limit",
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
        meaning: "median time from the touch until the error stays below 1 mm; a dash if it never does in most trials",
        value: |row| row.get(&error::TIME_TO_1MM),
        decimals: 2,
    },
    Column {
        heading: "to 0.3 mm",
        unit: "s",
        meaning: "median time from the touch until the error stays below 0.3 mm; a dash if it never does in most trials",
        value: |row| row.get(&error::TIME_TO_0P3MM),
        decimals: 2,
    },
    Column {
        heading: "never 1 mm",
        unit: "%",
        meaning: "share of the trials whose error never stays below 1 mm",
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
pub(crate) fn html(data: &RunData, animations: &[Animation], figures: &Figures) -> Result<String> {
    let sections = sections(data, animations, figures)?;
    let title = format!("Whisker contact localisation: {}", data.run.name);
    Ok(document(&title, lead(data), &sections, provenance(data, &figures.left_out)))
}

/// A page with a heading, a lead, links to its sections, the sections and its provenance. It loads no other file.
pub(crate) fn document(title: &str, lead: Markup, sections: &[Section], provenance: Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            (head(title))
            body {
                header {
                    h1 { (title) }
                    (lead)
                    nav {
                        @for Section { id, title, .. } in sections { a href={ "#" (id) } { (title) } }
                        a href="#provenance" { "Provenance" }
                    }
                }
                main {
                    @for Section { id, title, content } in sections { section id=(id) { h2 { (title) } (content) } }
                }
                (provenance)
            }
        }
    };
    page.into_string()
}

/// A section of a page.
pub(crate) struct Section {
    /// Anchor.
    pub(crate) id: &'static str,
    /// Heading.
    pub(crate) title: &'static str,
    /// Content below the heading.
    pub(crate) content: Markup,
}

/// The sections of the page, in order: those for which the run has data.
fn sections(data: &RunData, animations: &[Animation], figures: &Figures) -> Result<Vec<Section>> {
    let mut sections = vec![Section { id: "summary", title: "Summary", content: summary(data) }];
    let mut add = |id, title, content: Option<Markup>| {
        sections.extend(content.map(|content| Section { id, title, content }));
    };
    add("baseline", "Filters compared with the baselines", comparison(data));
    add("sweeps", "Animations", (!animations.is_empty()).then(|| sweeps(animations)));
    add("replay", "Interactive replay", replay::section(data)?);
    for figure in &figures.drawn {
        add(figure.name, figure.title, Some(figure_content(figure)?));
    }
    add("outlines", "Outline accuracy", contours::section(data));
    add("consistent", "Consistency by method", consistency::section(data));
    Ok(sections)
}

/// Contents of the run in one sentence.
fn lead(data: &RunData) -> Markup {
    let run = &data.run;
    let traces = run.sets.iter().map(|set| set.traces.len()).sum::<usize>();
    html! {
        p {
            (counted(traces, "trial")) " in " (counted(run.sets.len(), "set")) ", "
            (counted(run.estimators.len(), "estimator")) ", "
            "measurement noise " (run.noise_unit.describe(&run.noise))
            @if !run.front_end.sensors.is_empty() { ", in addition to that of the front end " (run.front_end.name) }
            ", "
            (counted(run.seeds.len(), "noise seed")) ". "
            "Errors are distances from the true contact, without alignment."
        }
    }
}

/// The head of a page that loads no other file.
fn head(title: &str) -> Markup {
    html! {
        head {
            meta charset="utf-8";
            meta name="viewport" content="width=device-width, initial-scale=1";
            title { (title) }
            link rel="icon" href="data:,";
            style { (PreEscaped(font::face_css())) (PreEscaped(include_str!("page.css"))) (PreEscaped(include_str!("replay.css"))) }
        }
    }
}

/// A figure with its caption, and the pictures of all methods folded away behind it.
///
/// # Errors
/// When a picture cannot be painted.
pub(crate) fn figure_content(figure: &Drawn) -> Result<Markup> {
    let Drawn { name, title, caption, picture } = figure;
    let svg = picture.to_inline_svg(title)?;
    let all = picture.all_methods.iter().map(|picture| Ok((picture.to_inline_svg(title)?, &picture.note)));
    let all: Vec<(String, &String)> = all.collect::<Result<_>>()?;
    Ok(html! {
        figure {
            div.scroll tabindex="0" aria-label={ "Figure: " (title) } { (PreEscaped(svg)) }
            figcaption { (caption) " " (files("figures", name)) }
        }
        @if !all.is_empty() {
            details.all {
                summary { "All methods" }
                @for (index, (svg, note)) in all.iter().enumerate() {
                    div.scroll tabindex="0" aria-label={ "Figure: " (title) ", all methods " (index + 1) } { (PreEscaped(svg)) }
                    p.note { (note) " " (files(ALL_METHODS, &numbered(name, index))) }
                }
            }
        }
    })
}

/// Links to the files of a picture.
fn files(folder: &str, name: &str) -> Markup {
    html! {
        span.files {
            @for (kind, label) in [("svg", "SVG"), ("png", "PNG")] {
                a href={ (folder) "/" (name) "." (kind) } { (label) } " "
            }
        }
    }
}

/// A still picture of each set, linked to its animation.
fn sweeps(animations: &[Animation]) -> Markup {
    html! {
        p {
            "One trial of each set in plan view, as simulated: the base (black) moves the whisker along the object "
            "(grey). Ring: contact; arrow: force of the object on the whisker; dots: earlier contacts. Each picture "
            "shows the instant of the largest reading and links to the animation in real time."
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

/// The factor by which the error of each method is smaller than that of the better baseline, in start-up and steady state.
/// `None` if the run has no baseline or nothing to compare it with.
fn comparison(data: &RunData) -> Option<Markup> {
    let sets = data.leading_sets();
    let table = with_all_methods(data, |estimators| {
        let filters: Vec<&RunEstimator> =
            estimators.iter().copied().filter(|estimator| estimator.class != MethodClass::Baseline).collect();
        let factor =
            |filter: &RunEstimator, set: usize, phase| factor_over_baseline(data, sets[set], &filter.name, phase);
        let is_comparable = |filter: &&RunEstimator| {
            (0..sets.len()).any(|set| Phase::ALL.iter().any(|phase| factor(filter, set, *phase).is_some()))
        };
        let cell = |filter: &RunEstimator, set: usize, phase| {
            factor(filter, set, phase).map_or_else(|| "–".to_owned(), format_factor)
        };
        filters.iter().any(is_comparable).then(|| {
            html! {
                div.scroll tabindex="0" aria-label="Table: filters compared with the baselines" {
                    table {
                        thead {
                            tr {
                                th { "estimator" }
                                @for set in &sets {
                                    @for phase in Phase::ALL { th.number { (set.whisker) " whisker" br; (phase.words()) } }
                                }
                            }
                        }
                        tbody {
                            @for filter in &filters {
                                tr {
                                    td { (filter.label()) }
                                    @for set in 0..sets.len() {
                                        @for phase in Phase::ALL { td.number { (cell(filter, set, phase)) } }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        })
    })?;
    Some(html! {
        p {
            "Ratio of the error of the better Euler-Bernoulli baseline to that of the method"
            @if let Some(set) = sets.first() { ", group " b { (plain(&set.group)) } }
            ", at the times at which every trial has an estimate of both. Above 1, the method is more accurate."
        }
        (table)
    })
}

fn summary(data: &RunData) -> Markup {
    html! {
        p {
            "Steady state: after the first two seconds of contact. The best value of each block and column is "
            b.best { "marked" }
            ". "
            @if summary_blocks(data, &data.run.estimators.iter().collect::<Vec<_>>()).iter().flatten().any(|line| line.silent_share > 0.0) {
                "An estimator that gives no estimate during part of a trial's steady state is scored on the rest and "
                "not ranked; if that part exceeds a tenth, it has no score. "
            }
            @if data.run.estimators.iter().any(|estimator| estimator.class == MethodClass::Hindsight) {
                "Methods with hindsight use all readings of a contact, later ones included, and are not ranked. "
            }
            "As data: "
            @for file in data_files() { a href=(file) { (file) } " " }
        }
        @if let Some(tables) = with_all_methods(data, |estimators| summary_table(data, estimators)) { (tables) }
        dl.meanings {
            @for column in &COLUMNS { dt { (column.heading) } dd { (column.meaning) } }
            dt { "trials" } dd { "number of trials, each counted once for every noise seed" }
        }
        (all_metrics::details(data))
    }
}

fn summary_table(data: &RunData, estimators: &[&RunEstimator]) -> Option<Markup> {
    let unit = (data.run.noise.len() > 1).then_some(data.run.noise_unit);
    let blocks = summary_blocks(data, estimators);
    (!blocks.is_empty()).then(|| {
        html! {
            div.scroll tabindex="0" aria-label="Table: summary" {
                table.blocks {
                    thead {
                        tr {
                            @for name in ["group", "whisker", "estimator"] { th { (name) } }
                            @if let Some(unit) = unit { th.number { "noise" br; small { (unit.symbol()) } } }
                            @for column in &COLUMNS {
                                th.number title=(column.meaning) { (column.heading) br; small { (column.unit) } }
                            }
                            th.number { "trials" }
                        }
                    }
                    @for block in &blocks { tbody { (summary_block(block, unit)) } }
                }
            }
        }
    })
}

/// One row of the summary table.
struct SummaryLine<'a> {
    estimator: &'a RunEstimator,
    scores: &'a SummaryRow,
    /// Share of the samples in steady contact without an estimate.
    silent_share: f64,
}

impl SummaryLine<'_> {
    /// Whether it is ranked: not if scored on a part of the samples only, nor with hindsight.
    fn is_ranked(&self) -> bool {
        self.silent_share == 0.0 && self.estimator.class != MethodClass::Hindsight
    }

    fn printed(&self, column: &Column) -> Option<String> {
        (column.value)(self.scores).map(|value| format!("{value:.*}", column.decimals))
    }
}

/// The rows of some estimators, a block for each set and noise level.
fn summary_blocks<'a>(data: &'a RunData, estimators: &[&'a RunEstimator]) -> Vec<Vec<SummaryLine<'a>>> {
    let blocks = data.run.sets.iter().flat_map(|set| data.run.noise.iter().map(move |noise| (set, noise)));
    let blocks = blocks
        .map(|(set, noise)| -> Vec<SummaryLine> {
            let lines = estimators.iter().filter_map(|estimator| {
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

/// The smallest value of the ranked rows of a block in a column, as printed. `None` if all rows print the same.
fn best_of(lines: &[SummaryLine<'_>], column: &Column) -> Option<String> {
    let ranked = lines.iter().filter(|line| line.is_ranked());
    let (best, _) = ranked
        .filter_map(|line| Some((line.printed(column)?, (column.value)(line.scores)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    lines.iter().any(|line| line.printed(column).as_ref() != Some(&best)).then_some(best)
}

/// The rows of one set and noise level; `unit` is the unit of the noise if there are several levels.
fn summary_block(lines: &[SummaryLine<'_>], unit: Option<NoiseUnit>) -> Markup {
    let best: Vec<Option<String>> = COLUMNS.iter().map(|column| best_of(lines, column)).collect();
    html! {
        @for line in lines {
            @let row = line.scores;
            tr {
                td { (plain(&row.head.group)) }
                td { (row.head.whisker) }
                td {
                    (line.estimator.label())
                    @if line.silent_share > 0.0 { " " small { "without estimate: " (two_digits(100.0 * line.silent_share)) " %" } }
                }
                @if let Some(unit) = unit { td.number { (unit.printed(row.head.noise)) } }
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

fn provenance(data: &RunData, left_out: &[&str]) -> Markup {
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
                dt { "measurement noise" } dd { (run.noise_unit.describe(&run.noise)) }
                dt { "seeds of the noise" } dd { (seeds.join(", ")) }
                @for calibration in &run.calibrations { (calibration_entry(calibration)) }
                (left_out_entry(left_out))
                dt { "data" }
                dd { @for file in data_files() { a href=(file) { (file) } " " } }
            }
            details {
                summary { "Front end, estimators and their settings" }
                dl {
                    dt { "front end" }
                    dd { (run.front_end.name) pre { (format!("{:#}", run.front_end.config)) } }
                    dt { "touch detection" }
                    dd { "thresholds and times, common to all estimators" pre { (format!("{:#}", json!(run.touch))) } }
                    @for estimator in &run.estimators {
                        dt { (estimator.name) }
                        dd { (estimator.about) pre { (format!("{:#}", estimator.config)) } }
                    }
                }
            }
        }
    }
}

/// The figures for which the results hold no data, as an entry of a list.
pub(crate) fn left_out_entry(titles: &[&str]) -> Markup {
    html! { @if !titles.is_empty() { dt { "Left out for lack of data" } dd { (titles.join(", ")) } } }
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
            nis_verdict: None,
            rmse_mean_m: rmse_m,
            rmse_p90_m: rmse_m,
            above_0p5mm: 0.0,
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
    fn verif_the_best_row_is_ranked_and_differs_from_another_row() {
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
