//! Batch evaluation: every estimator over every trial, noise level and seed, scored against the truth.
//!
//! Trials run in parallel; what they yield is put together in their order, so the results do not depend on the number of threads.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::Value;
use trace::{CalibrationFile, Outline, Role, Trace, is_plain_name, read_json, sha256, write_atomically, write_json};
use whisker::estimators::{self, Estimate, EstimatorRow};
use whisker::sensor::CalibratedFace;
use whisker::touch::TouchConfig;

use crate::dataset::Dataset;
use crate::fit::{REPORT_TABLES, face_stem};
use crate::front_end::FrontEnd;
use crate::metrics::{ContactError, Trial, score};
use crate::provenance::watermark;
use crate::replay::{self, check_calibration, knowledge, samples};
use crate::results::{
    ErrorBandRow, EstimateRow, FailureRow, Run, RunCalibration, RunEstimator, RunSet, SummaryRow, TrialRow, csv_bytes,
    read_rows,
};
use crate::settings::merged;
use crate::statistics::{median_of_scores, quantile};

/// Width of the time bins of `error_over_time.csv`.
const BIN_S: f64 = 0.02;

/// What to evaluate and how.
#[derive(Clone, Debug)]
pub struct EvaluateSettings {
    /// Name of the run.
    pub name: String,
    /// Estimators, by their names in the registry.
    pub estimators: Vec<String>,
    /// Settings by estimator; what is missing takes its default.
    pub config: BTreeMap<String, Value>,
    /// Settings of the touch detection, the same for all.
    pub touch: TouchConfig,
    /// Noise levels as fractions of the largest reading of each set.
    pub noise: Vec<f64>,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// Folder of the calibrations; without it, that beside the traces.
    pub calibrations: Option<PathBuf>,
    /// Folder under which the run's folder is made.
    pub results: PathBuf,
}

/// An evaluated run.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// Its folder.
    pub folder: PathBuf,
    /// Its summary.
    pub summary: Vec<SummaryRow>,
    /// Whether it had to be made anew.
    pub is_new: bool,
    /// Trials that could not be scored.
    pub failures: Vec<FailureRow>,
}

/// A set: trials of one group with one whisker, which share a noise level.
type SetKey = (String, String);

/// One trial, one noise level, one seed.
struct Job {
    trial: usize,
    noise: f64,
    seed: u64,
}

/// A trace and its object's outline.
struct BenchTrial {
    trace: Trace,
    outline: Option<Outline>,
}

/// Everything a trial needs, prepared once.
struct Bench {
    trials: Vec<BenchTrial>,
    calibrations: BTreeMap<String, Calibration>,
    largest_readings: BTreeMap<SetKey, f64>,
    methods: Vec<(&'static EstimatorRow, Value)>,
}

struct Calibration {
    path: PathBuf,
    file: CalibrationFile,
    sha256: String,
    faces: Vec<Arc<CalibratedFace>>,
}

/// What one trial yields for one estimator.
struct Outcome {
    row: TrialRow,
    errors: Vec<ContactError>,
    elapsed_ns: u128,
    steps: usize,
}

/// Evaluates and writes `<results>/<name>/`, unless it is there already from the same inputs.
///
/// # Errors
/// If inputs cannot be read or do not fit together, or results cannot be written.
pub fn evaluate(
    datasets: &[Dataset],
    settings: &EvaluateSettings,
    progress: &ProgressBar,
) -> anyhow::Result<Evaluated> {
    let folder = target(settings)?;
    let bench = Bench::open(datasets, settings)?;
    let run = bench.run(settings)?;
    if bench.is_up_to_date(&folder, &run) {
        let summary = read_rows(&folder.join("summary.csv"))?;
        let failures = read_rows(&folder.join("failures.csv"))?;
        return Ok(Evaluated { folder, summary, is_new: false, failures });
    }

    let part = PartFolder::new(&folder)?;
    let jobs: Vec<Job> = (0..bench.trials.len())
        .flat_map(|trial| {
            let seeds = || settings.seeds.iter();
            settings.noise.iter().flat_map(move |&noise| seeds().map(move |&seed| Job { trial, noise, seed }))
        })
        .collect();
    progress.set_length(jobs.len() as u64);
    let done: Vec<Result<Vec<Outcome>, FailureRow>> = jobs
        .par_iter()
        .map(|job| {
            let is_first = job.noise == settings.noise[0] && job.seed == settings.seeds[0];
            let done = bench.run_trial(job, settings, is_first.then_some(part.path()))?;
            progress.inc(1);
            Ok(done)
        })
        .collect::<anyhow::Result<_>>()?;
    let mut outcomes = Vec::new();
    let mut failures = Vec::new();
    for job in done {
        match job {
            Ok(of_job) => outcomes.extend(of_job),
            Err(failure) => failures.push(failure),
        }
    }
    if outcomes.is_empty() {
        bail!("no trial could be scored; the first: {}: {}", failures[0].trace, failures[0].reason);
    }
    let summary = summarise(&outcomes);
    let rows: Vec<&TrialRow> = outcomes.iter().map(|outcome| &outcome.row).collect();
    let bands = error_bands(&outcomes);
    let tables = [
        ("trials.csv", csv_bytes(&rows)?),
        ("summary.csv", csv_bytes(&summary)?),
        ("error_over_time.csv", csv_bytes(&bands)?),
        ("failures.csv", FailureRow::csv(&failures)?),
    ];
    for (name, bytes) in tables {
        write_atomically(&part.path().join(name), &bytes)?;
    }
    bench.copy_for_report(part.path())?;
    write_json(&part.path().join("run.json"), &run)?;
    part.finish()?;
    Ok(Evaluated { folder, summary, is_new: true, failures })
}

/// Folder of the run, which may only take the place of another run.
fn target(settings: &EvaluateSettings) -> anyhow::Result<PathBuf> {
    let name = &settings.name;
    if !is_plain_name(name) {
        bail!("name of the run: found `{name}`, expected a plain folder name");
    }
    let folder = settings.results.join(name);
    if folder.exists() && !folder.join("run.json").is_file() {
        bail!("{}: exists and is no run; evaluate under another --name", folder.display());
    }
    Ok(folder)
}

/// The folder in which a run is built. It takes the place of the run's folder when it is whole; until then that stays as it was. What an
/// interrupted evaluation left behind is cleared away by the next.
struct PartFolder<'a> {
    part: tempfile::TempDir,
    folder: &'a Path,
}

/// A hidden folder beside another.
fn beside(folder: &Path, what: &str) -> PathBuf {
    folder.with_file_name(format!(".{}.{what}", folder.file_name().unwrap_or_default().display()))
}

impl<'a> PartFolder<'a> {
    fn new(folder: &'a Path) -> anyhow::Result<Self> {
        let part = beside(folder, "part");
        let context = || part.display().to_string();
        let old = beside(folder, "old");
        if old.exists() && !folder.exists() {
            // Killed between the two renames of `finish`: the old run is the one that counts.
            fs::rename(&old, folder).with_context(|| old.display().to_string())?;
        }
        for left in [&part, &old] {
            if left.exists() {
                fs::remove_dir_all(left).with_context(|| left.display().to_string())?;
            }
        }
        let results = folder.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(results).with_context(context)?;
        let name = part.file_name().unwrap_or_default();
        let part = tempfile::Builder::new().prefix(name).rand_bytes(0).tempdir_in(results).with_context(context)?;
        Ok(Self { part, folder })
    }

    fn path(&self) -> &Path {
        self.part.path()
    }

    /// Puts the whole run in its place.
    fn finish(self) -> anyhow::Result<()> {
        let context = || self.folder.display().to_string();
        // Temporary folders are private; results are to be read by others.
        #[cfg(unix)]
        fs::set_permissions(self.path(), std::os::unix::fs::PermissionsExt::from_mode(0o755)).with_context(context)?;
        let old = beside(self.folder, "old");
        if self.folder.exists() {
            fs::rename(self.folder, &old).with_context(context)?;
        }
        fs::rename(self.part.keep(), self.folder).with_context(context)?;
        if old.exists() {
            fs::remove_dir_all(&old).with_context(context)?;
        }
        Ok(())
    }
}

impl Bench {
    fn open(datasets: &[Dataset], settings: &EvaluateSettings) -> anyhow::Result<Self> {
        if settings.noise.is_empty() || settings.seeds.is_empty() {
            bail!("an evaluation needs at least one noise level and one seed");
        }
        check_distinct("noise level", settings.noise.iter().map(f64::to_string))?;
        check_distinct("estimator", settings.estimators.iter().cloned())?;
        settings.touch.validate().context("settings of `touch`")?;
        let mut methods = Vec::new();
        for name in &settings.estimators {
            let row = estimators::estimator(name).with_context(|| {
                let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
                format!("unknown estimator `{name}`, expected one of: {}", known.join(", "))
            })?;
            let overrides = settings.config.get(name).cloned().unwrap_or_else(|| Value::Object(Default::default()));
            let config = merged((row.defaults)(), &overrides).with_context(|| format!("settings of `{name}`"))?;
            methods.push((row, config));
        }
        if let Some(name) = settings.config.keys().find(|name| !settings.estimators.contains(name)) {
            let known = settings.estimators.join(", ");
            bail!("settings are given for `{name}`, which is not among the estimators: {known}");
        }
        let mut trials: Vec<BenchTrial> = Vec::new();
        let mut calibrations: BTreeMap<String, Calibration> = BTreeMap::new();
        for dataset in datasets {
            let folder = settings.calibrations.clone().unwrap_or_else(|| dataset.calibrations());
            for trace in dataset.read(Role::Trial)? {
                let sidecar = &trace.sidecar;
                let whisker = &sidecar.whisker.name;
                let path = folder.join(format!("{whisker}.json"));
                match calibrations.get(whisker) {
                    None => _ = calibrations.insert(whisker.clone(), Calibration::read(&path)?),
                    Some(known) if known.path == path => {}
                    Some(known) => {
                        let other = known.path.display();
                        bail!(
                            "{}: `{whisker}` is calibrated by {other} too; name one by --calibrations",
                            path.display()
                        );
                    }
                }
                check_calibration(&path, &calibrations[whisker].file, sidecar)?;
                let outline = trace.outline(&dataset.folder)?;
                trials.push(BenchTrial { trace, outline });
            }
        }
        check_distinct("trace", trials.iter().map(|trial| trial.trace.sidecar.name.clone()))?;
        let mut largest_readings: BTreeMap<SetKey, f64> = BTreeMap::new();
        for trial in &trials {
            let largest = largest_readings.entry(set_key(&trial.trace)).or_default();
            for instant in &trial.trace.recording.instants {
                *largest = largest.max(instant.moment_z_n_m.abs());
            }
        }
        let bench = Self { trials, calibrations, largest_readings, methods };
        bench.check_methods(settings)?;
        Ok(bench)
    }

    /// Makes every method once, so that wrong settings are found before anything is run.
    fn check_methods(&self, settings: &EvaluateSettings) -> anyhow::Result<()> {
        let sidecar = &self.trials[0].trace.sidecar;
        let knowledge = knowledge(&sidecar.whisker, &self.calibrations[&sidecar.whisker.name].faces, 0.0);
        for (row, config) in &self.methods {
            replay::estimator(row, config, settings.touch, &knowledge, &sidecar.name, 0)?;
        }
        Ok(())
    }

    /// Whether a run from the same inputs is there, with all that belongs to it.
    fn is_up_to_date(&self, folder: &Path, run: &Run) -> bool {
        let same = |old: Run| old.watermark.inputs_sha256 == run.watermark.inputs_sha256;
        let estimates = self.trials.iter().flat_map(|trial| {
            let name = &trial.trace.sidecar.name;
            self.methods.iter().map(move |(row, _)| format!("estimates/{name}.{}.csv", row.name))
        });
        let outlines = self
            .trials
            .iter()
            .filter(|trial| trial.outline.is_some())
            .map(|trial| format!("outlines/{}.csv", trial.trace.sidecar.name));
        let tables = ["trials.csv", "summary.csv", "error_over_time.csv", "failures.csv"].map(String::from);
        read_json::<Run>(&folder.join("run.json")).is_ok_and(same)
            && tables
                .into_iter()
                .chain(estimates)
                .chain(outlines)
                .chain(self.model_files().map(|(_, name)| format!("models/{name}")))
                .all(|name| folder.join(name).is_file())
    }

    /// What stands in `run.json`.
    fn run(&self, settings: &EvaluateSettings) -> anyhow::Result<Run> {
        let estimators: Vec<RunEstimator> = self
            .methods
            .iter()
            .map(|(row, config)| RunEstimator {
                name: row.name.into(),
                about: row.about.into(),
                is_baseline: row.is_baseline,
                config: config.clone(),
            })
            .collect();
        let sets: Vec<RunSet> = self
            .largest_readings
            .iter()
            .map(|(key, &largest_reading_n_m)| {
                let traces = self.trials.iter().map(|trial| &trial.trace);
                let members: Vec<&Trace> = traces.filter(|trace| set_key(trace) == *key).collect();
                RunSet {
                    group: key.0.clone(),
                    whisker: key.1.clone(),
                    object: members[0].sidecar.object.clone(),
                    traces: members.iter().map(|trace| trace.sidecar.name.clone()).collect(),
                    largest_reading_n_m,
                }
            })
            .collect();
        let calibrations: Vec<RunCalibration> = self
            .calibrations
            .values()
            .flat_map(|calibration| {
                calibration.faces.iter().zip(&calibration.file.faces).map(|(face, file)| RunCalibration {
                    whisker: calibration.file.whisker.name.clone(),
                    face: face.face.name().into(),
                    model: face.model.about(),
                    sha256: calibration.sha256.clone(),
                    heldout_rms_n_m: file.heldout_rms_n_m,
                    heldout_worst_n_m: file.heldout_worst_n_m,
                    largest_reading_n_m: file.largest_reading_n_m,
                })
            })
            .collect();
        let mut inputs = vec![
            serde_json::to_string(&(&settings.name, &settings.noise, &settings.seeds, &settings.touch))?,
            serde_json::to_string(&(&estimators, &sets, &calibrations))?,
        ];
        for trial in &self.trials {
            let sidecar = &trial.trace.sidecar;
            inputs.push(sidecar.csv_sha256.clone());
            inputs.push(sidecar.contour.as_ref().map_or_else(String::new, |contour| contour.sha256.clone()));
        }
        Ok(Run {
            format: trace::FORMAT,
            kind: "run".into(),
            name: settings.name.clone(),
            watermark: watermark(inputs.iter().map(String::as_str)),
            noise: settings.noise.clone(),
            seeds: settings.seeds.clone(),
            touch: settings.touch,
            estimators,
            sets,
            calibrations,
        })
    }

    /// Replays one trial through every estimator; writes the estimates where a folder is given. A trial that cannot be scored is no
    /// error of the batch.
    fn run_trial(
        &self,
        job: &Job,
        settings: &EvaluateSettings,
        out: Option<&Path>,
    ) -> anyhow::Result<Result<Vec<Outcome>, FailureRow>> {
        let &Job { trial, noise, seed } = job;
        let BenchTrial { trace, outline } = &self.trials[trial];
        let sidecar = &trace.sidecar;
        let faces = &self.calibrations[&sidecar.whisker.name].faces;
        let front_end = FrontEnd { noise_sd_n_m: noise * self.largest_readings[&set_key(trace)], seed };
        let knowledge = knowledge(&sidecar.whisker, faces, front_end.noise_sd_n_m);
        let readings_n_m = front_end.readings_n_m(&sidecar.name, &trace.recording);
        let samples = samples(&trace.recording, &readings_n_m);
        let trial =
            Trial { trace, outline: outline.as_ref(), knowledge: &knowledge, readings_n_m: &readings_n_m, noise, seed };
        let mut outcomes = Vec::with_capacity(self.methods.len());
        for (row, config) in &self.methods {
            let mut estimator = replay::estimator(row, config, settings.touch, &knowledge, &sidecar.name, seed)?;
            let replayed = replay::replay(&mut estimator, &samples);
            if let Some(folder) = out {
                let path = folder.join("estimates").join(format!("{}.{}.csv", sidecar.name, row.name));
                write_atomically(&path, &csv_bytes(&estimate_rows(&trial, &replayed.estimates))?)?;
            }
            match score(&trial, row.name, &replayed.estimates) {
                Ok((row, errors)) => {
                    let (elapsed_ns, steps) = (replayed.elapsed_ns, samples.len());
                    outcomes.push(Outcome { row, errors, elapsed_ns, steps });
                }
                Err(unscored) => {
                    return Ok(Err(FailureRow {
                        trace: sidecar.name.clone(),
                        noise,
                        seed,
                        reason: unscored.to_string(),
                    }));
                }
            }
        }
        Ok(Ok(outcomes))
    }

    /// Tables about the sensor models, beside the calibrations: folder and name.
    fn model_files(&self) -> impl Iterator<Item = (&Path, String)> {
        self.calibrations.iter().flat_map(|(whisker, calibration)| {
            let folder = calibration.path.parent().unwrap_or(Path::new("."));
            calibration.faces.iter().flat_map(move |face| {
                REPORT_TABLES.map(|table| (folder, format!("{}.{table}.csv", face_stem(whisker, face.face))))
            })
        })
    }

    /// Copies what the report needs, so that it can be drawn from the run alone.
    fn copy_for_report(&self, folder: &Path) -> anyhow::Result<()> {
        for BenchTrial { trace, outline } in &self.trials {
            if let Some(outline) = outline {
                let mut text = String::from("x_m,y_m\n");
                for vertex in outline.vertices() {
                    text.push_str(&format!("{:.10},{:.10}\n", vertex.x(), vertex.y()));
                }
                let path = folder.join("outlines").join(format!("{}.csv", trace.sidecar.name));
                write_atomically(&path, text.as_bytes())?;
            }
        }
        for (from, name) in self.model_files() {
            let from = from.join(&name);
            let bytes = fs::read(&from).with_context(|| from.display().to_string())?;
            write_atomically(&folder.join("models").join(name), &bytes)?;
        }
        Ok(())
    }
}

/// Checks that nothing is named twice.
fn check_distinct(what: &str, names: impl Iterator<Item = String>) -> anyhow::Result<()> {
    let mut seen = BTreeSet::new();
    for name in names {
        if seen.contains(&name) {
            bail!("{what} `{name}`: found twice, expected each once");
        }
        seen.insert(name);
    }
    Ok(())
}

impl Calibration {
    fn read(path: &Path) -> anyhow::Result<Self> {
        if !path.is_file() {
            bail!("{}: no such calibration; `whisker fit` makes it", path.display());
        }
        let bytes = fs::read(path).with_context(|| path.display().to_string())?;
        let file = CalibrationFile::read(path)?;
        let faces = file.calibrated(path)?;
        Ok(Self { path: path.into(), file, sha256: sha256(bytes), faces })
    }
}

fn set_key(trace: &Trace) -> SetKey {
    (trace.sidecar.group.clone(), trace.sidecar.whisker.name.clone())
}

/// Rows of `estimates/<trace>.<estimator>.csv`.
pub fn estimate_rows(trial: &Trial<'_>, estimates: &[Option<Estimate>]) -> Vec<EstimateRow> {
    let instants = trial.trace.recording.instants.iter().zip(&trial.trace.truth.instants);
    instants
        .zip(trial.readings_n_m)
        .zip(estimates)
        .map(|(((known, truth), &reading_n_m), estimate)| {
            let contact = estimate.map(|e| known.base.apply(e.contact));
            let surface = estimate.map(|e| known.base.apply(trial.knowledge.surface(&e, reading_n_m)));
            let covariance = estimate.and_then(|e| e.covariance_m2).map(|p| known.base.turn(p));
            EstimateRow {
                t_s: known.t_s,
                base_x_m: known.base.origin().x(),
                base_y_m: known.base.origin().y(),
                base_yaw_rad: known.base.yaw_rad(),
                reading_n_m,
                contact_x_m: contact.map(|p| p.x()),
                contact_y_m: contact.map(|p| p.y()),
                surface_x_m: surface.map(|p| p.x()),
                surface_y_m: surface.map(|p| p.y()),
                cov_xx_m2: covariance.map(|p| p[(0, 0)]),
                cov_xy_m2: covariance.map(|p| p[(0, 1)]),
                cov_yy_m2: covariance.map(|p| p[(1, 1)]),
                calibrated: estimate.map(|e| e.calibrated),
                truth_contact_x_m: truth.contact.map(|p| p.x()),
                truth_contact_y_m: truth.contact.map(|p| p.y()),
                truth_surface_x_m: truth.surface.map(|p| p.x()),
                truth_surface_y_m: truth.surface.map(|p| p.y()),
            }
        })
        .collect()
}

/// Outcomes by group, whisker, noise level and estimator, in the order in which they first appear.
fn by_set(outcomes: &[Outcome]) -> Vec<Vec<&Outcome>> {
    let mut sets: Vec<Vec<&Outcome>> = Vec::new();
    let key = |row: &TrialRow| (row.group.clone(), row.whisker.clone(), row.noise.to_bits(), row.estimator.clone());
    let mut places: BTreeMap<_, usize> = BTreeMap::new();
    for outcome in outcomes {
        let place = *places.entry(key(&outcome.row)).or_insert_with(|| {
            sets.push(Vec::new());
            sets.len() - 1
        });
        sets[place].push(outcome);
    }
    sets
}

fn summarise(outcomes: &[Outcome]) -> Vec<SummaryRow> {
    by_set(outcomes)
        .iter()
        .map(|set| {
            let first = &set[0].row;
            let median = |score: fn(&TrialRow) -> Option<f64>| median_of_scores(set.iter().map(|o| score(&o.row)));
            let never = set.iter().filter(|o| o.row.time_to_1mm_s.is_none()).count();
            let elapsed: u128 = set.iter().map(|o| o.elapsed_ns).sum();
            let steps: usize = set.iter().map(|o| o.steps).sum();
            let worst = set.iter().map(|o| o.row.worst_m.unwrap_or(f64::INFINITY)).fold(0.0, f64::max);
            SummaryRow {
                group: first.group.clone(),
                whisker: first.whisker.clone(),
                object: first.object.clone(),
                estimator: first.estimator.clone(),
                noise: first.noise,
                trials: set.len(),
                rmse_m: median(|row| row.rmse_m),
                median_m: median(|row| row.median_m),
                p95_m: median(|row| row.p95_m),
                worst_m: Some(worst).filter(|worst| worst.is_finite()),
                time_to_1mm_s: median(|row| row.time_to_1mm_s),
                time_to_0p3mm_s: median(|row| row.time_to_0p3mm_s),
                never_1mm: never as f64 / set.len() as f64,
                step_ns: elapsed as f64 / steps as f64,
            }
        })
        .collect()
}

fn error_bands(outcomes: &[Outcome]) -> Vec<ErrorBandRow> {
    let mut rows = Vec::new();
    for set in by_set(outcomes) {
        let mut bins: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
        for outcome in &set {
            // One sample a trial and bin, the last.
            let mut of_trial: BTreeMap<u64, f64> = BTreeMap::new();
            for error in &outcome.errors {
                if let Some(error_m) = error.error_m {
                    of_trial.insert((error.t_contact_s / BIN_S).floor() as u64, error_m);
                }
            }
            for (bin, error_m) in of_trial {
                bins.entry(bin).or_default().push(error_m);
            }
        }
        let first = &set[0].row;
        for (bin, errors) in bins {
            let at = |q| quantile(&errors, q).expect("a bin holds at least one trial");
            rows.push(ErrorBandRow {
                group: first.group.clone(),
                whisker: first.whisker.clone(),
                estimator: first.estimator.clone(),
                noise: first.noise,
                t_contact_s: (bin as f64 + 0.5) * BIN_S,
                trials: errors.len(),
                p10_m: at(0.1),
                median_m: at(0.5),
                p90_m: at(0.9),
            });
        }
    }
    rows
}
