//! Batch evaluation: every estimator over every trial, noise level and seed, scored against the truth.
//!
//! The work is cut into items (`plan`), which are done in parallel (`work`); what each yields is kept in a file of its own (`shards`), so that an evaluation which
//! was interrupted goes on where it stood. At the end it is put together in the order of trials, noise levels and seeds (`merge`), so the results depend neither on
//! the number of threads nor on interruptions. A trial that fails leaves its reason behind and the others alone.

mod arrays;
mod contours;
mod merge;
mod part_folder;
mod plan;
mod shards;
mod starts;
mod tables;
mod work;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use files::{read_json, sha256, write_atomically, write_json};
use indicatif::ProgressBar;
use serde_json::Value;
use trace::{CalibrationFile, Outline, Role, SensorFile, Sidecar, Trace, is_plain_name};
use whisker::estimators::{BaseNoise, ContactPrior, ESTIMATORS, Knowledge, ModelShares};
use whisker::events::{DETECTORS, DetectorRow, TouchConfig};
use whisker::sensor::CalibratedFace;

use crate::bound::TraceBound;
use crate::contact_events::Events;
use crate::contour::{Comparison, Touched};
use crate::dataset::Dataset;
use crate::encoders::Encoders;
use crate::fit::{REPORT_TABLES, face_stem};
use crate::front_end::{FrontEnd, FrontEndConfig, Mounting, SensorInput};
use crate::map::MapConfig;
use crate::metrics::{GroundTruth, Scored, Scores, Trial, Unscored, contour, first_touch_s};
use crate::participant::{Participant, Program, Registered, Task};
use crate::provenance::watermark;
use crate::replay::{self, Replay, check_calibration, knowledge, motions, read_by, with_readings};
use crate::results::{
    ContourTrialRow, FailureRow, Run, RunCalibration, RunEstimator, RunSet, SummaryRow, TrialHead, TrialRow, csv_bytes,
    has_outline, read_rows, read_scores,
};
use arrays::{Arrays, Mounted, Sighting};
use contours::{trial_row, vertex_rows};
use merge::{Merged, merge};
use part_folder::{PartFolder, restore, tidy};
use shards::{Outcome, Shards, Yield};
use tables::OverTime;
use work::{Member, caught};

pub use plan::Share;
pub use starts::Starts;
pub use tables::estimate_row;

/// What to evaluate and how.
#[derive(Clone, Debug, Default)]
pub struct EvaluateSettings {
    /// Name of the run.
    pub name: String,
    /// Estimators, by their names in the registry; without names all whose sensor model is calibrated.
    pub estimators: Option<Vec<String>>,
    /// Programs of other people, beside the estimators.
    pub programs: Vec<Program>,
    /// Settings by estimator; what is missing takes its default.
    pub config: BTreeMap<String, Value>,
    /// The front end through which the trials are read.
    pub front_end: FrontEndConfig,
    /// Settings of the touch detection, the same for all.
    pub touch: TouchConfig,
    /// Noise levels as fractions of the largest reading of each set.
    pub noise: Vec<f64>,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// What the estimators are contact_prior of the first touch.
    pub starts: Starts,
    /// Encoders of an arm's joints, each a trial of its own; without any, perfect ones.
    pub encoders: Vec<Encoders>,
    /// Settings of the maps of recordings of several whiskers.
    pub map: MapConfig,
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
    /// Trials that could not be scored, or on which an estimator failed.
    pub failures: Vec<FailureRow>,
    /// Estimators that were left out, since nobody asked for them by name and they need what was not fitted.
    pub skipped: Vec<Skipped>,
    /// Trials that were replayed but not scored, for nobody knows where the contact was.
    pub unscored: Vec<String>,
}

/// An estimator that was left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Its name.
    pub estimator: String,
    /// Label of the sensor model that it insists on.
    pub sensor_model: String,
    /// The calibration that lacks it.
    pub calibration: PathBuf,
}

/// A set: trials of one group with one whisker, which share a noise level.
type SetKey = (String, String);

/// A trace that is to be replayed. Its rows are read when their turn comes.
struct BenchTrial {
    /// What it is, under the name that it has in the run.
    sidecar: Sidecar,
    /// Its CSV.
    path: PathBuf,
    outline: Option<Outline>,
    mounting: Mounting,
    /// What calibration taught of its sensor, where the front end has one.
    sensor: Option<SensorFile>,
    /// The recording of several whiskers that it belongs to.
    mounted: Option<Mounted>,
    /// What the estimators are contact_prior of the first touch.
    contact_prior: Option<ContactPrior>,
    /// Whether the contact is known, so that there is something to score against.
    is_known: bool,
}

impl BenchTrial {
    /// Name of what is replayed together: the recording of several whiskers, or the trace alone.
    fn scene(&self) -> String {
        self.mounted.as_ref().map_or_else(
            || format!("trace {}", self.sidecar.name),
            |mounted| format!("recording {}", mounted.recording()),
        )
    }

    /// How well the robot knows its base.
    fn base_noise(&self) -> BaseNoise {
        self.mounted.as_ref().map(Mounted::base_noise).unwrap_or_default()
    }
}

/// Everything a trial needs, prepared once.
struct Bench {
    trials: Vec<BenchTrial>,
    calibrations: BTreeMap<String, Calibration>,
    largest_readings: BTreeMap<SetKey, f64>,
    front_end: FrontEnd,
    participants: Vec<Box<dyn Participant>>,
    /// Names of the participants.
    names: Vec<String>,
    skipped: Vec<Skipped>,
}

struct Calibration {
    path: PathBuf,
    file: CalibrationFile,
    sha256: String,
    /// Faces by label of the sensor model; without a label, with the model that the calibration chose.
    faces: BTreeMap<Option<&'static str>, Vec<Arc<CalibratedFace>>>,
}

/// Evaluates and writes `<results>/<name>/`, unless it is there already from the same inputs. What an interrupted evaluation from the same inputs has finished is
/// not done again.
///
/// # Errors
/// If inputs cannot be read or do not fit together, or results cannot be written.
pub fn evaluate(
    datasets: &[Dataset],
    settings: &EvaluateSettings,
    progress: &ProgressBar,
) -> anyhow::Result<Evaluated> {
    let folder = target(settings)?;
    restore(&folder)?;
    let bench = Bench::open(datasets, settings)?;
    let run = bench.run(settings)?;
    let (unscored, skipped) = (bench.unscored(), bench.skipped.clone());
    let read = || anyhow::Ok((read_scores(&folder.join("summary.csv"))?, read_rows(&folder.join("failures.csv"))?));
    // What cannot be read is made anew.
    if bench.is_up_to_date(&folder, &run)
        && let Ok((summary, failures)) = read()
    {
        tidy(&folder)?;
        return Ok(Evaluated { folder, summary, is_new: false, failures, skipped, unscored });
    }

    let part = PartFolder::open(&folder, &run.watermark.inputs_sha256)?;
    let (plan, shards) = (bench.plan(settings), Shards::in_run(part.path()));
    bench.finish_items(&plan, None, (part.path(), &shards), settings, progress)?;
    let Merged { summary, failures } = merge(&plan, &shards, part.path())?;
    if summary.is_empty() {
        part.discard()?;
        let reason = match failures.first() {
            Some(first) => format!("the first: {}: {}", first.trace, first.reason),
            None => Unscored::TruthUnknown.to_string(),
        };
        bail!("no trial could be scored; {reason}");
    }
    bench.copy_for_report(part.path())?;
    write_json(&part.path().join("run.json"), &run)?;
    part.finish()?;
    Ok(Evaluated { folder, summary, is_new: true, failures, skipped, unscored })
}

/// Does a share of the work and leaves it for [`evaluate`], which puts the run together when all shares are done, and does itself what is missing. Several
/// processes may do so at once, on one machine or on several with a common file system.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_share(
    datasets: &[Dataset],
    settings: &EvaluateSettings,
    share: Share,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let folder = target(settings)?;
    let bench = Bench::open(datasets, settings)?;
    let run = bench.run(settings)?;
    if bench.is_up_to_date(&folder, &run) {
        return Ok(());
    }
    let part = PartFolder::open(&folder, &run.watermark.inputs_sha256)?;
    let (plan, shards) = (bench.plan(settings), Shards::in_run(part.path()));
    bench.finish_items(&plan, Some(share), (part.path(), &shards), settings, progress)
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

impl EvaluateSettings {
    /// Who takes part: registered estimators, then programs.
    fn participants(&self) -> anyhow::Result<Vec<Box<dyn Participant>>> {
        let all = || ESTIMATORS.iter().map(|row| row.name.to_owned()).collect();
        let estimators = self.estimators.clone().unwrap_or_else(all);
        if let Some(name) = self.config.keys().find(|name| !estimators.contains(name)) {
            let known = estimators.join(", ");
            bail!("settings are given for `{name}`, which is not among the estimators: {known}");
        }
        check_distinct("estimator", estimators.iter().cloned())?;
        check_distinct("program", self.programs.iter().map(|program| program.describe().name))?;
        let mut participants: Vec<Box<dyn Participant>> = Vec::new();
        for name in &estimators {
            let overrides = self.config.get(name).cloned().unwrap_or_else(|| Value::Object(Default::default()));
            participants.push(Box::new(Registered::new(name, &overrides)?));
        }
        participants.extend(self.programs.iter().map(|program| Box::new(program.clone()) as Box<dyn Participant>));
        Ok(participants)
    }
}

impl Bench {
    fn open(datasets: &[Dataset], settings: &EvaluateSettings) -> anyhow::Result<Self> {
        if settings.noise.is_empty() || settings.seeds.is_empty() {
            bail!("an evaluation needs at least one noise level and one seed");
        }
        check_distinct("noise level", settings.noise.iter().map(f64::to_string))?;
        settings.touch.validate().context("settings of `touch`")?;
        settings.map.validate()?;
        settings.encoders.iter().try_for_each(Encoders::validate)?;
        check_distinct("encoders", settings.encoders.iter().map(Encoders::label))?;
        let participants = settings.participants()?;
        let front_end = FrontEnd::new(&settings.front_end)?;
        let mut trials: Vec<BenchTrial> = Vec::new();
        let mut largest_readings: BTreeMap<SetKey, f64> = BTreeMap::new();
        let mut calibrations: BTreeMap<String, Calibration> = BTreeMap::new();
        let mut arrays = Arrays::default();
        for dataset in datasets {
            let folder = settings.calibrations.clone().unwrap_or_else(|| dataset.calibrations(front_end.row.name));
            for csv in dataset.of_role(Role::Trial)? {
                let trace = Trace::read(csv)?;
                let sidecar = &trace.sidecar;
                front_end.check_trace(sidecar)?;
                let whisker = &sidecar.whisker.name;
                let path = folder.join(format!("{whisker}.json"));
                match calibrations.get(whisker) {
                    None => {
                        calibrations.insert(whisker.clone(), Calibration::read(&path)?);
                    }
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
                let mounting = Mounting::of(&dataset.folder, sidecar)?;
                let sensor = front_end.sensor(&path, &calibrations[whisker].file, &mounting)?.cloned();
                let outline = trace.outline(&dataset.folder)?;
                let is_known = first_touch_s(&trace) != Err(Unscored::TruthUnknown);
                let moments = trace.recording.instants.iter().map(|instant| instant.moment_z_n_m.abs());
                let largest_n_m = moments.fold(0.0, f64::max);
                let mut add = |sidecar: Sidecar, mounted, contact_prior| {
                    let largest = largest_readings.entry(set_key(&sidecar)).or_default();
                    *largest = largest.max(largest_n_m);
                    let (path, outline, mounting, sensor) =
                        (csv.into(), outline.clone(), mounting.clone(), sensor.clone());
                    trials.push(BenchTrial {
                        sidecar,
                        path,
                        outline,
                        mounting,
                        sensor,
                        mounted,
                        contact_prior,
                        is_known,
                    });
                };
                if settings.starts == Starts::Wrong {
                    starts::wrong(&trace)
                        .into_iter()
                        .for_each(|(sidecar, contact_prior)| add(sidecar, None, Some(contact_prior)));
                }
                for (sidecar, mounted) in arrays.trials(&dataset.folder, &trace, &settings.encoders)? {
                    add(sidecar, mounted, None);
                }
            }
        }
        arrays.check(&settings.encoders)?;
        check_distinct("trace", trials.iter().map(|trial| trial.sidecar.name.clone()))?;
        let (entered, names, skipped) = (Vec::new(), Vec::new(), Vec::new());
        let mut bench =
            Self { trials, calibrations, largest_readings, front_end, participants: entered, names, skipped };
        for participant in participants {
            let is_configured = settings.config.contains_key(&participant.describe().name);
            bench.admit(participant, settings.estimators.is_some() || is_configured)?;
        }
        Ok(bench)
    }

    /// Takes an participant in, if the sensor model that it insists on is calibrated for every whisker and it can run; so what is wrong is found before anything
    /// is run. Without the sensor model it is left out, unless it was asked for by name or settings.
    fn admit(&mut self, participant: Box<dyn Participant>, by_name: bool) -> anyhow::Result<()> {
        let label = participant.sensor_model();
        if let Some(label) = label.filter(|_| !by_name)
            && let Some(lacking) = self.calibrations.values().find(|calibration| calibration.lacks(label))
        {
            self.skipped.push(Skipped {
                estimator: participant.describe().name,
                sensor_model: label.into(),
                calibration: lacking.path.clone(),
            });
            return Ok(());
        }
        for calibration in self.calibrations.values_mut() {
            calibration.load(label)?;
        }
        let sidecar = &self.trials[0].sidecar;
        participant.check(&knowledge(sidecar, &self.calibrations[&sidecar.whisker.name].faces[&label], 0.0))?;
        self.names.push(participant.describe().name);
        self.participants.push(participant);
        Ok(())
    }

    /// Trials without a known contact.
    fn unscored(&self) -> Vec<String> {
        self.trials.iter().filter(|trial| !trial.is_known).map(|trial| trial.sidecar.name.clone()).collect()
    }

    /// Whether a run from the same inputs is there, with all that belongs to it.
    fn is_up_to_date(&self, folder: &Path, run: &Run) -> bool {
        let same = |old: Run| old.watermark.inputs_sha256 == run.watermark.inputs_sha256;
        let of_entrants = |folder: &'static str| {
            let names = &self.names;
            self.trials.iter().flat_map(move |trial| {
                let trace = &trial.sidecar.name;
                names.iter().map(move |name| format!("{folder}/{trace}.{name}.csv"))
            })
        };
        let outlines = self
            .trials
            .iter()
            .filter(|trial| trial.outline.is_some())
            .map(|trial| format!("outlines/{}.csv", trial.sidecar.name));
        let bounds = self.trials.iter().map(|trial| format!("bounds/{}.csv", trial.sidecar.name));
        let events = self
            .trials
            .iter()
            .flat_map(|trial| DETECTORS.iter().map(|row| format!("events/{}", event_file(&trial.sidecar, row))));
        let tables = [
            "trials.csv",
            "summary.csv",
            "error_over_time.csv",
            "consistency.csv",
            "contours.csv",
            "contour_trials.csv",
            "failures.csv",
            "maps.csv",
            "map_objects.csv",
        ];
        read_json::<Run>(&folder.join("run.json")).is_ok_and(same)
            && tables
                .into_iter()
                .map(String::from)
                .chain(of_entrants("estimates"))
                .chain(of_entrants("contours"))
                .chain(outlines)
                .chain(bounds)
                .chain(events)
                .chain(arrays::files(&run.recordings, &self.names))
                .chain(self.model_files().map(|(_, name)| format!("models/{name}")))
                .chain(
                    self.sensors()
                        .flat_map(|sensor| self.front_end.table_files(sensor))
                        .map(|name| format!("sensors/{name}")),
                )
                .all(|name| folder.join(name).is_file())
    }

    /// What stands in `run.json`.
    fn run(&self, settings: &EvaluateSettings) -> anyhow::Result<Run> {
        let estimators: Vec<RunEstimator> =
            self.participants.iter().map(|participant| participant.describe()).collect();
        let sets: Vec<RunSet> = self
            .largest_readings
            .iter()
            .map(|(key, &largest_reading_n_m)| {
                let sidecars = self.trials.iter().map(|trial| &trial.sidecar);
                let members: Vec<&Sidecar> = sidecars.filter(|sidecar| set_key(sidecar) == *key).collect();
                RunSet {
                    group: key.0.clone(),
                    whisker: key.1.clone(),
                    object: members[0].object.clone(),
                    traces: members.iter().map(|sidecar| sidecar.name.clone()).collect(),
                    largest_reading_n_m,
                }
            })
            .collect();
        let calibrations: Vec<RunCalibration> = self
            .calibrations
            .values()
            .flat_map(|calibration| {
                calibration.faces[&None].iter().map(|face| RunCalibration {
                    whisker: calibration.file.whisker.name.clone(),
                    face: face.face.name().into(),
                    model: face.model.about(),
                    sha256: calibration.sha256.clone(),
                    heldout_rms_n_m: face.heldout_rms_n_m,
                    heldout_worst_n_m: face.heldout_worst_n_m,
                    largest_reading_n_m: face.largest_reading_n_m,
                })
            })
            .collect();
        let front_end = self.front_end.describe(self.sensors().cloned().collect());
        let recordings = arrays::recordings(self.mounted(), settings.map);
        let mut inputs = vec![
            serde_json::to_string(&(
                &settings.name,
                &settings.noise,
                &settings.seeds,
                &settings.touch,
                settings.starts,
            ))?,
            serde_json::to_string(&(&estimators, &sets, &calibrations))?,
            serde_json::to_string(&front_end)?,
            serde_json::to_string(&recordings)?,
        ];
        inputs.extend(arrays::inputs(self.mounted().map(|(_, mounted)| mounted))?);
        for trial in &self.trials {
            let sidecar = &trial.sidecar;
            inputs.push(sidecar.csv_sha256.clone());
            inputs.push(sidecar.contour.as_ref().map_or_else(String::new, |contour| contour.sha256.clone()));
        }
        Ok(Run {
            format: files::FORMAT,
            kind: "run".into(),
            name: settings.name.clone(),
            watermark: watermark(inputs.iter().map(String::as_str)),
            noise: settings.noise.clone(),
            seeds: settings.seeds.clone(),
            front_end,
            touch: settings.touch,
            estimators,
            sets,
            calibrations,
            whiskers: self.calibrations.values().map(|calibration| calibration.file.whisker.clone()).collect(),
            recordings,
        })
    }

    /// Standard deviation of the measurement noise that is added to a trial at a noise level.
    fn added_noise_sd_n_m(&self, trial: &BenchTrial, noise: f64) -> f64 {
        noise * self.largest_readings[&set_key(&trial.sidecar)]
    }

    /// Standard deviation of all of its measurement noise.
    fn noise_sd_n_m(&self, trial: &BenchTrial, noise: f64) -> f64 {
        replay::noise_sd_n_m(self.added_noise_sd_n_m(trial, noise), trial.sensor.as_ref(), &trial.sidecar)
    }

    /// The trials that are whiskers of recordings of several.
    fn mounted(&self) -> impl Iterator<Item = (&Sidecar, &Mounted)> {
        self.trials.iter().filter_map(|trial| Some((&trial.sidecar, trial.mounted.as_ref()?)))
    }

    /// A trial as the front end is played it at a noise level. The earth's field turns with the sensor as it is, not as the encoders have it,
    /// and its noise is the same whatever these are.
    fn played<'a>(&self, member: &'a Member<'_>, noise: f64, seed: u64) -> SensorInput<'a> {
        let Member { trial, trace, .. } = member;
        let played = SensorInput::new(trace, &trial.mounting, self.added_noise_sd_n_m(trial, noise), seed);
        let sidecar = trial.mounted.as_ref().map_or(played.sidecar, Mounted::sidecar);
        SensorInput { sidecar, sensor: trial.sensor.as_ref(), ..played }
    }

    /// The sensors of the trials, each once.
    fn sensors(&self) -> impl Iterator<Item = &SensorFile> {
        let mut seen = BTreeSet::new();
        let of_trials = self.trials.iter().filter_map(|trial| trial.sensor.as_ref());
        of_trials.filter(move |sensor| seen.insert((&sensor.array, &sensor.name)))
    }

    /// What no estimator can do better than on a trial at a noise level.
    fn bound(&self, member: &Member<'_>, noise: f64) -> Option<TraceBound> {
        let Member { trial, trace, .. } = member;
        let sidecar = &trial.sidecar;
        let faces = &self.calibrations[&sidecar.whisker.name].faces[&None];
        let face = faces
            .iter()
            .find(|face| face.face == sidecar.face)
            .expect("the face was checked when the trial was opened");
        TraceBound::new(trace, face, self.noise_sd_n_m(trial, noise), &trial.base_noise())
    }

    /// Replays one trial of a scene through every participant, at one noise level and under one seed; writes estimates, outlines and the bound where a folder is given,
    /// of a trial that cannot be scored too: every run has the same files. Such a trial, or one on which an participant fails, is no error of the batch.
    fn run_trial(
        &self,
        (member, scene): (&Member<'_>, &[Member<'_>]),
        level: usize,
        seed: u64,
        settings: &EvaluateSettings,
        out: Option<&Path>,
    ) -> anyhow::Result<(Yield, Vec<Sighting>)> {
        let Member { trial: bench_trial, trace: true_one, motions: as_is, ground_truth, .. } = member;
        let BenchTrial { outline, sensor, mounted, contact_prior, .. } = bench_trial;
        let noise = settings.noise[level];
        let bound = member.bound(level, || self.bound(member, noise));
        let known = mounted.as_ref().map_or(Cow::Borrowed(true_one), |mounted| mounted.known(true_one, seed));
        let trace = known.as_ref();
        let sidecar = &trace.sidecar;
        let calibration = &self.calibrations[&sidecar.whisker.name];
        let (noise_sd_n_m, base_noise) = (self.noise_sd_n_m(bench_trial, noise), bench_trial.base_noise());
        let neighbours: Vec<SensorInput> =
            scene.iter().filter(|other| other.is_beside(member)).map(|other| self.played(other, noise, seed)).collect();
        let played = SensorInput { neighbours: &neighbours, ..self.played(member, noise, seed) };
        let failed = |estimator: Option<&str>, reason: String| {
            let (trace, estimator) = (sidecar.name.clone(), estimator.map(Into::into));
            FailureRow { trace, estimator, noise, seed, reason }
        };
        let readings_n_m = match self.front_end.readings_n_m(&played) {
            Ok(readings_n_m) => readings_n_m,
            Err(error) => {
                let failures = vec![failed(None, format!("{error:#}"))];
                return Ok((Yield { failures, ..Yield::default() }, Vec::new()));
            }
        };
        let (samples, ground_truth) = match &known {
            Cow::Borrowed(_) => (with_readings(as_is, &readings_n_m), Cow::Borrowed(ground_truth)),
            Cow::Owned(measured) => {
                let rest = sidecar.whisker.rest_shape();
                let ground_truth = GroundTruth::new(measured, outline.as_ref(), &rest);
                (with_readings(&motions(&measured.recording), &readings_n_m), Cow::Owned(ground_truth))
            }
        };
        if let Some(folder) = out {
            let path = folder.join("bounds").join(format!("{}.csv", sidecar.name));
            let rows = bound.map_or_else(Vec::new, |bound| tables::bound_rows(trace, bound));
            write_atomically(&path, &csv_bytes(&rows)?)?;
        }
        let robot = knowledge(sidecar, &read_by(sensor.as_ref(), &calibration.faces[&None]), noise_sd_n_m);
        let touched = replay::touched(settings.touch, &robot, &samples);
        if let Some(folder) = out {
            for row in DETECTORS {
                let touch = if settings.touch.is_of(row) { settings.touch } else { (row.config)() };
                let rows = tables::event_rows(trace, &readings_n_m, &replay::signals(touch, &robot, &samples));
                write_atomically(&folder.join("events").join(event_file(sidecar, row)), &csv_bytes(&rows)?)?;
            }
        }
        let events = Events::of(trace, &touched);
        let mut done = Yield::default();
        let mut sightings = Vec::new();
        let never_touches = first_touch_s(trace).err().filter(|unscored| *unscored == Unscored::NeverTouches);
        done.failures.extend(never_touches.map(|unscored| failed(None, unscored.to_string())));
        for (participant, name) in self.participants.iter().zip(&self.names) {
            let faces = read_by(sensor.as_ref(), &calibration.faces[&participant.sensor_model()]);
            let knowledge = Arc::unwrap_or_clone(knowledge(sidecar, &faces, noise_sd_n_m));
            let knowledge = Arc::new(Knowledge { contact_prior: *contact_prior, base_noise, ..knowledge });
            let (samples, touched) = (samples.as_slice(), touched.as_slice());
            let task = Task { knowledge: &knowledge, samples, touched, trace: &sidecar.name, seed };
            let answer = caught(|| participant.replay(&task).map_err(|error| format!("{error:#}"))).flatten();
            let replay = answer.unwrap_or_else(|reason| Replay::silent(samples.len(), reason));
            done.failures.extend(replay.failure.iter().map(|reason| failed(Some(name), reason.clone())));
            let outline = outline.as_ref();
            let events = events.as_ref();
            let (knowledge, readings_n_m, ground_truth) = (&*knowledge, readings_n_m.as_slice(), ground_truth.as_ref());
            let trial = Trial { trace, outline, knowledge, readings_n_m, events, bound, ground_truth };
            if let Some(mounted) = mounted {
                match mounted.sighting((&trial, &replay), (name, noise, seed), &settings.map) {
                    Ok(sighting) => sightings.push(sighting),
                    Err(error) => done.failures.push(failed(Some(name), format!("{error:#}"))),
                }
            }
            let said = trial.surface_points(&replay);
            let contour = trial.contour(&replay, &said, 0).filter(|_| mounted.is_none());
            if let Some(folder) = out {
                let path = folder.join("estimates").join(format!("{}.{name}.csv", sidecar.name));
                write_atomically(&path, &csv_bytes(&tables::estimate_rows(&trial, &replay.estimates))?)?;
                let path = folder.join("contours").join(format!("{}.{name}.csv", sidecar.name));
                write_atomically(&path, &csv_bytes(&vertex_rows(contour.as_ref()))?)?;
            }
            let scored = match Scored::new(&trial, &replay, &said, contour.as_ref()) {
                Ok(scored) => Some(scored),
                Err(Unscored::TruthUnknown) => None,
                Err(Unscored::NeverTouches) => continue,
            };
            if has_outline(&sidecar.object) {
                let compared = match &scored {
                    Some(scored) => scored.contour,
                    None => contour
                        .as_ref()
                        .zip(outline)
                        .map(|(contour, outline)| Comparison::new(contour, outline, &Touched::default())),
                };
                let contact_rmse_m = scored.as_ref().and_then(contour::CONTACT_RMSE.measure);
                let found = ContourTrialRow { contact_rmse_m, ..trial_row(sidecar, contour.as_ref(), compared) };
                done.contours.push(ContourTrialRow { estimator: name.clone(), noise, seed, ..found });
            }
            let Some(scored) = scored else { continue };
            let stated = scored.contacts.iter().filter_map(|contact| replay.estimates[contact.row]?.models);
            let models = tables::mean_shares(stated);
            let head = TrialHead {
                trace: sidecar.name.clone(),
                group: sidecar.group.clone(),
                whisker: sidecar.whisker.name.clone(),
                object: sidecar.object.clone(),
                estimator: name.clone(),
                noise,
                seed,
                touch_s: scored.touch_s,
                samples: scored.steady().len(),
                missing: scored.missing(),
                models: models.map(|models| models.to_string()),
            };
            done.outcomes.push(Outcome {
                row: TrialRow { head, scores: Scores::of(&scored) },
                models: models.iter().flat_map(ModelShares::iter).map(|(name, share)| (name.into(), share)).collect(),
                over_time: OverTime::of(&scored),
                elapsed_ns: replay.elapsed_ns as u64,
                steps: samples.len(),
            });
        }
        Ok((done, sightings))
    }

    /// Tables about the sensor models, beside the calibrations: folder and name.
    fn model_files(&self) -> impl Iterator<Item = (&Path, String)> {
        self.calibrations.iter().flat_map(|(whisker, calibration)| {
            let folder = calibration.path.parent().unwrap_or(Path::new("."));
            calibration.faces[&None].iter().flat_map(move |face| {
                REPORT_TABLES.map(|table| (folder, format!("{}.{table}.csv", face_stem(whisker, face.face))))
            })
        })
    }

    /// Copies what the report needs, so that it can be drawn from the run alone.
    fn copy_for_report(&self, folder: &Path) -> anyhow::Result<()> {
        for BenchTrial { sidecar, outline, .. } in &self.trials {
            if let Some(outline) = outline {
                let path = folder.join("outlines").join(format!("{}.csv", sidecar.name));
                write_atomically(&path, outline.to_csv().as_bytes())?;
            }
        }
        for sensor in self.sensors() {
            for (name, bytes) in self.front_end.tables(sensor)? {
                write_atomically(&folder.join("sensors").join(name), &bytes)?;
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
    /// Reads a calibration with the sensor models that it chose.
    fn read(path: &Path) -> anyhow::Result<Self> {
        if !path.is_file() {
            bail!("{}: no such calibration; `whisker fit` makes it, with the same --front-end", path.display());
        }
        let bytes = fs::read(path).with_context(|| path.display().to_string())?;
        let file = CalibrationFile::read(path)?;
        let faces = BTreeMap::from([(None, file.calibrated(path, None)?)]);
        Ok(Self { path: path.into(), file, sha256: sha256(bytes), faces })
    }

    /// Whether a face is without a sensor model of this label.
    fn lacks(&self, label: &str) -> bool {
        self.file.faces.iter().any(|face| face.model(Some(label)).is_none())
    }

    /// Makes the sensor models of this label ready.
    fn load(&mut self, label: Option<&'static str>) -> anyhow::Result<()> {
        if !self.faces.contains_key(&label) {
            self.faces.insert(label, self.file.calibrated(&self.path, label)?);
        }
        Ok(())
    }
}

/// Name of the table of what a detector saw in a trace.
fn event_file(sidecar: &Sidecar, detector: &DetectorRow) -> String {
    format!("{}.{}.csv", sidecar.name, detector.name)
}

fn set_key(sidecar: &Sidecar) -> SetKey {
    (sidecar.group.clone(), sidecar.whisker.name.clone())
}
