//! Fitting a sensor model to calibration traces and judging it on data it has not seen.

use serde_json::Value;

use super::{CalibratedFace, Domain, Face, ModelError, ModelRow, Sample};
use crate::Whisker;

/// Blocks into which a single calibration trace is cut so that parts of it can be held out.
const BLOCKS: usize = 5;

/// A fitted face and its residuals on held-out data.
#[derive(Debug)]
pub struct Fit {
    /// The face.
    pub face: CalibratedFace,
    /// Samples that were fitted.
    pub samples: usize,
    /// Predicted less true reading of each sample, under the model fitted without the trace it belongs to; in the order
    /// of the input.
    pub residuals_n_m: Vec<Vec<f64>>,
    /// The largest of them, absolute.
    pub heldout_worst_n_m: f64,
}

/// Fits the model `row` with `config` to the traces of one face.
///
/// `noisy` and `clean` hold the same traces with and without measurement noise: the fit sees the first, residuals are taken against
/// the second, so that they show the model's error alone. Each trace is judged by the model fitted to the others; a single trace is
/// cut into blocks that take the part of traces.
///
/// # Errors
/// [`ModelError`] where the settings are wrong or the data do not determine the model.
pub fn fit(
    row: &ModelRow,
    config: &Value,
    whisker: &Whisker,
    face: Face,
    noisy: &[Vec<Sample>],
    clean: &[Vec<Sample>],
) -> Result<Fit, ModelError> {
    let all = noisy.concat();
    let rest = whisker.rest_shape();
    let coordinates: Vec<(f64, f64)> = all
        .iter()
        .map(|sample| {
            let foot = rest.foot(sample.contact);
            (foot.arc_m, foot.left_m * face.away_sign())
        })
        .collect();
    let domain = Domain::covering(&coordinates)
        .ok_or_else(|| ModelError::Data("the calibration's contacts do not spread along the whisker".into()))?;

    let largest_reading_n_m = clean.iter().flatten().map(|s| s.reading_n_m.abs()).fold(0.0, f64::max);
    let folds = folds(noisy);
    let mut residuals_n_m: Vec<Vec<f64>> = clean.iter().map(|trace| vec![0.0; trace.len()]).collect();
    for fold in 0..folds.count {
        let training: Vec<Sample> = noisy
            .iter()
            .enumerate()
            .flat_map(|(trace, samples)| samples.iter().enumerate().map(move |(i, sample)| (trace, i, sample)))
            .filter(|&(trace, i, _)| folds.of(trace, i) != fold)
            .map(|(_, _, sample)| *sample)
            .collect();
        let model = (row.fit)(&training, config)?;
        for (trace, samples) in clean.iter().enumerate() {
            for (i, sample) in samples.iter().enumerate().filter(|&(i, _)| folds.of(trace, i) == fold) {
                residuals_n_m[trace][i] = model.reading_n_m(sample.contact) - sample.reading_n_m;
            }
        }
    }
    let count = all.len() as f64;
    let flat = || residuals_n_m.iter().flatten();
    let heldout_rms_n_m = (flat().map(|r| r * r).sum::<f64>() / count).sqrt();
    let heldout_worst_n_m = flat().map(|r| r.abs()).fold(0.0, f64::max);
    let model = (row.fit)(&all, config)?;
    Ok(Fit {
        face: CalibratedFace { face, rest, domain, model, heldout_rms_n_m, largest_reading_n_m },
        samples: all.len(),
        residuals_n_m,
        heldout_worst_n_m,
    })
}

struct Folds {
    count: usize,
    /// Length of a block where one trace is cut; without it every trace is a fold.
    block: Option<usize>,
}

impl Folds {
    fn of(&self, trace: usize, sample: usize) -> usize {
        self.block.map_or(trace, |length| sample / length)
    }
}

fn folds(traces: &[Vec<Sample>]) -> Folds {
    match traces {
        [only] => Folds { count: BLOCKS, block: Some(only.len().div_ceil(BLOCKS).max(1)) },
        _ => Folds { count: traces.len(), block: None },
    }
}
