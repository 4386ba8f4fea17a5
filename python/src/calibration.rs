//! The class `Calibration`, its predictions and its fit.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use ::trace::{CalibrationFile, FaceFile, FittedData, SensorFile};
use ::whisker::frames::{Base, Point};
use ::whisker::sensor::{self, CalibratedFace, Face, FitData, MODELS, ModelError, Sample};
use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use testbed::fitted_traces::check_fitted_traces;
use testbed::provenance::watermark;

use crate::arrays::{Numbers, column, flags, numbers, points, same_length, vectors};
use crate::convert::{check_not_negative, face as face_of, from_json};
use crate::error::{of_argument, raised, refused};
use crate::interrupt;
use crate::sensor::Sensor;
use crate::whisker::Whisker;

/// Faces by label of the sensor model; `None` is the model that the calibration chose.
type Loaded = BTreeMap<Option<String>, Vec<Arc<CalibratedFace>>>;

/// Sensor models of a whisker: the expected reading of a contact on each calibrated face.
///
/// A calibration comes from `load_calibration` or `fit_calibration`.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Calibration {
    pub(crate) file: CalibrationFile,
    /// Path of the file; of a calibration in memory, the name that messages use.
    pub(crate) path: PathBuf,
    loaded: Mutex<Loaded>,
}

/// Reads a calibration file, written by `whisker fit` or `Calibration.write`.
///
/// A calibration beside the traces that it was fitted to is refused if they have changed since.
#[pyfunction]
pub(crate) fn load_calibration(py: Python<'_>, path: PathBuf) -> PyResult<Calibration> {
    let read = || {
        let file = CalibrationFile::read(&path)?;
        check_fitted_traces(&path, &file)?;
        Ok::<_, anyhow::Error>(file)
    };
    let file = py.detach(read).map_err(raised)?;
    Ok(Calibration::new(file, path))
}

impl Calibration {
    fn new(file: CalibrationFile, path: PathBuf) -> Self {
        Self { file, path, loaded: Mutex::default() }
    }

    /// Calibrated faces with the model of this label, or with the chosen model. They are loaded once, so that
    /// estimators share what is computed from them.
    pub(crate) fn calibrated(&self, label: Option<&str>) -> PyResult<Vec<Arc<CalibratedFace>>> {
        let mut loaded = self.loaded.lock().unwrap_or_else(PoisonError::into_inner);
        let label = label.map(str::to_owned);
        if let Some(faces) = loaded.get(&label) {
            return Ok(faces.clone());
        }
        let faces = self.file.calibrated(&self.path, label.as_deref()).map_err(raised)?;
        loaded.insert(label, faces.clone());
        Ok(faces)
    }

    /// One calibrated face.
    pub(crate) fn face(&self, face: &str, label: Option<&str>) -> PyResult<Arc<CalibratedFace>> {
        let wanted = face_of(face)?;
        let faces = self.calibrated(label)?;
        let known = self.faces().join(", ");
        let missing = || refused(&format!("{}: face", self.path.display()), format!("`{face}`"), &known);
        faces.into_iter().find(|calibrated| calibrated.face == wanted).ok_or_else(missing)
    }
}

#[pymethods]
impl Calibration {
    /// The calibrated whisker.
    #[getter]
    fn whisker(&self) -> Whisker {
        Whisker { whisker: self.file.whisker.clone() }
    }

    /// Names of the calibrated faces: `left` (object on the left, negative readings), `right`.
    #[getter]
    fn faces(&self) -> Vec<&'static str> {
        self.file.faces.iter().map(|face| face.face.name()).collect()
    }

    /// Labels of the fitted sensor models of a face; the first is the chosen one.
    fn models(&self, face: &str) -> PyResult<Vec<String>> {
        let chosen = self.face(face, None)?;
        let of_face = self.file.faces.iter().filter(|file| file.face == chosen.face).flat_map(|file| &file.models);
        let others = of_face.map(|model| model.label.clone()).filter(|label| *label != chosen.label);
        Ok(std::iter::once(chosen.label.clone()).chain(others).collect())
    }

    /// Largest absolute reading of the calibration on any face (N m).
    #[getter]
    fn largest_reading_n_m(&self) -> f64 {
        self.file.faces.iter().map(|face| face.largest_reading_n_m).fold(0.0, f64::max)
    }

    /// Largest magnitude of a reading that estimators use (N m); larger ones count as missing.
    #[getter]
    fn gate_n_m(&self) -> f64 {
        self.file.gate().most_n_m()
    }

    /// Calibrated domain of a face: nodes `arc_m` along the undeflected whisker and at each the range `lower_m` to
    /// `upper_m` of the distance from it, positive away from the object. Linear between nodes.
    fn domain<'py>(&self, py: Python<'py>, face: &str) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.face(face, None)?.domain)
    }

    /// Expected readings of contacts (n, 2) on the centre line, in Base (m), with derivatives and model error.
    ///
    /// Outside the calibrated domain there is no prediction: NaN. `model` is a label of `models`; the default is the
    /// model that the calibration chose.
    #[pyo3(signature = (points, face, model=None))]
    fn predict(&self, py: Python<'_>, points: Numbers<'_>, face: &str, model: Option<&str>) -> PyResult<Prediction> {
        let contacts: Vec<Point<Base>> = self::points("points", &points)?;
        let face = self.face(face, model)?;
        let mut predicted = Vec::with_capacity(contacts.len());
        interrupt::each(py, contacts.len(), |row| {
            let contact = contacts[row];
            let expected = face.predict(contact).map(|expected| Predicted {
                reading_n_m: expected.reading_n_m,
                gradient_n: expected.gradient_n,
                model_sd_n_m: face.model_variance_n2_m2(contact).sqrt(),
                tangent_rad: face.model.tangent_rad(contact),
            });
            predicted.push(expected);
            Ok(())
        })?;
        Ok(Prediction { predicted })
    }

    /// Names of the sensors whose counts the calibration converts: that of the imported recordings to which it was fitted, or those
    /// of a front end that models sensors. Empty if the readings are known as moments only.
    #[getter]
    fn sensors(&self) -> Vec<String> {
        self.file.sensors().map(SensorFile::label).collect()
    }

    /// The sensor with this name among `sensors`, or the only one. Raises `ValueError` if there is no such sensor.
    #[pyo3(signature = (name=None))]
    fn sensor(&self, name: Option<&str>) -> PyResult<Sensor> {
        let file = self.file.sensor_of_counts(&self.path, name).map_err(raised)?;
        Ok(Sensor { file: file.clone() })
    }

    /// Coefficient of the friction of the calibration pin, which was removed from the fitted readings of a face, and its standard
    /// deviation. `None` if none was found.
    ///
    /// Raises `ValueError` if the face is not calibrated.
    fn friction(&self, face: &str) -> PyResult<Option<(f64, f64)>> {
        let face = face_of(face)?;
        let calibrated = self.file.faces.iter().find(|calibrated| calibrated.face == face);
        let calibrated = calibrated.ok_or_else(|| refused("face", face.name(), &self.faces().join(", ")))?;
        Ok(calibrated.friction.map(|found| (found.coefficient, found.coefficient_sd)))
    }

    /// Writes the calibration to a file, which `load_calibration` and `whisker --calibration` read.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        files::write_json(&path, &self.file).map_err(raised)
    }

    fn __repr__(&self) -> String {
        format!("<Calibration of {}: {}>", self.file.whisker.name, self.faces().join(", "))
    }
}

/// Prediction for one contact.
struct Predicted {
    reading_n_m: f64,
    gradient_n: Vector2<f64>,
    model_sd_n_m: f64,
    tangent_rad: Option<f64>,
}

/// Expected readings of n contacts. NaN outside the calibrated domain.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct Prediction {
    predicted: Vec<Option<Predicted>>,
}

impl Prediction {
    fn column<'py>(&self, py: Python<'py>, number: impl Fn(&Predicted) -> Option<f64>) -> Bound<'py, PyArray1<f64>> {
        column(py, self.predicted.iter().map(|row| row.as_ref().and_then(&number)))
    }
}

#[pymethods]
impl Prediction {
    /// Expected readings (n), in N m.
    #[getter]
    fn reading_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |row| Some(row.reading_n_m))
    }

    /// Derivatives (n, 2) of the readings by the contact's coordinates in Base, in N (N m per m).
    #[getter]
    fn gradient_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.predicted.iter().map(|row| row.as_ref().map(|row| row.gradient_n)))
    }

    /// Standard deviations (n) of the model error, in N m: constant for a given contact, to be added to the variance of the
    /// measurement noise.
    #[getter]
    fn model_sd_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |row| Some(row.model_sd_n_m))
    }

    /// Tangent angles (n) of the deflected whisker at the contacts, in Base (rad). NaN for models without mechanics.
    #[getter]
    fn tangent_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |row| row.tangent_rad)
    }

    /// Whether each contact lies in the calibrated domain (n).
    #[getter]
    fn calibrated<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.predicted.iter().map(Option::is_some))
    }

    fn __len__(&self) -> usize {
        self.predicted.len()
    }
}

/// Fits the sensor models of a whisker to calibration data and chooses the best by cross-validation.
///
/// `lines` holds the data of each calibrated face: `{"left": [(contacts, readings), ...]}`, with the contacts (n, 2) on the
/// centre line in Base (m) and the readings (n) in N m of each line along which a pin was pressed. Each line is compared
/// with the models fitted to the others, and its largest reading must have the sign of the face and that of the moment
/// which the elastica gives at its contact. `pin_radius_m` is the distance of the contacts from the centre of the pin: the
/// radius of pin and wire together. `models` are names of `sensor_models()`; by default all. `noise_sd_n_m` is the
/// standard deviation of the noise in the readings.
///
/// The samples of a line are successive states of one motion. If the pin slid along the whisker in both directions, its friction is
/// estimated and removed from the readings.
///
/// A model that the data do not determine is left out. If none is left, `ValueError` states the reasons.
#[pyfunction]
#[pyo3(signature = (whisker, lines, pin_radius_m, models=None, noise_sd_n_m=0.0))]
pub(crate) fn fit_calibration(
    py: Python<'_>,
    whisker: &Whisker,
    lines: &Bound<'_, PyDict>,
    pin_radius_m: f64,
    models: Option<Vec<String>>,
    noise_sd_n_m: f64,
) -> PyResult<Calibration> {
    for (what, number) in [("pin_radius_m", pin_radius_m), ("noise_sd_n_m", noise_sd_n_m)] {
        check_not_negative(what, number)?;
    }
    let rows = match &models {
        None => MODELS.iter().collect(),
        Some(names) => names.iter().map(|name| sensor::model(name).map_err(raised)).collect::<PyResult<Vec<_>>>()?,
    };
    if rows.is_empty() {
        return Err(refused("models", "none", "at least one name of a sensor model"));
    }
    let candidates: Vec<_> =
        rows.iter().flat_map(|row| (row.candidates)().into_iter().map(move |config| (*row, config))).collect();
    let mut faces = Vec::new();
    for (name, lines) in lines {
        let name: String = name.extract()?;
        let face = face_of(&name)?;
        let samples = samples(whisker, face, &lines)?;
        let data = FitData {
            whisker: &whisker.whisker,
            face,
            measured: &samples,
            reference: &samples,
            reference_noise_sd_n_m: noise_sd_n_m,
            pin_radius_m,
        };
        let without_friction = py.detach(|| sensor::without_friction(&data));
        let data = without_friction.as_ref().map_or(data, |without| without.applied_to(data));
        let (mut fits, mut reasons) = (Vec::new(), Vec::new());
        for (row, config) in &candidates {
            match py.detach(|| sensor::fit(row, config, &data)) {
                Ok(fit) => fits.push(fit),
                Err(ModelError::Data(reason)) => reasons.push(format!("{} {config}: {reason}", row.kind)),
                Err(error) => return Err(raised(error)),
            }
            py.check_signals()?;
        }
        let none = || {
            let expected = format!("other data: {}", reasons.join("; "));
            refused(&format!("lines[`{name}`]"), "data to which no model can be fitted", &expected)
        };
        let friction = without_friction.as_ref().map(|without| without.friction);
        faces.push(FaceFile::new(&fits, friction).ok_or_else(none)?);
    }
    if faces.is_empty() {
        return Err(refused("lines", "no face", "`left`, `right` or both"));
    }
    let watermark = watermark([&*serde_json::to_string(&faces).map_err(raised)?]);
    let data = FittedData { data_sha256: watermark.inputs_sha256.clone(), ..FittedData::default() };
    let file = CalibrationFile::new(whisker.whisker.clone(), data, faces, watermark);
    Ok(Calibration::new(file, "calibration".into()))
}

/// Calibration samples of one face, line by line. The largest reading of each line must have the sign of the face and that of the
/// moment which the elastica gives at its contact.
fn samples(whisker: &Whisker, face: Face, lines: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<Sample>>> {
    let elastica = whisker.elastica()?;
    lines
        .try_iter()?
        .enumerate()
        .map(|(i, line)| {
            let what = format!("lines[`{}`][{i}]", face.name());
            let of_readings = format!("readings of {what}");
            let (contacts, readings): (Bound<'_, PyAny>, Bound<'_, PyAny>) =
                line?.extract().map_err(|error| of_argument(lines.py(), &what, error))?;
            let contacts = points(&what, &Numbers::of(&what, &contacts)?)?;
            let readings = numbers(&of_readings, &Numbers::of(&of_readings, &readings)?)?;
            same_length(&of_readings, readings.len(), "contacts", contacts.len())?;
            let samples = contacts.into_iter().zip(readings);
            let samples: Vec<Sample> = samples.map(|(contact, reading_n_m)| Sample { contact, reading_n_m }).collect();
            let largest = samples.iter().max_by(|one, other| one.reading_n_m.abs().total_cmp(&other.reading_n_m.abs()));
            let Some(&Sample { contact, reading_n_m }) = largest else { return Ok(samples) };
            let refused = |expected: String| refused(&of_readings, format!("{reading_n_m} as the largest"), &expected);
            if reading_n_m == 0.0 || Face::of_reading(reading_n_m) != face {
                let sign = if face == Face::Left { "negative" } else { "positive" };
                return Err(refused(format!("{sign} readings, of an object on the {}", face.name())));
            }
            match elastica.at_point(contact) {
                Ok(solved) if reading_n_m * solved.deflection.moment_n_m <= 0.0 => {
                    let moment_n_m = solved.deflection.moment_n_m;
                    Err(refused(format!("about {moment_n_m:.3e}, as the whisker's mechanics give at its contact")))
                }
                _ => Ok(samples),
            }
        })
        .collect()
}
