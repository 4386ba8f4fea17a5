//! `whisker list`: the registries.

use std::process::ExitCode;

use importers::IMPORTERS;
use platform::calibration::logs::LAYOUTS;
use platform::calibration::regression::REGRESSIONS;
use platform::sensor::FORMATS;
use serde_json::{Value, json};
use testbed::front_end::FRONT_ENDS;
use testbed::metrics::{METRICS, Metric};
use whisker::estimators::ESTIMATORS;
use whisker::events::DETECTORS;
use whisker::sensor::MODELS;

use super::{print, python};
use crate::claims::claims;

/// Print the registries: estimators, sensor models, detectors, front ends, importers, magnetometers, metrics, figures, claims, and the generator's
#[derive(clap::Args)]
pub(super) struct Arguments {}

pub(super) fn run(_: &Arguments) -> anyhow::Result<ExitCode> {
    let mut sections = Vec::new();
    let with_defaults =
        |name: &str, about: &str, defaults: Value| format!("  {name:<28} {about}\n  {:<28} {defaults}\n", "");
    let estimators = ESTIMATORS.iter().map(|row| with_defaults(row.name, row.about, (row.defaults)()));
    sections.push(("estimators", estimators.collect::<String>()));
    let models = MODELS.iter().map(|row| with_defaults(row.kind, row.about, (row.defaults)()));
    sections.push(("sensor models", models.collect()));
    let detectors = DETECTORS.iter().map(|row| with_defaults(row.name, row.about, json!((row.config)())));
    sections.push(("detectors of contacts", detectors.collect()));
    let front_ends = FRONT_ENDS.iter().map(|row| with_defaults(row.name, row.about, (row.defaults)()));
    sections.push(("front ends", front_ends.collect()));
    sections.push(("importers", IMPORTERS.iter().map(|row| format!("  {:<28} {}\n", row.name, row.about)).collect()));
    let regressions = REGRESSIONS.iter().map(|row| format!("  {:<28} {}\n", row.name, row.about));
    sections.push(("regressions of the platform", regressions.collect()));
    let layouts = LAYOUTS.iter().map(|row| format!("  {:<28} {}\n", row.name, row.about));
    sections.push(("layouts of the platform's logs", layouts.collect()));
    let magnetometers = FORMATS.iter().map(|row| format!("  {:<28} {}\n", row.name, row.about));
    sections.push(("magnetometers of the platform", magnetometers.collect()));
    let metric = |row: &Metric| format!("  {:<28} {} ({} over trials)\n", row.name, row.about, row.summary.name());
    sections.push(("metrics", METRICS.iter().map(metric).collect()));
    let figure = |(name, title)| format!("  {name:<28} {title}\n");
    sections.push(("figures", report::figures().map(figure).collect()));
    sections.push(("figures of the physics study", report::physics_figures().map(figure).collect()));
    sections.push(("claims", claims().iter().map(|row| format!("  {:<36} {}\n", row.id, row.claim)).collect()));
    let text: String = sections.iter().map(|(name, rows)| format!("{name}\n{rows}\n")).collect();
    print(&text)?;
    match python::generator(["list"]) {
        Ok(command) => python::run(command),
        Err(error) => {
            eprintln!("whisker presets, shapes and motions are the generator's: {error:#}");
            Ok(ExitCode::SUCCESS)
        }
    }
}
