//! Participants of an evaluation in space: registered estimators and external programs.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use serde_json::Value;
use testbed::protocol::space::SPATIAL_PROTOCOL;
use testbed::settings::{SettingsOf, check_configured, merged_of};
use testbed::space::replay::{SpatialReplay, registered, replay};
use whisker::space::estimators::{SPATIAL_ESTIMATORS, SpatialEstimatorRow, spatial_estimator};

use super::evaluate::SpatialEvaluateSettings;
use crate::distinct::check_distinct;
use crate::participant::{Program, SpatialTask};

/// Participant of an evaluation in space.
pub(super) enum Participant {
    /// Registered estimator with its settings.
    Registered(&'static SpatialEstimatorRow, Value),
    /// External program.
    Program(Program),
}

impl Participant {
    /// Name, which identifies its rows and files.
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Registered(row, _) => row.name,
            Self::Program(program) => program.name(),
        }
    }

    /// Settings for the record of a run.
    pub(super) fn config(&self) -> Value {
        match self {
            Self::Registered(_, config) => config.clone(),
            Self::Program(program) => program.config(SPATIAL_PROTOCOL),
        }
    }

    /// Replays one trial.
    ///
    /// # Errors
    /// If the settings of an estimator are invalid, or a program does not start.
    pub(super) fn replay(&self, task: &SpatialTask<'_>) -> anyhow::Result<SpatialReplay> {
        match self {
            Self::Registered(row, config) => replay(row, config, task.knowledge, task.samples),
            Self::Program(program) => program.replay_in_space(task),
        }
    }
}

/// The participants that the settings name, in order.
///
/// # Errors
/// If an estimator is unknown, settings are given for one that does not participate, or two participants have the same name.
pub(super) fn participants(settings: &SpatialEvaluateSettings) -> anyhow::Result<Vec<Participant>> {
    let rows = match &settings.estimators {
        None => SPATIAL_ESTIMATORS.iter().collect(),
        Some(names) => names.iter().map(|name| registered(name)).collect::<anyhow::Result<Vec<_>>>()?,
    };
    let is_known = |name: &String| registered(name).map(drop).with_context(|| SettingsOf(name.clone()));
    settings.config.keys().try_for_each(is_known)?;
    let names: Vec<String> = rows.iter().map(|row| row.name.to_owned()).collect();
    check_configured(settings.config.keys(), &names)?;
    check_distinct("estimator", names.into_iter())?;
    check_distinct("program", settings.programs.iter().map(|program| program.name().to_owned()))?;
    let mut found = Vec::new();
    for row in rows {
        let config = match settings.config.get(row.name) {
            Some(own) => merged_of(row.name, row.defaults(), own)?,
            None => row.defaults(),
        };
        found.push(Participant::Registered(row, config));
    }
    for program in &settings.programs {
        if spatial_estimator(program.name()).is_some() {
            let name = program.name();
            bail!("--exec: `{name}` is the name of a registered estimator; give another by --exec name=command");
        }
        found.push(Participant::Program(program.clone()));
    }
    Ok(found)
}

/// Names and settings of the participants, for the record of a run.
///
/// # Errors
/// As [`participants`].
pub(super) fn described(settings: &SpatialEvaluateSettings) -> anyhow::Result<BTreeMap<String, Value>> {
    Ok(participants(settings)?.into_iter().map(|one| (one.name().to_owned(), one.config())).collect())
}
