//! Preparation of an evaluation: trials, calibrations, front end and participants, read and checked before anything is replayed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use strict_json::shown_number;
use testbed::dataset::Dataset;
use testbed::encoders::Encoders;
use testbed::fitted_traces::check_fitted_to_all;
use testbed::front_end::{FrontEnd, Mounting};
use testbed::metrics::{ContactCount, Unscored, first_touch_s};
use testbed::noise::NoiseUnit;
use testbed::replay::{check_calibration, knowledge, noise_sd_n_m};
use testbed::results::SetName;
use testbed::settings::SettingsOf;
use trace::{Miscalibration, Outline, Role, SensorFile, Sidecar, Trace};
use whisker::estimators::{BaseNoise, ContactPrior};

use super::array_members::{ArrayMember, ArrayReader};
use super::calibration::{Calibration, Calibrations};
use super::settings::{EvaluateSettings, OmittedEstimator};
use super::starts::{self, Starts};
use crate::distinct::check_distinct;
use crate::participant::Participant;
use crate::plausibility::{Subject, contradicted_rate};
use crate::remarks::TrialRemarks;

/// Share of the largest calibrated reading above which a reading is that of a touch, not of the inertia or damping of a free whisker.
const TOUCHING: f64 = 0.05;

/// A trace to be replayed, without its rows, which are read when it is replayed.
pub(super) struct TrialSpec {
    /// Sidecar under the name that the trial has in the run.
    pub(super) sidecar: Sidecar,
    /// CSV of the trace.
    pub(super) path: PathBuf,
    /// Outline of the object, if known.
    pub(super) outline: Option<Outline>,
    pub(super) mounting: Mounting,
    /// Calibration of the magnetic sensor. `None` if the front end has none.
    pub(super) sensor: Option<SensorFile>,
    /// Recording of several whiskers to which the trace belongs.
    pub(super) array: Option<ArrayMember>,
    /// Prior of the first contact. `None` for the default prior along the undeflected whisker.
    pub(super) contact_prior: Option<ContactPrior>,
    /// Deviations from the calibration.
    pub(super) miscalibration: Miscalibration,
    /// Sidecar by whose name the noise is drawn: without encoders and miscalibrations in the name.
    pub(super) recorded: Arc<Sidecar>,
    /// Whether the true contact is known, so that the trial can be scored.
    pub(super) is_known: bool,
}

impl TrialSpec {
    /// Name of the scene: the recording of several whiskers, or the trace alone. Trials of one scene are replayed together.
    pub(super) fn scene(&self) -> String {
        self.array.as_ref().map_or_else(
            || format!("trace {}", self.sidecar.name),
            |member| format!("recording {}", member.recording()),
        )
    }

    /// Whether the deviation of the sensor and the velocity of the object are known, and the estimator is alone: unknown are those
    /// of real sensors and of modelled ones.
    pub(super) fn knows_quantities(&self) -> bool {
        self.array.is_none() && self.sensor.is_none() && self.sidecar.recorded.is_none()
    }

    /// Noise of the known pose of the base.
    pub(super) fn base_noise(&self) -> BaseNoise {
        self.array.as_ref().map(ArrayMember::base_noise).unwrap_or_default()
    }

    /// Group and whisker.
    pub(super) fn set(&self) -> SetName {
        SetName { group: self.sidecar.group.clone(), whisker: self.sidecar.whisker.name.clone() }
    }
}

/// An evaluation that is ready to run.
pub(super) struct Prepared {
    pub(super) trials: Vec<TrialSpec>,
    pub(super) calibrations: Calibrations,
    /// Largest absolute reading of each set without noise and without gated readings.
    pub(super) largest_readings_n_m: BTreeMap<SetName, f64>,
    /// Traces with gated readings: name, number of these readings and of all rows.
    pub(super) gated: Vec<(String, usize, usize)>,
    pub(super) remarks: TrialRemarks,
    noise_unit: NoiseUnit,
    pub(super) front_end: FrontEnd,
    pub(super) participants: Vec<Box<dyn Participant>>,
    /// Names of the participants.
    pub(super) names: Vec<String>,
    pub(super) omitted: Vec<OmittedEstimator>,
}

impl Prepared {
    /// Reads and checks the inputs of an evaluation.
    ///
    /// # Errors
    /// If settings are invalid, or inputs cannot be read or contradict one another.
    pub(super) fn new(datasets: &[Dataset], settings: &EvaluateSettings) -> anyhow::Result<Self> {
        check_settings(settings)?;
        let participants = settings.participants()?;
        let mut prepared = Self {
            trials: Vec::new(),
            calibrations: Calibrations::default(),
            largest_readings_n_m: BTreeMap::new(),
            gated: Vec::new(),
            remarks: TrialRemarks::default(),
            noise_unit: settings.noise_unit,
            front_end: FrontEnd::new(&settings.front_end)?,
            participants: Vec::new(),
            names: Vec::new(),
            omitted: Vec::new(),
        };
        let mut arrays = ArrayReader::default();
        for dataset in datasets {
            let default = || dataset.calibrations(prepared.front_end.row.name);
            let calibrations = settings.calibrations.clone().unwrap_or_else(default);
            for csv in dataset.of_role(Role::Trial)? {
                prepared.add_trace(csv, &dataset.folder, &calibrations, &mut arrays, settings)?;
            }
            if settings.calibrations.is_none() {
                for Calibration { path, file, .. } in prepared.calibrations.iter() {
                    if path.parent() == Some(&calibrations) {
                        check_fitted_to_all(path, file, dataset)?;
                    }
                }
            }
        }
        arrays.check(&settings.encoders)?;
        check_distinct("trace", prepared.trials.iter().map(|trial| trial.sidecar.name.clone()))?;
        for participant in participants {
            prepared.admit(participant, settings)?;
        }
        Ok(prepared)
    }

    /// Adds the trials of one trace: one for each prior of the first contact and for each of the encoders.
    fn add_trace(
        &mut self,
        csv: &Path,
        folder: &Path,
        calibrations: &Path,
        arrays: &mut ArrayReader,
        settings: &EvaluateSettings,
    ) -> anyhow::Result<()> {
        let trace = Trace::read(csv)?;
        let sidecar = &trace.sidecar;
        self.front_end.check_trace(sidecar)?;
        let whisker = &sidecar.whisker.name;
        let path = calibrations.join(format!("{whisker}.json"));
        let calibration = self.calibrations.open(whisker, &path)?;
        check_calibration(&path, &calibration.file, sidecar)?;
        let mounting = Mounting::of(folder, sidecar)?;
        let spec = TrialSpec {
            sensor: self.front_end.sensor(&path, &calibration.file, &mounting)?.cloned(),
            sidecar: sidecar.clone(),
            path: csv.into(),
            // The file has the pose at the start.
            outline: if sidecar.is_object_at_rest() { trace.outline(folder)? } else { None },
            mounting,
            array: None,
            contact_prior: None,
            miscalibration: Miscalibration::default(),
            recorded: Arc::new(sidecar.clone()),
            is_known: first_touch_s(&trace) != Err(Unscored::TruthUnknown),
        };
        let gate = calibration.file.gate();
        self.remarks.rates.extend(contradicted_rate(&trace).map(|finding| (sidecar.name.clone(), finding)));
        let touched = calibration.faces(None).iter().find(|face| face.face == sidecar.face);
        let set = SetName { group: sidecar.group.clone(), whisker: whisker.clone() };
        let largest_n_m = trace.moments_n_m().into_iter().map(f64::abs).fold(0.0, f64::max);
        let touches = largest_n_m > TOUCHING * calibration.file.largest_reading_n_m();
        let touching = Subject::new(&trace, None).touching_face().filter(|_| touches);
        if let Some(face) =
            touching.filter(|touching| calibration.faces(None).iter().all(|face| face.face != *touching))
        {
            *self.remarks.uncalibrated.entry((set.clone(), face)).or_default() += 1;
        }
        self.remarks.contacts.entry(set).or_default().add(ContactCount::of(&trace, touched.map(|face| &**face)));
        let mut admitted = trace.moments_n_m();
        let rows = admitted.len();
        admitted.retain(|moment_n_m| gate.admits(*moment_n_m));
        let largest_n_m = admitted.iter().copied().map(f64::abs).fold(0.0, f64::max);
        if admitted.len() < rows {
            self.gated.push((sidecar.name.clone(), rows - admitted.len(), rows));
        }
        if settings.starts == Starts::Wrong {
            for (sidecar, prior) in starts::wrong(&trace) {
                self.add(spec.with(sidecar, None, Some(prior)), largest_n_m, settings)?;
            }
        }
        for (sidecar, member) in arrays.trials(folder, &trace, &settings.encoders)? {
            self.add(spec.with(sidecar, member, None), largest_n_m, settings)?;
        }
        Ok(())
    }

    /// Adds a trial with each of the miscalibrations.
    fn add(&mut self, trial: TrialSpec, largest_n_m: f64, settings: &EvaluateSettings) -> anyhow::Result<()> {
        for trial in trial.miscalibrated(&settings.miscalibrations)? {
            trial.check_noise(self.noise_unit)?;
            let largest = self.largest_readings_n_m.entry(trial.set()).or_default();
            *largest = largest.max(largest_n_m);
            self.trials.push(trial);
        }
        Ok(())
    }

    /// Admits a participant that can run with the calibrations of all whiskers, so that errors are found before
    /// anything is replayed. A participant whose sensor model is not calibrated is omitted unless the settings require
    /// it.
    fn admit(&mut self, participant: Box<dyn Participant>, settings: &EvaluateSettings) -> anyhow::Result<()> {
        let (label, name) = (participant.sensor_model(), participant.describe().name);
        if let Some(label) = label.filter(|_| !settings.requires(&name))
            && let Some(lacking) = self.calibrations.iter().find(|calibration| calibration.lacks(label))
        {
            let (sensor_model, calibration) = (label.into(), lacking.path.clone());
            self.omitted.push(OmittedEstimator { estimator: name, sensor_model, calibration });
            return Ok(());
        }
        self.calibrations.load(label)?;
        let first = &self.trials[0];
        participant.check(&knowledge(&first.sidecar, self.calibration(first).faces(label), 0.0))?;
        self.names.push(name);
        self.participants.push(participant);
        Ok(())
    }

    /// Calibration of a trial's whisker.
    pub(super) fn calibration(&self, trial: &TrialSpec) -> &Calibration {
        self.calibrations.of(&trial.sidecar.whisker.name)
    }

    /// Names of the trials whose true contact is unknown.
    pub(super) fn unscored(&self) -> Vec<String> {
        self.trials.iter().filter(|trial| !trial.is_known).map(|trial| trial.sidecar.name.clone()).collect()
    }

    /// Standard deviation of the measurement noise that is added to a trial at a noise level.
    pub(super) fn added_noise_sd_n_m(&self, trial: &TrialSpec, noise: f64) -> f64 {
        let of_set = || self.largest_readings_n_m[&trial.set()];
        match self.noise_unit {
            NoiseUnit::Set => noise * of_set(),
            NoiseUnit::Range => noise * self.largest_calibrated_n_m(trial),
            NoiseUnit::NewtonMetre => noise,
            NoiseUnit::Stated => noise * trial.sidecar.replay.map_or(0.0, |stated| stated.noise) * of_set(),
        }
    }

    /// Largest calibrated reading of the face with which a trial touches.
    pub(super) fn largest_calibrated_n_m(&self, trial: &TrialSpec) -> f64 {
        let faces = self.calibration(trial).faces(None).iter().filter(|face| face.face == trial.sidecar.face);
        faces.map(|face| face.largest_reading_n_m).fold(0.0, f64::max)
    }

    /// Standard deviation of all measurement noise of a trial at a noise level.
    pub(super) fn noise_sd_n_m(&self, trial: &TrialSpec, noise: f64) -> f64 {
        noise_sd_n_m(self.added_noise_sd_n_m(trial, noise), trial.sensor.as_ref(), &trial.sidecar)
    }

    /// Trials that belong to recordings of several whiskers.
    pub(super) fn array_members(&self) -> impl Iterator<Item = (&Sidecar, &ArrayMember)> {
        self.trials.iter().filter_map(|trial| Some((&trial.sidecar, trial.array.as_ref()?)))
    }

    /// Sensors of the trials, each once.
    pub(super) fn sensors(&self) -> impl Iterator<Item = &SensorFile> {
        let mut seen = BTreeSet::new();
        let of_trials = self.trials.iter().filter_map(|trial| trial.sensor.as_ref());
        of_trials.filter(move |sensor| seen.insert((&sensor.array, &sensor.name)))
    }
}

impl TrialSpec {
    /// The same trace as another trial.
    fn with(&self, sidecar: Sidecar, array: Option<ArrayMember>, contact_prior: Option<ContactPrior>) -> Self {
        Self {
            sidecar,
            array,
            contact_prior,
            path: self.path.clone(),
            outline: self.outline.clone(),
            mounting: self.mounting.clone(),
            sensor: self.sensor.clone(),
            miscalibration: self.miscalibration,
            recorded: self.recorded.clone(),
            is_known: self.is_known,
        }
    }

    /// The trial with each of some miscalibrations, under a name and in a group of its own unless there is none.
    /// Without `given` the trial with those that its trace states.
    ///
    /// # Errors
    /// If a miscalibration is given for a whisker of an arm, whose encoders measure the poses.
    fn miscalibrated(self, given: &[Miscalibration]) -> anyhow::Result<Vec<Self>> {
        let recorded = match &self.array {
            Some(member) => member.recorded().clone(),
            None => Arc::new(self.sidecar.clone()),
        };
        if given.is_empty() {
            let miscalibration =
                self.sidecar.replay.map_or_else(Miscalibration::default, |stated| stated.miscalibration);
            return Ok(vec![Self { miscalibration, recorded, ..self }]);
        }
        if self.array.is_some() {
            let name = &self.sidecar.name;
            bail!("{name}: found a whisker of an arm with a miscalibration, expected traces of single whiskers");
        }
        let with = |miscalibration: &Miscalibration| {
            let mut sidecar = self.sidecar.clone();
            if !miscalibration.is_none() {
                sidecar.name = format!("{}_{}", sidecar.name, miscalibration.label());
                sidecar.group = format!("{}, {}", sidecar.group, miscalibration.label().replace('_', " "));
            }
            let recorded = recorded.clone();
            Self { miscalibration: *miscalibration, recorded, ..self.with(sidecar, None, self.contact_prior) }
        };
        Ok(given.iter().map(with).collect())
    }

    /// # Errors
    /// If the noise is to be the stated one and the trace states none.
    fn check_noise(&self, unit: NoiseUnit) -> anyhow::Result<()> {
        if unit == NoiseUnit::Stated && self.sidecar.replay.is_none() {
            let path = self.path.with_extension("json");
            bail!("{}: replay: found no stated noise, expected one; --noise-unit states another noise", path.display());
        }
        Ok(())
    }
}

fn check_settings(settings: &EvaluateSettings) -> anyhow::Result<()> {
    if settings.noise.is_empty() || settings.seeds.is_empty() {
        bail!("an evaluation needs at least one noise level and one seed");
    }
    check_distinct("noise level", settings.noise.iter().map(f64::to_string))?;
    settings.touch.validate().with_context(|| SettingsOf("touch".into()))?;
    settings.map.validate().with_context(|| SettingsOf("map".into()))?;
    settings.encoders.iter().try_for_each(Encoders::validate)?;
    for miscalibration in &settings.miscalibrations {
        if let Some((name, found, most)) = miscalibration.out_of_range() {
            bail!("miscalibration: {name}: found {}, expected -{most} to {most}", shown_number(found));
        }
    }
    check_distinct("miscalibration", settings.miscalibrations.iter().map(Miscalibration::label))?;
    check_distinct("encoders", settings.encoders.iter().map(Encoders::label))
}
