//! Estimated outlines and their distance from the true ones.

use serde::{Deserialize, Serialize};

/// Outlines found on the trials of one set by one estimator at one noise level, compared with the true ones. Errors are
/// medians over trials, in which a trial without a value counts as worse than any other. A field is `None` if the
/// median is not defined or the truth is unknown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContourScoreRow {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Number of trials, each counted once for every noise seed.
    pub trials: usize,
    /// Root mean square contact error after the first second of contact.
    pub contact_rmse_m: Option<f64>,
    /// Mean distance of the outline from the true one.
    pub mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub p95_m: Option<f64>,
    /// Hausdorff distance between the outline and the touched part of the true one.
    pub hausdorff_m: Option<f64>,
    /// Share of the outline whose 95 % band contains the true one, mean over trials.
    pub band_coverage: Option<f64>,
}

/// One vertex of an outline found, counter-clockwise around the object, in World.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VertexRow {
    /// Position, x.
    pub x_m: f64,
    /// Position, y.
    pub y_m: f64,
    /// Direction of the outward normal.
    pub normal_rad: f64,
    /// Variance of the position along x; the 95 % band is the envelope of the ellipses of 1.96 standard deviations.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the position between x and y.
    pub cov_xy_m2: Option<f64>,
    /// Variance of the position along y.
    pub cov_yy_m2: Option<f64>,
    /// Whether the vertex was touched; otherwise it bridges two touched stretches.
    pub touched: bool,
}

/// Outline found by an estimator in one trial: its distance from the true outline if that is known, and the circle
/// through it if the object is round.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContourTrialRow {
    /// Name of the trace.
    pub trace: String,
    /// Group of the trace.
    pub group: String,
    /// Whisker of the trace.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Root mean square contact error after the first second of contact.
    pub contact_rmse_m: Option<f64>,
    /// Length of the touched part of the outline found. Runs of earlier versions have none.
    pub length_m: Option<f64>,
    /// Mean distance of the outline from the true one.
    pub mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub p95_m: Option<f64>,
    /// Hausdorff distance between the outline and the touched part of the true one.
    pub hausdorff_m: Option<f64>,
    /// Share of the outline whose 95 % band contains the true one.
    pub band_coverage: Option<f64>,
    /// Centre of the circle in World, x.
    pub center_x_m: Option<f64>,
    /// Centre of the circle in World, y.
    pub center_y_m: Option<f64>,
    /// Radius of the circle.
    pub radius_m: Option<f64>,
    /// Lower end of the 95 % interval of the radius.
    pub radius_low_m: Option<f64>,
    /// Upper end of that interval. `None` if the interval includes a straight line.
    pub radius_high_m: Option<f64>,
    /// Root mean square distance of the outline's vertices from the circle.
    pub residual_rms_m: Option<f64>,
}
