//! Datasets: the traces that a command processes.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::read_json;
use trace::{ArrayRecording, ArraySidecar, Role, Sidecar, Suite, Trace};

use crate::front_end::{FRONT_ENDS, FrontEnd};

/// Traces to process and the name of their results.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name of the suite or folder.
    pub name: String,
    /// Folder of the traces and their calibrations.
    pub folder: PathBuf,
    /// Paths of the traces' CSV files, in order.
    pub paths: Vec<PathBuf>,
}

impl Dataset {
    /// Opens the traces of a suite or of a folder. A suite is a JSON file; its traces lie in `folder`, by default `datasets/<suite>`.
    ///
    /// # Errors
    /// If the suite does not parse, or a trace is missing.
    pub fn open(input: &Path, folder: Option<&Path>) -> anyhow::Result<Self> {
        if input.is_dir() {
            if folder.is_some() {
                bail!("{}: is a folder of traces itself; --traces goes with a suite", input.display());
            }
            return Self::of_folder(input);
        }
        if input.extension().is_some_and(|extension| extension == "csv") {
            bail!("{}: is one file, expected a suite (.json) or a folder of traces", input.display());
        }
        let suite = Suite::read(input)?;
        let folder = folder.map_or_else(|| Path::new("datasets").join(&suite.name), Into::into);
        let mut paths = Vec::new();
        for name in suite.names(input)? {
            for path in traces(&folder, &name)? {
                if !path.with_extension("json").is_file() {
                    bail!("{}: no such trace; `whisker simulate {}` makes it", path.display(), input.display());
                }
                paths.push(path);
            }
        }
        Ok(Self { name: suite.name, folder, paths })
    }

    fn of_folder(folder: &Path) -> anyhow::Result<Self> {
        let listed = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
        let mut paths = Vec::new();
        for entry in listed {
            let path = entry.with_context(|| folder.display().to_string())?.path();
            if path.extension().is_some_and(|extension| extension == "csv") && path.with_extension("json").is_file() {
                paths.push(path);
            }
        }
        if paths.is_empty() {
            bail!("{}: no traces, expected pairs of .csv and .json", folder.display());
        }
        paths.sort();
        let folder = folder.to_path_buf();
        let absolute = folder.canonicalize().with_context(|| folder.display().to_string())?;
        let name = absolute.file_name().map_or_else(|| "run".into(), |name| name.to_string_lossy().into_owned());
        Ok(Self { name, folder, paths })
    }

    /// The dataset restricted to traces with these names.
    pub fn only(&self, names: &[String]) -> Self {
        let is_named =
            |path: &&PathBuf| names.iter().any(|name| path.file_stem().is_some_and(|stem| stem == name.as_str()));
        Self { paths: self.paths.iter().filter(is_named).cloned().collect(), ..self.clone() }
    }

    /// Paths of the traces with one role.
    ///
    /// # Errors
    /// If a sidecar cannot be read, or there are none of this role.
    pub fn of_role(&self, role: Role) -> anyhow::Result<Vec<&Path>> {
        let mut paths = Vec::new();
        for path in &self.paths {
            if Sidecar::read(path)?.role == role {
                paths.push(path.as_path());
            }
        }
        if paths.is_empty() {
            bail!("{}: no traces with the role `{}`", self.folder.display(), role.name());
        }
        Ok(paths)
    }

    /// Reads the traces of one role.
    ///
    /// # Errors
    /// If a trace cannot be read, or there are none of this role.
    pub fn read(&self, role: Role) -> anyhow::Result<Vec<Trace>> {
        self.of_role(role)?.into_iter().map(|path| Ok(Trace::read(path)?)).collect()
    }

    /// Default measurement noise to add, see [`FrontEnd::default_noise`]. A dataset with a simulated trace counts as simulated.
    ///
    /// # Errors
    /// If a sidecar cannot be read.
    pub fn default_noise(&self, front_end: &FrontEnd) -> anyhow::Result<f64> {
        let mut noise = 0.0;
        for path in &self.paths {
            noise = front_end.default_noise(&read_json(&path.with_extension("json"))?).max(noise);
        }
        Ok(noise)
    }

    /// Folder of the calibrations of these traces through a front end, see [`calibrations`].
    pub fn calibrations(&self, front_end: &str) -> PathBuf {
        calibrations(&self.folder, front_end)
    }
}

/// Folder of the calibrations of a folder of traces: `calibrations` for the default front end, and a subfolder for any other.
pub fn calibrations(folder: &Path, front_end: &str) -> PathBuf {
    let folder = folder.join("calibrations");
    if front_end == FRONT_ENDS[0].name { folder } else { folder.join(front_end) }
}

/// Paths of the traces of a scene: one, or one per whisker of a recording.
fn traces(folder: &Path, name: &str) -> anyhow::Result<Vec<PathBuf>> {
    let path = folder.join(format!("{name}.json"));
    if !path.is_file() || !ArrayRecording::is_one(&path)? {
        return Ok(vec![path.with_extension("csv")]);
    }
    let whiskers = ArraySidecar::read(&path)?.whiskers;
    Ok(whiskers.iter().map(|whisker| folder.join(format!("{}.csv", whisker.trace))).collect())
}
