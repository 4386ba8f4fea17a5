//! Tables of the outlines found.

use trace::Sidecar;

use super::tables::Place;
use crate::contour::{Circle, Comparison, Contour};
use crate::results::{ContourScoreRow, ContourTrialRow, VertexRow, is_round};
use crate::statistics::{mean, median_of_scores};

/// What a row of `contour_trials.csv` says of an outline, whoever found it: `compared` where the true outline is known.
pub(super) fn trial_row(sidecar: &Sidecar, contour: Option<&Contour>, compared: Option<Comparison>) -> ContourTrialRow {
    let circle = contour.filter(|_| is_round(&sidecar.object)).and_then(Circle::through);
    ContourTrialRow {
        trace: sidecar.name.clone(),
        group: sidecar.group.clone(),
        whisker: sidecar.whisker.name.clone(),
        object: sidecar.object.clone(),
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

/// What is kept of the trials of a set for `contours.csv`: error of the contact, mean, 95th percentile and largest distance of the outline, and coverage of its band.
pub(super) type Judged = [Option<f64>; 5];

pub(super) fn judged(trial: &ContourTrialRow) -> Judged {
    [trial.contact_rmse_m, trial.mean_m, trial.p95_m, trial.hausdorff_m, trial.band_coverage]
}

/// A row of `contours.csv`, of all trials of a set.
pub(super) fn summarise(place: &Place, trials: &[Judged]) -> ContourScoreRow {
    let values = |of: usize| trials.iter().map(move |trial| trial[of]);
    ContourScoreRow {
        group: place.group.clone(),
        whisker: place.whisker.clone(),
        estimator: place.estimator.clone(),
        noise: place.noise,
        trials: trials.len(),
        contact_rmse_m: median_of_scores(values(0)),
        mean_m: median_of_scores(values(1)),
        p95_m: median_of_scores(values(2)),
        hausdorff_m: median_of_scores(values(3)),
        band_coverage: mean(values(4).flatten()),
    }
}

/// Rows of `contours/<trace>.<estimator>.csv`; none where no outline was found.
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
