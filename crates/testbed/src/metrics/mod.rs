//! Metrics of a trial: error, start-up, contour, consistency and contact events.
//!
//! A [`Metric`] is a number computed from the estimates of one estimator on one trial and the ground truth
//! ([`Scored`]). Each metric is a column of `trials.csv` and, summarised over the trials of a set, of `summary.csv`.
//! Readers take it from the [`Scores`] of a row by the metric's constant, not by its column name.
//!
//! To add a metric: a constant in the file of its topic, and one row in [`METRICS`].

pub mod bound;
pub mod consistency;
pub mod contact_events;
pub mod contour;
pub mod doubt;
pub mod error;
pub mod friction;
pub mod radius;
pub mod rows;
mod scored;
pub mod second;

pub use scored::{
    Contact, ContactCount, GroundTruth, MOST_MISSING, START_UP_S, Scored, Trial, Unscored, first_touch_s,
};

use serde::{Deserialize, Serialize};

use crate::statistics::{mean, median_of_scores, rms};

/// Metric: a column of `trials.csv` and of `summary.csv`.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name of the column, with its unit.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Summary over trials.
    pub summary: Summary,
    /// Value for one trial. `None` if it is undefined.
    pub measure: fn(&Scored<'_>) -> Option<f64>,
}

impl Metric {
    /// Index in [`METRICS`].
    ///
    /// # Panics
    /// If the metric has no row there.
    pub fn place(&self) -> usize {
        METRICS.iter().position(|row| row.name == self.name).expect("a metric that is read has its row in METRICS")
    }
}

/// Summary of a metric over the trials of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Summary {
    /// Median, for metrics of which smaller is better; missing values count as worse than any other.
    Median,
    /// Maximum. `None` if a trial has no value.
    Worst,
    /// Mean of the available values; for values of 0 and 1, a fraction.
    Mean,
    /// Root mean square. `None` if a trial has no value.
    RootMeanSquare,
}

impl Summary {
    /// Name of the summary.
    pub fn name(self) -> &'static str {
        match self {
            Self::Median => "median",
            Self::Worst => "worst",
            Self::Mean => "mean",
            Self::RootMeanSquare => "root mean square",
        }
    }

    /// Summary of the values of the trials.
    pub fn of(self, values: &[Option<f64>]) -> Option<f64> {
        match self {
            Self::Median => median_of_scores(values.iter().copied()),
            Self::Worst => values.iter().copied().try_fold(0.0, |worst: f64, value| Some(worst.max(value?))),
            Self::Mean => mean(values.iter().copied().flatten()),
            Self::RootMeanSquare => rms(&values.iter().copied().collect::<Option<Vec<f64>>>()?),
        }
    }
}

/// Registry of metrics, in column order.
pub const METRICS: &[Metric] = &[
    error::RMSE,
    error::MEDIAN,
    error::P95,
    error::WORST,
    error::START_RMSE,
    error::TIME_TO_1MM,
    error::TIME_TO_0P3MM,
    error::NEVER_1MM,
    error::ANSWERED,
    rows::LATE_MEAN,
    rows::LATE_WORST,
    rows::ROWS_TO_1MM,
    contour::CONTACT_RMSE,
    contour::LATER_CONTACT_RMSE,
    contour::FIRST_TOUCH_RMSE,
    contour::LATER_TOUCHES_RMSE,
    contour::MEAN,
    contour::P95,
    contour::HAUSDORFF,
    contour::TOUCHED_MEAN,
    contour::IN_FREE_SPACE,
    contour::LATER_MEAN,
    contour::LATER_P95,
    contour::BAND_COVERAGE,
    radius::ERROR,
    radius::COVERED,
    friction::ERROR,
    friction::COVERED,
    bound::RMSE,
    bound::DEVIATING_RMSE,
    bound::UNSIZED_RMSE,
    bound::MOVING_RMSE,
    bound::RATIO,
    consistency::NEES,
    consistency::NEES_SAMPLES,
    consistency::NIS,
    consistency::COVERAGE,
    consistency::STATED_RMSE,
    consistency::RESIDUAL_RATIO,
    doubt::DOUBTED,
    doubt::DOUBT_TIME,
    doubt::ALARMS,
    doubt::CONTACT_TIME,
    doubt::MISLEADING,
    second::RECALL,
    second::IDEAL_RECALL,
    second::PRECISION,
    second::FALSE_RATE,
    contact_events::LOST_PRECISION,
    contact_events::LOST_RECALL,
    contact_events::LOST_DELAY,
    contact_events::TOUCH_PRECISION,
    contact_events::TOUCH_RECALL,
    contact_events::TOUCH_DELAY,
    contact_events::TIP_PRECISION,
    contact_events::TIP_RECALL,
];

/// Values of all metrics, for one trial or for a set of trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores(Vec<Option<f64>>);

impl Scores {
    /// Scores with a value per metric.
    pub fn from_fn(value: impl FnMut(&Metric) -> Option<f64>) -> Self {
        Self(METRICS.iter().map(value).collect())
    }

    /// Scores of one trial.
    pub fn of(scored: &Scored<'_>) -> Self {
        // Readings of extreme scale give non-finite values, which are dropped.
        Self::from_fn(|metric| (metric.measure)(scored).filter(|value| value.is_finite()))
    }

    /// Value of one metric.
    pub fn get(&self, metric: &Metric) -> Option<f64> {
        self.0[metric.place()]
    }

    /// Values in the order of [`METRICS`].
    pub fn values(&self) -> &[Option<f64>] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn verif_column_names_are_unique() {
        let names: BTreeSet<&str> = METRICS.iter().map(|metric| metric.name).collect();
        assert_eq!(names.len(), METRICS.len());
    }

    #[test]
    fn verif_summaries_of_missing_values() {
        let (all, some) = ([Some(1.0), Some(4.0), Some(2.0)], [Some(1.0), None, Some(4.0)]);
        assert_eq!((Summary::Median.of(&all), Summary::Median.of(&some)), (Some(2.0), Some(4.0)));
        assert_eq!((Summary::Worst.of(&all), Summary::Worst.of(&some)), (Some(4.0), None));
        assert_eq!((Summary::Mean.of(&all), Summary::Mean.of(&some)), (Some(7.0 / 3.0), Some(2.5)));
        assert_eq!(Summary::Mean.of(&[None]), None);
        let rms = Summary::RootMeanSquare;
        assert_eq!((rms.of(&all), rms.of(&some)), (Some(7f64.sqrt()), None));
    }
}
