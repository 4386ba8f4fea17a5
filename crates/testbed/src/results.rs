//! The files of a run under `results/<run>/`: the only thing that report and readers know of an evaluation.
//!
//! ```text
//! run.json                              watermark, settings, inputs
//! trials.csv                            [`TrialRow`], one a trace, estimator, noise level and seed
//! summary.csv                           [`SummaryRow`], one a group, whisker, estimator and noise level
//! failures.csv                          [`FailureRow`], one a trial that could not be scored or that an estimator failed on
//! error_over_time.csv                   [`ErrorBandRow`], spread of the error over trials against time since the touch
//! consistency.csv                       [`ConsistencyRow`], NEES, NIS and bound over trials against time since the touch
//! estimates/<trace>.<estimator>.csv     [`EstimateRow`], one an instant, for the first noise level and seed
//! events/<trace>.<detector>.csv         [`EventRow`], one an instant, for the first noise level and seed
//! bounds/<trace>.csv                    [`BoundRow`], one an instant of contact, for the first noise level
//! contours.csv                          [`ContourScoreRow`], one a group, whisker, estimator and noise level: outlines against the true ones
//! contours/<trace>.<estimator>.csv      [`VertexRow`], the outline found, for the first noise level and seed
//! contour_trials.csv                    [`ContourTrialRow`], one a trace with an outline, estimator, noise level and seed
//! outlines/<trace>.csv                  true outline of the object, `x_m,y_m`
//! outlines/<recording>.<object>.csv     the same of each object of a recording of several whiskers
//! maps.csv                              [`MapRow`], one a recording of several whiskers, estimator, noise level and seed
//! map_objects.csv                       [`MapObjectRow`], one an object that was found in such a recording
//! maps/<recording>.<estimator>.points.csv   [`MapPointRow`], the contact points of all whiskers, for the first noise level and seed
//! maps/<recording>.<estimator>.outlines.csv [`MapVertexRow`], the outlines of the objects found, for the same
//! maps/<recording>.<estimator>.grid.csv     [`GridRow`], the cells that were seen, for the same
//! models/<whisker>_<face>.surface.csv   [`SurfaceRow`], the sensor model on a grid over its domain
//! models/<whisker>_<face>.residuals.csv [`ResidualRow`], held-out residuals of the calibration
//! sensors/<array>.<sensor>.turn.csv     [`TurnRow`], counts at rest while the sensor is turned, where the front end has a sensor
//! sensors/<array>.<sensor>.transfer.csv [`TransferRow`], counts over the rotation of the root
//! ```
//!
//! The columns of a table are the fields of its type. Trials and summary have a column for each of [`METRICS`] after those
//! ([`ScoreRow`]).

use std::fs;
use std::io::Write;
use std::marker::PhantomData;
use std::path::Path;

use anyhow::{Context, bail};
use csv::{IntoInnerError, ReaderBuilder, StringRecord, Writer, WriterBuilder};
use files::AtomicFile;
use serde::de::{DeserializeOwned, Error as _, Visitor, value};
use serde::{Deserialize, Deserializer, Serialize, forward_to_deserialize_any};
use strict_json::shown;
use trace::{FrontEndFile, is_plain_name};
use whisker::Whisker;
use whisker::estimators::MethodClass;
use whisker::events::TouchConfig;

use crate::encoders::Encoders;
use crate::map::MapConfig;
use crate::metrics::{METRICS, Metric, Scores};

/// A row whose first columns are the fields of `Head` and whose others are the metrics, in the order of [`METRICS`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScoreRow<Head> {
    /// What was scored.
    pub head: Head,
    /// Its metrics.
    pub scores: Scores,
}

/// Scores of one estimator on one trial.
pub type TrialRow = ScoreRow<TrialHead>;

/// Scores of one estimator over all trials of one group with one whisker at one noise level, put together as each metric says.
pub type SummaryRow = ScoreRow<SummaryHead>;

/// What a row of `trials.csv` is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialHead {
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
    /// Standard deviation of the measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Instant of the true first touch.
    pub touch_s: f64,
    /// Samples in contact, start-up apart.
    pub samples: usize,
    /// Of those, samples without an estimate.
    pub missing: usize,
    /// Of an estimator that weighs models against one another: their mean probabilities over the contact, as `sliding=0.970 ekf=0.030`.
    pub models: Option<String>,
}

/// What a row of `summary.csv` is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SummaryHead {
    /// Group of the trials.
    pub group: String,
    /// Whisker of the trials.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Number of trials, each counted once for every noise seed.
    pub trials: usize,
    /// Mean wall-clock time of one estimator step.
    pub step_ns: f64,
    /// Of an estimator that weighs models against one another: their mean probabilities over the trials.
    pub models: Option<String>,
    /// What the readings, or of an estimator with hindsight the errors, say of its model: whether it is sure of itself as it should be.
    pub verdict: Option<String>,
}

impl<Head> ScoreRow<Head> {
    /// The value of one metric.
    pub fn get(&self, metric: &Metric) -> Option<f64> {
        self.scores.get(metric)
    }
}

/// A trial that could not be scored, or on which one estimator failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureRow {
    /// Name of the trace.
    pub trace: String,
    /// Name of the estimator that failed; without one the trial could not be scored at all.
    pub estimator: Option<String>,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Why.
    pub reason: String,
}

/// Spread of the contact error over the trials of a set at one time since the touch.
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
    /// Trials that have an estimate at that time.
    pub trials: usize,
    /// 10th percentile of the error.
    pub p10_m: f64,
    /// Median of the error.
    pub median_m: f64,
    /// 90th percentile of the error.
    pub p90_m: f64,
}

/// Consistency over the trials of a set at one time since the touch, beside the physical limit. Averages come with the interval that holds 95 % of those of a
/// consistent estimator; they are absent where no trial states what they are made of.
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
    /// Trials that have an estimate at that time.
    pub trials: usize,
    /// Root mean square error over those trials.
    pub rmse_m: f64,
    /// Root mean square over those trials of the posterior Cramer-Rao bound.
    pub bound_m: Option<f64>,
    /// Average normalised estimation error squared.
    pub anees: Option<f64>,
    /// Lower end of its interval.
    pub anees_low: Option<f64>,
    /// Upper end of its interval.
    pub anees_high: Option<f64>,
    /// Average normalised innovation squared.
    pub anis: Option<f64>,
    /// Lower end of its interval.
    pub anis_low: Option<f64>,
    /// Upper end of its interval.
    pub anis_high: Option<f64>,
    /// Median condition number of the information of the last half second.
    pub condition: Option<f64>,
}

/// What the readings of a trace tell at one instant of contact, whatever the estimator. See [`crate::bound`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoundRow {
    /// Time since the start of the trace.
    pub t_s: f64,
    /// Posterior Cramer-Rao bound of the root mean square error.
    pub bound_m: f64,
    /// The same from the readings of the last half second alone; absent where they tell of one direction at most.
    pub window_m: Option<f64>,
    /// Condition number of the information of that window.
    pub condition: Option<f64>,
}

/// One instant of one replayed trial: what the robot knew, what the estimator said and what was true. Points in World.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimateRow {
    /// Time since the start of the trace.
    pub t_s: f64,
    /// Position of the base.
    pub base_x_m: f64,
    /// Position of the base.
    pub base_y_m: f64,
    /// Yaw of the base.
    pub base_yaw_rad: f64,
    /// Reading with measurement noise, as the estimator saw it.
    pub reading_n_m: f64,
    /// Estimated contact.
    pub contact_x_m: Option<f64>,
    /// Estimated contact.
    pub contact_y_m: Option<f64>,
    /// Estimated point of the object's surface.
    pub surface_x_m: Option<f64>,
    /// Estimated point of the object's surface.
    pub surface_y_m: Option<f64>,
    /// Covariance of the contact.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the contact.
    pub cov_xy_m2: Option<f64>,
    /// Covariance of the contact.
    pub cov_yy_m2: Option<f64>,
    /// Whether the sensor model could predict the reading at the estimated contact.
    pub calibrated: Option<bool>,
    /// Whether the estimated contact may lie at the tip.
    pub at_tip: Option<bool>,
    /// Estimated radius of the object where it is touched.
    pub radius_m: Option<f64>,
    /// Its standard deviation.
    pub radius_sd_m: Option<f64>,
    /// Probabilities of rival models, the most probable first, as `sliding=0.970 ekf=0.030`.
    pub models: Option<String>,
    /// True contact.
    pub truth_contact_x_m: Option<f64>,
    /// True contact.
    pub truth_contact_y_m: Option<f64>,
    /// True point of the object's surface.
    pub truth_surface_x_m: Option<f64>,
    /// True point of the object's surface.
    pub truth_surface_y_m: Option<f64>,
}

impl EstimateRow {
    /// Distance of the estimated from the true contact.
    pub fn contact_error_m(&self) -> Option<f64> {
        let (dx_m, dy_m) = (self.contact_x_m? - self.truth_contact_x_m?, self.contact_y_m? - self.truth_contact_y_m?);
        Some(dx_m.hypot(dy_m))
    }
}

/// What a detector of contacts saw and concluded at one instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventRow {
    /// Time since the start of the recording.
    pub t_s: f64,
    /// The reading.
    pub reading_n_m: f64,
    /// The filtered reading that it judges.
    pub watched_n_m: f64,
    /// The threshold that it holds its absolute value against.
    pub threshold_n_m: f64,
    /// Whether it takes the whisker to touch.
    pub touched: bool,
    /// Whether the whisker touches, where known.
    pub truth_touching: Option<bool>,
}

/// The outlines that an estimator made of the objects of one group with one whisker at one noise level, against the true ones. Errors are medians over
/// trials, to which a trial without a value is worse than any; a field is empty where that lacks, or nothing is known of the truth.
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
    /// Largest of those distances and of those of the touched part of the true outline from the one found.
    pub hausdorff_m: Option<f64>,
    /// Share of the outline whose 95 % band holds the true one, mean over trials.
    pub band_coverage: Option<f64>,
}

/// One vertex of the outline that an estimator found, counter-clockwise around the object. In World.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VertexRow {
    /// Place.
    pub x_m: f64,
    /// Place.
    pub y_m: f64,
    /// Direction of the outward normal.
    pub normal_rad: f64,
    /// Covariance of the place; the 95 % band is the envelope of the ellipses of 1.96 standard deviations.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the place.
    pub cov_xy_m2: Option<f64>,
    /// Covariance of the place.
    pub cov_yy_m2: Option<f64>,
    /// Whether it was touched; where not, the outline is bridged.
    pub touched: bool,
}

/// The outline that an estimator found in one trial: how far it lies from the true one where that is known, and the circle through it where the object is
/// round.
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
    /// Mean distance of the outline from the true one.
    pub mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub p95_m: Option<f64>,
    /// Largest of those distances and of those of the touched part of the true outline from the one found.
    pub hausdorff_m: Option<f64>,
    /// Share of the outline whose 95 % band holds the true one.
    pub band_coverage: Option<f64>,
    /// Middle of the circle, in World.
    pub center_x_m: Option<f64>,
    /// Middle of the circle, in World.
    pub center_y_m: Option<f64>,
    /// Radius of the circle.
    pub radius_m: Option<f64>,
    /// Lower end of its 95 % interval.
    pub radius_low_m: Option<f64>,
    /// Upper end; nothing where a straight line is within the interval.
    pub radius_high_m: Option<f64>,
    /// Root mean square distance of the outline's vertices from the circle.
    pub residual_rms_m: Option<f64>,
}

/// What stands for the shape of the object in a trace of a recording among several objects.
pub const SEVERAL: &str = "several";

/// The shape of a pin, which is touched in one place.
pub const PIN: &str = "pin";

/// Whether an object of this shape has an outline worth tracing by one whisker: a pin has none, and several objects have one each, of which the map tells.
pub fn has_outline(object: &str) -> bool {
    object != PIN && object != SEVERAL
}

/// Whether an object of this shape shows a circle where it is touched. By its name, not by its outline: that of a recorded object may not be known, or be that
/// of a half ring whose back nobody touches.
pub fn is_round(object: &str) -> bool {
    object == "circle" || object.contains("cylinder")
}

/// The map that an estimator made of a recording of several whiskers, beside the truth. Nothing is aligned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapRow {
    /// Name of the recording; with that of the encoders, where they are not perfect.
    pub recording: String,
    /// Group of its traces.
    pub group: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Number of whiskers.
    pub whiskers: usize,
    /// Contact points of all whiskers that the estimator is sure of.
    pub points: usize,
    /// Their number over that of the rows in which a whisker truly touches in one place.
    pub points_share: Option<f64>,
    /// Mean distance of the points from the nearest true outline.
    pub points_mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub points_p95_m: Option<f64>,
    /// True objects that were touched.
    pub objects_touched: usize,
    /// Objects found.
    pub objects_found: usize,
    /// Of these, those beyond the first of each true object.
    pub objects_split: usize,
    /// Of these, those with points of several true objects.
    pub objects_merged: usize,
}

/// One object of a map, beside the true one whose outline is nearest to its points. Nothing is aligned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapObjectRow {
    /// Name of the recording; with that of the encoders, where they are not perfect.
    pub recording: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Number of the object in the map, from 1: the most often touched first.
    pub object: usize,
    /// Whiskers that touched it.
    pub whiskers: usize,
    /// Its contact points.
    pub points: usize,
    /// Name of the true object.
    pub matched: Option<String>,
    /// How far the true object was displaced at most, wherever on it.
    pub moved_m: Option<f64>,
    /// Mean distance of its points from the true outline.
    pub points_mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub points_p95_m: Option<f64>,
    /// Mean distance of its outline from the true one.
    pub outline_mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub outline_p95_m: Option<f64>,
    /// Largest of those distances and of those of the touched part of the true outline from the one found.
    pub outline_hausdorff_m: Option<f64>,
    /// Share of the outline whose 95 % band holds the true one.
    pub band_coverage: Option<f64>,
    /// Middle of the circle through the outline, where that is round by the data; in World.
    pub center_x_m: Option<f64>,
    /// Middle of the circle.
    pub center_y_m: Option<f64>,
    /// Radius of the circle.
    pub radius_m: Option<f64>,
    /// Lower end of its 95 % interval.
    pub radius_low_m: Option<f64>,
    /// Upper end.
    pub radius_high_m: Option<f64>,
    /// Root mean square distance of the outline's vertices from the circle.
    pub residual_rms_m: Option<f64>,
    /// Radius found less the true one, where the true outline is round, too.
    pub radius_error_m: Option<f64>,
    /// Distance of the middle from the true one.
    pub center_error_m: Option<f64>,
}

/// One contact point of a map, in World.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapPointRow {
    /// Time since the start.
    pub t_s: f64,
    /// Name of the whisker in the recording.
    pub whisker: String,
    /// Array that it belongs to.
    pub array: String,
    /// Number of the object that the point was told to be of; none where its touch was too short.
    pub object: Option<usize>,
    /// Place on the surface.
    pub x_m: f64,
    /// Place on the surface.
    pub y_m: f64,
    /// Direction of the outward normal.
    pub normal_rad: f64,
    /// Covariance of the place.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the place.
    pub cov_xy_m2: Option<f64>,
    /// Covariance of the place.
    pub cov_yy_m2: Option<f64>,
}

/// One vertex of an outline of a map, as [`VertexRow`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapVertexRow {
    /// Number of the object in the map.
    pub object: usize,
    /// Place.
    pub x_m: f64,
    /// Place.
    pub y_m: f64,
    /// Direction of the outward normal.
    pub normal_rad: f64,
    /// Covariance of the place; the 95 % band is the envelope of the ellipses of 1.96 standard deviations.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the place.
    pub cov_xy_m2: Option<f64>,
    /// Covariance of the place.
    pub cov_yy_m2: Option<f64>,
    /// Whether it was touched; where not, the outline is bridged.
    pub touched: bool,
}

impl MapVertexRow {
    /// A vertex of the object with this number.
    pub fn new(object: usize, vertex: VertexRow) -> Self {
        let VertexRow { x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched } = vertex;
        Self { object, x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched }
    }

    /// The vertex without its object.
    pub fn vertex(&self) -> VertexRow {
        let &Self { x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched, .. } = self;
        VertexRow { x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched }
    }
}

/// One cell of the occupancy grid that was seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridRow {
    /// Middle of the cell.
    pub x_m: f64,
    /// Middle of the cell.
    pub y_m: f64,
    /// Scans in which a wire lay in it.
    pub swept: u32,
    /// Scans in which a contact did.
    pub touched: u32,
    /// Probability that there is an object.
    pub occupied: f64,
}

/// The sensor model at one node of a grid over its domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceRow {
    /// Arc length of the nearest point of the undeflected whisker.
    pub arc_m: f64,
    /// Distance from the undeflected whisker, positive away from the object.
    pub distance_m: f64,
    /// Contact in Base.
    pub x_m: f64,
    /// Contact in Base.
    pub y_m: f64,
    /// Expected reading.
    pub reading_n_m: f64,
}

/// Residual of one calibration sample under the model fitted to the other traces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualRow {
    /// Name of the calibration trace.
    pub trace: String,
    /// Contact in Base.
    pub x_m: f64,
    /// Contact in Base.
    pub y_m: f64,
    /// Reading without measurement noise.
    pub reading_n_m: f64,
    /// Predicted less true reading.
    pub residual_n_m: f64,
}

/// Counts of a resting sensor while it is turned by half a circle and back, from zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TurnRow {
    /// Time since the start.
    pub t_s: f64,
    /// Yaw of the base since the start.
    pub yaw_rad: f64,
    /// Counts of the axis that is read.
    pub counts: f64,
    /// The same with the common mode taken out.
    pub compensated_counts: f64,
}

/// Counts of a sensor at one rotation of the root, without noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferRow {
    /// Gain over that of the sensor as it is.
    pub amplified: f64,
    /// Rotation of the root against the base.
    pub rotation_rad: f64,
    /// Counts of the axis along the root.
    pub x_counts: f64,
    /// Counts of the axis across it in the plane: the one that is read.
    pub y_counts: f64,
    /// Counts of the axis out of the plane.
    pub z_counts: f64,
}

/// `run.json`: what was run, on what, by what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Version of the format, 1.
    pub format: u32,
    /// `"run"`.
    pub kind: String,
    /// Name of the run.
    pub name: String,
    /// What wrote the run.
    pub watermark: files::Watermark,
    /// Noise levels, as fractions of each set's largest reading.
    pub noise: Vec<f64>,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// The front end through which the trials were read, with its settings and what calibration taught of its sensors.
    pub front_end: FrontEndFile,
    /// Settings of the touch detection.
    pub touch: TouchConfig,
    /// Estimators with their settings.
    pub estimators: Vec<RunEstimator>,
    /// Sets of trials: one a group and whisker.
    pub sets: Vec<RunSet>,
    /// Calibrations used.
    pub calibrations: Vec<RunCalibration>,
    /// The whiskers, by which the report draws them bent.
    pub whiskers: Vec<Whisker>,
    /// Recordings of several whiskers among the traces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recordings: Vec<RunRecording>,
}

/// A recording of several whiskers, as it was replayed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunRecording {
    /// Its name; with that of the encoders, where they are not perfect.
    pub name: String,
    /// Group of its traces.
    pub group: String,
    /// Encoders of the arm's joints.
    pub encoders: Encoders,
    /// Settings of the map.
    pub map: MapConfig,
    /// Names of the objects, whose true outlines are `outlines/<name>.<object>.csv`.
    pub objects: Vec<String>,
    /// The whiskers.
    pub whiskers: Vec<RunMounted>,
}

/// A whisker of a recording of several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunMounted {
    /// Its name.
    pub name: String,
    /// The array that it belongs to.
    pub array: String,
    /// Name of its trace in the run.
    pub trace: String,
}

impl Run {
    /// Reads and checks `run.json`.
    ///
    /// # Errors
    /// If it is missing, does not parse, or is not the description of a run.
    pub fn read(path: &Path) -> Result<Self, files::Error> {
        let run: Self = files::read_json(path)?;
        if run.format != files::FORMAT {
            return Err(files::Error::value(path, "format", run.format, files::FORMAT));
        }
        if run.kind != "run" {
            return Err(files::Error::value(path, "kind", &run.kind, "run"));
        }
        for (key, is_empty) in [("noise", run.noise.is_empty()), ("estimators", run.estimators.is_empty())] {
            if is_empty {
                return Err(files::Error::value(path, key, "an empty list", "at least one entry"));
            }
        }
        for (key, name) in run.names() {
            if !is_plain_name(name) {
                return Err(files::Error::value(path, key, format!("`{name}`"), "a plain file name"));
            }
        }
        Ok(run)
    }

    /// The names of which those of files are made, each with its key.
    fn names(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let estimators = self.estimators.iter().map(|estimator| ("estimators.name", &estimator.name));
        let sets = self.sets.iter().flat_map(|set| {
            let own = [("sets.group", &set.group), ("sets.whisker", &set.whisker)];
            own.into_iter().chain(set.traces.iter().map(|trace| ("sets.traces", trace)))
        });
        let calibrations = self.calibrations.iter().flat_map(|calibration| {
            [("calibrations.whisker", &calibration.whisker), ("calibrations.face", &calibration.face)]
        });
        let sensors =
            self.front_end.sensors.iter().flat_map(|sensor| {
                [("front_end.sensors.name", &sensor.name), ("front_end.sensors.array", &sensor.array)]
            });
        let recordings = self.recordings.iter().flat_map(|recording| {
            let objects = recording.objects.iter().map(|object| ("recordings.objects", object));
            std::iter::once(("recordings.name", &recording.name)).chain(objects)
        });
        let named = estimators.chain(sets).chain(calibrations).chain(sensors).chain(recordings);
        named.map(|(key, name)| (key, name.as_str()))
    }
}

/// The estimator that the documentation recommends.
pub const RECOMMENDED: &str = "recommended";

/// One estimator of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunEstimator {
    /// Name in the registry.
    pub name: String,
    /// One line about it.
    pub about: String,
    /// What it may know of a recording, and what it is there for.
    #[serde(rename = "kind")]
    pub class: MethodClass,
    /// Label of the sensor model that it insists on; without one it takes the calibration's choice.
    pub sensor_model: Option<String>,
    /// Its settings.
    pub config: serde_json::Value,
}

impl RunEstimator {
    /// Its name for people. What hindsight knows, no other estimator can know: it says so wherever both stand side by side.
    pub fn label(&self) -> String {
        match self.class {
            MethodClass::Recursive | MethodClass::Published | MethodClass::Baseline => self.name.clone(),
            MethodClass::Hindsight => format!("{} (hindsight)", self.name),
        }
    }

    /// Whether it is a program of other people rather than one of the registry.
    pub fn is_program(&self) -> bool {
        self.config.get("command").is_some()
    }
}

/// Trials that are scored together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunSet {
    /// Group.
    pub group: String,
    /// Whisker.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Names of the traces.
    pub traces: Vec<String>,
    /// Largest absolute reading of the set without noise; noise is a fraction of it.
    pub largest_reading_n_m: f64,
}

/// One calibration of a run and how well it fits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCalibration {
    /// Whisker.
    pub whisker: String,
    /// Face.
    pub face: String,
    /// One line about the sensor model.
    pub model: String,
    /// Hash of the calibration file.
    pub sha256: String,
    /// Root mean square residual on held-out traces.
    pub heldout_rms_n_m: f64,
    /// Largest residual on held-out traces.
    pub heldout_worst_n_m: f64,
    /// Largest absolute reading of the calibration.
    pub largest_reading_n_m: f64,
}

/// Rows as the bytes of a CSV with a header, which stands there even without rows.
///
/// # Errors
/// If a row does not serialise.
pub fn csv_bytes<Row: Serialize + DeserializeOwned>(rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    table_bytes(columns::<Row>(), rows.iter())
}

/// Rows of scores as the bytes of a CSV with a header.
///
/// # Errors
/// If a row does not serialise.
pub fn score_bytes<Head: Serialize + DeserializeOwned>(rows: &[ScoreRow<Head>]) -> anyhow::Result<Vec<u8>> {
    table_bytes(&score_columns::<Head>(), rows.iter().map(|row| (&row.head, row.scores.values())))
}

fn table_bytes(columns: &[&str], rows: impl Iterator<Item: Serialize>) -> anyhow::Result<Vec<u8>> {
    let mut writer = WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    writer.write_record(columns)?;
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner()?)
}

/// A table that is written row by row, with the bytes of [`csv_bytes`] or [`score_bytes`].
pub struct Table<Row, To: Write> {
    writer: Writer<To>,
    rows: PhantomData<Row>,
}

/// A table in a file, which is there when it is finished.
pub type TableFile<Row> = Table<Row, AtomicFile>;

impl<Row: Serialize + DeserializeOwned, To: Write> Table<Row, To> {
    /// Begins a table of such rows.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn new(to: To) -> anyhow::Result<Self> {
        Self::with_columns(to, columns::<Row>())
    }

    /// Takes the next row.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn push(&mut self, row: &Row) -> anyhow::Result<()> {
        self.writer.serialize(row).map_err(refusal)
    }
}

impl<Head: Serialize + DeserializeOwned, To: Write> Table<ScoreRow<Head>, To> {
    /// Begins a table of scores.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn of_scores(to: To) -> anyhow::Result<Self> {
        Self::with_columns(to, &score_columns::<Head>())
    }

    /// Takes the next row of scores.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn push_scores(&mut self, row: &ScoreRow<Head>) -> anyhow::Result<()> {
        self.writer.serialize((&row.head, row.scores.values())).map_err(refusal)
    }
}

impl<Row, To: Write> Table<Row, To> {
    fn with_columns(to: To, columns: &[&str]) -> anyhow::Result<Self> {
        let mut writer = WriterBuilder::new().has_headers(false).from_writer(to);
        writer.write_record(columns).map_err(refusal)?;
        Ok(Self { writer, rows: PhantomData })
    }

    /// Ends the table; gives back what it was written to.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> anyhow::Result<To> {
        Ok(self.writer.into_inner().map_err(IntoInnerError::into_error)?)
    }
}

/// Why a table was not written: the system's own answer, where it was the system that refused.
fn refusal(error: csv::Error) -> anyhow::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error.into(),
        other => anyhow::anyhow!("{other:?}"),
    }
}

/// Names of the columns of a table of scores.
fn score_columns<Head: DeserializeOwned>() -> Vec<&'static str> {
    columns::<Head>().iter().copied().chain(METRICS.iter().map(|metric| metric.name)).collect()
}

/// Reads a table whose columns are the fields of `T`.
///
/// # Errors
/// If the file cannot be read; for a damaged one, file, line and column, what was found and what was expected.
pub fn read_rows<T: DeserializeOwned>(path: &Path) -> anyhow::Result<Vec<T>> {
    read_table(path, parse_row)
}

/// Reads a table of scores.
///
/// # Errors
/// As [`read_rows`], and if it has other columns than this program's metrics.
pub fn read_scores<Head: DeserializeOwned>(path: &Path) -> anyhow::Result<Vec<ScoreRow<Head>>> {
    read_table(path, parse_scores)
}

fn read_table<T>(
    path: &Path,
    parse: impl Fn(&StringRecord, &StringRecord) -> Result<T, String>,
) -> anyhow::Result<Vec<T>> {
    let at = path.display();
    let bytes = fs::read(path).with_context(|| format!("{at}: cannot be read"))?;
    if let Some(line) = stray_quote(&bytes) {
        bail!("{at}:{line}: found more after the quote that ends a field, expected a comma or the end of the line");
    }
    let mut reader = ReaderBuilder::new().from_reader(bytes.as_slice());
    let header = reader.headers().with_context(|| format!("{at}:1: cannot be read"))?.clone();
    let mut rows = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let record = record.with_context(|| format!("{at}: row {}", index + 1))?;
        let line = record.position().map_or(0, csv::Position::line);
        for (place, (column, field)) in header.iter().zip(&record).enumerate() {
            if field.parse::<f64>().is_ok_and(|value| !value.is_finite())
                && !takes_words(place, &record, &header, &parse)
            {
                bail!("{at}:{line}: column `{}`: found {field}, expected a finite number", shown(column));
            }
        }
        rows.push(parse(&record, &header).map_err(|problem| anyhow::anyhow!("{at}:{line}: {}", shown(&problem)))?);
    }
    Ok(rows)
}

/// The line of a quoted field after whose closing quote there is more: the parser would add that to the field, and read `"1"5` as 15.
fn stray_quote(bytes: &[u8]) -> Option<u64> {
    let mut line = 1;
    let mut is_quoted = false;
    let mut last = b'\n';
    for (i, &byte) in bytes.iter().enumerate() {
        let next = bytes.get(i + 1).copied().unwrap_or(b'\n');
        match byte {
            // A pair of quotes within a quoted field, which stands for one, closes and opens it.
            b'"' if is_quoted => {
                is_quoted = false;
                if !matches!(next, b'"' | b',' | b'\r' | b'\n') {
                    return Some(line);
                }
            }
            b'"' => is_quoted = matches!(last, b'"' | b',' | b'\r' | b'\n'),
            b'\n' => line += 1,
            _ => {}
        }
        last = byte;
    }
    None
}

/// Whether a column holds words, of which `nan` and `inf` may be some: then the row can be read with any other word there.
fn takes_words<T>(
    place: usize,
    record: &StringRecord,
    header: &StringRecord,
    parse: impl Fn(&StringRecord, &StringRecord) -> Result<T, String>,
) -> bool {
    let other: StringRecord =
        record.iter().enumerate().map(|(i, field)| if i == place { "a word" } else { field }).collect();
    parse(&other, header).is_ok()
}

/// Parses a row of scores, or says in which column what was found.
fn parse_scores<Head: DeserializeOwned>(
    record: &StringRecord,
    header: &StringRecord,
) -> Result<ScoreRow<Head>, String> {
    let expected = score_columns::<Head>();
    for place in 0..expected.len().max(header.len()) {
        let name = |name: Option<&str>| name.map_or("no more columns".into(), |name| format!("`{name}`"));
        let (found, expected) = (name(header.get(place)), name(expected.get(place).copied()));
        if found != expected {
            let place = place + 1;
            return Err(format!(
                "column {place}: found {found}, expected {expected}; evaluate again with this version"
            ));
        }
    }
    let metrics = |row: &StringRecord| row.iter().skip(expected.len() - METRICS.len()).collect::<StringRecord>();
    let values: Vec<Option<f64>> = parse_row(&metrics(record), &metrics(header))?;
    let mut values = values.into_iter();
    Ok(ScoreRow { head: parse_row(record, header)?, scores: Scores::from_fn(|_| values.next().flatten()) })
}

/// Parses a row, or says in which column what was found.
fn parse_row<T: DeserializeOwned>(record: &StringRecord, header: &StringRecord) -> Result<T, String> {
    record.deserialize(Some(header)).map_err(|error| {
        let csv::ErrorKind::Deserialize { err, .. } = error.kind() else {
            return error.to_string();
        };
        match err.field().and_then(|field| usize::try_from(field).ok()) {
            Some(field) => format!(
                "column `{}`: found `{}`, expected another kind of value: {}",
                header.get(field).unwrap_or_default(),
                record.get(field).unwrap_or_default(),
                err.kind()
            ),
            None => err.kind().to_string(),
        }
    })
}

/// Names of the fields of a type that reads as a struct, in their order: what it asks a deserializer for.
fn columns<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut names: &'static [&'static str] = &[];
    // The type gets no values: that its deserialization fails is how it ends.
    _ = T::deserialize(FieldNames(&mut names));
    names
}

/// A deserializer that holds nothing and keeps the names it is asked for.
struct FieldNames<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for FieldNames<'_> {
    type Error = value::Error;

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        names: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, value::Error> {
        *self.0 = names;
        self.deserialize_any(visitor)
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, value::Error> {
        Err(value::Error::custom("holds nothing"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> SummaryRow {
        let head = SummaryHead {
            group: "pin".into(),
            whisker: "straight".into(),
            object: "pin".into(),
            estimator: "ekf".into(),
            noise: 0.01,
            trials: 50,
            step_ns: 500.0,
            models: None,
            verdict: None,
        };
        let mut next = 0.0;
        let scores = Scores::from_fn(|_| {
            next += 0.5;
            (next != 1.5).then_some(next)
        });
        ScoreRow { head, scores }
    }

    fn read(bytes: &[u8]) -> anyhow::Result<Vec<SummaryRow>> {
        let file = tempfile::NamedTempFile::new()?;
        std::fs::write(file.path(), bytes)?;
        read_scores(file.path())
    }

    #[test]
    fn verif_scores_read_back_as_they_were_written() {
        let bytes = score_bytes(&[row(), row()]).unwrap();
        assert!(
            bytes.starts_with(b"group,whisker,object,estimator,noise,trials,step_ns,models,verdict,rmse_m,median_m,")
        );
        assert_eq!(read(&bytes).unwrap(), [row(), row()]);
        assert_eq!(csv_bytes::<FailureRow>(&[]).unwrap(), b"trace,estimator,noise,seed,reason\n");
    }

    #[test]
    fn robust_other_metrics_and_damaged_scores_are_named() {
        let text = String::from_utf8(score_bytes(&[row()]).unwrap()).unwrap();
        for (from, to, expected) in [
            ("rmse_m", "rmse_mm", "column 10: found `rmse_mm`, expected `rmse_m`"),
            (",rmse_m,median_m", ",median_m,rmse_m", "column 10: found `median_m`, expected `rmse_m`"),
            ("500.0,,,0.5", "500.0,,,half", "column `rmse_m`: found `half`"),
            (",50,", ",many,", "column `trials`: found `many`"),
        ] {
            let message = read(text.replacen(from, to, 1).as_bytes()).expect_err(expected).to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
