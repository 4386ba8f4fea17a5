//! Estimated outlines of objects without known contacts, one panel per sweep.

use anyhow::Result;
use testbed::results::{ContourTrialRow, RECOMMENDED};

use crate::canvas::Picture;
use crate::contour_panel::{ContourPanel, Found, picture};
use crate::methods::look_of;
use crate::run_data::RunData;
use crate::style::{plain, two_digits};

/// Filters drawn, if they state outlines: the recommended one, and that for general convex outlines. Otherwise the first that do.
const FILTERS: [&str; 2] = [RECOMMENDED, "outline"];

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let traces: Vec<&String> = data.unscored_sets().into_iter().flat_map(|set| &set.traces).collect();
    let states = |name: &str| traces.iter().any(|trace| data.contours_of(trace).any(|row| row.estimator == name));
    let stating: Vec<&str> = data.filters().filter(|name| states(name)).collect();
    let preferred: Vec<&str> = stating.iter().copied().filter(|name| FILTERS.contains(name)).collect();
    let filters = if preferred.is_empty() { stating.into_iter().take(FILTERS.len()).collect() } else { preferred };
    let mut panels = Vec::new();
    for trace in traces {
        panels.extend(panel(data, trace, &filters)?);
    }
    Ok(picture(panels))
}

fn panel(data: &RunData, trace: &str, filters: &[&str]) -> Result<Option<ContourPanel>> {
    let (mut object, mut found) = (None, Vec::new());
    for row in data.contours_of(trace).filter(|row| filters.contains(&row.estimator.as_str())) {
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
