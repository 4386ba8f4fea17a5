//! Cross-validation: each press is estimated by a regression that was fitted without it.

use serde::{Deserialize, Serialize};

use super::learn::{SD_OVER_MAD, quantile};
use super::regression::{Fit, RegressionRow};
use super::{Error, LabelledPress, Scores};

/// Largest modified z-score of a press that is not suspicious (Iglewicz and Hoaglin, *How to Detect and Handle Outliers*, 1993).
pub const LARGEST_SCORE: f64 = 3.5;

/// Estimate for one press by a regression that was fitted without it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOut {
    /// Estimated radial distance (m).
    pub estimated_m: f64,
    /// Estimated less labelled distance (m).
    pub error_m: f64,
    /// Absolute error in standard deviations, the latter estimated from the median absolute error.
    pub score: f64,
}

impl HeldOut {
    /// Whether the press may be mislabelled: its score exceeds [`LARGEST_SCORE`].
    pub fn is_suspicious(&self) -> bool {
        self.score > LARGEST_SCORE
    }
}

/// Errors of a regression on presses that it was not fitted to.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossValidation {
    /// One entry a press, in the order of the presses.
    pub held_out: Vec<HeldOut>,
}

impl CrossValidation {
    pub(super) fn of(presses: &[LabelledPress], estimated_m: &[f64]) -> Self {
        let errors_m: Vec<f64> =
            presses.iter().zip(estimated_m).map(|(press, estimated_m)| estimated_m - press.distance_m).collect();
        let scatter_m = SD_OVER_MAD * quantile(errors_m.iter().map(|error| error.abs()).collect(), 0.5);
        let held_out = |(&estimated_m, &error_m): (&f64, &f64)| {
            let score = if error_m == 0.0 { 0.0 } else { error_m.abs() / scatter_m };
            HeldOut { estimated_m, error_m, score }
        };
        Self { held_out: estimated_m.iter().zip(&errors_m).map(held_out).collect() }
    }

    /// Root mean square error (m) over the presses whose index satisfies `which`. `None` if there are none.
    pub fn rmse_m(&self, which: impl Fn(usize) -> bool) -> Option<f64> {
        let squares: Vec<f64> = self.errors(which).map(|error| error * error).collect();
        (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }

    /// Median absolute error (m) over the presses whose index satisfies `which`. `None` if there are none.
    pub fn median_m(&self, which: impl Fn(usize) -> bool) -> Option<f64> {
        let mut sizes: Vec<f64> = self.errors(which).map(f64::abs).collect();
        sizes.sort_by(f64::total_cmp);
        let count = sizes.len();
        (count > 0).then(|| 0.5 * (sizes[(count - 1) / 2] + sizes[count / 2]))
    }

    /// Largest absolute error (m) over the presses whose index satisfies `which`. `None` if there are none.
    pub fn worst_m(&self, which: impl Fn(usize) -> bool) -> Option<f64> {
        self.errors(which).map(f64::abs).max_by(f64::total_cmp)
    }

    /// Scores over all presses.
    pub fn scores(&self) -> Scores {
        let suspicious = self.held_out.iter().enumerate().filter(|(_, held_out)| held_out.is_suspicious());
        Scores {
            rmse_m: self.rmse_m(|_| true).unwrap_or(f64::NAN),
            median_m: self.median_m(|_| true).unwrap_or(f64::NAN),
            worst_m: self.worst_m(|_| true).unwrap_or(f64::NAN),
            suspicious: suspicious.map(|(i, _)| i + 1).collect(),
        }
    }

    fn errors(&self, which: impl Fn(usize) -> bool) -> impl Iterator<Item = f64> {
        self.held_out.iter().enumerate().filter(move |(i, _)| which(*i)).map(|(_, held_out)| held_out.error_m)
    }
}

/// Unit of cross-validation: the presses that are held out together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HoldOut {
    /// One press.
    Press,
    /// All presses of one recording.
    Log,
    /// All presses at one place, in any recording.
    Place,
}

/// Largest difference between the distances of two presses at the same place (m).
pub(super) const SAME_PLACE_M: f64 = 0.5e-3;

impl HoldOut {
    /// Index of the group of each press, from zero.
    pub fn groups(self, presses: &[LabelledPress]) -> Vec<usize> {
        if self == Self::Place {
            return places(presses);
        }
        let mut logs: Vec<&str> = Vec::new();
        let group = |(i, press)| match self {
            Self::Press => i,
            Self::Log | Self::Place => number_of(&mut logs, press),
        };
        presses.iter().enumerate().map(group).collect()
    }
}

fn number_of<'a>(logs: &mut Vec<&'a str>, press: &'a LabelledPress) -> usize {
    logs.iter().position(|log| *log == press.log).unwrap_or_else(|| {
        logs.push(&press.log);
        logs.len() - 1
    })
}

/// Index of the place of each press, from zero, in the order of the distances. Presses whose distances follow each
/// other within [`SAME_PLACE_M`] are at one place.
fn places(presses: &[LabelledPress]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..presses.len()).collect();
    order.sort_by(|&a, &b| presses[a].distance_m.total_cmp(&presses[b].distance_m));
    let (mut places, mut place) = (vec![0; presses.len()], 0);
    for pair in order.windows(2) {
        place += usize::from(presses[pair[1]].distance_m - presses[pair[0]].distance_m > SAME_PLACE_M);
        places[pair[1]] = place;
    }
    places
}

/// Whether each press is at an inner place: neither at the nearest nor at the farthest one.
pub(super) fn inner(presses: &[LabelledPress]) -> Vec<bool> {
    let places = places(presses);
    let last = places.iter().max().copied().unwrap_or_default();
    places.iter().map(|&place| 0 < place && place < last).collect()
}

/// Callback with the number of fits done and of all fits.
pub type Progress<'a> = dyn FnMut(usize, usize) + 'a;

/// Progress that is not shown.
pub fn no_progress(_: usize, _: usize) {}

/// One fit for each group, to the presses of all other groups.
pub(super) fn fits_without_each<R>(
    row: &RegressionRow,
    fit: impl Fn(&[LabelledPress]) -> Result<R, Error>,
    presses: &[LabelledPress],
    groups: &[usize],
    progress: &mut Progress<'_>,
) -> Result<Vec<R>, Error> {
    let count = groups.iter().max().map_or(0, |last| last + 1);
    let mut without = |group| {
        progress(group, count);
        let rest = presses.iter().zip(groups).filter(|(_, other)| **other != group);
        let rest: Vec<LabelledPress> = rest.map(|(press, _)| press.clone()).collect();
        row.enough(&rest)?;
        fit(&rest)
    };
    (0..count).map(&mut without).collect()
}

/// Estimates each press by a regression that was fitted without its group. A leaking regression is given the true distance.
///
/// # Errors
/// If there are too few presses, a feature is missing, or the remaining presses do not determine the regression.
pub fn cross_validate(
    row: &RegressionRow,
    presses: &[LabelledPress],
    hold_out: HoldOut,
    progress: &mut Progress<'_>,
) -> Result<CrossValidation, Error> {
    row.enough(presses)?;
    let groups = hold_out.groups(presses);
    let pairs = presses.iter().zip(&groups);
    let estimated_m: Vec<f64> = match row.fit {
        Fit::Live(live) => {
            let fits = fits_without_each(row, live.fit, presses, &groups, progress)?;
            pairs.map(|(press, &group)| fits[group].distance_m(&press.features)).collect()
        }
        Fit::Leaking(fit) => {
            let fits = fits_without_each(row, fit, presses, &groups, progress)?;
            pairs.map(|(press, &group)| fits[group].distance_m(press)).collect()
        }
    };
    Ok(CrossValidation::of(presses, &estimated_m))
}
