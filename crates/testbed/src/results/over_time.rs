//! Statistics over the trials of a set against time since the touch.

use serde::{Deserialize, Serialize};

/// Distribution of the contact error over the trials of a set at one time since the touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorBandRow {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Time since the true first touch.
    pub t_contact_s: f64,
    /// Number of trials with an estimate at that time.
    pub trials: usize,
    /// 10th percentile of the error.
    pub p10_m: f64,
    /// Median of the error.
    pub median_m: f64,
    /// 90th percentile of the error.
    pub p90_m: f64,
}

/// Consistency over the trials of a set at one time since the touch, with the posterior Cramér–Rao bound. Each average
/// comes with the interval that contains 95 % of the averages of a consistent estimator; it is `None` if no trial has a
/// value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConsistencyRow {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Time since the true first touch.
    pub t_contact_s: f64,
    /// Number of trials with an estimate at that time.
    pub trials: usize,
    /// Root mean square error over those trials.
    pub rmse_m: f64,
    /// Root mean square over those trials of the posterior Cramér–Rao bound.
    pub bound_m: Option<f64>,
    /// Average normalised estimation error squared.
    pub anees: Option<f64>,
    /// Lower end of the 95 % interval of `anees`.
    pub anees_low: Option<f64>,
    /// Upper end of the 95 % interval of `anees`.
    pub anees_high: Option<f64>,
    /// Average normalised innovation squared.
    pub anis: Option<f64>,
    /// Lower end of the 95 % interval of `anis`.
    pub anis_low: Option<f64>,
    /// Upper end of the 95 % interval of `anis`.
    pub anis_high: Option<f64>,
    /// Median condition number of the information matrix of the last half second.
    pub condition: Option<f64>,
}
