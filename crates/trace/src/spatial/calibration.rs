//! Calibration files in space, format 2, written by `whisker fit` for calibration traces in space.

use std::path::Path;
use std::sync::Arc;

use files::{Error, Watermark, read_json, sha256};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::Whisker;
use whisker::space::sensor::{
    CalibratedSpace, Mounting, READINGS, SPATIAL_MODELS, SpatialDomain, SpatialErrorMap, SpatialFit, SpatialRegion,
    SpatialWhisker, spatial_model,
};

use super::sidecar::{check_whisker, other_format};
use super::{BendingSensor, SPATIAL_FORMAT, SpatialFrontEndFile, SpatialSensor, StatedSuspension};
use crate::FittedData;
use crate::calibration::{MOST_NOISE, model_not_stored};
use crate::sidecar::plain_name;

/// Calibration file in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialCalibrationFile {
    /// Format version.
    pub format: u32,
    /// `"calibration"`.
    pub kind: String,
    /// Whisker that was calibrated.
    pub whisker: Whisker,
    /// Springs at its root.
    pub suspension: StatedSuspension,
    /// Poisson ratio of its wire.
    pub poisson_ratio: f64,
    /// Columns of the traces that were fitted.
    pub readings: Vec<String>,
    /// Measurement noise added before the fit, as a fraction of the largest reading.
    pub noise_fraction: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Front end through which the traces were read. `None` if the readings are the moments themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub front_end: Option<SpatialFrontEndFile>,
    /// Sensor of the recordings, which converts counts in live estimation. `None` for simulated traces, and if the recordings do
    /// not state one and the same response.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<BendingSensor>,
    /// Whether the sensor is a real one ([`CalibratedSpace::real_sensor`]).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub real_sensor: bool,
    /// Deviation of the present mounting from that of the calibration, by `whisker mount`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<LearntMounting>,
    /// Hash over the hashes of the traces.
    pub data_sha256: String,
    /// Names of the traces.
    pub traces: Vec<String>,
    /// Calibrated domain.
    pub domain: SpatialDomain,
    /// Number of fitted samples.
    pub samples: usize,
    /// Number of lines of contacts.
    pub lines: usize,
    /// Largest bending moment.
    pub largest_reading_n_m: f64,
    /// Label of the model with the smallest error on held-out lines.
    pub chosen: String,
    /// The fitted models.
    pub models: Vec<SpatialModelFile>,
    /// Hash of `domain` and `models`. It detects manual changes.
    pub models_sha256: String,
    /// Provenance of the file.
    pub watermark: Watermark,
}

/// Mounting of the sensor, learnt from touches at known places.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearntMounting {
    /// Deviation from the mounting of the calibration.
    pub deviation: Mounting,
    /// Names of the traces with the touches.
    pub traces: Vec<String>,
    /// Hash over the hashes of these traces.
    pub data_sha256: String,
}

/// Fitted sensor model in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialModelFile {
    /// Unique label of the model.
    pub label: String,
    /// Root mean square residual of a moment on held-out lines.
    pub heldout_rms_n_m: f64,
    /// Largest residual of a moment on held-out lines.
    pub heldout_worst_n_m: f64,
    /// Covariance of the model's error over the calibrated domain, in addition to the variances that the model itself predicts.
    pub error: SpatialErrorMap,
    /// The sensor model, tagged by `kind`.
    pub model: Value,
}

impl SpatialModelFile {
    fn new(fit: &SpatialFit) -> Self {
        let calibrated = &fit.calibrated;
        Self {
            label: calibrated.label.clone(),
            heldout_rms_n_m: calibrated.heldout_rms_n_m,
            heldout_worst_n_m: calibrated.heldout_worst_n_m,
            error: calibrated.error.clone(),
            model: calibrated.model.to_json(),
        }
    }
}

fn models_sha256(domain: &SpatialDomain, models: &[SpatialModelFile]) -> String {
    sha256(serde_json::to_vec(&(domain, models)).expect("numbers and names serialise"))
}

impl SpatialCalibrationFile {
    /// Calibration with several fits to the same `data`. The model with the smallest error on held-out lines is chosen, the
    /// first of equals. `None` if there are no fits.
    pub fn new(fits: &[SpatialFit], data: FittedData, watermark: Watermark) -> Option<Self> {
        let best = fits.iter().min_by(|a, b| a.calibrated.heldout_rms_n_m.total_cmp(&b.calibrated.heldout_rms_n_m))?;
        let models: Vec<SpatialModelFile> = fits.iter().map(SpatialModelFile::new).collect();
        let CalibratedSpace { whisker, domain, label, largest_reading_n_m, real_sensor, .. } = &best.calibrated;
        let FittedData { noise_fraction, seed, data_sha256, traces, .. } = data;
        Some(Self {
            format: SPATIAL_FORMAT,
            kind: "calibration".into(),
            whisker: whisker.whisker.clone(),
            suspension: whisker.suspension.into(),
            poisson_ratio: whisker.poisson_ratio,
            readings: READINGS.map(Into::into).into(),
            noise_fraction,
            seed,
            front_end: None,
            sensor: None,
            real_sensor: *real_sensor,
            mounting: None,
            data_sha256,
            traces,
            samples: best.samples,
            lines: best.lines,
            largest_reading_n_m: *largest_reading_n_m,
            chosen: label.clone(),
            models_sha256: models_sha256(domain, &models),
            domain: domain.clone(),
            models,
            watermark,
        })
    }

    /// Reads and checks a calibration file in space. It does not load the sensor models, which takes about a tenth of a second
    /// each: [`Self::calibrated`] loads and checks one.
    ///
    /// # Errors
    /// [`Error`] with file and place. A planar calibration, which has no contacts out of the plane, is named as such.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file: Self = read_json(path).map_err(|error| other_format(path, SPATIAL_FORMAT, "calibration", error))?;
        file.check(path)?;
        Ok(file)
    }

    /// The whisker with its properties out of its plane.
    pub fn spatial_whisker(&self) -> SpatialWhisker {
        self.suspension.whisker(&self.whisker, self.poisson_ratio)
    }

    /// Model with this label, or the chosen model if `label` is `None`.
    pub fn model(&self, label: Option<&str>) -> Option<&SpatialModelFile> {
        let label = label.unwrap_or(&self.chosen);
        self.models.iter().find(|model| model.label == label)
    }

    /// The sensor of the front end through which the calibration was made. `None` if its readings are the moments themselves.
    pub fn front_end_sensor(&self) -> Option<&SpatialSensor> {
        self.front_end.as_ref()?.sensor(&self.whisker.name)
    }

    /// Loads the model of this label, or the chosen model if `label` is `None`. `path` is used in error messages.
    ///
    /// # Errors
    /// [`Error::Value`] if there is no such model, or if it is invalid.
    pub fn calibrated(&self, path: &Path, label: Option<&str>) -> Result<Arc<CalibratedSpace>, Error> {
        self.load(path, self.known_model(path, label)?).map(Arc::new)
    }

    /// [`Self::model`], or an error that names the file.
    fn known_model(&self, path: &Path, label: Option<&str>) -> Result<&SpatialModelFile, Error> {
        self.model(label).ok_or_else(|| {
            let known = self.models.iter().map(|model| model.label.as_str()).collect::<Vec<_>>().join(", ");
            match label {
                Some(label) => Error::value(path, "models", known, format!("`{label}` among them")),
                None => Error::value(path, "chosen", &self.chosen, format!("one of the fitted models: {known}")),
            }
        })
    }

    fn load(&self, path: &Path, model: &SpatialModelFile) -> Result<CalibratedSpace, Error> {
        let key = |name: &str| format!("models.{}.{name}", model.label);
        let kind = model.model.get("kind").and_then(Value::as_str).unwrap_or_default();
        let row = spatial_model(kind).map_err(|_| {
            let known: Vec<_> = SPATIAL_MODELS.iter().map(|row| row.kind).collect();
            Error::value(path, key("model.kind"), format!("`{kind}`"), format!("one of: {}", known.join(", ")))
        })?;
        let whisker = self.spatial_whisker();
        let region = SpatialRegion { whisker: &whisker, domain: &self.domain };
        let loaded = (row.load)(&region, &model.model).map_err(|error| model_not_stored(path, key("model"), &error))?;
        if loaded.label() != model.label {
            return Err(Error::value(path, key("label"), format!("`{}`", model.label), loaded.label()));
        }
        Ok(CalibratedSpace {
            axis: self.domain.axis(&self.whisker),
            domain: self.domain.clone(),
            label: loaded.label(),
            model: loaded.into(),
            error: model.error.clone(),
            heldout_rms_n_m: model.heldout_rms_n_m,
            heldout_worst_n_m: model.heldout_worst_n_m,
            largest_reading_n_m: self.largest_reading_n_m,
            real_sensor: self.real_sensor,
            mounting: self.mounting.as_ref().map(|mounting| mounting.deviation),
            geometry: Default::default(),
            whisker,
        })
    }

    fn check(&self, path: &Path) -> Result<(), Error> {
        if self.format != SPATIAL_FORMAT {
            return Err(Error::value(path, "format", self.format, SPATIAL_FORMAT));
        }
        if self.kind != "calibration" {
            return Err(Error::value(path, "kind", &self.kind, "calibration"));
        }
        if self.readings != READINGS {
            return Err(Error::value(path, "readings", self.readings.join(", "), READINGS.join(", ")));
        }
        plain_name(path, "whisker.name", &self.whisker.name)?;
        if !(0.0..=MOST_NOISE).contains(&self.noise_fraction) {
            return Err(Error::value(path, "noise_fraction", self.noise_fraction, format!("0 to {MOST_NOISE}")));
        }
        check_whisker(path, &self.spatial_whisker())?;
        if let Some(front_end) = &self.front_end {
            front_end.check(path)?;
            let names: Vec<&str> = front_end.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
            if names.iter().any(|name| *name != self.whisker.name) || names.len() > 1 {
                let expected = format!("none, or that of the whisker, `{}`", self.whisker.name);
                return Err(Error::value(path, "front_end.sensors", names.join(", "), expected));
            }
        }
        if let Some(sensor) = &self.sensor {
            sensor.validate(path, "sensor")?;
        }
        if let Some(mounting) = self.mounting.as_ref().filter(|mounting| !mounting.deviation.is_valid()) {
            let expected = "finite numbers, the covariance symmetric and positive definite";
            return Err(Error::value(path, "mounting.deviation", format!("{:?}", mounting.deviation), expected));
        }
        let found = models_sha256(&self.domain, &self.models);
        if found != self.models_sha256 {
            let expected = format!("{found}, the hash of domain and models");
            return Err(Error::value(path, "models_sha256", &self.models_sha256, expected));
        }
        if !self.domain.is_valid(self.whisker.length_m) {
            let expected = "evenly spaced nodes along the whisker, with distances from 0 to its length";
            return Err(Error::value(path, "domain", format!("{:?}", self.domain), expected));
        }
        if !self.domain.axis(&self.whisker).is_usable() {
            let expected =
                "a whisker that turns by less than a right angle from the line from root to tip, or no such key";
            return Err(Error::value(path, "domain.across", format!("{:?}", self.domain.across), expected));
        }
        if !(self.largest_reading_n_m.is_finite() && self.largest_reading_n_m > 0.0) {
            return Err(Error::value(path, "largest_reading_n_m", self.largest_reading_n_m, "a positive number"));
        }
        self.known_model(path, None)?;
        self.models.iter().try_for_each(|model| model.check(path))
    }
}

impl SpatialModelFile {
    fn check(&self, path: &Path) -> Result<(), Error> {
        let key = |name: &str| format!("models.{}.{name}", self.label);
        for (name, residual) in
            [("heldout_rms_n_m", self.heldout_rms_n_m), ("heldout_worst_n_m", self.heldout_worst_n_m)]
        {
            if !(residual.is_finite() && residual >= 0.0) {
                return Err(Error::value(path, key(name), residual, "a number of 0 or more"));
            }
        }
        if !self.error.is_valid() {
            let expected = "a grid (along x away) of positive definite covariances, at least 2 x 2";
            return Err(Error::value(path, key("error"), format!("{:?}", self.error), expected));
        }
        Ok(())
    }
}
