//! Calibration files, written by `whisker fit`.

use std::path::Path;
use std::sync::Arc;

use files::{Error, FORMAT, Watermark, read_json, sha256};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::sensor::{self, CalibratedFace, Domain, ErrorMap, Face, Fit, ModelError, PinFriction, Region};
use whisker::{ReadingGate, Whisker};

use crate::Characteristic;
use crate::characteristic::polynomial;
use crate::sidecar::plain_name;
use crate::spatial::other_format;

/// The only reading column in format 1.
const READING: &str = "moment_z_n_m";

/// Keys of the sensors.
const FRONT_END_SENSORS: &str = "front_end.sensors";
const SENSOR: &str = "sensor";

/// Largest measurement noise, as a fraction of the largest reading.
pub const MOST_NOISE: f64 = 10.0;

/// Error of a sensor model that cannot be loaded.
pub(crate) fn model_not_stored(path: &Path, key: String, error: &ModelError) -> Error {
    let expected = "a model as `whisker fit` stores it; fit it again".into();
    Error::Stored { path: path.into(), key, reason: error.to_string(), expected }
}

fn faces_sha256(faces: &[FaceFile]) -> String {
    sha256(serde_json::to_vec(faces).expect("numbers and names serialise"))
}

/// Calibration file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    /// Format version.
    pub format: u32,
    /// `"calibration"`.
    pub kind: String,
    /// Whisker that was calibrated.
    pub whisker: Whisker,
    /// Column of the trace that was fitted.
    pub reading: String,
    /// Measurement noise added before the fit, as a fraction of the largest reading.
    pub noise_fraction: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Front end through which the traces were read, with its calibrated sensors. `None` if the readings are the
    /// moments themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub front_end: Option<FrontEndFile>,
    /// Sensor of the recordings to which the calibration was fitted. `None` if they were simulated, or do not state one and the
    /// same characteristic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorFile>,
    /// Hash over the hashes of the traces.
    pub data_sha256: String,
    /// Names of the traces.
    pub traces: Vec<String>,
    /// Fitted faces.
    pub faces: Vec<FaceFile>,
    /// Hash of `faces`. It detects manual changes.
    pub faces_sha256: String,
    /// Provenance of the file.
    pub watermark: Watermark,
}

/// Data that a calibration is fitted to, with the fields of [`CalibrationFile`] that describe them.
#[derive(Clone, Debug, Default)]
pub struct FittedData {
    /// Measurement noise added before the fit, as a fraction of the largest reading.
    pub noise_fraction: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Front end through which the traces were read. `None` if the readings are the moments themselves.
    pub front_end: Option<FrontEndFile>,
    /// Sensor of the recordings, if they state one and the same characteristic.
    pub sensor: Option<SensorFile>,
    /// Hash over the hashes of the traces.
    pub data_sha256: String,
    /// Names of the traces.
    pub traces: Vec<String>,
}

/// Front end and the calibration of its sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontEndFile {
    /// Its name in the registry.
    pub name: String,
    /// Its settings.
    pub config: Value,
    /// Calibrated sensors.
    pub sensors: Vec<SensorFile>,
}

impl FrontEndFile {
    /// The sensor of this name in this array.
    pub fn sensor(&self, array: &str, name: &str) -> Option<&SensorFile> {
        self.sensors.iter().find(|sensor| sensor.array == array && sensor.name == name)
    }
}

/// Calibration of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    /// Name of the sensor.
    pub name: String,
    /// Name of the array on whose board it sits, beside the reference sensor.
    pub array: String,
    /// Common-mode coefficients: counts of this sensor per count of the reference sensor's x and y axes (in Base).
    pub common_mode: [f64; 2],
    /// Response of the counts to the moment, after common-mode compensation.
    pub characteristic: Characteristic,
    /// Response of the counts to the moments of the other whiskers on the board.
    pub cross_talk: Vec<CrossTalk>,
    /// RMS of the noise in the readings over the calibrated range, for the part that varies within a recording.
    pub noise_sd_n_m: f64,
    /// Standard deviation of the offset at rest, constant within a recording, over the calibrated range.
    pub offset_sd_n_m: f64,
    /// Relative standard deviation of the gain between recordings.
    pub gain_sd: f64,
}

impl SensorFile {
    /// Sensor of recordings of a single whisker, with the noise of their readings (N m).
    pub fn recorded(whisker: &str, characteristic: Characteristic, noise_sd_n_m: f64) -> Self {
        Self {
            name: whisker.into(),
            array: whisker.into(),
            common_mode: [0.0; 2],
            characteristic,
            cross_talk: Vec::new(),
            noise_sd_n_m,
            offset_sd_n_m: 0.0,
            gain_sd: 0.0,
        }
    }

    /// Unique name of the form `<array>.<sensor>`, for example `left.left_1`.
    pub fn label(&self) -> String {
        format!("{}.{}", self.array, self.name)
    }
}

/// Cross-talk: response of a sensor's counts to the magnet of another whisker, after common-mode compensation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrossTalk {
    /// Name of the other whisker's sensor, in the same array.
    pub from: String,
    /// `c1, c2, ...`, in counts by powers of N m of the other whisker's moment.
    pub coefficients: Vec<f64>,
}

impl CrossTalk {
    /// Counts relative to the other whisker at rest.
    pub fn counts(&self, moment_n_m: f64) -> f64 {
        polynomial(&self.coefficients, moment_n_m)
    }
}

/// Calibration of one face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceFile {
    /// Face of the whisker.
    pub face: Face,
    /// Calibrated domain.
    pub domain: Domain,
    /// Number of fitted samples.
    pub samples: usize,
    /// Largest absolute reading.
    pub largest_reading_n_m: f64,
    /// Distance of the contacts from the centre of the calibration pin.
    pub pin_radius_m: f64,
    /// Friction of the pin, which was removed from the fitted readings. `None` if none was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<PinFriction>,
    /// Label of the model with the smallest held-out error.
    pub chosen: String,
    /// The fitted models.
    pub models: Vec<ModelFile>,
}

/// Fitted sensor model of one face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Unique label of the model.
    pub label: String,
    /// Root mean square residual on held-out data.
    pub heldout_rms_n_m: f64,
    /// Largest residual on held-out data.
    pub heldout_worst_n_m: f64,
    /// Model error over the calibrated domain.
    pub error: ErrorMap,
    /// The sensor model, tagged by `kind`.
    pub model: Value,
}

impl FaceFile {
    /// Collects several fits to the same samples, from which this friction was removed. The model with the smallest held-out error
    /// is chosen, the first of equals. `None` if there are no fits.
    pub fn new(fits: &[Fit], friction: Option<PinFriction>) -> Option<Self> {
        let best = fits.iter().min_by(|a, b| a.face.heldout_rms_n_m.total_cmp(&b.face.heldout_rms_n_m))?;
        let models = fits.iter().map(|fit| ModelFile {
            label: fit.face.label.clone(),
            heldout_rms_n_m: fit.face.heldout_rms_n_m,
            heldout_worst_n_m: fit.face.heldout_worst_n_m,
            error: fit.face.error.clone(),
            model: fit.face.model.to_json(),
        });
        Some(Self {
            face: best.face.face,
            domain: best.face.domain.clone(),
            samples: best.samples,
            largest_reading_n_m: best.face.largest_reading_n_m,
            pin_radius_m: best.face.pin_radius_m,
            friction,
            chosen: best.face.label.clone(),
            models: models.collect(),
        })
    }

    /// Key path of an entry of this face, for error messages.
    fn key(&self, name: &str) -> String {
        format!("faces.{}.{name}", self.face.name())
    }

    /// Model with this label, or the chosen model if `label` is `None`.
    pub fn model(&self, label: Option<&str>) -> Option<&ModelFile> {
        let label = label.unwrap_or(&self.chosen);
        self.models.iter().find(|model| model.label == label)
    }
}

impl CalibrationFile {
    /// Calibration of these faces, fitted to `data`.
    pub fn new(whisker: Whisker, data: FittedData, faces: Vec<FaceFile>, watermark: Watermark) -> Self {
        let FittedData { noise_fraction, seed, front_end, sensor, data_sha256, traces } = data;
        Self {
            format: FORMAT,
            kind: "calibration".into(),
            whisker,
            reading: READING.into(),
            noise_fraction,
            seed,
            front_end,
            sensor,
            data_sha256,
            traces,
            faces_sha256: faces_sha256(&faces),
            faces,
            watermark,
        }
    }

    /// Reads and checks a calibration file.
    ///
    /// # Errors
    /// [`Error`] with file and place.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file: Self = read_json(path).map_err(|error| other_format(path, FORMAT, "calibration", error))?;
        if file.format != FORMAT {
            return Err(Error::value(path, "format", file.format, FORMAT));
        }
        if file.kind != "calibration" {
            return Err(Error::value(path, "kind", &file.kind, "calibration"));
        }
        if file.reading != READING {
            return Err(Error::value(path, "reading", &file.reading, READING));
        }
        plain_name(path, "whisker.name", &file.whisker.name)?;
        if !(0.0..=MOST_NOISE).contains(&file.noise_fraction) {
            return Err(Error::value(path, "noise_fraction", file.noise_fraction, format!("0 to {MOST_NOISE}")));
        }
        file.whisker
            .validate()
            .map_err(|error| Error::value(path, format!("whisker.{}", error.key), error.found, error.expected))?;
        file.check_sensors(path)?;
        file.check_faces(path)?;
        Ok(file)
    }

    /// Gate of the readings: that of the largest reading of all faces.
    pub fn gate(&self) -> ReadingGate {
        ReadingGate::new(self.largest_reading_n_m())
    }

    /// Largest calibrated reading of all faces (N m).
    pub fn largest_reading_n_m(&self) -> f64 {
        self.faces.iter().map(|face| face.largest_reading_n_m).fold(0.0, f64::max)
    }

    /// The sensors whose counts the calibration converts: that of the recordings, or those of the front end.
    pub fn sensors(&self) -> impl Iterator<Item = &SensorFile> {
        self.front_end.iter().flat_map(|front_end| &front_end.sensors).chain(&self.sensor)
    }

    /// The sensor with this label, or the only one if `label` is `None`. `path` is used in error messages.
    ///
    /// # Errors
    /// [`Error::Value`] if there is no such sensor, or if there are several and `label` is `None`.
    pub fn sensor_of_counts(&self, path: &Path, label: Option<&str>) -> Result<&SensorFile, Error> {
        let found = match label {
            Some(label) => self.sensors().find(|sensor| sensor.label() == label),
            None => self.sensors().next().filter(|_| self.sensors().count() == 1),
        };
        found.ok_or_else(|| {
            let known: Vec<_> = self.sensors().map(SensorFile::label).collect();
            let (found, expected) = match (label, known.is_empty()) {
                (_, true) => (
                    "none".into(),
                    "one, by which counts are converted; `whisker fit` writes that of imported \
                    recordings, and those of a front end that models sensors"
                        .into(),
                ),
                (Some(label), false) => (known.join(", "), format!("`{label}` among them")),
                (None, false) => (known.join(", "), "the name of one of them, or a calibration with one sensor".into()),
            };
            Error::value(path, if self.front_end.is_some() { FRONT_END_SENSORS } else { SENSOR }, found, expected)
        })
    }

    /// Loads the calibrated faces with the model of this label, or with the chosen model if `label` is `None`. `path`
    /// is used in error messages.
    ///
    /// # Errors
    /// [`Error::Value`] if a face has no model with this label, or if its domain or model is invalid.
    pub fn calibrated(&self, path: &Path, label: Option<&str>) -> Result<Vec<Arc<CalibratedFace>>, Error> {
        self.faces
            .iter()
            .map(|face| {
                let model = face.model(label).ok_or_else(|| {
                    let known = face.models.iter().map(|model| model.label.as_str()).collect::<Vec<_>>().join(", ");
                    match label {
                        Some(label) => Error::value(path, face.key("models"), known, format!("`{label}` among them")),
                        None => {
                            let found = format!("`{}`", face.chosen);
                            Error::value(path, face.key("chosen"), found, format!("one of the fitted models: {known}"))
                        }
                    }
                })?;
                Ok(Arc::new(self.load(path, face, model)?))
            })
            .collect()
    }

    fn check_sensors(&self, path: &Path) -> Result<(), Error> {
        if self.front_end.is_some() && self.sensor.is_some() {
            return Err(Error::value(path, SENSOR, "one beside `front_end`", "one of the two"));
        }
        for (index, sensor) in self.sensors().enumerate() {
            let is_recorded = self.sensor.is_some();
            let place = if is_recorded { SENSOR.into() } else { format!("{FRONT_END_SENSORS}[{index}]") };
            // Tables of the report are named after the sensors.
            plain_name(path, &format!("{place}.name"), &sensor.name)?;
            plain_name(path, &format!("{place}.array"), &sensor.array)?;
            let place = if is_recorded { place } else { format!("{FRONT_END_SENSORS}.{}", sensor.label()) };
            let key = |name: &str| format!("{place}.{name}");
            if !sensor.characteristic.is_valid() {
                let found = format!("{:?}", sensor.characteristic);
                let expected = "a polynomial that is monotone on a range containing 0";
                return Err(Error::value(path, key("characteristic"), found, expected));
            }
            let SensorFile { noise_sd_n_m, offset_sd_n_m, gain_sd, .. } = *sensor;
            for (name, sd) in [("noise_sd_n_m", noise_sd_n_m), ("offset_sd_n_m", offset_sd_n_m), ("gain_sd", gain_sd)] {
                if !(sd.is_finite() && sd >= 0.0) {
                    return Err(Error::value(path, key(name), sd, "a number of 0 or more"));
                }
            }
            if let Some(talk) = sensor.cross_talk.iter().find(|talk| !talk.coefficients.iter().all(|c| c.is_finite())) {
                let found = format!("{:?}", talk.coefficients);
                return Err(Error::value(path, key(&format!("cross_talk.{}", talk.from)), found, "finite numbers"));
            }
        }
        Ok(())
    }

    fn check_faces(&self, path: &Path) -> Result<(), Error> {
        if self.faces.is_empty() {
            return Err(Error::value(path, "faces", "none", "at least one"));
        }
        let found = faces_sha256(&self.faces);
        if found != self.faces_sha256 {
            let expected = format!("{found}, the hash of the faces");
            return Err(Error::value(path, "faces_sha256", &self.faces_sha256, expected));
        }
        for (i, face) in self.faces.iter().enumerate() {
            if self.faces[..i].iter().any(|other| other.face == face.face) {
                return Err(Error::value(path, "faces", format!("`{}` twice", face.face.name()), "each face once"));
            }
            if !face.domain.is_valid(self.whisker.length_m) {
                let found = serde_json::to_string(&face.domain).unwrap_or_default();
                let expected =
                    "evenly spaced nodes along the whisker, with lower_m <= 0 and lower_m <= upper_m <= its length";
                return Err(Error::value(path, face.key("domain"), found, expected));
            }
            if !(face.largest_reading_n_m.is_finite() && face.largest_reading_n_m > 0.0) {
                let key = face.key("largest_reading_n_m");
                return Err(Error::value(path, key, face.largest_reading_n_m, "a positive number"));
            }
            if !(face.pin_radius_m.is_finite() && face.pin_radius_m >= 0.0) {
                return Err(Error::value(path, face.key("pin_radius_m"), face.pin_radius_m, "a number of 0 or more"));
            }
            if let Some(PinFriction { coefficient, coefficient_sd }) = face.friction {
                for (name, number) in [("coefficient", coefficient), ("coefficient_sd", coefficient_sd)] {
                    if !(number.is_finite() && number >= 0.0) {
                        let key = face.key(&format!("friction.{name}"));
                        return Err(Error::value(path, key, number, "a number of 0 or more"));
                    }
                }
            }
            for model in &face.models {
                self.load(path, face, model)?;
            }
        }
        self.calibrated(path, None).map(|_| ())
    }

    fn load(&self, path: &Path, face: &FaceFile, model: &ModelFile) -> Result<CalibratedFace, Error> {
        let key = |name: &str| face.key(&format!("models.{}.{name}", model.label));
        for (name, residual) in
            [("heldout_rms_n_m", model.heldout_rms_n_m), ("heldout_worst_n_m", model.heldout_worst_n_m)]
        {
            if !(residual.is_finite() && residual >= 0.0) {
                return Err(Error::value(path, key(name), residual, "a number of 0 or more"));
            }
        }
        if !model.error.is_valid() {
            let found = format!("{:?}", model.error);
            return Err(Error::value(
                path,
                key("error"),
                found,
                "a grid (along x away) of positive numbers, at least 2 x 2",
            ));
        }
        let kind = model.model.get("kind").and_then(Value::as_str).unwrap_or_default();
        let row = sensor::model(kind).map_err(|_| {
            let known: Vec<_> = sensor::MODELS.iter().map(|row| row.kind).collect();
            Error::value(path, key("model.kind"), format!("`{kind}`"), format!("one of: {}", known.join(", ")))
        })?;
        let region = Region { whisker: &self.whisker, face: face.face, domain: &face.domain };
        let loaded = (row.load)(&region, &model.model).map_err(|error| model_not_stored(path, key("model"), &error))?;
        if loaded.label() != model.label {
            return Err(Error::value(path, key("label"), format!("`{}`", model.label), loaded.label()));
        }
        Ok(CalibratedFace {
            face: face.face,
            rest: self.whisker.rest_shape(),
            domain: face.domain.clone(),
            modelled: sensor::modelled(&*loaded, &face.domain, self.whisker.length_m),
            label: loaded.label(),
            model: loaded.into(),
            error: model.error.clone(),
            heldout_rms_n_m: model.heldout_rms_n_m,
            heldout_worst_n_m: model.heldout_worst_n_m,
            largest_reading_n_m: face.largest_reading_n_m,
            pin_radius_m: face.pin_radius_m,
            turn: Default::default(),
        })
    }
}
