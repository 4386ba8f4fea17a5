//! Objects of every shape: how far the contact that an estimator follows, and the outline that it makes of them, lie from the truth, and whether it knows.

use anyhow::Context as _;
use indicatif::ProgressBar;
use serde_json::json;

use super::{Claim, Context, RECOMMENDED, WHISKERS};
use crate::dataset::Dataset;
use crate::evaluate::{EvaluateSettings, evaluate};
use crate::metrics::{Metric, consistency, contour};
use crate::results::{SummaryRow, read_scores};

/// Suite and run: the objects of the standard suite, under more seeds of the measurement noise.
pub(super) const RUN: &str = "objects";

/// Estimators that are judged as they go along.
const ONLINE: &[&str] = &[RECOMMENDED];

/// Estimators that are judged with hindsight.
const HINDSIGHT: &[&str] = &["batch-recommended"];

const CIRCLES: [&str; 2] = ["circle_15", "circle_50"];
const POLYGONS: [&str; 2] = ["octagon", "rectangle"];

/// The published filter, which takes the contact to rest, and how fast it forgets: as published, and what might suit an object better.
const STATIC: &str = "paper-ekf";
const PUBLISHED_FADING: f64 = 1.004;
const FADINGS: [f64; 6] = [1.0, PUBLISHED_FADING, 1.01, 1.02, 1.05, 1.1];

/// Share of steps and of outline that a 95 % ellipse or band may hold, in per cent.
const COVERAGE: [f64; 2] = [85.0, 98.0];

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for whisker in WHISKERS {
        for group in CIRCLES {
            claims.extend(circle(group, whisker));
        }
        for group in POLYGONS {
            claims.extend(polygon(group, whisker));
        }
        for group in CIRCLES.into_iter().chain(POLYGONS) {
            claims.extend(ONLINE.iter().flat_map(|estimator| coverage(group, whisker, estimator)));
        }
    }
    claims
}

fn circle(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let online_mm = if (group, whisker) == ("circle_50", "curved") { 0.4 } else { 0.3 };
    let mut claims = Vec::new();
    for estimator in ONLINE {
        claims.push(length(group, whisker, estimator, contour::CONTACT_RMSE, online_mm));
        claims.push(length(group, whisker, estimator, contour::MEAN, 0.05));
    }
    claims.extend(HINDSIGHT.iter().map(|estimator| length(group, whisker, estimator, contour::CONTACT_RMSE, 0.2)));
    let about = format!("{group}, {whisker} whisker: contact error after 1 s of {STATIC}");
    claims.push(Claim::at_least(
        format!("static_{group}_{whisker}"),
        format!("{about} as published over that of {RECOMMENDED}"),
        5.0,
        "times",
        move |context| over_recommended(context, group, whisker, &[PUBLISHED_FADING]),
    ));
    claims.push(Claim::at_least(
        format!("best_static_{group}_{whisker}"),
        format!("{about} under the best of several fadings over that of {RECOMMENDED}"),
        3.0,
        "times",
        move |context| over_recommended(context, group, whisker, &FADINGS),
    ));
    claims
}

fn polygon(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let hindsight = [(contour::CONTACT_RMSE, 1.0), (contour::MEAN, 0.15), (contour::P95, 0.5)];
    let online = [(contour::LATER_CONTACT_RMSE, 1.5), (contour::LATER_MEAN, 0.2), (contour::LATER_P95, 0.7)];
    let mut claims = Vec::new();
    for (estimators, bounds) in [(HINDSIGHT, hindsight), (ONLINE, online)] {
        for estimator in estimators {
            claims
                .extend(bounds.iter().map(|(metric, bound_mm)| length(group, whisker, estimator, *metric, *bound_mm)));
        }
    }
    claims
}

/// A length, in mm.
fn length(group: &'static str, whisker: &'static str, estimator: &'static str, metric: Metric, bound_mm: f64) -> Claim {
    let name = metric.name.trim_end_matches("_m");
    Claim::at_most(
        format!("{name}_{group}_{whisker}_{estimator}"),
        format!("{group}, {whisker} whisker, {estimator}: {}, median over trials", metric.about),
        bound_mm,
        "mm",
        move |context| {
            let row = context.run(RUN).summary(group, whisker, estimator);
            Ok(row.and_then(|row| row.get(&metric)).map(|value_m| 1e3 * value_m))
        },
    )
}

/// Whether ellipses and band hold the truth as often as they should.
fn coverage(group: &'static str, whisker: &'static str, estimator: &'static str) -> Vec<Claim> {
    let [least, most] = COVERAGE;
    let mut claims = Vec::new();
    for metric in [consistency::COVERAGE, contour::BAND_COVERAGE] {
        let measured = move |context: &Context| {
            let row = context.run(RUN).summary(group, whisker, estimator);
            Ok(row.and_then(|row| row.get(&metric)).map(|share| 100.0 * share))
        };
        let id = format!("{}_{group}_{whisker}_{estimator}", metric.name);
        let about = format!("{group}, {whisker} whisker, {estimator}: {}", metric.about);
        claims.push(Claim::at_least(format!("{id}_least"), about.clone(), least, "%", measured));
        claims.push(Claim::at_most(format!("{id}_most"), about, most, "%", measured));
    }
    claims
}

/// The contact error of the filter that takes the contact to rest, at the best of some fadings, over that of the recommended estimator.
fn over_recommended(context: &Context, group: &str, whisker: &str, fadings: &[f64]) -> anyhow::Result<Option<f64>> {
    let of_run = |rows: &[SummaryRow], estimator: &str| {
        let is_meant = |row: &&SummaryRow| {
            row.head.group == group && row.head.whisker == whisker && row.head.estimator == estimator
        };
        rows.iter().find(is_meant)?.get(&contour::CONTACT_RMSE)
    };
    let run = &context.run(RUN).run;
    let set = run.sets.iter().find(|set| set.group == group && set.whisker == whisker);
    let traces = &set.with_context(|| format!("{group}, {whisker}: no such set in the run"))?.traces;
    let is_of_set = |path: &&std::path::PathBuf| {
        traces.iter().any(|name| path.file_stem().is_some_and(|stem| stem == name.as_str()))
    };
    let paths = context.dataset.paths.iter().filter(is_of_set).cloned().collect();
    let dataset = Dataset { paths, ..context.dataset.clone() };
    let folder = tempfile::tempdir()?;
    let mut errors_m = Vec::new();
    for fading in fadings {
        let settings = EvaluateSettings {
            name: format!("fading-{fading}"),
            estimators: Some(vec![STATIC.into()]),
            programs: Vec::new(),
            config: [(STATIC.into(), json!({"paper": {"fading": fading}}))].into(),
            touch: run.touch,
            noise: run.noise[..1].to_vec(),
            seeds: run.seeds.clone(),
            starts: Default::default(),
            calibrations: None,
            results: folder.path().into(),
        };
        let evaluated = evaluate(std::slice::from_ref(&dataset), &settings, &ProgressBar::hidden())?;
        errors_m.extend(of_run(&read_scores(&evaluated.folder.join("summary.csv"))?, STATIC));
    }
    let recommended_m = of_run(&context.run(RUN).summary, RECOMMENDED);
    Ok(errors_m
        .into_iter()
        .min_by(f64::total_cmp)
        .zip(recommended_m)
        .map(|(error_m, recommended_m)| error_m / recommended_m))
}
