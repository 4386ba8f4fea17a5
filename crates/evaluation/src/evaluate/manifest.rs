//! `run.json` of an evaluation, and the files that an up-to-date run must have.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::Context;
use files::{read_json, write_atomically};
use testbed::results::files::{OUTLINE, RESIDUALS, RUN, SURFACE, evaluated_files};
use testbed::results::{Run, RunCalibration, RunEstimator, RunNames, RunSet, SetName};
use trace::Sidecar;

use super::array_members;
use super::prepared::{Prepared, TrialSpec};
use super::settings::EvaluateSettings;
use crate::provenance::{evaluation_watermark, scored_inputs};

impl Prepared {
    /// Contents of `run.json`.
    ///
    /// # Errors
    /// If an input does not serialise.
    pub(super) fn run(&self, settings: &EvaluateSettings) -> anyhow::Result<Run> {
        let estimators: Vec<RunEstimator> =
            self.participants.iter().map(|participant| participant.describe()).collect();
        let (sets, calibrations) = (self.run_sets(), self.run_calibrations());
        let front_end = self.front_end.describe(self.sensors().cloned().collect());
        let recordings = array_members::recordings(self.array_members(), settings.map);
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
        inputs.extend(array_members::inputs(self.array_members().map(|(_, member)| member))?);
        if !settings.noise_unit.is_default() {
            inputs.push(serde_json::to_string(&settings.noise_unit)?);
        }
        let sidecars = self.trials.iter().map(|trial| &trial.sidecar);
        inputs.extend(sidecars.map(|sidecar| scored_inputs(&sidecar.data_sha256(), &sidecar.scene)));
        Ok(Run {
            format: files::FORMAT,
            kind: "run".into(),
            name: settings.name.clone(),
            watermark: evaluation_watermark(inputs.iter().map(String::as_str)),
            noise: settings.noise.clone(),
            noise_unit: settings.noise_unit,
            seeds: settings.seeds.clone(),
            front_end,
            touch: settings.touch,
            estimators,
            sets,
            calibrations,
            whiskers: self.calibrations.iter().map(|calibration| calibration.file.whisker.clone()).collect(),
            recordings,
        })
    }

    fn run_sets(&self) -> Vec<RunSet> {
        let set = |(name, &largest_reading_n_m): (&SetName, &f64)| {
            let trials = self.trials.iter().filter(|trial| trial.set() == *name);
            let trials: Vec<&TrialSpec> = trials.collect();
            let members: Vec<&Sidecar> = trials.iter().map(|trial| &trial.sidecar).collect();
            let stated = |sidecar: &&Sidecar| Some((sidecar.object.clone(), sidecar.recorded.as_ref()?.object_class?));
            RunSet {
                group: name.group.clone(),
                whisker: name.whisker.clone(),
                object: members[0].object.clone(),
                object_classes: members.iter().filter_map(stated).collect(),
                traces: members.iter().map(|sidecar| sidecar.name.clone()).collect(),
                largest_reading_n_m,
                stated_noise: members[0].replay.map(|stated| stated.noise),
                miscalibration: trials[0].miscalibration,
            }
        };
        self.largest_readings_n_m.iter().map(set).collect()
    }

    fn run_calibrations(&self) -> Vec<RunCalibration> {
        let faces = self.calibrations.iter().flat_map(|calibration| {
            calibration.faces(None).iter().map(|face| RunCalibration {
                whisker: calibration.file.whisker.name.clone(),
                face: face.face.name().into(),
                model: face.model.about(),
                sha256: calibration.sha256.clone(),
                heldout_rms_n_m: face.heldout_rms_n_m,
                heldout_worst_n_m: face.heldout_worst_n_m,
                largest_reading_n_m: face.largest_reading_n_m,
            })
        });
        faces.collect()
    }

    /// Whether a folder contains a complete run from the same inputs.
    pub(super) fn is_up_to_date(&self, folder: &Path, run: &Run) -> bool {
        let is_same = |old: Run| old.watermark.inputs_sha256 == run.watermark.inputs_sha256;
        let outlined = self.trials.iter().filter(|trial| trial.outline.is_some());
        let outlined: Vec<String> = outlined.map(|trial| trial.sidecar.name.clone()).collect();
        let sensor_tables: BTreeSet<String> =
            self.sensors().flat_map(|sensor| self.front_end.table_files(sensor)).collect();
        let names = RunNames { run, outlined: &outlined, sensor_tables: &sensor_tables };
        read_json::<Run>(&RUN.path(folder)).is_ok_and(is_same)
            && evaluated_files(&names).iter().all(|name| folder.join(name).is_file())
    }

    /// Copies the inputs that the report draws, so that it needs the run alone.
    ///
    /// # Errors
    /// If a file cannot be read or written.
    pub(super) fn copy_for_report(&self, folder: &Path) -> anyhow::Result<()> {
        for trial in &self.trials {
            if let Some(outline) = &trial.outline {
                write_atomically(&OUTLINE.path_of(folder, &[&trial.sidecar.name]), outline.to_csv().as_bytes())?;
            }
        }
        for sensor in self.sensors() {
            for (name, bytes) in self.front_end.tables(sensor)? {
                write_atomically(&folder.join("sensors").join(name), &bytes)?;
            }
        }
        for calibration in self.calibrations.iter() {
            let source = calibration.path.parent().unwrap_or(Path::new("."));
            for face in calibration.faces(None) {
                let values = [calibration.file.whisker.name.as_str(), face.face.name()];
                for file in [SURFACE, RESIDUALS] {
                    let from = source.join(file.file_name_of(&values));
                    let bytes = fs::read(&from).with_context(|| from.display().to_string())?;
                    write_atomically(&file.path_of(folder, &values), &bytes)?;
                }
            }
        }
        Ok(())
    }
}
