//! Traces that a calibration was fitted to, compared with the present traces.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::sha256_of_file;
use trace::{FittedTraces, Role, TraceData, data_sha256};

use crate::dataset::{CALIBRATIONS, Dataset};

/// Checks that there is a calibration, which `whisker fit` makes from the traces in the folder that contains `calibrations`, if
/// there is one. `other` states how to name another calibration.
///
/// # Errors
/// If there is no such file.
pub fn check_is_calibration(path: &Path, folder: Option<&Path>, other: &str) -> anyhow::Result<()> {
    if path.is_file() {
        return Ok(());
    }
    if path.is_dir() {
        bail!("{}: found a folder, expected a calibration (.json)", path.display());
    }
    if let Some(file) = path.parent().filter(|parent| parent.is_file()) {
        bail!("{}: found a file, expected the folder of the calibrations", file.display());
    }
    let folder = folder.map_or_else(String::new, |folder| {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        format!(" {}", folder.display())
    });
    bail!(
        "{}: no such calibration; make it from calibration traces by `whisker fit{folder}`, with the same --front-end, or name {other}",
        path.display()
    )
}

/// Checks that the traces a calibration was fitted to have not changed since. They lie in the folder that contains
/// `calibrations`. A calibration without any of its traces, for example a copy, is accepted.
///
/// # Errors
/// If a trace is missing, damaged, or other than at the fit. `path` is the path of the calibration.
pub fn check_fitted_traces<'a>(path: &Path, calibration: impl Into<FittedTraces<'a>>) -> anyhow::Result<()> {
    let calibration = calibration.into();
    let Some(folder) = folder_of_traces(path)? else { return Ok(()) };
    let csv = |name: &String| folder.join(name).with_extension("csv");
    let (found, missing): (Vec<&String>, Vec<&String>) =
        calibration.traces.iter().partition(|name| csv(name).with_extension("json").is_file());
    if found.is_empty() {
        return Ok(());
    }
    let remedy = format!("run `whisker fit {}`, or on its suite, with the options of the first fit", folder.display());
    if let Some(name) = missing.first() {
        bail!("{}: traces: {} is missing, to which it was fitted; {remedy}", path.display(), csv(name).display());
    }
    let mut present = Vec::new();
    for name in found {
        let data = (calibration.read)(&csv(name)).map_err(Into::into).and_then(|data| unchanged(&folder, data));
        present.push(data.with_context(|| format!("{}: traces", path.display()))?);
    }
    if data_sha256(present) != calibration.data_sha256 {
        bail!(
            "{}: data_sha256: found a fit to other data than those of its traces in {} now: they have changed, or \
            another version of whisker made the fit; {remedy}",
            path.display(),
            folder.display()
        );
    }
    Ok(())
}

/// Checks that a calibration was fitted to all calibration traces of its whisker in the dataset that it belongs to.
///
/// # Errors
/// If a sidecar cannot be read, or the calibration was not fitted to a trace. `path` is the path of the calibration.
pub fn check_fitted_to_all<'a>(
    path: &Path,
    calibration: impl Into<FittedTraces<'a>>,
    dataset: &Dataset,
) -> anyhow::Result<()> {
    let calibration = calibration.into();
    for csv in &dataset.paths {
        let TraceData { name, role, whisker, .. } = (calibration.read)(csv)?;
        if role == Role::Calibration && whisker == calibration.whisker && !calibration.traces.contains(&name) {
            bail!(
                "{}: traces: was not fitted to {}; run `whisker fit {}` with the options of the first fit",
                path.display(),
                csv.display(),
                dataset.input.display()
            );
        }
    }
    Ok(())
}

/// Folder that contains the folder `calibrations` of this file. `None` if there is no such folder.
fn folder_of_traces(path: &Path) -> anyhow::Result<Option<PathBuf>> {
    if let Some(folder) = above_calibrations(path).filter(|folder| !folder.as_os_str().is_empty()) {
        return Ok(Some(folder.into()));
    }
    let absolute = path.canonicalize().with_context(|| path.display().to_string())?;
    Ok(above_calibrations(&absolute).map(Path::to_path_buf))
}

/// Folder that contains the folder `calibrations` in this path, empty if the path begins with `calibrations`.
pub fn above_calibrations(path: &Path) -> Option<&Path> {
    path.ancestors().find(|folder| folder.file_name().is_some_and(|name| name == CALIBRATIONS))?.parent()
}

/// Hash of the data of a trace in a folder, whose files have the hashes that its sidecar states.
fn unchanged(folder: &Path, data: TraceData) -> anyhow::Result<String> {
    for (name, expected) in &data.files {
        let file = folder.join(name);
        let found = sha256_of_file(&file)?;
        if found != *expected {
            bail!("{}: sha256: found {found}, expected {expected}, as stated by its sidecar", file.display());
        }
    }
    Ok(data.sha256)
}
