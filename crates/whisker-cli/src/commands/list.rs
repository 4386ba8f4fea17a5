//! `whisker list`: the registries.

use std::process::ExitCode;

use clap::builder::PossibleValuesParser;
use evaluation::plausibility::{SPATIAL_TESTS, TESTS};
use importers::IMPORTERS;
use platform::calibration::logs::LAYOUTS;
use platform::calibration::regression::REGRESSIONS;
use platform::sensor::FORMATS;
use serde_json::{Value, json};
use testbed::front_end::{FRONT_ENDS, SPATIAL_FRONT_ENDS, SpatialFrontEndRow};
use testbed::metrics::METRICS;
use whisker::estimators::ESTIMATORS;
use whisker::events::DETECTORS;
use whisker::sensor::MODELS;
use whisker::space::estimators::SPATIAL_ESTIMATORS;
use whisker::space::sensor::SPATIAL_MODELS;

use super::{print, python};
use crate::claims::claims;

/// Name of the generator's registries, which its own `list` prints.
const GENERATOR: &str = "generator";

/// Largest number of rows whose names the overview lists.
const MOST_NAMES: usize = 40;

/// Width of the overview in characters, and of its first column.
const WIDTH: usize = 100;
const INDENT: usize = 28;

/// List the registries, or the rows of one with their default settings
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Registry whose rows are printed [default: an overview of all]
    #[arg(value_parser = PossibleValuesParser::new(REGISTRIES.iter().map(|registry| registry.name).chain([GENERATOR])))]
    registry: Option<String>,
}

/// A registry as it is printed.
struct Registry {
    /// Name, an argument of the command.
    name: &'static str,
    /// One line about its rows.
    about: &'static str,
    rows: fn() -> Vec<Row>,
}

/// One row of a registry.
struct Row {
    name: String,
    about: String,
    /// Default settings. `None` if the row has no settings.
    defaults: Option<Value>,
}

impl Row {
    fn new(name: impl Into<String>, about: impl Into<String>) -> Self {
        Self { name: name.into(), about: about.into(), defaults: None }
    }

    fn with_defaults(self, defaults: Value) -> Self {
        Self { defaults: Some(defaults), ..self }
    }
}

const REGISTRIES: &[Registry] = &[
    Registry {
        name: "estimators",
        about: "contact estimators: evaluate --estimators, replay --estimator",
        rows: || ESTIMATORS.iter().map(|row| Row::new(row.name, row.about).with_defaults((row.defaults)())).collect(),
    },
    Registry {
        name: "sensor-models",
        about: "contact to expected reading: fit --model",
        rows: || MODELS.iter().map(|row| Row::new(row.kind, row.about).with_defaults((row.defaults)())).collect(),
    },
    Registry {
        name: "space-estimators",
        about: "contact estimators for traces in space: evaluate --estimators",
        rows: || {
            SPATIAL_ESTIMATORS.iter().map(|row| Row::new(row.name, row.about).with_defaults(row.defaults())).collect()
        },
    },
    Registry {
        name: "space-sensor-models",
        about: "contact in space to expected moments: fit --model",
        rows: || {
            SPATIAL_MODELS.iter().map(|row| Row::new(row.kind, row.about).with_defaults((row.defaults)())).collect()
        },
    },
    Registry {
        name: "detectors",
        about: "contact detectors: `touch` of evaluate --config",
        rows: || {
            DETECTORS.iter().map(|row| Row::new(row.name, row.about).with_defaults(json!((row.config)()))).collect()
        },
    },
    Registry {
        name: "front-ends",
        about: "sensor between moment and reading: --front-end",
        rows: || FRONT_ENDS.iter().map(|row| Row::new(row.name, row.about).with_defaults((row.defaults)())).collect(),
    },
    Registry {
        name: "space-front-ends",
        about: "sensor between loads and reading of traces in space",
        rows: || {
            let row = |row: &SpatialFrontEndRow| Row::new(row.name, row.about).with_defaults((row.defaults)());
            SPATIAL_FRONT_ENDS.iter().map(row).collect()
        },
    },
    Registry {
        name: "importers",
        about: "formats of recordings of real sensors: import",
        rows: || IMPORTERS.iter().map(|row| Row::new(row.name, row.about)).collect(),
    },
    Registry {
        name: "regressions",
        about: "distance regressions: platform fit --regression",
        rows: || REGRESSIONS.iter().map(|row| Row::new(row.name, row.about)).collect(),
    },
    Registry {
        name: "log-layouts",
        about: "layouts of magnetometer logs, recognised by platform fit",
        rows: || LAYOUTS.iter().map(|row| Row::new(row.name, row.about)).collect(),
    },
    Registry {
        name: "magnetometers",
        about: "line formats of magnetometers: platform run --format",
        rows: || FORMATS.iter().map(|row| Row::new(row.name, row.about)).collect(),
    },
    Registry {
        name: "metrics",
        about: "columns of trials.csv and summary.csv",
        rows: || {
            let about = |row: &testbed::metrics::Metric| format!("{} ({} over trials)", row.about, row.summary.name());
            METRICS.iter().map(|row| Row::new(row.name, about(row))).collect()
        },
    },
    Registry {
        name: "plausibility-tests",
        about: "tests of traces for errors of unit, sign, frame and rate: check",
        rows: || TESTS.iter().map(|row| Row::new(row.name, row.about)).collect(),
    },
    Registry {
        name: "spatial-plausibility-tests",
        about: "tests of traces in space for errors of unit, sign, frame and rate: check",
        rows: || SPATIAL_TESTS.iter().map(|row| Row::new(row.name, row.about)).collect(),
    },
    Registry {
        name: "figures",
        about: "figures of an evaluated run",
        rows: || report::figures().map(|(name, title)| Row::new(name, title)).collect(),
    },
    Registry {
        name: "space-figures",
        about: "figures of an evaluated run in space",
        rows: || report::space_figures().map(|(name, title)| Row::new(name, title)).collect(),
    },
    Registry {
        name: "physics-figures",
        about: "figures of the physics study",
        rows: || report::physics_figures().map(|(name, title)| Row::new(name, title)).collect(),
    },
    Registry {
        name: "claims",
        about: "claims of the documentation, measured by reproduce",
        rows: || claims().into_iter().map(|row| Row::new(row.id, row.claim)).collect(),
    },
];

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match arguments.registry.as_deref() {
        None => print(&overview())?,
        Some(GENERATOR) => return python::run(python::generator(["list"])?),
        Some(name) => {
            let registry = REGISTRIES.iter().find(|registry| registry.name == name);
            print(&registry.map(listing).unwrap_or_default())?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Every registry with the names of its rows.
fn overview() -> String {
    let mut text = String::new();
    for registry in REGISTRIES {
        let names: Vec<String> = (registry.rows)().into_iter().map(|row| row.name).collect();
        text += &format!("{:<INDENT$}{}\n", registry.name, registry.about);
        text +=
            &if names.len() > MOST_NAMES { format!("{:<INDENT$}{} rows\n", "", names.len()) } else { wrapped(&names) };
    }
    text += &format!("{GENERATOR:<INDENT$}whiskers, shapes and motions of scenes\n");
    text + "\n`whisker list REGISTRY` describes each row of a registry with its default settings.\n"
}

/// Names separated by commas, in indented lines of at most [`WIDTH`] characters.
fn wrapped(names: &[String]) -> String {
    let mut lines = vec![String::new()];
    for (place, name) in names.iter().enumerate() {
        let word = if place + 1 < names.len() { format!("{name},") } else { name.clone() };
        let line = lines.last_mut().expect("there is a line");
        if !line.is_empty() && INDENT + line.len() + 1 + word.len() > WIDTH {
            lines.push(word);
        } else {
            *line = if line.is_empty() { word } else { format!("{line} {word}") };
        }
    }
    lines.iter().map(|line| format!("{:<INDENT$}{line}\n", "")).collect()
}

/// Every row of a registry with its default settings.
fn listing(registry: &Registry) -> String {
    let rows = (registry.rows)();
    let width = rows.iter().map(|row| row.name.len()).max().unwrap_or(0) + 2;
    let line = |row: &Row| {
        let defaults = row.defaults.as_ref().map_or_else(String::new, |defaults| format!("{:<width$}{defaults}\n", ""));
        format!("{:<width$}{}\n{defaults}", row.name, row.about)
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_overview_names_every_registry_in_short_lines() {
        let text = overview();
        for registry in REGISTRIES {
            let entry = format!("{} ", registry.name);
            assert!(text.lines().any(|line| line.starts_with(&entry)), "{}", registry.name);
        }
        assert!(text.lines().count() < 60, "{}", text.lines().count());
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
    }

    #[test]
    fn verif_a_listing_has_every_row() {
        for registry in REGISTRIES {
            let (text, rows) = (listing(registry), (registry.rows)());
            assert!(!rows.is_empty() && rows.iter().all(|row| text.contains(&row.name)), "{}", registry.name);
        }
    }
}
