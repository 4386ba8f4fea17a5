//! Estimated outlines with their bands over the true ones, one panel per set.

use anyhow::Result;
use testbed::contour::touched_stretch;
use testbed::metrics::contour;
use testbed::results::{RECOMMENDED, RunEstimator, RunSet};
use whisker::estimators::MethodClass;

use crate::canvas::Picture;
use crate::contour_panel::{ContourPanel, Found, Points, picture};
use crate::methods;
use crate::run_data::{RunData, smallest};
use crate::style::{Look, plain, two_digits};

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let mut sets = data.outline_sets();
    let whiskers: Vec<&str> = data.run.sets.iter().map(|set| set.whisker.as_str()).collect();
    sets.sort_by_key(|set| whiskers.iter().position(|whisker| *whisker == set.whisker));
    let leading = leading(data);
    let mut panels = Vec::new();
    for set in sets {
        panels.extend(panel(data, set, &leading)?);
    }
    let shown =
        |row: &RunEstimator| panels.iter().any(|panel| panel.found.iter().any(|found| found.estimator == row.label()));
    let labels: Vec<String> =
        leading.iter().map(|(row, _)| *row).filter(|row| shown(row)).map(RunEstimator::label).collect();
    let note = format!("Drawn: {}.", methods::in_words(labels.iter().map(String::as_str)));
    Ok(picture(panels).map(|picture| picture.noted(note)))
}

/// Estimators to show, the same on every set: the recommended filter or else the first, and the most accurate with
/// hindsight and as published.
fn leading(data: &RunData) -> Vec<(&RunEstimator, Look)> {
    let recommended = data.filters().find(|name| *name == RECOMMENDED).or(data.filters().next());
    let best = |class| methods::best_of(data, class).or(data.of_class(class).next());
    let shown = [recommended, best(MethodClass::Hindsight), best(MethodClass::Published)];
    let rows = shown.into_iter().flatten().filter_map(|name| data.run.estimators.iter().find(|row| row.name == name));
    rows.map(|row| (row, methods::look_of(data, &row.name))).collect()
}

fn panel(data: &RunData, set: &RunSet, leading: &[(&RunEstimator, Look)]) -> Result<Option<ContourPanel>> {
    let Some(best) = smallest(leading.iter().map(|(row, _)| row.name.as_str()), |name| {
        data.summary_of(set, name)?.get(&contour::CONTACT_RMSE)
    }) else {
        return Ok(None);
    };
    let Some(trial) = data.typical_trial(set, best, &contour::CONTACT_RMSE) else { return Ok(None) };
    let trace = &trial.head.trace;
    let (Some(outline), Some(rows)) = (data.outline(trace)?, data.estimates(trace, best)?) else { return Ok(None) };
    let outline: Points = outline.iter().map(|(x, y)| (1e3 * x, 1e3 * y)).collect();
    let touched = rows.iter().filter_map(|row| Some((1e3 * row.truth_surface_x_m?, 1e3 * row.truth_surface_y_m?)));
    let mut found = Vec::new();
    for (estimator, look) in leading {
        let Some(vertices) = data.contour(trace, &estimator.name)? else { continue };
        let in_mm = |value_m: Option<f64>| value_m.map_or_else(|| "–".into(), |value_m| two_digits(1e3 * value_m));
        let scores = data.summary_of(set, &estimator.name);
        let contact = in_mm(scores.and_then(|row| row.get(&contour::CONTACT_RMSE)));
        let mean = in_mm(scores.and_then(|row| row.get(&contour::MEAN)));
        let label = estimator.label();
        let words = format!("{}: contact {contact}, outline {mean} mm", estimator.name);
        found.push(Found::new(label, vec![words], *look, &vertices));
    }
    Ok(Some(ContourPanel {
        title: format!("{}, {} whisker", plain(&set.group), set.whisker),
        touched: touched_stretch(&outline, touched),
        outline,
        found,
    }))
}
