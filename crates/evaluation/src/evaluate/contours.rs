//! Rows of the tables of estimated outlines.

use testbed::contour::{Circle, Comparison, Contour};
use testbed::results::{ContourScoreRow, ContourTrialRow, SetKey, VertexRow};
use testbed::statistics::{mean, median_of_scores};
use trace::{ObjectClass, Sidecar};

/// Columns of `contour_trials.csv` that depend on the outline alone. `compared` is `None` if the true outline is unknown.
pub(super) fn trial_row(sidecar: &Sidecar, contour: Option<&Contour>, compared: Option<Comparison>) -> ContourTrialRow {
    let circle = contour.filter(|_| sidecar.object_class() == ObjectClass::Round).and_then(Circle::through);
    ContourTrialRow {
        trace: sidecar.name.clone(),
        group: sidecar.group.clone(),
        whisker: sidecar.whisker.name.clone(),
        object: sidecar.object.clone(),
        length_m: Some(contour.map_or(0.0, Contour::touched_length_m)),
        mean_m: compared.map(|compared| compared.mean_m),
        p95_m: compared.map(|compared| compared.p95_m),
        hausdorff_m: compared.and_then(|compared| compared.hausdorff_m),
        band_coverage: compared.and_then(|compared| compared.band_coverage),
        center_x_m: circle.map(|circle| circle.center.x()),
        center_y_m: circle.map(|circle| circle.center.y()),
        radius_m: circle.map(|circle| circle.radius_m),
        radius_low_m: circle.map(|circle| circle.low_m),
        radius_high_m: circle.and_then(|circle| circle.high_m),
        residual_rms_m: circle.map(|circle| circle.residual_rms_m),
        ..ContourTrialRow::default()
    }
}

/// Values of a trial that are combined in `contours.csv`.
#[derive(Clone, Copy)]
pub(super) struct ContourScores {
    contact_rmse_m: Option<f64>,
    mean_m: Option<f64>,
    p95_m: Option<f64>,
    hausdorff_m: Option<f64>,
    band_coverage: Option<f64>,
}

impl ContourScores {
    pub(super) fn of(trial: &ContourTrialRow) -> Self {
        Self {
            contact_rmse_m: trial.contact_rmse_m,
            mean_m: trial.mean_m,
            p95_m: trial.p95_m,
            hausdorff_m: trial.hausdorff_m,
            band_coverage: trial.band_coverage,
        }
    }
}

/// Row of `contours.csv` over all trials of a set.
pub(super) fn contour_score(key: &SetKey, trials: &[ContourScores]) -> ContourScoreRow {
    ContourScoreRow {
        group: key.set.group.clone(),
        whisker: key.set.whisker.clone(),
        estimator: key.estimator.clone(),
        noise: key.noise,
        trials: trials.len(),
        contact_rmse_m: median_of_scores(trials.iter().map(|trial| trial.contact_rmse_m)),
        mean_m: median_of_scores(trials.iter().map(|trial| trial.mean_m)),
        p95_m: median_of_scores(trials.iter().map(|trial| trial.p95_m)),
        hausdorff_m: median_of_scores(trials.iter().map(|trial| trial.hausdorff_m)),
        band_coverage: mean(trials.iter().filter_map(|trial| trial.band_coverage)),
    }
}

/// Rows of `contours/<trace>.<estimator>.csv`. Empty if no outline was found.
pub(super) fn vertex_rows(contour: Option<&Contour>) -> Vec<VertexRow> {
    let vertices = contour.into_iter().flat_map(|contour| &contour.vertices);
    vertices
        .map(|vertex| VertexRow {
            x_m: vertex.at.x(),
            y_m: vertex.at.y(),
            normal_rad: vertex.normal_rad,
            cov_xx_m2: vertex.covariance_m2.map(|covariance| covariance.m11),
            cov_xy_m2: vertex.covariance_m2.map(|covariance| covariance.m12),
            cov_yy_m2: vertex.covariance_m2.map(|covariance| covariance.m22),
            touched: vertex.touched,
        })
        .collect()
}
