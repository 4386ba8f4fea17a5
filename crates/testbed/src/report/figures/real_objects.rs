//! The outlines found on objects of which nobody knows where they were touched: one panel a sweep.

use anyhow::Result;

use crate::report::canvas::Picture;
use crate::report::contour_panel::{ContourPanel, Found, picture};
use crate::report::run_data::RunData;
use crate::report::style::{Look, plain, two_digits};
use crate::results::ContourTrialRow;

/// Filters drawn: so many of the run's first.
const FILTERS: usize = 2;

/// Lays the figure out.
pub(super) fn draw(data: &RunData) -> Result<Option<Picture>> {
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
            let look = Look::of(data.place_of(&row.estimator));
            found.push(Found::new(row.estimator.clone(), words(row), look, &vertices));
        }
    }
    let Some(object) = object else { return Ok(None) };
    let outline = data.outline(trace)?.unwrap_or_default().iter().map(|(x, y)| (1e3 * x, 1e3 * y)).collect();
    let sweep = trace.rsplit('_').next().unwrap_or(trace);
    Ok(Some(ContourPanel { title: format!("{}, {sweep}", plain(object)), outline, touched: Vec::new(), found }))
}

/// What is to be said of the outline that an estimator found.
fn words(row: &ContourTrialRow) -> String {
    let mut words = row.estimator.clone();
    if let Some(mean_m) = row.mean_m {
        words += &format!(": {} mm off", two_digits(1e3 * mean_m));
    }
    if let Some(radius_m) = row.radius_m {
        words += &format!(", radius {} mm", two_digits(1e3 * radius_m));
    }
    words
}
