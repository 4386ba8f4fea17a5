//! Sensor models of a calibration, fitted to the samples of its lines.

use anyhow::{Context, ensure};
use importers::{Labelled, SpatialCalibration, Wire};
use nalgebra::{Vector2, Vector3};
use whisker::space::sensor::gaussian_process::{LEAST_SAMPLES, Process, Sample, neighbours, selected};

/// Distance below which two stage positions are the same (m).
const SAME_M: f64 = 1e-6;

/// A calibration with its Gaussian process.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Name of the calibration.
    pub name: String,
    /// All samples.
    pub samples: Vec<Sample>,
    /// The process.
    pub process: Process,
    /// Number of samples left out as outliers.
    pub outliers: usize,
    /// Point about which the root of the wire rotates, in the frame of the sensor (m), 3x1.
    pub root_m: Vector3<f64>,
    /// The wire, from which the arc lengths of contacts follow.
    pub wire: Wire,
    /// Lines that are left out with each line.
    pub neighbours: Vec<Vec<usize>>,
}

/// Samples of the lines of a calibration, above the sensor's rest reading.
pub fn samples(calibration: &SpatialCalibration) -> Vec<Sample> {
    let rows = &calibration.rows;
    // The rest reading is the median over the visits of the first place, because the first readings drift.
    let is_first = |row: &&Labelled| (row.contact_m - rows[0].contact_m).norm() < SAME_M;
    let visits: Vec<Vector2<f64>> = rows.iter().filter(is_first).map(|row| row.counts).collect();
    let median = |channel: usize| {
        let mut values: Vec<f64> = visits.iter().map(|counts| counts[channel]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let rest = Vector2::new(median(0), median(1));
    let mut found = Vec::new();
    let long = calibration.lines.iter().filter(|line| line.len() > 2);
    for (index, line) in long.enumerate() {
        found.extend(line.iter().map(|&row| Sample {
            contact_m: rows[row].contact_m,
            reading: rows[row].counts - rest,
            line: index,
        }));
    }
    found
}

impl Calibrated {
    /// Selects the covariance of each channel and fits the process.
    ///
    /// # Errors
    /// If the samples do not determine a process.
    pub fn new(calibration: &SpatialCalibration) -> anyhow::Result<Self> {
        let samples = samples(calibration);
        let place = || calibration.path.display().to_string();
        let found = samples.len();
        ensure!(found >= LEAST_SAMPLES, "{}: found {found} rows on lines, expected at least {LEAST_SAMPLES}", place());
        let kernels = selected(&samples).context("singular covariance").with_context(place)?;
        let (mut process, outliers) =
            Process::robust(&samples, kernels).with_context(|| format!("{}: rows: singular covariance", place()))?;
        let neighbours = neighbours(&samples);
        let held_out = process.inflate(&neighbours);
        held_out.with_context(|| format!("{}: rows: singular covariance of held-out lines", place()))?;
        let SpatialCalibration { name, root_m, wire, .. } = calibration.clone();
        Ok(Self { name, samples, process, outliers: outliers.len(), root_m, wire, neighbours })
    }
}
