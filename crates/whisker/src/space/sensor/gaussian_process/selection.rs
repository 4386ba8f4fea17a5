//! Selection of the covariance by predictions of held-out lines.

use super::kernel::{Kernel, Sample};
use super::process::{HeldOut, Process, neighbours};

/// Largest number of samples from which the covariance is selected; of more samples, every second line is taken.
const MOST_SELECTED: usize = 1000;

/// Scores of a channel on held-out samples.
#[derive(Clone, Copy)]
struct Score {
    /// Negative logarithm of the mean squared error.
    accuracy: f64,
    /// Mean logarithm of the predicted density.
    density: f64,
}

/// Scores of both channels.
fn score(held: &[HeldOut], largest_reading: f64) -> [Score; 2] {
    let count = held.len() as f64;
    [0, 1].map(|channel| {
        let square: f64 = held.iter().map(|one| (one.error[channel] / largest_reading).powi(2)).sum();
        let density = |one: &HeldOut| {
            let sd = one.sd[channel];
            -0.5 * (one.error[channel] / sd).powi(2) - (sd / largest_reading).ln()
        };
        Score { accuracy: -(square / count).ln(), density: held.iter().map(density).sum::<f64>() / count }
    })
}

/// Changes that the selection tries, in turn, on each channel. The lengths in the whisker's plane change together: the error on
/// held-out lines does not reveal a length that is too short between the samples of a line.
const CHANGES: [fn(&mut Kernel, f64); 6] = [
    |kernel, factor| kernel.length_m.iter_mut().for_each(|length_m| *length_m *= factor),
    |kernel, factor| kernel.length_m[2] *= factor,
    |kernel, factor| kernel.map_sd *= factor,
    |kernel, factor| kernel.line = kernel.line.map(|sd| sd * factor),
    |kernel, factor| kernel.noise = kernel.noise.map(|sd| sd * factor),
    |kernel, factor| kernel.line_length_m *= factor,
];
/// Number of these changes, the first ones, that concern the map. They are judged by the error on held-out lines, the others by its
/// predicted density.
const OF_MAP: usize = 3;

const FACTORS: [f64; 2] = [0.7, 1.4];

/// Number of times that all changes are tried.
const ROUNDS: usize = 3;

/// The covariance of each channel by a coordinate search: the map with the least error on held-out lines, errors and noise with the
/// largest predicted density. `None` if the covariance of the samples is singular.
pub fn selected(samples: &[Sample]) -> Option<[Kernel; 2]> {
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
    let (first, _) = Process::robust(samples, [Kernel::START; 2])?;
    // The lines of the kept samples, numbered again without gaps.
    let mut lines: Vec<usize> = first.samples.iter().map(|sample| sample.line).collect();
    lines.dedup();
    let number = |line: usize| lines.iter().position(|known| *known == line).expect("a known line");
    let samples: Vec<Sample> =
        first.samples.iter().map(|sample| Sample { line: number(sample.line), ..*sample }).collect();
    let near = neighbours(&samples);
    let scored = |kernels: [Kernel; 2]| {
        let process = Process::new(&samples, kernels)?;
        Some(score(&process.held_out(&near)?, process.largest_reading))
    };
    let mut kernels = [Kernel::START; 2];
    let mut best = scored(kernels)?;
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
    Some(kernels)
}
