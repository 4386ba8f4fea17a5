//! Readings of a whole trace through a front end, with the influence of the other whiskers of its board.

use std::path::Path;

use trace::{CalibrationFile, Trace};

use super::{FrontEnd, Mounting, SensorInput};

/// Conditions under which the traces of a folder are read.
#[derive(Clone, Copy)]
pub struct Reading<'a> {
    /// Front end.
    pub front_end: &'a FrontEnd,
    /// Path of the calibration, for messages.
    pub path: &'a Path,
    /// Calibration of the whisker.
    pub calibration: &'a CalibrationFile,
    /// Standard deviation of the noise added to the moments (N m).
    pub added_sd_n_m: f64,
    /// Seed of the noise and of the front end.
    pub seed: u64,
}

impl Reading<'_> {
    /// Readings of a trace of `folder` (N m), one per instant. The traces of the other whiskers of its board are read from the
    /// same folder.
    ///
    /// # Errors
    /// If one of these traces cannot be read, or if the calibration does not contain a sensor of the board.
    pub fn of(&self, trace: &Trace, mounting: &Mounting, folder: &Path) -> anyhow::Result<Vec<f64>> {
        let others = mounting.board.iter().filter_map(|slot| slot.trace.as_ref());
        let mut beside = Vec::new();
        for name in others.filter(|name| **name != trace.sidecar.name) {
            let trace = Trace::read(&folder.join(format!("{name}.csv")))?;
            let mounting = Mounting::of(folder, &trace.sidecar)?;
            beside.push((trace, mounting));
        }
        let neighbours = beside.iter().map(|(trace, mounting)| self.input(trace, mounting));
        let neighbours = neighbours.collect::<anyhow::Result<Vec<_>>>()?;
        self.front_end.readings_n_m(&SensorInput { neighbours: &neighbours, ..self.input(trace, mounting)? })
    }

    fn input<'a>(&'a self, trace: &'a Trace, mounting: &'a Mounting) -> anyhow::Result<SensorInput<'a>> {
        let sensor = self.front_end.sensor(self.path, self.calibration, mounting)?;
        Ok(SensorInput { sensor, ..SensorInput::new(trace, mounting, self.added_sd_n_m, self.seed) })
    }
}
