//! The class `SpatialCalibration` and its predictions.

use std::path::PathBuf;
use std::sync::Arc;

use ::trace::{FittedData, SpatialCalibrationFile};
use ::whisker::sensor::ModelError;
use ::whisker::space::frames::Point;
use ::whisker::space::sensor::{
    self, Across, CalibratedSpace, SPATIAL_MODELS, SpatialFitData, SpatialModelRow, SpatialPrediction as Predicted,
    SpatialSample, spatial_model,
};
use nalgebra::{Matrix2, Vector2};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use testbed::provenance::watermark;
use testbed::space::replay::read_fitted;

use super::rod::Rod;
use super::sensor::BendingSensor;
use crate::arrays::{Numbers, flags, matrices, rows, same_length, vectors};
use crate::convert::check_not_negative;
use crate::error::{raised, refused};
use crate::interrupt;
use crate::whisker::Whisker;

/// Sensor model of a whisker in space: the expected bending moments of a contact.
///
/// A calibration comes from `load_spatial_calibration` or `fit_spatial_calibration`.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialCalibration {
    pub(super) file: SpatialCalibrationFile,
    pub(super) path: PathBuf,
    pub(super) calibrated: Arc<CalibratedSpace>,
}

/// Reads a calibration of format 2, written by `whisker fit` from traces in space.
///
/// A calibration beside the traces that it was fitted to is refused if they have changed since.
#[pyfunction]
pub(crate) fn load_spatial_calibration(py: Python<'_>, path: PathBuf) -> PyResult<SpatialCalibration> {
    py.detach(|| anyhow::Ok(SpatialCalibration::new(read_fitted(&path)?, path)?)).map_err(raised)
}

/// Fits the sensor models of a whisker in space to calibration data and chooses the best by cross-validation.
///
/// `lines` holds the data of each line along which a pin was pressed: `[(contacts, readings), ...]`, with the contacts (n, 3) on
/// the centre line in Base (m) and the bending moments (n, 2) about y and z of Base in N m. The lines must surround the whisker.
/// Each is compared with the models fitted without it and its neighbours. `models` are names of sensor models in space:
/// `polynomial`, `rod` and `gaussian-process`. The default is `polynomial` and `rod` or, with `real_sensor`, `polynomial` and
/// `gaussian-process`, whose fit takes about a minute. `noise_sd_n_m` is the standard deviation of the noise in the readings (N m).
/// `real_sensor` states that the readings are those of a real sensor: the estimators then allow for errors that are correlated
/// along the path of a contact, and `recommended` for contacts that friction holds in place and for a mounting that deviates from
/// that of the calibration. Contacts whose coordinates about the whisker are not unique, and those whose readings contradict those
/// of all others, are then left out.
///
/// A model that the data do not determine is left out. If none is left, `ValueError` states the reasons.
#[pyfunction]
#[pyo3(signature = (rod, lines, models=None, noise_sd_n_m=0.0, real_sensor=false))]
pub(crate) fn fit_spatial_calibration(
    py: Python<'_>,
    rod: &Rod,
    lines: Vec<(Numbers<'_>, Numbers<'_>)>,
    models: Option<Vec<String>>,
    noise_sd_n_m: f64,
    real_sensor: bool,
) -> PyResult<SpatialCalibration> {
    check_not_negative("noise_sd_n_m", noise_sd_n_m)?;
    let rows: Vec<&SpatialModelRow> = match &models {
        None => SPATIAL_MODELS.iter().collect(),
        Some(names) => names.iter().map(|name| spatial_model(name).map_err(raised)).collect::<PyResult<_>>()?,
    };
    let settings = |row: &SpatialModelRow| {
        let compared = (row.candidates)(real_sensor);
        // A model that is named is fitted in any case.
        if compared.is_empty() && models.is_some() { vec![(row.defaults)()] } else { compared }
    };
    if rows.is_empty() {
        return Err(refused("models", "none", "at least one name of a sensor model"));
    }
    let mut lines = lines.iter().enumerate().map(|(i, line)| samples(rod, i, line)).collect::<PyResult<Vec<_>>>()?;
    let mut across = Across::Normal;
    if real_sensor {
        across = py.detach(|| sensor::screen(&rod.whisker.whisker, &mut lines)).across;
        py.check_signals()?;
    }
    let data = SpatialFitData {
        whisker: &rod.whisker,
        lines: &lines,
        reference_noise_sd_n_m: noise_sd_n_m,
        across,
        real_sensor,
    };
    let (mut fits, mut reasons) = (Vec::new(), Vec::new());
    for row in rows {
        for config in settings(row) {
            match py.detach(|| sensor::fit(row, &config, &data)) {
                Ok(fit) => fits.push(fit),
                Err(ModelError::Data(reason)) => reasons.push(format!("{} {config}: {reason}", row.kind)),
                Err(error) => return Err(raised(error)),
            }
            py.check_signals()?;
        }
    }
    let contacts: Vec<_> = lines.iter().flatten().map(|sample| (sample.contact.vector(), sample.reading_n_m)).collect();
    let watermark = watermark([&*format!("{:?} {contacts:?}", rod.whisker)]);
    let data = FittedData { data_sha256: watermark.inputs_sha256.clone(), ..FittedData::default() };
    let file = SpatialCalibrationFile::new(&fits, data, watermark).ok_or_else(|| {
        refused("lines", "data to which no model can be fitted", &format!("other data: {}", reasons.join("; ")))
    })?;
    SpatialCalibration::new(file, "calibration".into()).map_err(raised)
}

/// Calibration samples of one line. Its largest reading must not be opposite or perpendicular to the bending moment of the rod at
/// that contact.
fn samples(rod: &Rod, i: usize, (contacts, readings): &(Numbers<'_>, Numbers<'_>)) -> PyResult<Vec<SpatialSample>> {
    let what = format!("lines[{i}]");
    let (contacts, readings) = (rows::<3>(&what, contacts)?, rows::<2>(&format!("readings of {what}"), readings)?);
    same_length(&format!("readings of {what}"), readings.len(), "contacts", contacts.len())?;
    let sized = contacts.iter().zip(readings.iter().map(|&reading| Vector2::from(reading)));
    let largest = sized.max_by(|(_, one), (_, other)| one.norm().total_cmp(&other.norm()));
    if let Some((&contact, reading_n_m)) = largest
        && let Ok(solved) = rod.rod.at_point(contact.into())
        && reading_n_m.dot(&solved.deflection.moment_n_m.yz()) <= 0.0
    {
        let (found, of_rod) = (reading_n_m, solved.deflection.moment_n_m.yz());
        let found = format!("[{}, {}] as the largest", found.x, found.y);
        let expected = format!("about [{:.3e}, {:.3e}], as the whisker's mechanics give", of_rod.x, of_rod.y);
        return Err(refused(&format!("readings of {what}"), found, &expected));
    }
    let sample = |([x_m, y_m, z_m], reading): ([f64; 3], [f64; 2])| {
        let reading_n_m = Vector2::from(reading);
        SpatialSample { contact: Point::new(x_m, y_m, z_m), reading_n_m, reference_n_m: reading_n_m, count: 1.0 }
    };
    Ok(contacts.into_iter().zip(readings).map(sample).collect())
}

impl SpatialCalibration {
    fn new(file: SpatialCalibrationFile, path: PathBuf) -> Result<Self, files::Error> {
        let calibrated = file.calibrated(&path, None)?;
        Ok(Self { file, path, calibrated })
    }
}

#[pymethods]
impl SpatialCalibration {
    /// The calibrated whisker.
    #[getter]
    fn whisker(&self) -> Whisker {
        Whisker { whisker: self.calibrated.whisker.whisker.clone() }
    }

    /// Name of the sensor model.
    #[getter]
    fn model(&self) -> &str {
        &self.calibrated.label
    }

    /// Root mean square residual of a moment on held-out lines (N m).
    #[getter]
    fn heldout_rms_n_m(&self) -> f64 {
        self.calibrated.heldout_rms_n_m
    }

    /// Largest bending moment of the calibration (N m).
    #[getter]
    fn largest_reading_n_m(&self) -> f64 {
        self.calibrated.largest_reading_n_m
    }

    /// Whether the sensor is a real one: the argument `real_sensor` of the fit, true for a calibration from recordings.
    #[getter]
    fn real_sensor(&self) -> bool {
        self.calibrated.real_sensor
    }

    /// The sensor of the imported recordings to which the calibration was fitted. Raises `ValueError` if the calibration has none,
    /// for example if it was fitted to simulated traces.
    fn sensor(&self) -> PyResult<BendingSensor> {
        let file = self.file.sensor.ok_or_else(|| {
            refused(
                &self.path.display().to_string(),
                "no sensor",
                "a calibration that `whisker fit` made of imported recordings",
            )
        })?;
        Ok(BendingSensor { file })
    }

    /// Writes the calibration file, which `load_spatial_calibration` and the command `whisker` read.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| files::write_json(&path, &self.file)).map_err(raised)
    }

    /// Predictions for contacts (n, 3) on the centre line, in Base (m). A contact outside the calibrated domain is a row of NaN.
    fn predict(&self, py: Python<'_>, points: Numbers<'_>) -> PyResult<SpatialPrediction> {
        let points = rows::<3>("points", &points)?;
        let mut predicted = Vec::with_capacity(points.len());
        interrupt::each(py, points.len(), |row| {
            let [x_m, y_m, z_m] = points[row];
            let contact = Point::new(x_m, y_m, z_m);
            let around = self.calibrated.around(contact);
            let prediction = self.calibrated.predict(contact);
            predicted.push(prediction.map(|prediction| (prediction, self.calibrated.model_covariance_n2_m2(around))));
            Ok(())
        })?;
        Ok(SpatialPrediction { predicted })
    }

    fn __repr__(&self) -> String {
        format!("<SpatialCalibration of {}: {}>", self.calibrated.whisker.whisker.name, self.calibrated.label)
    }
}

/// Expected bending moments of contacts in space, one row each. NaN outside the calibrated domain.
#[pyclass(frozen, module = "whisker_contact")]
pub(crate) struct SpatialPrediction {
    predicted: Vec<Option<(Predicted, Matrix2<f64>)>>,
}

#[pymethods]
impl SpatialPrediction {
    /// Bending moments (n, 2) about y and z of Base (N m).
    #[getter]
    fn reading_n_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        vectors(py, self.predicted.iter().map(|row| row.map(|(prediction, _)| prediction.reading_n_m)))
    }

    /// Derivatives (n, 2, 3) of the moments by the contact's coordinates, in N (N m per m).
    #[getter]
    fn gradient_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.predicted.iter().map(|row| row.map(|(prediction, _)| prediction.gradient_n)))
    }

    /// Covariances (n, 2, 2) of the true moments about the expected ones, without measurement noise (N2 m2).
    #[getter]
    fn covariance_n2_m2<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        matrices(py, self.predicted.iter().map(|row| row.map(|(_, covariance)| covariance)))
    }

    /// Whether the contacts (n) lie in the calibrated domain.
    #[getter]
    fn calibrated<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        flags(py, self.predicted.iter().map(Option::is_some))
    }

    fn __len__(&self) -> usize {
        self.predicted.len()
    }
}
