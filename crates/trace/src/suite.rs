//! Suites: scenes that are generated and evaluated together.

use std::path::{Path, PathBuf};

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::sidecar::plain_name;

/// Suite file, which either lists its scenes or has them drawn by the generator.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Format version.
    pub format: u32,
    /// Name of the folder under `datasets/` and of the run under `results/`.
    pub name: String,
    /// Scenes in order. Empty in a random suite.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scenes: Vec<SuiteScene>,
    /// Seed and numbers of a random suite. `None` if the scenes are listed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub random: Option<RandomDraws>,
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

/// Seed of a random suite, and the numbers of what is drawn from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RandomDraws {
    /// Seed.
    pub seed: u64,
    /// Number of sets, each one whisker on one object.
    pub sets: u64,
    /// Traces of each set. `None` for the generator's default, [`Self::DEFAULT_TRACES`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traces: Option<u64>,
    /// Number of random whiskers, beside the presets. `None` for the generator's default, [`Self::DEFAULT_WHISKERS`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub whiskers: Option<u64>,
    /// Whether the scenes are scenes in space, whose whiskers are the presets.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub in_space: bool,
    /// Whether the contacts are without friction, on convex objects at rest. `None` for the generator's default, `true`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ideal: Option<bool>,
}

impl RandomDraws {
    /// Default number of traces of each set.
    pub const DEFAULT_TRACES: u64 = 5;

    /// Default number of random whiskers.
    pub const DEFAULT_WHISKERS: u64 = 8;

    /// Largest numbers of sets, and of traces of a set.
    const MOST: [u64; 2] = [1_000_000, 99];

    /// Number of traces of each set.
    pub fn traces(&self) -> u64 {
        self.traces.unwrap_or(Self::DEFAULT_TRACES)
    }

    /// Number of random whiskers.
    pub fn whiskers(&self) -> u64 {
        self.whiskers.unwrap_or(Self::DEFAULT_WHISKERS)
    }
}

/// One run of a scene: it generates a trace, or an array recording.
#[derive(Clone, Debug, PartialEq)]
pub struct SuiteRun {
    /// Name of the trace or recording.
    pub name: String,
    /// Path of the scene file.
    pub path: PathBuf,
    /// Contents of the scene file, with the seed of this run. The generator interprets them.
    pub scene: Value,
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
        match (&suite.random, suite.scenes.is_empty()) {
            (Some(_), false) => return Err(Error::value(path, "random", "this key beside `scenes`", "one of the two")),
            (None, true) => return Err(Error::value(path, "scenes", "no scene", "at least one, or the key `random`")),
            _ => {}
        }
        if let Some(random) = &suite.random {
            let numbers = [("random.sets", random.sets), ("random.traces", random.traces())];
            for ((key, found), most) in numbers.into_iter().zip(RandomDraws::MOST) {
                if !(1..=most).contains(&found) {
                    return Err(Error::value(path, key, found, format!("1 to {most}")));
                }
            }
            if random.in_space && random.ideal == Some(false) {
                return Err(Error::value(path, "random.ideal", "false with `in_space`", "true"));
            }
        }
        if suite.scenes.iter().any(|entry| entry.seeds.as_ref().is_some_and(Vec::is_empty)) {
            return Err(Error::value(path, "scenes.seeds", "an empty list", "at least one seed, or no such key"));
        }
        plain_name(path, "name", &suite.name)?;
        Ok(suite)
    }

    /// Runs of the scenes that the suite lists, in suite order. `path` is the path of the suite file.
    ///
    /// # Errors
    /// [`Error`] if a scene file is missing or has no valid name.
    pub fn runs(&self, path: &Path) -> Result<Vec<SuiteRun>, Error> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let mut runs = Vec::new();
        for entry in &self.scenes {
            let path = folder.join(&entry.scene);
            let scene: Value = read_json(&path)?;
            let Some(name) = scene.get("name").and_then(Value::as_str).map(str::to_owned) else {
                let found = scene.get("name").map_or_else(|| "nothing".into(), Value::to_string);
                return Err(Error::value(&path, "name", found, "the name of a scene"));
            };
            plain_name(&path, "name", &name)?;
            let Some(seeds) = &entry.seeds else {
                runs.push(SuiteRun { name, path, scene });
                continue;
            };
            for seed in seeds {
                let mut scene = scene.clone();
                scene["seed"] = (*seed).into();
                runs.push(SuiteRun { name: format!("{name}_{seed:02}"), path: path.clone(), scene });
            }
        }
        Ok(runs)
    }
}
