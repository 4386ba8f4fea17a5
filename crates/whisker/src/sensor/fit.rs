//! Fit of a sensor model to calibration traces, with cross-validation on held-out data.

use serde_json::Value;

use super::error_map::{ErrorMap, Residual};
use super::{AlongAway, CalibratedFace, Domain, Face, ModelError, ModelRow, Region, Sample, Shares};
use crate::Whisker;
use crate::frames::{Base, Point};

/// Number of blocks into which a single calibration trace is divided for cross-validation.
const BLOCKS: usize = 5;

/// Lower bound of a model's error, relative to the largest reading.
const SMALLEST_ERROR: f64 = 1e-6;

/// Lower bound of a model's mean square error (N2 m2) on `count` held-out samples: the standard error of the variance of their
/// noise, and at least the square of a millionth of the largest reading.
pub(crate) fn least_error_n2_m2(noise_n2_m2: f64, count: f64, largest_reading_n_m: f64) -> f64 {
    (noise_n2_m2 * (2.0 / count).sqrt()).max((SMALLEST_ERROR * largest_reading_n_m).powi(2))
}

/// A fitted face and its residuals on held-out data.
#[derive(Debug)]
pub struct Fit {
    /// The face.
    pub face: CalibratedFace,
    /// Number of fitted samples.
    pub samples: usize,
    /// Predicted less true reading of each sample, under the model fitted without its trace; in the order of the input.
    pub residuals_n_m: Vec<Vec<f64>>,
}

/// Data of a fit: the calibration traces of one face.
#[derive(Clone, Copy, Debug)]
pub struct FitData<'a> {
    /// The whisker.
    pub whisker: &'a Whisker,
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// Samples of each trace with the readings of the sensor, which are fitted; in the order of time.
    pub measured: &'a [Vec<Sample>],
    /// The same samples with the readings that held-out predictions are compared with: free of noise, if known.
    pub reference: &'a [Vec<Sample>],
    /// Standard deviation of the remaining noise of the reference.
    pub reference_noise_sd_n_m: f64,
    /// Mean distance of the contacts from the centre of the object that touched.
    pub pin_radius_m: f64,
}

/// Fits the model `row` with `config` to the traces of one face.
///
/// Each trace is compared with the model fitted to the others; a single trace is divided into blocks that replace the
/// traces. The noise of the reference is subtracted from the residuals' mean square, so that they show the model's
/// error alone.
///
/// # Errors
/// [`ModelError`] if the settings are invalid or the data do not determine the model.
pub fn fit(row: &ModelRow, config: &Value, material: &FitData<'_>) -> Result<Fit, ModelError> {
    let &FitData { whisker, face, measured, reference, .. } = material;
    debug_assert!(measured.iter().map(Vec::len).eq(reference.iter().map(Vec::len)), "the same samples");
    let all = measured.concat();
    let rest = whisker.rest_shape();
    let coordinates: Vec<AlongAway> = all
        .iter()
        .map(|sample| {
            let foot = rest.foot(sample.contact);
            AlongAway::new(foot.arc_m, foot.left_m * face.away_sign())
        })
        .collect();
    let domain = Domain::covering(&coordinates)
        .ok_or_else(|| ModelError::Data("the calibration's contacts do not spread along the whisker".into()))?;
    let region = Region { whisker, face, domain: &domain };

    let largest_reading_n_m = reference.iter().flatten().map(|s| s.reading_n_m.abs()).fold(0.0, f64::max);
    let nodes = region.places(&ErrorMap::nodes());
    let folds = folds(measured);
    let mut residuals_n_m: Vec<Vec<f64>> = reference.iter().map(|trace| vec![0.0; trace.len()]).collect();
    let mut heldout_variance = vec![0.0; nodes.len()];
    for fold in 0..folds.count {
        let training: Vec<Sample> = measured
            .iter()
            .enumerate()
            .flat_map(|(trace, samples)| samples.iter().enumerate().map(move |(i, sample)| (trace, i, sample)))
            .filter(|&(trace, i, _)| folds.of(trace, i) != fold)
            .map(|(_, _, sample)| *sample)
            .collect();
        let learnt = (row.fit)(&region, &training, config)?;
        for (trace, samples) in reference.iter().enumerate() {
            for (i, sample) in samples.iter().enumerate().filter(|&(i, _)| folds.of(trace, i) == fold) {
                residuals_n_m[trace][i] = learnt.model.reading_n_m(sample.contact) - sample.reading_n_m;
            }
        }
        for (sum, &node) in heldout_variance.iter_mut().zip(&nodes) {
            *sum += (learnt.variance_n2_m2)(node) / folds.count as f64;
        }
    }
    let learnt = (row.fit)(&region, &all, config)?;
    let modelled = super::modelled(&*learnt.model, &domain, material.whisker.length_m);

    let flat = || residuals_n_m.iter().flatten();
    let noise_n2_m2 = material.reference_noise_sd_n_m.powi(2);
    let count = all.len() as f64;
    let least_n2_m2 = least_error_n2_m2(noise_n2_m2, count, largest_reading_n_m);
    let mean_square = flat().map(|r| r * r).sum::<f64>() / count;
    let residuals: Vec<Residual> =
        coordinates.iter().zip(flat()).map(|(&at, r)| Residual { shares: domain.shares(at), squared: r * r }).collect();
    let remaining: Vec<f64> = nodes.iter().map(|&node| (learnt.variance_n2_m2)(node)).collect();
    Ok(Fit {
        face: CalibratedFace {
            face,
            rest,
            label: learnt.model.label(),
            model: learnt.model.into(),
            error: ErrorMap::new(&residuals, &heldout_variance, &remaining, noise_n2_m2, least_n2_m2),
            heldout_rms_n_m: (mean_square - noise_n2_m2).max(least_n2_m2).sqrt(),
            heldout_worst_n_m: flat().map(|r| r.abs()).fold(0.0, f64::max),
            largest_reading_n_m,
            pin_radius_m: material.pin_radius_m,
            modelled,
            turn: Default::default(),
            domain,
        },
        samples: all.len(),
        residuals_n_m,
    })
}

impl Region<'_> {
    /// Contacts at positions within the region.
    fn places(&self, shares: &[Shares]) -> Vec<Point<Base>> {
        let rest = self.whisker.rest_shape();
        let (low, high) = self.domain.arc_range_m();
        shares
            .iter()
            .map(|&Shares { along, away }| {
                let arc_m = low + along * (high - low);
                let (lower, upper) = self.domain.away_range_m(arc_m);
                rest.beside(arc_m, (lower + away * (upper - lower)) * self.face.away_sign())
            })
            .collect()
    }
}

struct Folds {
    count: usize,
    /// Length of a block if one trace is divided. `None` if every trace is a fold.
    block: Option<usize>,
}

impl Folds {
    fn of(&self, trace: usize, sample: usize) -> usize {
        self.block.map_or(trace, |length| sample / length)
    }
}

fn folds(traces: &[Vec<Sample>]) -> Folds {
    match traces {
        [only] => {
            let length = only.len().div_ceil(BLOCKS).max(1);
            // A short line fills fewer blocks.
            Folds { count: only.len().div_ceil(length), block: Some(length) }
        }
        _ => Folds { count: traces.len(), block: None },
    }
}
