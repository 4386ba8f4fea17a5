//! The calibration: the presses that it was fitted to, and all that can be computed of them.
//!
//! The file holds the labelled presses themselves, not coefficients that nobody can check: reading it fits the regression again, to the same
//! bits. The prediction interval is that of the jackknife+ (Barber, Candes, Ramdas and Tibshirani, "Predictive inference with the jackknife+",
//! *Annals of Statistics* 49, 2021): it contains the distance of a new press with a probability of about `coverage`, and of at least
//! `2 coverage - 1` whatever the distribution, as long as new presses come from where the old ones came. Where whole logs are held out it is the
//! paper's CV+ with the logs for folds, and holds for new presses of such logs only as far as one log is like another.

use std::path::Path;

use files::{FORMAT, Watermark, read_json, write_json};
use serde::{Deserialize, Serialize};

use super::cross_validation::{CrossValidation, HoldOut, fits_without_each};
use super::regression::{Fit, REGRESSIONS, RegressionRow, Regressor, regression};
use super::{Chain, Error, Features, LabelledPress};

/// Kind of the file.
pub const KIND: &str = "platform_calibration";

/// A slope is near those of the calibration if its logarithm lies within their range, widened on both sides by this share of it.
const MARGIN: f64 = 0.1;

/// What the held-out presses say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scores {
    /// Root mean square of their errors.
    pub rmse_m: f64,
    /// Median size of their errors.
    pub median_m: f64,
    /// Largest size of their errors.
    pub worst_m: f64,
    /// Numbers of the presses, from 1, that are suspected to be mislabelled.
    pub suspicious: Vec<usize>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationFile {
    format: u32,
    kind: String,
    regression: String,
    hold_out: HoldOut,
    coverage: f64,
    chain: Option<Chain>,
    scores: Scores,
    presses: Vec<LabelledPress>,
    watermark: Watermark,
}

/// A distance and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radial distance of the contact from the whisker's root.
    pub distance_m: f64,
    /// Ends of the prediction interval; none where there are too few presses for its coverage.
    pub interval_m: Option<[f64; 2]>,
}

/// A fitted calibration.
#[derive(Debug)]
pub struct Calibration {
    file: CalibrationFile,
    regressor: Box<dyn Regressor>,
    /// For each press the regression that was fitted without its group, by number, and the size of its error there.
    without: Vec<Box<dyn Regressor>>,
    groups: Vec<usize>,
    residuals_m: Vec<f64>,
    log_slopes: [f64; 2],
}

impl Calibration {
    /// Fits a regression to labelled presses. `chain` is what found them in samples; a calibration from a table of presses has none and cannot read samples.
    ///
    /// # Errors
    /// Where the regression leaks, or there are too few presses, a feature is missing, the presses do not determine the regression, or `coverage` is not from 0.5 to
    /// 0.999.
    pub fn fit(
        row: &RegressionRow,
        presses: Vec<LabelledPress>,
        chain: Option<Chain>,
        hold_out: HoldOut,
        coverage: f64,
        watermark: Watermark,
    ) -> Result<Self, Error> {
        let Fit::Live(fit) = row.fit else { return Err(Error::Leaks(row.name)) };
        if !(0.5..=0.999).contains(&coverage) {
            return Err(Error::Setting { key: "coverage", found: coverage, expected: "0.5 to 0.999".into() });
        }
        row.enough(&presses)?;
        let groups = hold_out.groups(&presses);
        let without = fits_without_each(row, fit, &presses, &groups)?;
        let estimated_m: Vec<f64> =
            presses.iter().zip(&groups).map(|(press, &group)| without[group].distance_m(&press.features)).collect();
        let validation = CrossValidation::of(&presses, &estimated_m);
        let log_slopes = presses
            .iter()
            .map(|press| press.features.slope_counts_per_s.ln())
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
        Ok(Self {
            regressor: fit(&presses)?,
            residuals_m: validation.held_out.iter().map(|held_out| held_out.error_m.abs()).collect(),
            without,
            groups,
            log_slopes,
            file: CalibrationFile {
                format: FORMAT,
                kind: KIND.into(),
                regression: row.name.into(),
                hold_out,
                coverage,
                chain,
                scores: validation.scores(),
                presses,
                watermark,
            },
        })
    }

    /// Reads a calibration.
    ///
    /// # Errors
    /// [`files::Error`] names file and key.
    pub fn read(path: &Path) -> Result<Self, files::Error> {
        let file: CalibrationFile = read_json(path)?;
        if file.format != FORMAT {
            return Err(files::Error::value(path, "format", file.format, FORMAT));
        }
        if file.kind != KIND {
            return Err(files::Error::value(path, "kind", &file.kind, KIND));
        }
        let row = regression(&file.regression).ok_or_else(|| {
            let known: Vec<_> = REGRESSIONS.iter().map(|row| row.name).collect();
            files::Error::value(path, "regression", &file.regression, known.join(", "))
        })?;
        for (i, press) in file.presses.iter().enumerate() {
            if press.features.slope_counts_per_s <= 0.0 {
                let key = format!("presses.{i}.features.slope_counts_per_s");
                return Err(files::Error::value(path, key, press.features.slope_counts_per_s, "a number above zero"));
            }
        }
        if let Some(chain) = &file.chain {
            chain.check(path)?;
        }
        Self::fit(row, file.presses, file.chain, file.hold_out, file.coverage, file.watermark)
            .map_err(|error| files::Error::value(path, "presses", format!("`{error}`"), "presses that can be fitted"))
    }

    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// [`files::Error::Io`] names the file.
    pub fn write(&self, path: &Path) -> Result<(), files::Error> {
        write_json(path, &self.file)
    }

    /// What finds presses in samples, if it was fitted to samples.
    pub fn chain(&self) -> Option<&Chain> {
        self.file.chain.as_ref()
    }

    /// The presses that it was fitted to.
    pub fn presses(&self) -> &[LabelledPress] {
        &self.file.presses
    }

    /// How it did on presses held out.
    pub fn scores(&self) -> &Scores {
        &self.file.scores
    }

    /// The distance at which a press with these features was; none where its slope lies outside the calibrated ones, or a feature is missing that the regression
    /// uses.
    pub fn estimate(&self, features: &Features) -> Option<Estimate> {
        let [low, high] = self.log_slopes;
        let margin = MARGIN * (high - low);
        let log_slope = features.slope_counts_per_s.ln();
        let distance_m = self.regressor.distance_m(features);
        let near = (low - margin..=high + margin).contains(&log_slope) && distance_m.is_finite();
        near.then(|| Estimate { distance_m, interval_m: self.interval_m(features) })
    }

    fn interval_m(&self, features: &Features) -> Option<[f64; 2]> {
        let count = self.groups.len();
        // Barber et al., equation 1.2: the ceil((1 - a)(n + 1))-th smallest upper end, and from above the same lower one.
        let rank = (self.file.coverage * (count + 1) as f64).ceil() as usize;
        if rank > count {
            return None;
        }
        let around: Vec<f64> = self.without.iter().map(|regressor| regressor.distance_m(features)).collect();
        let ends = |sign: f64| {
            let end = |(&group, residual_m): (&usize, &f64)| sign * around[group] + residual_m;
            let mut ends: Vec<f64> = self.groups.iter().zip(&self.residuals_m).map(end).collect();
            ends.sort_by(f64::total_cmp);
            sign * ends[rank - 1]
        };
        Some([ends(-1.0), ends(1.0)])
    }
}
