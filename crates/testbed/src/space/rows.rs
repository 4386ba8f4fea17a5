//! Rows of the tables of a run in space.

use serde::{Deserialize, Serialize};

/// Scores of one replay. Errors are those after [`START_S`](super::trial::START_S) of each touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpatialTrialRow {
    /// Name of the trace.
    pub trace: String,
    /// Group of the trace.
    pub group: String,
    /// Name of the whisker.
    pub whisker: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Seed of the noise.
    pub seed: u64,
    /// Standard deviation of the noise of each moment.
    pub noise_sd_n_m: f64,
    /// Share of the instants with an expected estimate that have one. An estimate is expected if the true contact lies in the
    /// calibrated domain, not at the tip and not at several places. `None` if there is no such instant.
    pub answered: Option<f64>,
    /// RMS error of the contact, over all instants with an estimate.
    pub rmse_m: Option<f64>,
    /// RMS error out of the plane of wire and force at the contact.
    pub out_of_plane_m: Option<f64>,
    /// RMS of the posterior Cramér–Rao bound with known sliding.
    pub bound_m: Option<f64>,
    /// RMS of the bound of a contact with an unknown object over all instants that are scored, also those without an estimate.
    /// `None` if the object is no rod, cylinder, edge or sphere.
    pub object_bound_m: Option<f64>,
    /// Normalised squared error of the last estimate, which has three degrees of freedom.
    pub nees: Option<f64>,
    /// Share of the instants at which the 95 % ellipsoid contains the true contact.
    pub coverage: Option<f64>,
    /// Share of the estimates in the first [`START_S`](super::trial::START_S) seconds of each touch whose 95 % ellipsoid contains
    /// the true contact.
    #[serde(default)]
    pub early_coverage: Option<f64>,
    /// Mean distance of the estimated points of the surface from the true solid. `None` for meshes.
    pub surface_m: Option<f64>,
    /// RMS angle between estimated and true normal.
    pub normal_rad: Option<f64>,
    /// RMS angle between the estimated and the true direction of the edge or rod. `None` for other objects and methods.
    pub direction_rad: Option<f64>,
    /// RMS of the bound of this angle with an unknown object.
    pub direction_bound_rad: Option<f64>,
    /// Error of the last stated radius relative to the true one, positive if it is too large. `None` unless the solid is a sphere
    /// or a cylinder.
    pub radius_error: Option<f64>,
    /// Bound of that error with an unknown object, at the instant of the radius.
    pub radius_bound: Option<f64>,
    /// Whether the 95 % interval of that radius contains the true one: 1 or 0.
    pub radius_coverage: Option<f64>,
    /// Mean distance of the estimated points of the surface from the touched edge of a box, over the instants with a contact on
    /// one.
    pub edge_m: Option<f64>,
    /// The same of the touched corner of a box.
    pub corner_m: Option<f64>,
    /// Mean normalised squared error over the scored instants, which has three degrees of freedom.
    pub nees_mean: Option<f64>,
    /// Number of independent samples of that error, by its autocorrelation.
    pub nees_samples: Option<f64>,
    /// Time of contact with an estimate, from the touch on.
    pub contact_s: f64,
    /// Share of the estimates, from the touch on, at which the readings contradict the models of the method. `None` for methods
    /// that do not judge them.
    pub doubted: Option<f64>,
    /// Time from the touch until the readings first contradict the models. `None` if they never do.
    pub doubt_time_s: Option<f64>,
}

/// Scores of the trials of one group with one whisker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpatialSummaryRow {
    /// Group of the trials.
    pub group: String,
    /// Name of the whisker.
    pub whisker: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Number of replays.
    pub trials: usize,
    /// Mean over the replays of the share of expected estimates that are given.
    pub answered: Option<f64>,
    /// RMS over the replays of their RMS error.
    pub rmse_m: Option<f64>,
    /// The same of the error out of the plane of wire and force.
    pub out_of_plane_m: Option<f64>,
    /// The same of the bound with known sliding.
    pub bound_m: Option<f64>,
    /// The same of the bound with an unknown object.
    pub object_bound_m: Option<f64>,
    /// Mean normalised squared error of the last estimates, per degree of freedom: 1 if the method is consistent.
    pub nees: Option<f64>,
    /// Bounds of its central 95 % interval for a consistent method and independent replays.
    pub nees_low: f64,
    /// Upper bound of that interval.
    pub nees_high: f64,
    /// Mean coverage of the 95 % ellipsoids.
    pub coverage: Option<f64>,
    /// Mean coverage of the ellipsoids in the first [`START_S`](super::trial::START_S) seconds of each touch.
    #[serde(default)]
    pub early_coverage: Option<f64>,
    /// Mean over the replays of the distance of the surface.
    pub surface_m: Option<f64>,
    /// RMS over the replays of the angle of the normal.
    pub normal_rad: Option<f64>,
    /// The same of the angle of the edge.
    pub direction_rad: Option<f64>,
    /// The same of the bound of this angle.
    pub direction_bound_rad: Option<f64>,
    /// RMS over the replays of the relative error of the radius.
    pub radius_error: Option<f64>,
    /// RMS of the bound of the radius' relative error with an unknown object.
    pub radius_bound: Option<f64>,
    /// Share of the replays whose 95 % interval of the radius contains the true one.
    pub radius_coverage: Option<f64>,
    /// Mean over the replays of the distance from the touched edge.
    pub edge_m: Option<f64>,
    /// The same from the touched corner.
    pub corner_m: Option<f64>,
    /// Mean normalised squared error over replays and scored instants, per degree of freedom: 1 if the method is consistent.
    pub nees_mean: Option<f64>,
    /// Verdict on the method by its errors, see [`crate::consistency`]. `None` without an estimate.
    pub verdict: Option<String>,
    /// Mean over the replays of the share of estimates at which the readings contradict the models.
    pub doubted: Option<f64>,
}

/// Wall-clock times of the steps of an estimator with an estimate, in all replays: a row of `space_times.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialTimesRow {
    /// Name of the estimator.
    pub estimator: String,
    /// Number of steps.
    pub steps: usize,
    /// Mean time of a step. `None` if there is none.
    pub mean_us: Option<f64>,
    /// 99th percentile.
    pub p99_us: Option<f64>,
}

/// Map of one solid by one estimator, against the true solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialMapRow {
    /// Names of the traces of the sweeps over the solid, joined by `+`.
    pub traces: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Number of points of the surface.
    pub points: usize,
    /// Number of estimates left out of the map.
    pub left_out: usize,
    /// Number of objects found; there is one.
    pub objects: usize,
    /// Mean distance of the points from the true solid, not aligned. `None` for meshes and without points.
    pub mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub p95_m: Option<f64>,
    /// Area of the surface.
    pub surface_m2: f64,
    /// Area of its triangles whose vertices have a standard deviation of at most 0.1 mm.
    pub surface_certain_m2: f64,
    /// Mean distance of its vertices with a standard deviation of at most 0.1 mm from the true solid, not aligned. `None` if the
    /// true solid is a mesh, or without such vertices.
    pub surface_mean_m: Option<f64>,
    /// Share of all vertices whose distance is at most 1.96 standard deviations.
    pub surface_coverage: Option<f64>,
}

/// State of a voxel.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Occupancy {
    /// A whisker passed through it.
    Free,
    /// It contains a point of the surface.
    Occupied,
}

/// A voxel that was observed.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct VoxelRow {
    /// Centre in World, x.
    pub x_m: f64,
    /// Centre in World, y.
    pub y_m: f64,
    /// Centre in World, z.
    pub z_m: f64,
    /// State.
    pub state: Occupancy,
}
