//! Tables of the outlines found.

use std::collections::BTreeMap;

use trace::Sidecar;

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

/// Rows of `contours.csv`, in the order in which sets and estimators first appear.
pub(super) fn summarise(trials: &[ContourTrialRow]) -> Vec<ContourScoreRow> {
    let mut sets: Vec<Vec<&ContourTrialRow>> = Vec::new();
    let mut places = BTreeMap::new();
    for trial in trials {
        let key = (&trial.group, &trial.whisker, trial.noise.to_bits(), &trial.estimator);
        let place = *places.entry(key).or_insert_with(|| {
            sets.push(Vec::new());
            sets.len() - 1
        });
        sets[place].push(trial);
    }
    let row = |set: &Vec<&ContourTrialRow>| {
        let median =
            |value: fn(&ContourTrialRow) -> Option<f64>| median_of_scores(set.iter().map(|trial| value(trial)));
        ContourScoreRow {
            group: set[0].group.clone(),
            whisker: set[0].whisker.clone(),
            estimator: set[0].estimator.clone(),
            noise: set[0].noise,
            trials: set.len(),
            contact_rmse_m: median(|trial| trial.contact_rmse_m),
            mean_m: median(|trial| trial.mean_m),
            p95_m: median(|trial| trial.p95_m),
            hausdorff_m: median(|trial| trial.hausdorff_m),
            band_coverage: mean(set.iter().filter_map(|trial| trial.band_coverage)),
        }
    };
    sets.iter().map(row).collect()
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
