//! Objects of every shape: errors of contact and outline, and coverage of their stated regions.

use anyhow::Context as _;
use evaluation::evaluate::{EvaluateSettings, evaluate};
use indicatif::ProgressBar;
use serde_json::{Value, json};
use testbed::metrics::{Metric, consistency, contour};

use super::{Claim, Context, Evaluation, RECOMMENDED, WHISKERS, in_words};

/// Suite and run of the objects of the standard suite with more noise seeds.
pub(super) const RUN: &str = "objects";

/// Recursive estimators under test.
const ONLINE: &[&str] = &[RECOMMENDED];

/// Hindsight methods under test.
const HINDSIGHT: &[&str] = &["batch-recommended"];

pub(super) const CIRCLES: [&str; 2] = ["circle_15", "circle_50"];
const POLYGONS: [&str; 2] = ["octagon", "rectangle"];

/// Published filter, which assumes a static contact.
const PUBLISHED: &str = "paper-ekf";

/// Fading factors of the filters with a static contact; 1.004 is published.
const FADINGS: [f64; 6] = [1.0, 1.004, 1.01, 1.02, 1.05, 1.1];

/// Settings of the filters with a static contact: the published one, and `ekf` with its sensor model and initialisation.
fn at_rest(fading: f64) -> [(&'static str, Value); 2] {
    [
        (PUBLISHED, json!({"paper": {"fading": fading}})),
        ("ekf", json!({"fading": fading, "motion": {"kind": "resting"}})),
    ]
}

/// Accepted coverage of 95 % ellipses and bands (%).
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
    let object = in_words(group);
    let mut claims = Vec::new();
    for estimator in ONLINE {
        claims.push(length(group, whisker, estimator, contour::CONTACT_RMSE, online_mm));
        claims.push(length(group, whisker, estimator, contour::MEAN, 0.05));
    }
    claims.extend(HINDSIGHT.iter().map(|estimator| length(group, whisker, estimator, contour::CONTACT_RMSE, 0.2)));
    claims.push(Claim::at_least(
        format!("static_{group}_{whisker}"),
        format!("{object}, {whisker} whisker: contact error after 1 s of {PUBLISHED} over that of {RECOMMENDED}"),
        5.0,
        "times",
        move |context| {
            let run = context.run(RUN);
            let of = |estimator| run.summary(group, whisker, estimator)?.get(&contour::CONTACT_RMSE);
            Ok(of(PUBLISHED).zip(of(RECOMMENDED)).map(|(published_m, own_m)| published_m / own_m))
        },
    ));
    claims.push(Claim::at_least(
        format!("best_static_{group}_{whisker}"),
        format!(
            "{object}, {whisker} whisker: contact error after 1 s of {PUBLISHED} or of ekf with a static contact, \
             with the best of several fading factors, over that of {RECOMMENDED}"
        ),
        3.0,
        "times",
        move |context| best_at_rest_over_recommended(context, group, whisker),
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

/// A metric that is a length (mm).
fn length(group: &'static str, whisker: &'static str, estimator: &'static str, metric: Metric, bound_mm: f64) -> Claim {
    let name = metric.name.trim_end_matches("_m");
    Claim::at_most(
        format!("{name}_{group}_{whisker}_{estimator}"),
        format!("{}, {whisker} whisker, {estimator}: {}, median over trials", in_words(group), metric.about),
        bound_mm,
        "mm",
        move |context| {
            let row = context.run(RUN).summary(group, whisker, estimator);
            Ok(row.and_then(|row| row.get(&metric)).map(|value_m| 1e3 * value_m))
        },
    )
}

/// Coverage of ellipses and band.
fn coverage(group: &'static str, whisker: &'static str, estimator: &'static str) -> Vec<Claim> {
    let [least, most] = COVERAGE;
    let mut claims = Vec::new();
    for metric in [consistency::COVERAGE, contour::BAND_COVERAGE] {
        let measured = move |context: &Context| {
            let row = context.run(RUN).summary(group, whisker, estimator);
            Ok(row.and_then(|row| row.get(&metric)).map(|share| 100.0 * share))
        };
        let id = format!("{}_{group}_{whisker}_{estimator}", metric.name);
        let about = format!("{}, {whisker} whisker, {estimator}: {}", in_words(group), metric.about);
        claims.push(Claim::at_least(format!("{id}_least"), about.clone(), least, "%", measured));
        claims.push(Claim::at_most(format!("{id}_most"), about, most, "%", measured));
    }
    claims
}

/// Smallest contact error of the filters with a static contact, over that of the recommended estimator.
fn best_at_rest_over_recommended(context: &Context, group: &str, whisker: &str) -> anyhow::Result<Option<f64>> {
    let Evaluation { run, .. } = context.run(RUN);
    let set = run.sets.iter().find(|set| set.group == group && set.whisker == whisker);
    let traces = &set.with_context(|| format!("{group}, {whisker}: no such set in the run"))?.traces;
    let dataset = context.dataset().only(traces);
    let folder = tempfile::tempdir()?;
    let mut errors_m = Vec::new();
    for fading in FADINGS {
        let config = at_rest(fading);
        let settings = EvaluateSettings {
            name: format!("fading-{fading}"),
            estimators: Some(config.iter().map(|(estimator, _)| (*estimator).into()).collect()),
            config: config.into_iter().map(|(estimator, config)| (estimator.into(), config)).collect(),
            touch: run.touch,
            noise: run.noise[..1].to_vec(),
            seeds: run.seeds.clone(),
            results: folder.path().into(),
            ..Default::default()
        };
        let evaluated = evaluate(std::slice::from_ref(&dataset), &settings, &ProgressBar::hidden())?;
        errors_m.extend(evaluated.summary.iter().filter_map(|row| row.get(&contour::CONTACT_RMSE)));
    }
    let own_m = context.run(RUN).summary(group, whisker, RECOMMENDED).and_then(|row| row.get(&contour::CONTACT_RMSE));
    let least_m = errors_m.into_iter().min_by(f64::total_cmp);
    Ok(least_m.zip(own_m).map(|(least_m, own_m)| least_m / own_m))
}
