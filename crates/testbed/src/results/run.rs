//! `run.json`: inputs, settings and provenance of a run.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use trace::{FrontEndFile, Miscalibration, ObjectClass, is_plain_name};
use whisker::Whisker;
use whisker::estimators::MethodClass;
use whisker::events::TouchConfig;

use crate::encoders::Encoders;
use crate::map::MapConfig;
use crate::noise::NoiseUnit;

/// Contents of `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Version of the format, 1.
    pub format: u32,
    /// `"run"`.
    pub kind: String,
    /// Name of the run.
    pub name: String,
    /// Program and inputs that produced the run.
    pub watermark: files::Watermark,
    /// Noise levels.
    pub noise: Vec<f64>,
    /// Unit of the noise levels; by default the largest reading of each set.
    #[serde(default, skip_serializing_if = "NoiseUnit::is_default")]
    pub noise_unit: NoiseUnit,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// Front end through which the trials were read, with its settings and the calibration of its sensors.
    pub front_end: FrontEndFile,
    /// Settings of the touch detection.
    pub touch: TouchConfig,
    /// Estimators with their settings.
    pub estimators: Vec<RunEstimator>,
    /// Sets of trials: one a group and whisker.
    pub sets: Vec<RunSet>,
    /// Calibrations used.
    pub calibrations: Vec<RunCalibration>,
    /// Parameters of the whiskers, from which the report draws their bent shapes.
    pub whiskers: Vec<Whisker>,
    /// Recordings of several whiskers among the traces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<RunRecording>,
}

/// Recording of several whiskers, as replayed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunRecording {
    /// Name of the recording, with a suffix for the encoders if these are not perfect.
    pub name: String,
    /// Group of its traces.
    pub group: String,
    /// Encoders of the arm's joints.
    pub encoders: Encoders,
    /// Settings of the map.
    pub map: MapConfig,
    /// Names of the objects, whose true outlines are `outlines/<name>.<object>.csv`.
    pub objects: Vec<String>,
    /// Whiskers of the recording.
    pub whiskers: Vec<RunMounted>,
}

/// One whisker of a recording of several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunMounted {
    /// Name of the whisker.
    pub name: String,
    /// Array of the whisker.
    pub array: String,
    /// Name of its trace in the run.
    pub trace: String,
}

impl Run {
    /// Reads and checks `run.json`.
    ///
    /// # Errors
    /// If the file is missing, does not parse, or does not describe a run.
    pub fn read(path: &Path) -> Result<Self, files::Error> {
        let run: Self = files::read_json(path)?;
        if run.format != files::FORMAT {
            return Err(files::Error::value(path, "format", run.format, files::FORMAT));
        }
        if run.kind != "run" {
            return Err(files::Error::value(path, "kind", &run.kind, "run"));
        }
        for (key, is_empty) in [("noise", run.noise.is_empty()), ("estimators", run.estimators.is_empty())] {
            if is_empty {
                return Err(files::Error::value(path, key, "an empty list", "at least one entry"));
            }
        }
        for (key, name) in run.names() {
            if !is_plain_name(name) {
                return Err(files::Error::value(path, key, format!("`{name}`"), "a plain file name"));
            }
        }
        Ok(run)
    }

    /// Names from which file names are composed, each with its key.
    fn names(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let estimators = self.estimators.iter().map(|estimator| ("estimators.name", &estimator.name));
        let sets = self.sets.iter().flat_map(|set| {
            let own = [("sets.group", &set.group), ("sets.whisker", &set.whisker)];
            own.into_iter().chain(set.traces.iter().map(|trace| ("sets.traces", trace)))
        });
        let calibrations = self.calibrations.iter().flat_map(|calibration| {
            [("calibrations.whisker", &calibration.whisker), ("calibrations.face", &calibration.face)]
        });
        let sensors =
            self.front_end.sensors.iter().flat_map(|sensor| {
                [("front_end.sensors.name", &sensor.name), ("front_end.sensors.array", &sensor.array)]
            });
        let recordings = self.recordings.iter().flat_map(|recording| {
            let objects = recording.objects.iter().map(|object| ("recordings.objects", object));
            std::iter::once(("recordings.name", &recording.name)).chain(objects)
        });
        let named = estimators.chain(sets).chain(calibrations).chain(sensors).chain(recordings);
        named.map(|(key, name)| (key, name.as_str()))
    }
}

/// Name of the estimator that the documentation recommends.
pub const RECOMMENDED: &str = "recommended";

/// One estimator of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunEstimator {
    /// Name in the registry.
    pub name: String,
    /// Description in one line.
    pub about: String,
    /// Information available to the method, and its role in comparisons.
    #[serde(rename = "kind")]
    pub class: MethodClass,
    /// Label of the sensor model that the method requires. `None` if it uses the one chosen by the calibration.
    pub sensor_model: Option<String>,
    /// Settings.
    pub config: serde_json::Value,
}

impl RunEstimator {
    /// Name for figures and tables. Methods with hindsight are marked, since they use later readings.
    pub fn label(&self) -> String {
        match self.class {
            MethodClass::Recursive | MethodClass::Published | MethodClass::Baseline => self.name.clone(),
            MethodClass::Hindsight => format!("{} (hindsight)", self.name),
        }
    }

    /// Whether the method is an external program rather than a row of the registry.
    pub fn is_program(&self) -> bool {
        self.config.get("command").is_some()
    }
}

/// Set of trials that are scored together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunSet {
    /// Group.
    pub group: String,
    /// Whisker.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Classes of the objects that recordings state, by the objects' names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub object_classes: BTreeMap<String, ObjectClass>,
    /// Names of the traces.
    pub traces: Vec<String>,
    /// Largest absolute reading of the set without noise, of which noise levels are fractions.
    pub largest_reading_n_m: f64,
    /// Noise that the set's first trace states, as a fraction of its largest reading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stated_noise: Option<f64>,
    /// Deviations from the calibration with which the set was replayed.
    #[serde(default, skip_serializing_if = "Miscalibration::is_none")]
    pub miscalibration: Miscalibration,
}

impl RunSet {
    /// Class of the object of the set's first trace.
    pub fn class(&self) -> ObjectClass {
        self.class_of(&self.object)
    }

    /// Class of an object of the set: as a recording states it, else by the shape.
    pub fn class_of(&self, object: &str) -> ObjectClass {
        self.object_classes.get(object).copied().unwrap_or_else(|| ObjectClass::of_shape(object))
    }
}

/// One face of a calibration used in a run, and its residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCalibration {
    /// Whisker.
    pub whisker: String,
    /// Face.
    pub face: String,
    /// Description of the sensor model in one line.
    pub model: String,
    /// SHA-256 of the calibration file.
    pub sha256: String,
    /// Root mean square residual on held-out traces.
    pub heldout_rms_n_m: f64,
    /// Largest residual on held-out traces.
    pub heldout_worst_n_m: f64,
    /// Largest absolute reading of the calibration.
    pub largest_reading_n_m: f64,
}
