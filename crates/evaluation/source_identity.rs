//! Identities of the code that computes calibrations and evaluations: hashes of declared sources and of the locked
//! packages that they depend on.
//!
//! `build.rs` and the test of these declarations include this file. The sources of a declared folder count as a whole,
//! unit tests and comments included; tests in `tests/`, benches and examples do not.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// Sources that determine one kind of result, relative to the workspace.
pub(crate) struct Code {
    /// Files and folders.
    pub(crate) sources: &'static [&'static str],
}

/// Code that computes calibrations: sensor models, elastica, front ends, reading of traces.
pub(crate) const CALIBRATION: Code = Code {
    sources: &[
        "crates/evaluation/src/fit.rs",
        "crates/evaluation/src/glitches.rs",
        "crates/evaluation/src/provenance.rs",
        "crates/evaluation/src/space/fit.rs",
        "crates/files/src",
        "crates/filters/src/cholesky.rs",
        "crates/filters/src/least_squares.rs",
        "crates/filters/src/lib.rs",
        "crates/filters/src/matrix.rs",
        "crates/filters/src/quantile.rs",
        "crates/filters/src/simd.rs",
        "crates/strict-json/src",
        "crates/testbed/src/contour/circle.rs",
        "crates/testbed/src/contour/vertex.rs",
        "crates/testbed/src/dataset.rs",
        "crates/testbed/src/front_end",
        "crates/testbed/src/provenance.rs",
        "crates/testbed/src/results/sensor_model.rs",
        "crates/testbed/src/results/sensors.rs",
        "crates/testbed/src/results/table.rs",
        "crates/testbed/src/seeds.rs",
        "crates/testbed/src/settings.rs",
        "crates/testbed/src/space/readings.rs",
        "crates/testbed/src/statistics.rs",
        "crates/trace/src",
        "crates/whisker/src/elastica",
        "crates/whisker/src/face.rs",
        "crates/whisker/src/frames.rs",
        "crates/whisker/src/gate.rs",
        "crates/whisker/src/rest.rs",
        "crates/whisker/src/rod",
        "crates/whisker/src/sensor",
        "crates/whisker/src/settings.rs",
        "crates/whisker/src/space/frames.rs",
        "crates/whisker/src/space/sensor",
        "crates/whisker/src/taylor.rs",
        "crates/whisker/src/wire.rs",
    ],
};

/// Code that computes estimates and scores.
pub(crate) const EVALUATION: Code = Code {
    sources: &[
        "crates/evaluation/src/distinct.rs",
        "crates/evaluation/src/evaluate",
        "crates/evaluation/src/glitches.rs",
        "crates/evaluation/src/participant",
        "crates/evaluation/src/plausibility",
        "crates/evaluation/src/provenance.rs",
        "crates/evaluation/src/remarks.rs",
        "crates/evaluation/src/space/evaluate.rs",
        "crates/evaluation/src/space/participant.rs",
        "crates/evaluation/src/space/run.rs",
        "crates/files/src",
        "crates/filters/src",
        "crates/signal/src",
        "crates/strict-json/src",
        "crates/testbed/src/bound",
        "crates/testbed/src/consistency.rs",
        "crates/testbed/src/contact_events.rs",
        "crates/testbed/src/contour",
        "crates/testbed/src/dataset.rs",
        "crates/testbed/src/encoders.rs",
        "crates/testbed/src/fitted_traces.rs",
        "crates/testbed/src/front_end",
        "crates/testbed/src/map",
        "crates/testbed/src/metrics",
        "crates/testbed/src/miscalibration.rs",
        "crates/testbed/src/noise.rs",
        "crates/testbed/src/protocol",
        "crates/testbed/src/provenance.rs",
        "crates/testbed/src/replay.rs",
        "crates/testbed/src/results",
        "crates/testbed/src/seeds.rs",
        "crates/testbed/src/settings.rs",
        "crates/testbed/src/space/bound.rs",
        "crates/testbed/src/space/estimates.rs",
        "crates/testbed/src/space/files.rs",
        "crates/testbed/src/space/glb.rs",
        "crates/testbed/src/space/map.rs",
        "crates/testbed/src/space/object.rs",
        "crates/testbed/src/space/ply.rs",
        "crates/testbed/src/space/readings.rs",
        "crates/testbed/src/space/replay.rs",
        "crates/testbed/src/space/rows.rs",
        "crates/testbed/src/space/run.rs",
        "crates/testbed/src/space/solid.rs",
        "crates/testbed/src/space/surface.rs",
        "crates/testbed/src/space/trial.rs",
        "crates/testbed/src/space/view.rs",
        "crates/testbed/src/space/wire.rs",
        "crates/testbed/src/statistics.rs",
        "crates/trace/src",
        "crates/whisker/src",
    ],
};

impl Code {
    /// Identity of the code in a workspace: hash of its files with their paths, and of the locked versions of the
    /// packages that its crates depend on, except for development and build dependencies of the crates.
    pub(crate) fn sha256(&self, workspace: &Path) -> String {
        let mut digest = Sha256::new();
        for file in self.files(workspace) {
            let bytes = fs::read(workspace.join(&file)).expect("a source file can be read");
            digest.update(file.as_bytes());
            digest.update((bytes.len() as u64).to_le_bytes());
            digest.update(bytes);
        }
        let lock = Lock::read(workspace);
        for package in lock.closure(workspace, self.crates()) {
            digest.update(package.as_bytes());
            digest.update(b"\n");
        }
        digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The files, with `/` in their paths, in order.
    pub(crate) fn files(&self, workspace: &Path) -> Vec<String> {
        let mut paths = Vec::new();
        self.sources.iter().for_each(|source| collect(&workspace.join(source), &mut paths));
        let relative = |path: &PathBuf| {
            let path = path.strip_prefix(workspace).expect("the file lies in the workspace");
            path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
        };
        paths.iter().map(relative).collect()
    }

    /// Names of the crates, which are those of their folders.
    fn crates(&self) -> BTreeSet<String> {
        let name = |source: &&str| source.split('/').nth(1).expect("a source lies in a crate").to_owned();
        self.sources.iter().map(name).collect()
    }
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    if path.is_file() {
        files.push(path.into());
        return;
    }
    let entries = fs::read_dir(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut entries: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    entries.sort();
    entries.iter().for_each(|entry| collect(entry, files));
}

/// A package of `Cargo.lock`.
#[derive(Default)]
struct Package {
    version: String,
    checksum: String,
    /// `name`, or `name version` if several versions are locked.
    dependencies: Vec<String>,
}

/// Packages of `Cargo.lock` by name and version.
struct Lock(BTreeMap<(String, String), Package>);

impl Lock {
    fn read(workspace: &Path) -> Self {
        let text = fs::read_to_string(workspace.join("Cargo.lock")).expect("Cargo.lock can be read");
        let mut packages = BTreeMap::new();
        for block in text.split("[[package]]").skip(1) {
            let value = |key: &str| {
                let line = block.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "));
                line.map_or_else(String::new, |value| value.trim_matches('"').to_owned())
            };
            let listed = block.split_once("dependencies = [").and_then(|(_, rest)| rest.split_once(']'));
            let listed = listed.map_or("", |(listed, _)| listed);
            let dependencies = listed.lines().map(|line| line.trim().trim_matches([',', '"']).to_owned());
            let package = Package {
                version: value("version"),
                checksum: value("checksum"),
                dependencies: dependencies.filter(|dependency| !dependency.is_empty()).collect(),
            };
            packages.insert((value("name"), package.version.clone()), package);
        }
        Self(packages)
    }

    /// The package of a dependency: `name`, or `name version`.
    fn find(&self, dependency: &str) -> (&(String, String), &Package) {
        let mut words = dependency.split(' ');
        let (name, version) = (words.next().unwrap_or_default(), words.next());
        let is_it = |(found, at): &&(String, String)| found == name && version.is_none_or(|version| version == at);
        let key = self.0.keys().find(is_it).unwrap_or_else(|| panic!("Cargo.lock: found no package `{dependency}`"));
        (key, &self.0[key])
    }

    /// Name, version and checksum of each external package that the crates depend on, in order.
    fn closure(&self, workspace: &Path, crates: BTreeSet<String>) -> BTreeSet<String> {
        let mut seen = BTreeSet::new();
        let mut external = BTreeSet::new();
        let mut open: Vec<String> = crates.into_iter().collect();
        while let Some(dependency) = open.pop() {
            let (key, package) = self.find(&dependency);
            if !seen.insert(key.clone()) {
                continue;
            }
            let manifest = workspace.join("crates").join(&key.0).join("Cargo.toml");
            if package.checksum.is_empty() && manifest.is_file() {
                let normal = normal_dependencies(&manifest);
                let is_normal =
                    |dependency: &&String| normal.contains(dependency.split(' ').next().unwrap_or_default());
                open.extend(package.dependencies.iter().filter(is_normal).cloned());
            } else {
                external.insert(format!("{} {} {}", key.0, package.version, package.checksum));
                open.extend(package.dependencies.iter().cloned());
            }
        }
        external
    }
}

/// Names in the sections `[dependencies]` and `[target.<platform>.dependencies]` of a manifest.
fn normal_dependencies(manifest: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(manifest).unwrap_or_else(|error| panic!("{}: {error}", manifest.display()));
    let mut names = BTreeSet::new();
    let mut is_normal = false;
    for line in text.lines() {
        if line.starts_with('[') {
            is_normal = line == "[dependencies]" || (line.starts_with("[target.") && line.ends_with(".dependencies]"));
        } else if let Some((name, _)) = line.split_once('=').filter(|_| is_normal) {
            names.insert(name.trim().trim_end_matches(".workspace").to_owned());
        }
    }
    names
}
