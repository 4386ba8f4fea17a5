//! Keys under which rows of results belong together.

use super::contours::{ContourScoreRow, ContourTrialRow};
use super::over_time::{ConsistencyRow, ErrorBandRow};
use super::scores::{SummaryHead, TrialHead};

/// Trials of one group with one whisker. Measurement noise is a fraction of the largest reading of such a set.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SetName {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
}

/// Key of all results of one estimator on one set at one noise level.
#[derive(Clone, Debug, PartialEq)]
pub struct SetKey {
    /// Set of trials.
    pub set: SetName,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
}

impl SetKey {
    /// The key in a form that maps can be ordered by.
    pub fn ordered(&self) -> (SetName, u64, String) {
        (self.set.clone(), self.noise.to_bits(), self.estimator.clone())
    }
}

/// A row that belongs to one estimator on one set at one noise level. Rows hold the key as columns rather than as a
/// [`SetKey`], since the order of columns is part of the file format and other columns lie between those of the key.
pub trait Keyed {
    /// The key in the columns `group`, `whisker`, `estimator` and `noise`.
    fn key(&self) -> SetKey;
}

/// Takes the key of rows from the fields of the same names.
macro_rules! keyed_by_fields {
    ($($row:ty),+) => {
        $(impl Keyed for $row {
            fn key(&self) -> SetKey {
                SetKey {
                    set: SetName { group: self.group.clone(), whisker: self.whisker.clone() },
                    estimator: self.estimator.clone(),
                    noise: self.noise,
                }
            }
        })+
    };
}

keyed_by_fields!(TrialHead, SummaryHead, ErrorBandRow, ConsistencyRow, ContourScoreRow, ContourTrialRow);
