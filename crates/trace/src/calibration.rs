//! Calibration files: what `whisker fit` learnt of a whisker.

use std::path::Path;
use std::sync::Arc;

use files::{Error, FORMAT, Watermark, read_json, sha256};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::Whisker;
use whisker::sensor::{self, CalibratedFace, Domain, ErrorMap, Face, Fit, Region};

use crate::Characteristic;
use crate::characteristic::polynomial;
use crate::sidecar::plain_name;

/// The only column that stands for a reading in format 1.
const READING: &str = "moment_z_n_m";

/// Largest measurement noise, as a fraction of the largest reading.
pub const MOST_NOISE: f64 = 10.0;

fn faces_sha256(faces: &[FaceFile]) -> String {
    sha256(serde_json::to_vec(faces).expect("numbers and names serialise"))
}

/// A calibration's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    /// Version of the format.
    pub format: u32,
    /// `"calibration"`.
    pub kind: String,
    /// The whisker.
    pub whisker: Whisker,
    /// Column that was fitted.
    pub reading: String,
    /// Measurement noise added before the fit, as a fraction of the largest reading.
    pub noise_fraction: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// The front end through which the traces were read, and its sensors; nothing where readings were the moments themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub front_end: Option<FrontEndFile>,
    /// Hash over the hashes of the traces.
    pub data_sha256: String,
    /// Names of the traces.
    pub traces: Vec<String>,
    /// Fitted faces.
    pub faces: Vec<FaceFile>,
    /// Hash of the faces, so that a change by hand does not pass for a fit.
    pub faces_sha256: String,
    /// What wrote the file.
    pub watermark: Watermark,
}

/// A front end and what was learnt of its sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontEndFile {
    /// Its name in the registry.
    pub name: String,
    /// Its settings.
    pub config: Value,
    /// The sensors that were calibrated.
    pub sensors: Vec<SensorFile>,
}

impl FrontEndFile {
    /// The sensor of this name in this array.
    pub fn sensor(&self, array: &str, name: &str) -> Option<&SensorFile> {
        self.sensors.iter().find(|sensor| sensor.array == array && sensor.name == name)
    }
}

/// What was learnt of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    /// Name of the sensor.
    pub name: String,
    /// Name of the array on whose board it sits, beside the reference sensor.
    pub array: String,
    /// How many counts of the reference sensor's two axes in the plane, x and y of Base, appear in those of the sensor.
    pub common_mode: [f64; 2],
    /// How its counts, with the common mode taken out, answer to the moment.
    pub characteristic: Characteristic,
    /// How they answer to the moments of the other whiskers on the board.
    pub cross_talk: Vec<CrossTalk>,
    /// Root mean square of its noise in readings, over the calibrated ones: what changes within a recording.
    pub noise_sd_n_m: f64,
    /// Standard deviation of what its readings are off by at rest throughout a recording, over the calibrated readings.
    pub offset_sd_n_m: f64,
    /// Standard deviation of its gain from recording to recording, relative.
    pub gain_sd: f64,
}

impl SensorFile {
    /// Its name with that of its array, which no other sensor has: `left.left_1`.
    pub fn label(&self) -> String {
        format!("{}.{}", self.array, self.name)
    }
}

/// What the magnet of another whisker does to the counts of a sensor, with the common mode taken out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrossTalk {
    /// Name of the other whisker's sensor, in the same array.
    pub from: String,
    /// `c1, c2, ...`, in counts by powers of N m of the other whisker's moment.
    pub coefficients: Vec<f64>,
}

impl CrossTalk {
    /// Counts above those with the other whisker at rest.
    pub fn counts(&self, moment_n_m: f64) -> f64 {
        polynomial(&self.coefficients, moment_n_m)
    }
}

/// One face of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceFile {
    /// The face.
    pub face: Face,
    /// Region that was calibrated.
    pub domain: Domain,
    /// Samples that were fitted.
    pub samples: usize,
    /// Largest absolute reading.
    pub largest_reading_n_m: f64,
    /// How far the contacts lay from the middle of the calibration's pin.
    pub pin_radius_m: f64,
    /// Label of the model that predicts held-out traces best.
    pub chosen: String,
    /// The fitted models.
    pub models: Vec<ModelFile>,
}

/// One fitted sensor model of a face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Name that tells it from the others.
    pub label: String,
    /// Root mean square residual on held-out data.
    pub heldout_rms_n_m: f64,
    /// Largest residual on held-out data.
    pub heldout_worst_n_m: f64,
    /// The model's own error over the region.
    pub error: ErrorMap,
    /// The sensor model, tagged by `kind`.
    pub model: Value,
}

impl FaceFile {
    /// The entry of several fits to the same samples; the one with the smallest held-out error is chosen, the first of equals.
    /// Nothing without any.
    pub fn new(fits: &[Fit]) -> Option<Self> {
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
            chosen: best.face.label.clone(),
            models: models.collect(),
        })
    }

    /// Path of a key of this face, for errors.
    fn key(&self, name: &str) -> String {
        format!("faces.{}.{name}", self.face.name())
    }

    /// The model of this label, or without one the chosen one.
    pub fn model(&self, label: Option<&str>) -> Option<&ModelFile> {
        let label = label.unwrap_or(&self.chosen);
        self.models.iter().find(|model| model.label == label)
    }
}

impl CalibrationFile {
    /// A calibration of these faces.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        whisker: Whisker,
        noise_fraction: f64,
        seed: u64,
        front_end: Option<FrontEndFile>,
        data_sha256: String,
        traces: Vec<String>,
        faces: Vec<FaceFile>,
        watermark: Watermark,
    ) -> Self {
        Self {
            format: FORMAT,
            kind: "calibration".into(),
            whisker,
            reading: READING.into(),
            noise_fraction,
            seed,
            front_end,
            data_sha256,
            traces,
            faces_sha256: faces_sha256(&faces),
            faces,
            watermark,
        }
    }

    /// Reads and checks a calibration's file.
    ///
    /// # Errors
    /// [`Error`] names the file and the place.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file: Self = read_json(path)?;
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

    /// The calibrated faces with the model of this label, or without one with that which was chosen; `path` is for errors.
    ///
    /// # Errors
    /// [`Error::Value`] where a face has no model of this label, or does not describe a region and a model.
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
        for (index, sensor) in self.front_end.iter().flat_map(|front_end| &front_end.sensors).enumerate() {
            // Tables of the report are named after the sensor.
            plain_name(path, &format!("front_end.sensors[{index}].name"), &sensor.name)?;
            plain_name(path, &format!("front_end.sensors[{index}].array"), &sensor.array)?;
            let key = |name: &str| format!("front_end.sensors.{}.{name}", sensor.label());
            if !sensor.characteristic.is_valid() {
                let found = format!("{:?}", sensor.characteristic);
                let expected = "a polynomial that does not turn back within a range that holds 0";
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
                let found = format!("{:?}", face.domain);
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
            return Err(Error::value(path, key("error"), found, "along x away positive numbers, at least 2 x 2"));
        }
        let kind = model.model.get("kind").and_then(Value::as_str).unwrap_or_default();
        let row = sensor::model(kind).map_err(|_| {
            let known: Vec<_> = sensor::MODELS.iter().map(|row| row.kind).collect();
            Error::value(path, key("model.kind"), format!("`{kind}`"), format!("one of: {}", known.join(", ")))
        })?;
        let region = Region { whisker: &self.whisker, face: face.face, domain: &face.domain };
        let loaded = (row.load)(&region, &model.model)
            .map_err(|error| Error::value(path, key("model"), &model.model, format!("a stored model ({error})")))?;
        if loaded.label() != model.label {
            return Err(Error::value(path, key("label"), format!("`{}`", model.label), loaded.label()));
        }
        Ok(CalibratedFace {
            face: face.face,
            rest: self.whisker.rest_shape(),
            domain: face.domain.clone(),
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
