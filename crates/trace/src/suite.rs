//! Suites: lists of scenes that are generated and evaluated together.

use std::path::{Path, PathBuf};

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};

use crate::sidecar::plain_name;

/// Suite file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Format version.
    pub format: u32,
    /// Name of the folder under `datasets/` and of the run under `results/`.
    pub name: String,
    /// Scenes in order.
    pub scenes: Vec<SuiteScene>,
}

/// Entry of a suite.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuiteScene {
    /// Path of the scene file, relative to the suite file.
    pub scene: PathBuf,
    /// Seeds with which the scene is run, at least one. `None`: the scene is run once, with its own seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seeds: Option<Vec<u64>>,
}

/// Part of a scene file that determines the name of its trace. The generator interprets the rest.
#[derive(Deserialize, Serialize)]
struct SceneName {
    name: String,
}

impl Suite {
    /// Reads a suite file.
    ///
    /// # Errors
    /// [`Error`] with file and place.
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

    /// Names of the traces and array recordings that the suite's scenes generate, in suite order. `path` is the path of
    /// the suite file.
    ///
    /// # Errors
    /// [`Error`] if a scene file is missing or has no valid name.
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
