//! A finished run of the same name, which is replaced only by a run with the same settings.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::path::Path;

use anyhow::{anyhow, bail};
use testbed::encoders::Encoders;
use testbed::map::MapConfig;
use testbed::results::files::RUN;
use testbed::results::{Run, RunEstimator};

/// Key in the settings of a program that identifies its code.
const CODE: &str = "files_sha256";

/// Number of names that a difference shows.
const SHOWN: usize = 4;

/// Checks that a run may replace the finished run in a folder: the settings are the same, and only traces, calibrations
/// or code have changed.
///
/// # Errors
/// If the settings differ, or the finished run cannot be read.
pub(super) fn check_replaceable(folder: &Path, run: &Run) -> anyhow::Result<()> {
    let path = RUN.path(folder);
    if !path.is_file() {
        return Ok(());
    }
    let old = Run::read(&path).map_err(|error| anyhow!("{error}"));
    check_same(folder, old.map(|old| differences(&old, run)))
}

/// Checks that a finished run has no differences in settings.
///
/// # Errors
/// If it has some, or they are not known because the run cannot be read.
pub(crate) fn check_same(folder: &Path, differences: anyhow::Result<Vec<String>>) -> anyhow::Result<()> {
    let choice = "give another --name, or --force to replace it";
    match differences {
        Err(error) => bail!("{}: holds a finished run that cannot be compared ({error}); {choice}", folder.display()),
        Ok(found) if found.is_empty() => Ok(()),
        Ok(found) => {
            bail!("{}: holds a finished run with other settings ({}); {choice}", folder.display(), found.join("; "))
        }
    }
}

/// Difference of a setting, if there is one: the value of the finished run and that of the new one.
pub(crate) fn difference(key: &str, old: &str, new: &str) -> Option<String> {
    (old != new).then(|| format!("{key}: {old} there, {new} here"))
}

/// Differences in settings.
fn differences(old: &Run, new: &Run) -> Vec<String> {
    let mut found = Vec::new();
    let mut compare = |key: &str, old: String, new: String| found.extend(difference(key, &old, &new));
    compare("noise", text(&old.noise), text(&new.noise));
    compare("noise unit", text(&old.noise_unit), text(&new.noise_unit));
    compare("seeds", seeds(&old.seeds), seeds(&new.seeds));
    compare("front end", front_end(old), front_end(new));
    compare("touch", text(&old.touch), text(&new.touch));
    compare("encoders and maps", recordings(old), recordings(new));
    let names = |run: &Run| run.estimators.iter().map(|estimator| estimator.name.clone()).collect();
    found.extend(of_lists("estimators", names(old), names(new)));
    let traces = |run: &Run| run.sets.iter().flat_map(|set| set.traces.clone()).collect();
    found.extend(of_lists("traces", traces(old), traces(new)));
    for one in &old.estimators {
        let other = new.estimators.iter().find(|other| other.name == one.name);
        if other.is_some_and(|other| settings(one) != settings(other)) {
            found.push(format!("settings of `{}`", one.name));
        }
    }
    found
}

fn text(value: &impl Debug) -> String {
    format!("{value:?}")
}

/// Seeds in short form: usually 1 to a number.
pub(crate) fn seeds(seeds: &[u64]) -> String {
    match seeds {
        [first, .., last] if last - first + 1 == seeds.len() as u64 => format!("{first} to {last}"),
        _ => text(&seeds),
    }
}

fn front_end(run: &Run) -> String {
    format!("{} {}", run.front_end.name, run.front_end.config)
}

fn recordings(run: &Run) -> String {
    let of_recordings: Vec<(&str, Encoders, MapConfig)> =
        run.recordings.iter().map(|recording| (recording.name.as_str(), recording.encoders, recording.map)).collect();
    text(&of_recordings)
}

/// Settings of an estimator. The code of a program is not part of them: a program is evaluated again when it has changed.
fn settings(estimator: &RunEstimator) -> serde_json::Value {
    let mut config = estimator.config.clone();
    if let Some(keys) = config.as_object_mut() {
        keys.shift_remove(CODE);
    }
    config
}

/// Difference of two lists of names, if there is one.
pub(crate) fn of_lists(key: &str, old: BTreeSet<String>, new: BTreeSet<String>) -> Option<String> {
    let only = |one: &BTreeSet<String>, other: &BTreeSet<String>| {
        let names: Vec<&str> = one.difference(other).map(String::as_str).collect();
        match names.len() {
            0 => "none".into(),
            count if count > SHOWN => format!("{} and {} more", names[..SHOWN].join(", "), count - SHOWN),
            _ => names.join(", "),
        }
    };
    (old != new).then(|| format!("{key}: {} only there, {} only here", only(&old, &new), only(&new, &old)))
}
