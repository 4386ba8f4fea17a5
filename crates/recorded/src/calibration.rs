//! Sensor models of a calibration: the samples of its lines, and the selection of the covariance.

use anyhow::{Context, ensure};
use importers::{Labelled, SpatialCalibration, Wire};
use nalgebra::{Vector2, Vector3};

use crate::kernel::{Kernel, Sample};
use crate::process::{HeldOut, Process, neighbours};

/// Distance below which two stage positions are the same (m).
const SAME_M: f64 = 1e-6;

/// Largest number of samples from which the covariance is selected; of a larger calibration, every second line is taken.
const MOST_SELECTED: usize = 1000;

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
            counts: rows[row].counts - rest,
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
        ensure!(samples.len() >= 100, "{}: found {} rows on lines, expected at least 100", place(), samples.len());
        let kernels = selected(&samples).with_context(place)?;
        let (mut process, outliers) =
            Process::robust(&samples, kernels).with_context(|| format!("{}: rows: singular covariance", place()))?;
        let neighbours = neighbours(&samples);
        let held_out = process.inflate(&neighbours);
        held_out.with_context(|| format!("{}: rows: singular covariance of held-out lines", place()))?;
        let SpatialCalibration { name, root_m, wire, .. } = calibration.clone();
        Ok(Self { name, samples, process, outliers, root_m, wire, neighbours })
    }
}

/// Scores of a channel on held-out samples.
#[derive(Clone, Copy)]
struct Score {
    /// Negative logarithm of the mean squared error.
    accuracy: f64,
    /// Mean logarithm of the predicted density.
    density: f64,
}

/// Scores of both channels.
fn score(held: &[HeldOut], largest_counts: f64) -> [Score; 2] {
    let count = held.len() as f64;
    [0, 1].map(|channel| {
        let square: f64 = held.iter().map(|one| (one.error[channel] / largest_counts).powi(2)).sum();
        let density = |one: &HeldOut| {
            let sd = one.sd[channel];
            -0.5 * (one.error[channel] / sd).powi(2) - (sd / largest_counts).ln()
        };
        Score { accuracy: -(square / count).ln(), density: held.iter().map(density).sum::<f64>() / count }
    })
}

/// Changes that the selection tries, in turn, on each channel. The lengths in the whisker's plane change together: left-out lines
/// do not show a length that is too short between the samples of a line.
const CHANGES: [fn(&mut Kernel, f64); 6] = [
    |kernel, factor| kernel.length_m.iter_mut().for_each(|length_m| *length_m *= factor),
    |kernel, factor| kernel.length_m[2] *= factor,
    |kernel, factor| kernel.map_sd *= factor,
    |kernel, factor| kernel.line = kernel.line.map(|sd| sd * factor),
    |kernel, factor| kernel.noise = kernel.noise.map(|sd| sd * factor),
    |kernel, factor| kernel.line_length_m *= factor,
];
/// Number of these changes, the first ones, that concern the map: they are judged by the error on held-out lines, the others by
/// its predicted density.
const OF_MAP: usize = 3;

const FACTORS: [f64; 2] = [0.7, 1.4];

/// Number of times that all changes are tried.
const ROUNDS: usize = 3;

/// The covariance of each channel by a coordinate search: the map with the least error on held-out lines, errors and noise with the
/// largest predicted density.
fn selected(samples: &[Sample]) -> anyhow::Result<[Kernel; 2]> {
    let thinned: Vec<Sample>;
    let samples = if samples.len() > MOST_SELECTED {
        thinned = samples
            .iter()
            .filter(|sample| sample.line % 2 == 0)
            .map(|sample| Sample { line: sample.line / 2, ..*sample })
            .collect();
        &thinned
    } else {
        samples
    };
    let (first, _) = Process::robust(samples, [Kernel::START; 2]).context("singular covariance")?;
    // The lines of the kept samples, numbered again without gaps.
    let mut lines: Vec<usize> = first.samples.iter().map(|sample| sample.line).collect();
    lines.dedup();
    let number = |line: usize| lines.iter().position(|known| *known == line).expect("a known line");
    let samples: Vec<Sample> =
        first.samples.iter().map(|sample| Sample { line: number(sample.line), ..*sample }).collect();
    let near = neighbours(&samples);
    let scored = |kernels: [Kernel; 2]| {
        let process = Process::new(&samples, kernels)?;
        Some(score(&process.held_out(&near)?, process.largest_counts))
    };
    let mut kernels = [Kernel::START; 2];
    let mut best = scored(kernels).context("singular covariance")?;
    for _ in 0..ROUNDS {
        for (index, change) in CHANGES.into_iter().enumerate() {
            for factor in FACTORS {
                let mut tried = kernels;
                tried.iter_mut().for_each(|kernel| change(kernel, factor));
                let Some(found) = scored(tried) else { continue };
                for channel in 0..2 {
                    let (new, old) = (found[channel], best[channel]);
                    let is_better =
                        if index < OF_MAP { new.accuracy > old.accuracy } else { new.density > old.density };
                    if is_better {
                        (kernels[channel], best[channel]) = (tried[channel], found[channel]);
                    }
                }
            }
        }
    }
    Ok(kernels)
}
