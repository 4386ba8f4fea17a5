//! Calibration files: what `whisker fit` learnt of a whisker.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::Whisker;
use whisker::sensor::{self, CalibratedFace, Domain, Face, Fit};

use crate::sidecar::plain_name;
use crate::{Error, FORMAT, Watermark, read_json, sha256};

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

/// One face of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceFile {
    /// The face.
    pub face: Face,
    /// Region that was calibrated.
    pub domain: Domain,
    /// The sensor model, tagged by `kind`.
    pub model: Value,
    /// Samples that were fitted.
    pub samples: usize,
    /// Root mean square residual on held-out data.
    pub heldout_rms_n_m: f64,
    /// Largest residual on held-out data.
    pub heldout_worst_n_m: f64,
    /// Largest absolute reading.
    pub largest_reading_n_m: f64,
}

impl FaceFile {
    /// The entry of a fit.
    pub fn new(fit: &Fit) -> Self {
        Self {
            face: fit.face.face,
            domain: fit.face.domain.clone(),
            model: fit.face.model.to_json(),
            samples: fit.samples,
            heldout_rms_n_m: fit.face.heldout_rms_n_m,
            heldout_worst_n_m: fit.heldout_worst_n_m,
            largest_reading_n_m: fit.face.largest_reading_n_m,
        }
    }
}

impl CalibrationFile {
    /// A calibration of these faces.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        whisker: Whisker,
        noise_fraction: f64,
        seed: u64,
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
        file.calibrated(path)?;
        Ok(file)
    }

    /// The calibrated faces, ready for use; `path` is for errors.
    ///
    /// # Errors
    /// [`Error::Value`] where a face does not describe a region and a model.
    pub fn calibrated(&self, path: &Path) -> Result<Vec<Arc<CalibratedFace>>, Error> {
        if self.faces.is_empty() {
            return Err(Error::value(path, "faces", "none", "at least one"));
        }
        let found = faces_sha256(&self.faces);
        if found != self.faces_sha256 {
            return Err(Error::value(
                path,
                "faces_sha256",
                &self.faces_sha256,
                format!("{found}, the hash of the faces"),
            ));
        }
        let faces: Vec<Arc<CalibratedFace>> =
            self.faces.iter().map(|face| self.face(path, face)).collect::<Result<_, _>>()?;
        for (i, face) in faces.iter().enumerate() {
            if faces[..i].iter().any(|other| other.face == face.face) {
                return Err(Error::value(path, "faces", format!("`{}` twice", face.face.name()), "each face once"));
            }
        }
        Ok(faces)
    }

    fn face(&self, path: &Path, file: &FaceFile) -> Result<Arc<CalibratedFace>, Error> {
        let key = |name: &str| format!("faces.{}.{name}", file.face.name());
        if !file.domain.is_valid(self.whisker.length_m) {
            let found = format!("{:?}", file.domain);
            let expected =
                "evenly spaced nodes along the whisker, with lower_m <= 0 and lower_m <= upper_m <= its length";
            return Err(Error::value(path, key("domain"), found, expected));
        }
        if !(file.largest_reading_n_m.is_finite() && file.largest_reading_n_m > 0.0) {
            return Err(Error::value(path, key("largest_reading_n_m"), file.largest_reading_n_m, "a positive number"));
        }
        for (name, residual) in
            [("heldout_rms_n_m", file.heldout_rms_n_m), ("heldout_worst_n_m", file.heldout_worst_n_m)]
        {
            if !(residual.is_finite() && residual >= 0.0) {
                return Err(Error::value(path, key(name), residual, "a number of 0 or more"));
            }
        }
        let kind = file.model.get("kind").and_then(Value::as_str).unwrap_or_default();
        let row = sensor::model(kind).map_err(|_| {
            let known: Vec<_> = sensor::MODELS.iter().map(|row| row.kind).collect();
            Error::value(path, key("model.kind"), format!("`{kind}`"), format!("one of: {}", known.join(", ")))
        })?;
        let model = (row.load)(&file.model)
            .map_err(|error| Error::value(path, key("model"), &file.model, format!("a stored model ({error})")))?;
        Ok(Arc::new(CalibratedFace {
            face: file.face,
            rest: self.whisker.rest_shape(),
            domain: file.domain.clone(),
            model,
            heldout_rms_n_m: file.heldout_rms_n_m,
            largest_reading_n_m: file.largest_reading_n_m,
        }))
    }
}
