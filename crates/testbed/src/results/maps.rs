//! Maps of recordings of several whiskers. Distances from the truth are taken without alignment.

use serde::{Deserialize, Serialize};

use super::contours::VertexRow;

/// Map of a recording of several whiskers by one estimator, compared with the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapRow {
    /// Name of the recording, with a suffix for the encoders if these are not perfect.
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
    /// Number of contact points of all whiskers that pass the map's thresholds.
    pub points: usize,
    /// That number relative to the rows in which a whisker truly touches in one place.
    pub points_share: Option<f64>,
    /// Mean distance of the points from the nearest true outline.
    pub points_mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub points_p95_m: Option<f64>,
    /// Number of further contact points that are left out because the models were in doubt or a second contact had taken load.
    #[serde(default)]
    pub points_left_out: usize,
    /// Number of true objects that were touched.
    pub objects_touched: usize,
    /// Number of objects found.
    pub objects_found: usize,
    /// Number of objects found beyond the first of each true object.
    pub objects_split: usize,
    /// Number of objects found with points of several true objects.
    pub objects_merged: usize,
}

/// One object of a map, compared with the true object whose outline is nearest to its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapObjectRow {
    /// Name of the recording, with a suffix for the encoders if these are not perfect.
    pub recording: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Number of the object in the map, from 1, in decreasing order of contact points.
    pub object: usize,
    /// Number of whiskers that touched it.
    pub whiskers: usize,
    /// Number of its contact points.
    pub points: usize,
    /// Name of the true object. `None` if no true object matches.
    pub matched: Option<String>,
    /// Upper bound of the displacement of any place of the true object.
    pub moved_m: Option<f64>,
    /// Mean distance of its points from the true outline.
    pub points_mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub points_p95_m: Option<f64>,
    /// Mean distance of its outline from the true one.
    pub outline_mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub outline_p95_m: Option<f64>,
    /// Hausdorff distance between its outline and the touched part of the true one.
    pub outline_hausdorff_m: Option<f64>,
    /// Share of its outline whose 95 % band contains the true one.
    pub band_coverage: Option<f64>,
    /// Centre of the circle through the outline in World, x. `None` if the outline is not round by its own data.
    pub center_x_m: Option<f64>,
    /// Centre of the circle in World, y.
    pub center_y_m: Option<f64>,
    /// Radius of the circle.
    pub radius_m: Option<f64>,
    /// Lower end of the 95 % interval of the radius.
    pub radius_low_m: Option<f64>,
    /// Upper end of that interval.
    pub radius_high_m: Option<f64>,
    /// Root mean square distance of the outline's vertices from the circle.
    pub residual_rms_m: Option<f64>,
    /// Estimated less true radius. `None` unless the true outline is round too.
    pub radius_error_m: Option<f64>,
    /// Distance between the estimated and the true centre.
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
    /// Array of the whisker.
    pub array: String,
    /// Number of the object to which the point is assigned. `None` if its touch is too short, or if it lies in front of
    /// the tangents of its object.
    pub object: Option<usize>,
    /// Point of the surface, x.
    pub x_m: f64,
    /// Point of the surface, y.
    pub y_m: f64,
    /// Direction of the outward normal.
    pub normal_rad: f64,
    /// Variance of the point along x.
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the point between x and y.
    pub cov_xy_m2: Option<f64>,
    /// Variance of the point along y.
    pub cov_yy_m2: Option<f64>,
}

/// One vertex of an outline of a map, as [`VertexRow`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapVertexRow {
    /// Number of the object in the map.
    pub object: usize,
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

impl MapVertexRow {
    /// A vertex of the object with this number.
    pub fn new(object: usize, vertex: VertexRow) -> Self {
        let VertexRow { x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched } = vertex;
        Self { object, x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched }
    }

    /// The vertex without the number of its object.
    pub fn vertex(&self) -> VertexRow {
        let &Self { x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched, .. } = self;
        VertexRow { x_m, y_m, normal_rad, cov_xx_m2, cov_xy_m2, cov_yy_m2, touched }
    }
}

/// One observed cell of the occupancy grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridRow {
    /// Centre of the cell, x.
    pub x_m: f64,
    /// Centre of the cell, y.
    pub y_m: f64,
    /// Number of scans in which a wire lay in the cell.
    pub swept: u32,
    /// Number of scans in which a contact lay in the cell.
    pub touched: u32,
    /// Posterior probability that the cell is occupied.
    pub occupied: f64,
}
