//! Results that the repository keeps in `results/reference/`, because the documentation shows them.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::failure::{Failure, Outcome};
use crate::repository::root;

const FOLDER: &str = "results/reference";

/// Copies files of `results/<name>/` to `results/reference/<name>/`, without their subfolders.
pub(crate) fn keep(name: &str, files: &[&str]) -> Outcome {
    let (results, kept) = (root().join("results").join(name), root().join(FOLDER).join(name));
    files.iter().try_for_each(|file| copy(&results.join(file), &kept))
}

fn copy(file: &Path, folder: &Path) -> Outcome {
    let kept = folder.join(file.file_name().unwrap_or_default());
    let unfinished = kept.with_extension("partial");
    fs::create_dir_all(folder)
        .and_then(|()| fs::copy(file, &unfinished))
        .and_then(|_| fs::rename(&unfinished, &kept))
        .map_err(|error| Failure::new(format!("{}: cannot be copied to {}: {error}", file.display(), kept.display())))
}

/// Table of measured values.
const TABLE: &str = "results/reference/measured.csv";

/// A measured value.
pub(crate) struct Measured {
    /// End of its name.
    pub(crate) id: &'static str,
    pub(crate) about: String,
    pub(crate) value: f64,
    pub(crate) unit: &'static str,
}

impl Measured {
    pub(crate) fn new(id: &'static str, about: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { id, about: about.into(), value, unit }
    }
}

/// Replaces the rows of the table whose names begin with `prefix` by these, measured by `command`.
pub(crate) fn write_measured(prefix: &str, command: &str, rows: &[Measured]) -> Outcome {
    let path = root().join(TABLE);
    let failed = |error: std::io::Error| Failure::new(format!("{}: {error}", path.display()));
    let text = fs::read_to_string(&path).map_err(failed)?;
    let mut kept: Vec<String> = text.lines().filter(|line| !line.starts_with(prefix)).map(Into::into).collect();
    let commit = commit()?;
    kept.extend(rows.iter().map(|Measured { id, about, value, unit }| {
        format!(r#"{prefix}{id},"{about}",{value:.3},{unit},{command},{commit}"#)
    }));
    let unfinished = path.with_extension("partial");
    fs::write(&unfinished, kept.join("\n") + "\n").and_then(|()| fs::rename(&unfinished, &path)).map_err(failed)
}

/// Commit of the working copy, seven digits.
fn commit() -> Result<String, Failure> {
    let output = Command::new("git").args(["rev-parse", "--short=7", "HEAD"]).current_dir(root()).output();
    let output = output.map_err(|error| Failure::new(format!("git: {error}")))?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().chars().take(7).collect())
}
