//! Batch evaluation: every estimator over every trial, noise level and seed, scored against the truth.
//!
//! Trials run in parallel; what they yield is put together in their order, so the results do not depend on the number of threads.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::Value;
use trace::{CalibrationFile, Outline, Role, Trace, read_json, sha256, write_atomically, write_json};
use whisker::estimators::{self, Estimate, Estimator, EstimatorRow, Knowledge};
use whisker::sensor::CalibratedFace;
use whisker::touch::TouchConfig;

use crate::dataset::Dataset;
use crate::fit::face_stem;
use crate::front_end::{FrontEnd, derived_seed};
use crate::metrics::{ContactError, Trial, score};
use crate::provenance::watermark;
use crate::replay::{replay, samples};
use crate::results::{
    ErrorBandRow, EstimateRow, Run, RunCalibration, RunEstimator, RunSet, SummaryRow, TrialRow, csv_bytes, read_rows,
};
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
    /// Noise levels as fractions of the largest reading of each set.
    pub noise: Vec<f64>,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// Folder of the calibrations.
    pub calibrations: PathBuf,
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
}

/// A set: trials of one group with one whisker, which share a noise level.
type SetKey = (String, String);

/// Everything a trial needs, prepared once.
struct Bench {
    traces: Vec<Trace>,
    outlines: Vec<Option<Outline>>,
    calibrations: BTreeMap<String, Calibration>,
    largest_readings: BTreeMap<SetKey, f64>,
    methods: Vec<(&'static EstimatorRow, Value)>,
}

struct Calibration {
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
pub fn evaluate(dataset: &Dataset, settings: &EvaluateSettings, progress: &ProgressBar) -> anyhow::Result<Evaluated> {
    let folder = target(settings)?;
    let bench = Bench::open(dataset, settings)?;
    let run = bench.run(settings)?;
    if read_json::<Run>(&folder.join("run.json")).is_ok_and(|old| old == run) {
        let summary = read_rows(&folder.join("summary.csv"))?;
        return Ok(Evaluated { folder, summary, is_new: false });
    }

    let part = PartFolder::new(&folder)?;
    let jobs: Vec<(usize, f64, u64)> = (0..bench.traces.len())
        .flat_map(|trace| {
            settings.noise.iter().flat_map(move |&noise| settings.seeds.iter().map(move |&seed| (trace, noise, seed)))
        })
        .collect();
    progress.set_length(jobs.len() as u64);
    let outcomes: Vec<Vec<Outcome>> = jobs
        .par_iter()
        .map(|&(trace, noise, seed)| {
            let is_first = noise == settings.noise[0] && seed == settings.seeds[0];
            let outcomes = bench.trial(trace, noise, seed, is_first.then_some(part.path()));
            progress.inc(1);
            outcomes
        })
        .collect::<anyhow::Result<_>>()?;
    let outcomes: Vec<Outcome> = outcomes.into_iter().flatten().collect();
    let summary = summarise(&outcomes);
    let rows: Vec<&TrialRow> = outcomes.iter().map(|outcome| &outcome.row).collect();
    write_atomically(&part.path().join("trials.csv"), &csv_bytes(&rows)?)?;
    write_atomically(&part.path().join("summary.csv"), &csv_bytes(&summary)?)?;
    write_atomically(&part.path().join("error_over_time.csv"), &csv_bytes(&error_bands(&outcomes))?)?;
    bench.copy_for_report(settings, part.path())?;
    write_json(&part.path().join("run.json"), &run)?;
    part.finish()?;
    Ok(Evaluated { folder, summary, is_new: true })
}

/// Folder of the run, which may only take the place of another run.
fn target(settings: &EvaluateSettings) -> anyhow::Result<PathBuf> {
    let name = &settings.name;
    if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\']) {
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
        for left in [&part, &beside(folder, "old")] {
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
    fn open(dataset: &Dataset, settings: &EvaluateSettings) -> anyhow::Result<Self> {
        if settings.noise.is_empty() || settings.seeds.is_empty() {
            bail!("an evaluation needs at least one noise level and one seed");
        }
        let mut methods = Vec::new();
        for name in &settings.estimators {
            let row = estimators::estimator(name).with_context(|| {
                let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
                format!("unknown estimator `{name}`, expected one of: {}", known.join(", "))
            })?;
            methods.push((row, merged((row.defaults)(), settings.config.get(name))));
        }
        if let Some(name) = settings.config.keys().find(|name| !settings.estimators.contains(name)) {
            bail!(
                "settings are given for `{name}`, which is not among the estimators: {}",
                settings.estimators.join(", ")
            );
        }
        let traces = dataset.read(Role::Trial)?;
        let mut outlines = Vec::new();
        for trace in &traces {
            outlines.push(trace.outline(&dataset.folder)?);
        }
        let mut calibrations: BTreeMap<String, Calibration> = BTreeMap::new();
        let mut largest_readings: BTreeMap<SetKey, f64> = BTreeMap::new();
        for trace in &traces {
            let sidecar = &trace.sidecar;
            let path = settings.calibrations.join(format!("{}.json", sidecar.whisker.name));
            if !calibrations.contains_key(&sidecar.whisker.name) {
                calibrations.insert(sidecar.whisker.name.clone(), Calibration::read(&path)?);
            }
            let calibration = &calibrations[&sidecar.whisker.name];
            if calibration.file.whisker != sidecar.whisker {
                bail!("{}: calibrates a whisker with other parameters than that of {}", path.display(), sidecar.name);
            }
            if !calibration.faces.iter().any(|face| face.face == sidecar.face) {
                let face = sidecar.face.name();
                bail!("{}: has no face {face}, which {} touches with", path.display(), sidecar.name);
            }
            let largest = largest_readings.entry(set_key(trace)).or_default();
            for instant in &trace.recording.instants {
                *largest = largest.max(instant.moment_z_n_m.abs());
            }
        }
        Ok(Self { traces, outlines, calibrations, largest_readings, methods })
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
                let members: Vec<&Trace> = self.traces.iter().filter(|trace| set_key(trace) == *key).collect();
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
            serde_json::to_string(&(&settings.name, &settings.noise, &settings.seeds))?,
            serde_json::to_string(&(&estimators, &sets, &calibrations))?,
        ];
        inputs.extend(self.traces.iter().map(|trace| trace.sidecar.csv_sha256.clone()));
        Ok(Run {
            format: trace::FORMAT,
            kind: "run".into(),
            name: settings.name.clone(),
            watermark: watermark(inputs.iter().map(String::as_str))?,
            noise: settings.noise.clone(),
            seeds: settings.seeds.clone(),
            estimators,
            sets,
            calibrations,
        })
    }

    /// Replays one trial through every estimator; writes the estimates where a folder is given.
    fn trial(&self, index: usize, noise: f64, seed: u64, out: Option<&Path>) -> anyhow::Result<Vec<Outcome>> {
        let trace = &self.traces[index];
        let sidecar = &trace.sidecar;
        let knowledge = Arc::new(Knowledge {
            whisker: sidecar.whisker.clone(),
            rest: sidecar.whisker.rest_shape(),
            faces: self.calibrations[&sidecar.whisker.name].faces.clone(),
            noise_sd_n_m: noise * self.largest_readings[&set_key(trace)],
        });
        let front_end = FrontEnd { noise_sd_n_m: knowledge.noise_sd_n_m, seed };
        let readings_n_m = front_end.readings_n_m(&sidecar.name, &trace.recording);
        let samples = samples(&trace.recording, &readings_n_m);
        let trial = Trial {
            trace,
            outline: self.outlines[index].as_ref(),
            knowledge: &knowledge,
            readings_n_m: &readings_n_m,
            noise,
            seed,
        };
        let mut outcomes = Vec::with_capacity(self.methods.len());
        for (row, config) in &self.methods {
            let method = (row.build)(config, &knowledge)
                .map_err(|error| anyhow::anyhow!("settings of `{}`: {error}", row.name))?;
            let own_seed = derived_seed(seed, &[row.name, &sidecar.name]);
            let mut estimator = Estimator::new(method, knowledge.clone(), TouchConfig::default(), own_seed);
            let replayed = replay(&mut estimator, &samples);
            let (scored, errors) = score(&trial, row.name, &replayed.estimates)
                .with_context(|| format!("{}: the whisker never touches; there is nothing to score", sidecar.name))?;
            if let Some(folder) = out {
                let path = folder.join("estimates").join(format!("{}.{}.csv", sidecar.name, row.name));
                write_atomically(&path, &csv_bytes(&estimate_rows(&trial, &replayed.estimates))?)?;
            }
            let steps = samples.len();
            outcomes.push(Outcome { row: scored, errors, elapsed_ns: replayed.elapsed_ns, steps });
        }
        Ok(outcomes)
    }

    /// Copies what the report needs, so that it can be drawn from the run alone.
    fn copy_for_report(&self, settings: &EvaluateSettings, folder: &Path) -> anyhow::Result<()> {
        for (trace, outline) in self.traces.iter().zip(&self.outlines) {
            if let Some(outline) = outline {
                let mut text = String::from("x_m,y_m\n");
                for vertex in outline.vertices() {
                    text.push_str(&format!("{:.10},{:.10}\n", vertex.x(), vertex.y()));
                }
                let path = folder.join("outlines").join(format!("{}.csv", trace.sidecar.name));
                write_atomically(&path, text.as_bytes())?;
            }
        }
        for (whisker, calibration) in &self.calibrations {
            for face in &calibration.faces {
                for kind in ["surface", "residuals"] {
                    let name = format!("{}.{kind}.csv", face_stem(whisker, face.face));
                    let from = settings.calibrations.join(&name);
                    let bytes = fs::read(&from).with_context(|| from.display().to_string())?;
                    write_atomically(&folder.join("models").join(name), &bytes)?;
                }
            }
        }
        Ok(())
    }
}

impl Calibration {
    fn read(path: &Path) -> anyhow::Result<Self> {
        if !path.is_file() {
            bail!("{}: no such calibration; `whisker fit` makes it", path.display());
        }
        let bytes = fs::read(path).with_context(|| path.display().to_string())?;
        let file = CalibrationFile::read(path)?;
        let faces = file.calibrated(path)?;
        Ok(Self { file, sha256: sha256(bytes), faces })
    }
}

fn set_key(trace: &Trace) -> SetKey {
    (trace.sidecar.group.clone(), trace.sidecar.whisker.name.clone())
}

/// Settings over their defaults. Keys that the defaults lack are kept, for the method to reject by name.
fn merged(mut defaults: Value, overrides: Option<&Value>) -> Value {
    if let (Some(defaults), Some(Value::Object(overrides))) = (defaults.as_object_mut(), overrides) {
        defaults.extend(overrides.clone());
    }
    defaults
}

/// Rows of `estimates/<trace>.<estimator>.csv`.
pub fn estimate_rows(trial: &Trial<'_>, estimates: &[Option<Estimate>]) -> Vec<EstimateRow> {
    let instants = trial.trace.recording.instants.iter().zip(&trial.trace.truth.instants);
    instants
        .zip(trial.readings_n_m)
        .zip(estimates)
        .map(|(((known, truth), &reading_n_m), estimate)| {
            let contact = estimate.map(|e| known.base.apply(e.contact));
            let surface = estimate.map(|e| known.base.apply(trial.knowledge.surface(e.contact, reading_n_m)));
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
