//! Calibrations of the whiskers of an evaluation.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use files::sha256;
use testbed::fitted_traces::{check_fitted_traces, check_is_calibration};
use testbed::results::files::{RESIDUALS, SURFACE};
use trace::CalibrationFile;
use whisker::sensor::CalibratedFace;

use super::OTHERS;

/// A calibration with the sensor models that the estimators use.
pub(super) struct Calibration {
    pub(super) path: PathBuf,
    pub(super) file: CalibrationFile,
    /// Hash of the file.
    pub(super) sha256: String,
    /// Faces by label of the sensor model; `None` is the model that the calibration chose.
    faces: BTreeMap<Option<&'static str>, Vec<Arc<CalibratedFace>>>,
}

impl Calibration {
    /// Reads a calibration with the sensor models that it chose. Its traces must be those of the fit.
    fn read(path: &Path) -> anyhow::Result<Self> {
        check_is_calibration(path, None, OTHERS)?;
        let bytes = fs::read(path).with_context(|| path.display().to_string())?;
        let file = CalibrationFile::read(path)?;
        check_fitted_traces(path, &file)?;
        for face in &file.faces {
            for table in [SURFACE, RESIDUALS] {
                let beside = path.with_file_name(table.file_name_of(&[&file.whisker.name, face.face.name()]));
                if !beside.is_file() {
                    bail!("{}: no such file beside its calibration; `whisker fit` writes both", beside.display());
                }
            }
        }
        let faces = BTreeMap::from([(None, file.calibrated(path, None)?)]);
        Ok(Self { path: path.into(), file, sha256: sha256(bytes), faces })
    }

    /// Faces with the sensor model of a label that was loaded.
    pub(super) fn faces(&self, label: Option<&'static str>) -> &[Arc<CalibratedFace>] {
        &self.faces[&label]
    }

    /// Whether a face is without a sensor model of this label.
    pub(super) fn lacks(&self, label: &str) -> bool {
        self.file.faces.iter().any(|face| face.model(Some(label)).is_none())
    }

    /// Loads the sensor models of this label.
    pub(super) fn load(&mut self, label: Option<&'static str>) -> anyhow::Result<()> {
        if !self.faces.contains_key(&label) {
            self.faces.insert(label, self.file.calibrated(&self.path, label)?);
        }
        Ok(())
    }
}

/// Calibrations by whisker.
#[derive(Default)]
pub(super) struct Calibrations(BTreeMap<String, Calibration>);

impl Calibrations {
    /// Calibration of a whisker from a file, which is read once.
    ///
    /// # Errors
    /// If the file cannot be read, or the whisker already has a calibration from another file.
    pub(super) fn open(&mut self, whisker: &str, path: &Path) -> anyhow::Result<&Calibration> {
        if !self.0.contains_key(whisker) {
            self.0.insert(whisker.into(), Calibration::read(path)?);
        }
        let known = &self.0[whisker];
        if known.path != path {
            let other = known.path.display();
            bail!("{}: `{whisker}` is calibrated by {other} too; name one by --calibrations", path.display());
        }
        Ok(known)
    }

    /// Calibration of a whisker that was opened.
    pub(super) fn of(&self, whisker: &str) -> &Calibration {
        &self.0[whisker]
    }

    /// All calibrations, in the order of the whiskers' names.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Calibration> {
        self.0.values()
    }

    /// Loads the sensor models of this label for all whiskers.
    pub(super) fn load(&mut self, label: Option<&'static str>) -> anyhow::Result<()> {
        self.0.values_mut().try_for_each(|calibration| calibration.load(label))
    }
}
