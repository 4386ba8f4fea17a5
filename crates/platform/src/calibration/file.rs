//! The calibration: labelled presses, the regression fitted to them, and the prediction interval.
//!
//! A file contains the presses and the fitted coefficients: the presses make the fit reproducible, the coefficients
//! make reading fast. A file without coefficients, written by an earlier version, is fitted again when it is read, with
//! bit-identical results.
//!
//! The prediction interval is that of the jackknife+ (Barber, Candes, Ramdas and Tibshirani, "Predictive inference with
//! the jackknife+", *Annals of Statistics* 49, 2021). It contains the distance of a new press with a probability of
//! about `coverage`, and of at least `2 coverage - 1` for any distribution, if new presses are exchangeable with the
//! labelled ones. If whole logs are held out, it is the CV+ interval of that paper with the logs as folds, and its
//! coverage requires that new logs are exchangeable with the labelled ones.
//!
//! If whole places are held out, the interval is one for a press at a new place: `x +- t s`, with the mean square `s^2`
//! of the errors at the inner places, each estimated without it, and the quantile `t` of Student's distribution with as
//! many degrees of freedom as there are inner places. It contains the scatter between places, such as that of the speed
//! of the push, which the presses of one place share and which a press held out alone does not show. The outermost
//! places do not count, since the regression without them extrapolates, which no estimate does by more than the margin
//! of the calibrated domain. The fit without a place is interpolated over twice the distance, so that the interval is
//! rather too wide than too narrow.

use std::collections::BTreeMap;
use std::path::Path;

use files::{FORMAT, Watermark, read_json, write_json};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::coefficients::{Coefficients, Fitted};
use super::cross_validation::{HoldOut, Progress, fits_without_each, inner, no_progress};
use super::regression::{Fit, LiveFit, Quantity, REGRESSIONS, RegressionRow};
use super::{Chain, Error, Features, LabelledPress};

/// Kind of the file.
pub const KIND: &str = "platform_calibration";

/// Margin of the calibrated domain: the range of each quantity of the regression is extended on both sides by this share of it.
const MARGIN: f64 = 0.1;

/// Largest relative difference between the scores in a file and those of its coefficients: rounding of another machine's logarithm.
const SAME_SCORES: f64 = 1e-6;

/// Scores over presses held out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scores {
    /// Root mean square error (m).
    pub rmse_m: f64,
    /// Median absolute error (m).
    pub median_m: f64,
    /// Largest absolute error (m).
    pub worst_m: f64,
    /// Numbers, from 1, of the presses that may be mislabelled.
    pub suspicious: Vec<usize>,
}

impl Scores {
    /// # Errors
    /// [`files::Error::Value`] if those in a file are not these, which its coefficients have: it was changed after the fit.
    fn check(&self, path: &Path, in_file: &Self) -> Result<(), files::Error> {
        let pairs = [
            ("rmse_m", self.rmse_m, in_file.rmse_m),
            ("median_m", self.median_m, in_file.median_m),
            ("worst_m", self.worst_m, in_file.worst_m),
        ];
        let differs =
            |&(_, own, found): &(&str, f64, f64)| !(0.0..=SAME_SCORES * own.abs()).contains(&(own - found).abs());
        pairs.into_iter().find(differs).map_or(Ok(()), |(key, own, found)| {
            let expected = format!("{own}, the error of its coefficients: remove the key `coefficients` to fit again");
            Err(files::Error::value(path, format!("scores.{key}"), found, expected))
        })
    }
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    coefficients: Option<Coefficients>,
    presses: Vec<LabelledPress>,
    watermark: Watermark,
}

/// An estimated distance and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radial distance of the contact from the whisker's root (m).
    pub distance_m: f64,
    /// Ends of the prediction interval (m). `None` if there are too few presses for its coverage, or an end is not finite.
    pub interval_m: Option<[f64; 2]>,
}

/// A fitted calibration.
#[derive(Debug)]
pub struct Calibration {
    file: CalibrationFile,
    fitted: Fitted,
    /// Group of each press, an index of `fitted.held_out`.
    groups: Vec<usize>,
    /// Absolute error of each press by the regression without its group (m).
    residuals_m: Vec<f64>,
    /// Half of the interval at a new place (m). `None` if no places were held out, or there are too few.
    half_m: Option<f64>,
    /// Quantities by which the regression estimates, with their ranges over the presses.
    domain: Vec<(Quantity, [f64; 2])>,
    was_fitted_on_reading: bool,
}

impl Calibration {
    /// Fits a regression to labelled presses. `chain` detected them in samples; a calibration from a table of presses
    /// has none and cannot be applied to samples.
    ///
    /// # Errors
    /// If the regression leaks, there are too few presses, a feature is missing, the presses do not determine the
    /// regression, or `coverage` is not from 0.5 to 0.999.
    pub fn fit(
        row: &RegressionRow,
        presses: Vec<LabelledPress>,
        chain: Option<Chain>,
        hold_out: HoldOut,
        coverage: f64,
        watermark: Watermark,
    ) -> Result<Self, Error> {
        Self::fit_with(row, presses, chain, hold_out, coverage, watermark, &mut no_progress)
    }

    /// As [`Calibration::fit`], with a callback that receives the progress.
    ///
    /// # Errors
    /// As [`Calibration::fit`].
    pub fn fit_with(
        row: &RegressionRow,
        presses: Vec<LabelledPress>,
        chain: Option<Chain>,
        hold_out: HoldOut,
        coverage: f64,
        watermark: Watermark,
        progress: &mut Progress<'_>,
    ) -> Result<Self, Error> {
        let Fit::Live(live) = row.fit else { return Err(Error::Leaks(row.name)) };
        check(row, &presses, coverage)?;
        let groups = hold_out.groups(&presses);
        let held_out = fits_without_each(row, live.fit, &presses, &groups, progress)?;
        let fitted = Fitted { all: (live.fit)(&presses)?, held_out };
        let coefficients = Coefficients::of(&fitted, &live).ok_or(Error::Undetermined(row.name))?;
        let scores = fitted.validation(&presses, &groups).scores();
        let file = CalibrationFile {
            format: FORMAT,
            kind: KIND.into(),
            regression: row.name.into(),
            hold_out,
            coverage,
            chain,
            scores,
            coefficients: Some(coefficients),
            presses,
            watermark,
        };
        Ok(Self::new(file, &live, fitted, groups))
    }

    fn new(file: CalibrationFile, live: &LiveFit, fitted: Fitted, groups: Vec<usize>) -> Self {
        let validation = fitted.validation(&file.presses, &groups);
        let range = |quantity: &Quantity| {
            let values = file.presses.iter().map(|press| quantity(&press.features));
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
        };
        let domain = live.quantities.iter().map(|quantity| (*quantity, range(quantity))).collect();
        let residuals_m: Vec<f64> = validation.held_out.iter().map(|held_out| held_out.error_m.abs()).collect();
        let is_by_place = file.hold_out == HoldOut::Place;
        Self {
            half_m: is_by_place.then(|| half_m(&file.presses, &groups, &residuals_m, file.coverage)).flatten(),
            residuals_m,
            file,
            fitted,
            groups,
            domain,
            was_fitted_on_reading: false,
        }
    }

    /// Reads a calibration. One without coefficients is fitted again, which may take minutes.
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
        let (row, live) = live_regression(&file.regression).ok_or_else(|| {
            let known: Vec<_> =
                REGRESSIONS.iter().filter(|row| matches!(row.fit, Fit::Live(_))).map(|row| row.name).collect();
            let expected = format!("{}: fit again with one of these", known.join(", "));
            files::Error::value(path, "regression", &file.regression, expected)
        })?;
        for (i, press) in file.presses.iter().enumerate() {
            if let Some((key, found)) = not_above_zero(&press.features, live) {
                let key = format!("presses.{i}.features.{key}");
                return Err(files::Error::value(path, key, found, "a number above zero"));
            }
        }
        if let Some(chain) = &file.chain {
            chain.check(path)?;
        }
        let unfit = |error: Error| {
            files::Error::value(path, "presses", format!("`{error}`"), "presses that determine the regression")
        };
        let Some(coefficients) = &file.coefficients else {
            let fitted = Self::fit(row, file.presses, file.chain, file.hold_out, file.coverage, file.watermark);
            return Ok(Self { was_fitted_on_reading: true, ..fitted.map_err(unfit)? });
        };
        check(row, &file.presses, file.coverage).map_err(unfit)?;
        let groups = file.hold_out.groups(&file.presses);
        let fitted = coefficients.restore(path, live, groups.iter().max().map_or(0, |last| last + 1))?;
        let scores = fitted.validation(&file.presses, &groups).scores();
        scores.check(path, &file.scores)?;
        Ok(Self::new(CalibrationFile { scores, ..file }, live, fitted, groups))
    }

    /// Whether the file that it was read from had no coefficients, so that it was fitted again.
    pub fn was_fitted_on_reading(&self) -> bool {
        self.was_fitted_on_reading
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`files::Error::Io`] names the file.
    pub fn write(&self, path: &Path) -> Result<(), files::Error> {
        write_json(path, &self.file)
    }

    /// Detection of presses in samples. `None` if it was fitted to a table of presses.
    pub fn chain(&self) -> Option<&Chain> {
        self.file.chain.as_ref()
    }

    /// The presses that it was fitted to.
    pub fn presses(&self) -> &[LabelledPress] {
        &self.file.presses
    }

    /// Scores over presses held out.
    pub fn scores(&self) -> &Scores {
        &self.file.scores
    }

    /// Estimated distance of a press with these features. `None` if a feature that the regression uses is missing or outside the
    /// calibrated domain.
    pub fn estimate(&self, features: &Features) -> Option<Estimate> {
        let is_inside = self.domain.iter().all(|(quantity, [low, high])| {
            let margin = MARGIN * (high - low);
            (low - margin..=high + margin).contains(&quantity(features))
        });
        let distance_m = self.fitted.all.distance_m(features);
        let is_known = is_inside && distance_m.is_finite();
        is_known.then(|| Estimate { distance_m, interval_m: self.interval_m(features, distance_m) })
    }

    fn interval_m(&self, features: &Features, distance_m: f64) -> Option<[f64; 2]> {
        if self.file.hold_out == HoldOut::Place {
            return self.half_m.map(|half_m| [distance_m - half_m, distance_m + half_m]);
        }
        let count = self.groups.len();
        // Barber et al., equation 1.2: the ceil((1 - a)(n + 1))-th smallest upper end; the lower end by symmetry.
        let rank = (self.file.coverage * (count + 1) as f64).ceil() as usize;
        if rank > count {
            return None;
        }
        let around: Vec<f64> = self.fitted.held_out.iter().map(|regressor| regressor.distance_m(features)).collect();
        let ends = |sign: f64| {
            let end = |(&group, residual_m): (&usize, &f64)| sign * around[group] + residual_m;
            let mut ends: Vec<f64> = self.groups.iter().zip(&self.residuals_m).map(end).collect();
            ends.sort_by(f64::total_cmp);
            sign * ends[rank - 1]
        };
        let ends = [ends(-1.0), ends(1.0)];
        ends.iter().all(|end| end.is_finite()).then_some(ends)
    }
}

/// Fewest inner places that determine an interval.
const FEWEST_INNER: usize = 3;

/// Half of the interval at a new place (m): Student's quantile times the root mean square over the inner places of the
/// root mean square error at each. `None` if there are too few, or an error is not finite.
fn half_m(presses: &[LabelledPress], places: &[usize], residuals_m: &[f64], coverage: f64) -> Option<f64> {
    let inner = inner(presses);
    let mut squares: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for i in (0..presses.len()).filter(|&i| inner[i]) {
        let (sum, count) = squares.entry(places[i]).or_default();
        *sum += residuals_m[i].powi(2);
        *count += 1.0;
    }
    if squares.len() < FEWEST_INNER {
        return None;
    }
    let freedom = squares.len() as f64;
    let scatter_m = (squares.values().map(|(sum, count)| sum / count).sum::<f64>() / freedom).sqrt();
    let student = StudentsT::new(0.0, 1.0, freedom).ok()?;
    Some(scatter_m * student.inverse_cdf(0.5 + 0.5 * coverage)).filter(|half_m| half_m.is_finite())
}

/// # Errors
/// If `coverage` is out of range or there are too few presses.
fn check(row: &RegressionRow, presses: &[LabelledPress], coverage: f64) -> Result<(), Error> {
    if !(0.5..=0.999).contains(&coverage) {
        return Err(Error::Setting { key: "coverage", found: coverage, expected: "0.5 to 0.999".into() });
    }
    row.enough(presses)
}

/// Name and value of the slope, or of a feature whose logarithm the regression uses, if it is not above zero.
fn not_above_zero(features: &Features, live: &LiveFit) -> Option<(&'static str, f64)> {
    // A regression uses a feature if another value of it makes a quantity finite.
    let is_used = |other: Features| {
        live.quantities.iter().any(|quantity| !quantity(features).is_finite() && quantity(&other).is_finite())
    };
    let peak = is_used(Features { peak_counts: Some(1.0), ..*features });
    let ramp = is_used(Features { ramp_counts_per_s: Some(1.0), ..*features });
    let checked = [
        ("slope_counts_per_s", Some(features.slope_counts_per_s), true),
        ("peak_counts", features.peak_counts, peak),
        ("ramp_counts_per_s", features.ramp_counts_per_s, ramp),
    ];
    checked.into_iter().find_map(|(key, found, is_used)| Some((key, found.filter(|found| is_used && *found <= 0.0)?)))
}

/// Row of the registry with this name and its fit. `None` if there is none that works at run time.
fn live_regression(name: &str) -> Option<(&'static RegressionRow, &'static LiveFit)> {
    REGRESSIONS.iter().find_map(|row| match &row.fit {
        Fit::Live(live) if row.name == name => Some((row, live)),
        _ => None,
    })
}
