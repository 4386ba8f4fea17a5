//! Datasets: the traces that a command processes.

use std::path::{Path, PathBuf};
use std::{fs, io};

use anyhow::{Context, anyhow, bail};
use files::{is_of_kind, read_json};
use serde_json::Value;
use trace::{
    ArrayRecording, ArraySidecar, RandomDraws, Role, SceneDifference, Sidecar, SpatialSidecar, Suite, SuiteRun, Trace,
    is_spatial, is_trace_table, scene_difference,
};

use crate::front_end::{FRONT_ENDS, FrontEnd, SpatialFrontEnd};

/// Name of the folder of calibrations in the folder of their traces.
pub const CALIBRATIONS: &str = "calibrations";

/// Traces to process and the name of their results.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name of the suite or folder.
    pub name: String,
    /// Path of the suite or folder, as given.
    pub input: PathBuf,
    /// Folder of the traces and their calibrations.
    pub folder: PathBuf,
    /// Paths of the traces' CSV files, in order.
    pub paths: Vec<PathBuf>,
}

impl Dataset {
    /// Opens the traces of a suite or of a folder. A suite is a JSON file; its traces lie in `folder`, by default
    /// `datasets/<suite>`.
    ///
    /// # Errors
    /// If the suite does not parse, a trace is missing, or a scene has changed since its trace was simulated.
    pub fn open(input: &Path, folder: Option<&Path>) -> anyhow::Result<Self> {
        if input.is_dir() {
            if folder.is_some() {
                bail!("{}: is a folder of traces itself; --traces goes with a suite", input.display());
            }
            return Self::of_folder(input);
        }
        if !input.try_exists().with_context(|| input.display().to_string())? {
            let absent =
                format!("{}: no such file or folder, expected a suite (.json) or a folder of traces", input.display());
            return Err(io::Error::new(io::ErrorKind::NotFound, absent).into());
        }
        if input.extension().is_some_and(|extension| extension == "csv") {
            bail!("{}: is one file, expected a suite (.json) or a folder of traces", input.display());
        }
        let keys: Value = read_json(input)?;
        if keys.get("scenes").is_none() && keys.get("random").is_none() {
            bail!("{}: scenes: found no such key, expected a suite, or the folder of the traces", input.display());
        }
        let suite = Suite::read(input)?;
        let simulated = Simulated { suite: input, folder, name: &suite.name };
        let folder = simulated.folder();
        let mut paths = Vec::new();
        for run in suite.runs(input)? {
            paths.extend(simulated.traces(&run)?);
        }
        if let Some(random) = &suite.random {
            for name in random_names(&folder, &suite.name, random)? {
                paths.extend(simulated.present(&name)?);
            }
            simulated.check_draws(random, &paths)?;
        }
        Ok(Self { name: suite.name, input: input.into(), folder, paths })
    }

    /// Checks that those traces of a suite that have been simulated into its own folder are those of its scenes.
    ///
    /// # Errors
    /// If a scene has changed since its trace was simulated, or a file cannot be read.
    pub fn check_simulated(input: &Path) -> anyhow::Result<()> {
        let suite = Suite::read(input)?;
        let simulated = Simulated { suite: input, folder: None, name: &suite.name };
        let is_there = |name: &str| simulated.folder().join(format!("{name}.json")).is_file();
        for run in suite.runs(input)?.iter().filter(|run| is_there(&run.name)) {
            simulated.traces(run)?;
        }
        if let Some(random) = &suite.random {
            let mut names = random_names(&simulated.folder(), &suite.name, random)?;
            names.retain(|name| is_there(name));
            let paths = names.iter().map(|name| simulated.present(name)).collect::<anyhow::Result<Vec<_>>>()?;
            simulated.check_draws(random, &paths.concat())?;
        }
        Ok(())
    }

    fn of_folder(folder: &Path) -> anyhow::Result<Self> {
        let listed = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
        let mut paths = Vec::new();
        for entry in listed {
            let path = entry.with_context(|| folder.display().to_string())?.path();
            let is_of = |extension: &str| path.extension().is_some_and(|found| found == extension);
            let (is_table, is_json) = (is_of("csv"), is_of("json"));
            if is_table && path.with_extension("json").is_file() {
                paths.push(path);
            } else if is_table && path.is_file() && is_trace_table(&path)? {
                bail!(
                    "{}: found a trace without its sidecar, expected {}; restore it, or move the table elsewhere",
                    path.display(),
                    path.with_extension("json").display()
                );
            } else if is_json && !path.with_extension("csv").is_file() && is_of_kind(&path, "trace") {
                bail!(
                    "{}: found a sidecar without its trace, expected {}; restore it, or move the sidecar elsewhere",
                    path.display(),
                    path.with_extension("csv").display()
                );
            }
        }
        if paths.is_empty() {
            bail!(
                "{}: found no traces, expected pairs of .csv and .json, as written by `whisker simulate ... --out {0}`",
                folder.display()
            );
        }
        paths.sort();
        let folder = folder.to_path_buf();
        let absolute = folder.canonicalize().with_context(|| folder.display().to_string())?;
        let name = absolute.file_name().map_or_else(|| "run".into(), |name| name.to_string_lossy().into_owned());
        Ok(Self { name, input: folder.clone(), folder, paths })
    }

    /// The dataset restricted to traces with these names.
    pub fn only(&self, names: &[String]) -> Self {
        let is_named =
            |path: &&PathBuf| names.iter().any(|name| path.file_stem().is_some_and(|stem| stem == name.as_str()));
        Self { paths: self.paths.iter().filter(is_named).cloned().collect(), ..self.clone() }
    }

    /// Whether the traces are traces in space, judged by the first one.
    ///
    /// # Errors
    /// If its sidecar cannot be read.
    pub fn is_spatial(&self) -> anyhow::Result<bool> {
        Ok(self.paths.first().map(|path| is_spatial(path)).transpose()?.unwrap_or_default())
    }

    /// Paths of the traces with one role.
    ///
    /// # Errors
    /// If a sidecar cannot be read, or there are none of this role.
    pub fn of_role(&self, role: Role) -> anyhow::Result<Vec<&Path>> {
        let mut paths = Vec::new();
        for path in &self.paths {
            if self::role(path)? == role {
                paths.push(path.as_path());
            }
        }
        if paths.is_empty() {
            let (folder, role) = (self.folder.display(), role.name());
            bail!(
                "{folder}: found no traces with the role `{role}`; simulate a scene or import a recording with this role"
            );
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

    /// Whether every trial states the noise that is to be added to it.
    ///
    /// # Errors
    /// If a sidecar cannot be read.
    pub fn states_noise(&self) -> anyhow::Result<bool> {
        for path in &self.paths {
            let sidecar = Sidecar::read(path)?;
            if sidecar.role == Role::Trial && sidecar.replay.is_none() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Default measurement noise to add to every trial of datasets, see
    /// [`FrontEndRow::default_noise`](crate::front_end::FrontEndRow::default_noise).
    ///
    /// # Errors
    /// If a sidecar cannot be read, or if recordings, to which no noise is added, and simulated traces occur together among the
    /// trials.
    pub fn default_noise(datasets: &[Self], front_end: &FrontEnd) -> anyhow::Result<f64> {
        common_noise(datasets.iter().flat_map(|dataset| &dataset.paths), |path| {
            let sidecar = Sidecar::read(path)?;
            Ok((sidecar.role == Role::Trial).then(|| front_end.row.default_noise(&sidecar)))
        })
    }

    /// As [`Self::default_noise`], for a dataset in space.
    ///
    /// # Errors
    /// As [`Self::default_noise`].
    pub fn default_noise_in_space(&self, front_end: &SpatialFrontEnd) -> anyhow::Result<f64> {
        common_noise(&self.paths, |path| {
            let sidecar = SpatialSidecar::read(path)?;
            Ok((sidecar.role == Role::Trial).then(|| front_end.default_noise(&sidecar)))
        })
    }

    /// Folder of the calibrations of these traces through a front end, see [`calibrations`].
    pub fn calibrations(&self, front_end: &str) -> PathBuf {
        calibrations(&self.folder, front_end)
    }
}

/// Default noise, common to all trials among these traces; 0 without trials. `of` returns that of a trace, `None` if the trace is
/// not a trial.
fn common_noise<'a>(
    paths: impl IntoIterator<Item = &'a PathBuf>,
    of: impl Fn(&Path) -> anyhow::Result<Option<f64>>,
) -> anyhow::Result<f64> {
    let mut noise: Option<f64> = None;
    for path in paths {
        let Some(own) = of(path)? else { continue };
        if *noise.get_or_insert(own) != own {
            bail!(
                "{}: found recordings and simulated traces together, expected one kind, since noise is added to \
                simulated traces alone; give the noise for all by --noise",
                path.display()
            );
        }
    }
    Ok(noise.unwrap_or_default())
}

/// Folder of the calibrations of a folder of traces: `calibrations` for the default front end, and a subfolder for any other.
pub fn calibrations(folder: &Path, front_end: &str) -> PathBuf {
    let folder = folder.join(CALIBRATIONS);
    if front_end == FRONT_ENDS[0].name { folder } else { folder.join(front_end) }
}

/// Names of the traces of a random suite: the calibrations in the folder, then the trials of all sets.
fn random_names(folder: &Path, suite: &str, random: &RandomDraws) -> anyhow::Result<Vec<String>> {
    let prefix = format!("{suite}_{}_", random.seed);
    let sets = (0..random.sets).flat_map(|set| (0..random.traces()).map(move |trace| format!("{set:04}_{trace:02}")));
    let trials: Vec<String> = sets.map(|number| format!("{prefix}{number}")).collect();
    let mut names = Vec::new();
    // Without a folder, the first trial is reported as missing.
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        let is_trace = path.extension().is_some_and(|extension| extension == "json");
        let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        if let Some(name) = stem.filter(|name| is_trace && name.starts_with(&prefix))
            && role(&path)? == Role::Calibration
        {
            names.push(name);
        }
    }
    names.sort();
    names.extend(trials);
    Ok(names)
}

/// Role of a trace, in the plane or in space.
fn role(path: &Path) -> anyhow::Result<Role> {
    Ok(if is_spatial(path)? { SpatialSidecar::read(path)?.role } else { Sidecar::read(path)?.role })
}

/// Traces that were simulated from the scenes of a suite.
struct Simulated<'a> {
    /// Path of the suite.
    suite: &'a Path,
    /// Folder of the traces, if it is not the suite's own.
    folder: Option<&'a Path>,
    /// Name of the suite.
    name: &'a str,
}

impl Simulated<'_> {
    fn folder(&self) -> PathBuf {
        self.folder.map_or_else(|| Path::new("datasets").join(self.name), Into::into)
    }

    /// Paths of the traces of a run, one, or one per whisker of a recording, which are those of its scene.
    fn traces(&self, run: &SuiteRun) -> anyhow::Result<Vec<PathBuf>> {
        let paths = self.present(&run.name)?;
        paths.iter().try_for_each(|path| self.check(run, path))?;
        Ok(paths)
    }

    /// Paths of the traces of a scene with this name, all of which exist.
    fn present(&self, name: &str) -> anyhow::Result<Vec<PathBuf>> {
        let paths = traces(&self.folder(), name)?;
        for path in &paths {
            if !path.with_extension("json").is_file() {
                bail!(
                    "{}: no such trace; run {}, or give the folder of the traces by --traces",
                    path.display(),
                    self.remedy()
                );
            }
        }
        Ok(paths)
    }

    /// Checks that a trace was simulated from the scene as it is now. A recording of a real sensor has no scene.
    ///
    /// `whisker simulate --simulation` replaces the settings of the integration; they are compared in the suite's own folder alone.
    fn check(&self, run: &SuiteRun, path: &Path) -> anyhow::Result<()> {
        let in_space = is_spatial(path)?;
        let mut simulated = if in_space { SpatialSidecar::read(path)?.scene } else { Sidecar::read(path)?.scene };
        if simulated.is_null() {
            return Ok(());
        }
        let mut scene = run.scene.clone();
        if self.folder.is_some() {
            // Removed from both, so that both have the default.
            for keys in [&mut scene, &mut simulated].into_iter().filter_map(Value::as_object_mut) {
                keys.shift_remove("simulation");
            }
        }
        if let Some(SceneDifference { key, in_file, in_trace }) = scene_difference(&scene, &simulated) {
            bail!(
                "{}: {key}: found {in_file}, but {} was simulated with {in_trace}: the scene has changed; run {}",
                run.path.display(),
                path.display(),
                self.remedy()
            );
        }
        Ok(())
    }

    /// Checks that traces were drawn with the numbers of a random suite as it is now: none is of a whisker or of a set with
    /// more. Names of traces contain the name and the seed of the suite, which determine everything else that is drawn.
    fn check_draws(&self, random: &RandomDraws, paths: &[PathBuf]) -> anyhow::Result<()> {
        let (prefix, folder) = (format!("{}_{}_", self.name, random.seed), self.folder());
        let changed = |key: &str, found: u64, path: &Path, drawn: &str| {
            let (suite, path, folder, remedy) = (self.suite.display(), path.display(), folder.display(), self.remedy());
            anyhow!(
                "{suite}: random.{key}: found {found}, but {path} was drawn with {drawn}: the suite has changed; \
                 remove the traces in {folder} and run {remedy}"
            )
        };
        let beyond = (0..random.sets).map(|set| folder.join(format!("{prefix}{set:04}_{:02}.csv", random.traces())));
        if let Some(path) = beyond.into_iter().find(|path| path.with_extension("json").is_file()) {
            return Err(changed("traces", random.traces(), &path, "more traces of a set"));
        }
        if random.in_space {
            return Ok(());
        }
        for path in paths {
            let whisker = Sidecar::read(path)?.whisker.name;
            let number = whisker.strip_prefix(&format!("{prefix}w")).and_then(|number| number.parse::<u64>().ok());
            if number.is_some_and(|number| number >= random.whiskers()) {
                return Err(changed("whiskers", random.whiskers(), path, "more whiskers"));
            }
        }
        Ok(())
    }

    /// The command that simulates the traces again.
    fn remedy(&self) -> String {
        let out = self.folder.map_or_else(String::new, |folder| format!(" --out {}", folder.display()));
        format!("`whisker simulate {}{out}`", self.suite.display())
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_an_absent_dataset_is_an_error_of_the_operating_system() {
        for name in ["absent", "absent.json", "absent.csv"] {
            let error = Dataset::open(Path::new(name), None).unwrap_err();
            let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
            assert_eq!(kind, Some(io::ErrorKind::NotFound), "{error}");
            assert!(
                error.to_string().starts_with(&format!("{name}: no such file or folder, expected a suite")),
                "{error}"
            );
        }
    }
}
