//! Suites: which scenes belong together.

use std::path::{Path, PathBuf};

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};

use crate::sidecar::plain_name;

/// A suite's file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Version of the format.
    pub format: u32,
    /// Name: of the folder under `datasets/` and of the run under `results/`.
    pub name: String,
    /// Its scenes.
    pub scenes: Vec<SuiteScene>,
}

/// One scene of a suite.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuiteScene {
    /// The scene's file, relative to the suite's.
    pub scene: PathBuf,
    /// Seeds with which it is run, at least one; without them once, with its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seeds: Option<Vec<u64>>,
}

/// The part of a scene that names its trace; the rest is the generator's business.
#[derive(Deserialize, Serialize)]
struct SceneName {
    name: String,
}

impl Suite {
    /// Reads a suite's file.
    ///
    /// # Errors
    /// [`Error`] names the file and the place.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let suite: Self = read_json(path)?;
        if suite.format != FORMAT {
            return Err(Error::value(path, "format", suite.format, FORMAT));
        }
        if suite.scenes.iter().any(|entry| entry.seeds.as_ref().is_some_and(Vec::is_empty)) {
            return Err(Error::value(path, "scenes.seeds", "an empty list", "at least one seed, or no such key"));
        }
        plain_name(path, "name", &suite.name)?;
        Ok(suite)
    }

    /// Names of what the suite's scenes make, in its order: traces, and recordings of several whiskers. `path` is the suite's own.
    ///
    /// # Errors
    /// [`Error`] where a scene's file does not tell its name.
    pub fn names(&self, path: &Path) -> Result<Vec<String>, Error> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let mut names = Vec::new();
        for entry in &self.scenes {
            let scene = folder.join(&entry.scene);
            let SceneName { name } = read_json(&scene)?;
            plain_name(&scene, "name", &name)?;
            match &entry.seeds {
                None => names.push(name),
                Some(seeds) => names.extend(seeds.iter().map(|seed| format!("{name}_{seed:02}"))),
            }
        }
        Ok(names)
    }
}
