//! Estimated outlines of objects without known contacts, one panel per sweep.

use anyhow::Result;
use testbed::results::ContourTrialRow;

use crate::canvas::Picture;
use crate::contour_panel::{ContourPanel, Found, picture};
use crate::methods::look_of;
use crate::run_data::RunData;
use crate::style::{plain, two_digits};

/// Number of filters drawn: the first of the run.
const FILTERS: usize = 2;

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let mut panels = Vec::new();
    for trace in data.unscored_sets().into_iter().flat_map(|set| &set.traces) {
        panels.extend(panel(data, trace)?);
    }
    Ok(picture(panels))
}

fn panel(data: &RunData, trace: &str) -> Result<Option<ContourPanel>> {
    let (mut object, mut found) = (None, Vec::new());
    for row in data.contours_of(trace).filter(|row| data.filters().take(FILTERS).any(|name| name == row.estimator)) {
        object = Some(&row.object);
        if let Some(vertices) = data.contour(trace, &row.estimator)? {
            let look = look_of(data, &row.estimator);
            found.push(Found::new(row.estimator.clone(), words(row), look, &vertices));
        }
    }
    let Some(object) = object else { return Ok(None) };
    let outline = data.outline(trace)?.unwrap_or_default().iter().map(|(x, y)| (1e3 * x, 1e3 * y)).collect();
    let sweep = trace.rsplit('_').next().unwrap_or(trace);
    Ok(Some(ContourPanel { title: format!("{}, {sweep}", plain(object)), outline, touched: Vec::new(), found }))
}

/// Deviation of the estimated outline and the circle fitted to it, in words.
fn words(row: &ContourTrialRow) -> Vec<String> {
    let off = row.mean_m.map(|mean_m| format!(": mean distance {} mm", two_digits(1e3 * mean_m)));
    let mut lines = vec![format!("{}{}", row.estimator, off.unwrap_or_default())];
    if let (Some(radius_m), Some(low_m), Some(residual_m)) = (row.radius_m, row.radius_low_m, row.residual_rms_m) {
        let [radius, low, residual] = [radius_m, low_m, residual_m].map(|length_m| two_digits(1e3 * length_m));
        let high = row.radius_high_m.map_or("∞".into(), |high_m| two_digits(1e3 * high_m));
        lines.push(format!("radius {radius} ({low} to {high}) mm, residual {residual} mm"));
    }
    lines
}
