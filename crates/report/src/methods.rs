//! Selection of the methods that figures and tables show: a few by default, all of them in groups.

use maud::{Markup, html};
use testbed::metrics::error;
use testbed::results::{RECOMMENDED, RunEstimator, RunSet};
use whisker::estimators::MethodClass;

use super::canvas::Picture;
use super::run_data::{RunData, smallest};
use super::style::{LOOKS, Look};

/// Methods shown by default, programs given by `--exec` apart.
const FEW: usize = 5;

/// The filter shown beside [`RECOMMENDED`]: of another principle than the Kalman filters.
const BESIDE: &str = "particle";

/// A method with its look.
#[derive(Clone)]
pub(crate) struct Method {
    /// Name of the estimator.
    pub(crate) name: String,
    /// Name in figures and tables.
    pub(crate) label: String,
    /// Class of the estimator.
    pub(crate) class: MethodClass,
    /// Colour and marker in the picture.
    pub(crate) look: Look,
}

impl Method {
    /// The methods of one picture. Their places give the looks.
    fn of(estimators: &[&RunEstimator]) -> Vec<Self> {
        let method = |(place, estimator): (usize, &&RunEstimator)| Self {
            name: estimator.name.clone(),
            label: estimator.label(),
            class: estimator.class,
            look: Look::of(place),
        };
        estimators.iter().enumerate().map(method).collect()
    }
}

/// The estimator of a class with the smallest RMS contact error, summed over all scored sets or else over those on the
/// leading object. `None` if none of the class has one on each of these sets.
pub(crate) fn best_of(data: &RunData, class: MethodClass) -> Option<&str> {
    let best = |sets: &[&RunSet]| {
        smallest(data.of_class(class), |name| {
            sets.iter().map(|set| data.summary_of(set, name)?.get(&error::RMSE)).sum()
        })
    };
    best(&data.scored_sets()).or_else(|| best(&data.leading_sets()))
}

/// The estimators shown by default, in the order of the run: all of a run with few; else the recommended one, the programs
/// given by `--exec`, the most exact with hindsight, as published and of the baselines, and another filter.
pub(crate) fn leading(data: &RunData) -> Vec<&RunEstimator> {
    let all = &data.run.estimators;
    if all.len() <= FEW {
        return all.iter().collect();
    }
    let programs = all.iter().filter(|estimator| estimator.is_program()).map(|program| program.name.as_str());
    let classes = [MethodClass::Hindsight, MethodClass::Published, MethodClass::Baseline];
    let of_classes = classes.into_iter().filter_map(|class| best_of(data, class));
    let wanted = std::iter::once(RECOMMENDED).chain(programs).chain(of_classes).chain([BESIDE]);
    let mut chosen: Vec<&RunEstimator> = Vec::new();
    let known = |name: &str| all.iter().find(|estimator| estimator.name == name);
    for estimator in wanted.filter_map(known) {
        if chosen.len() < LOOKS && !chosen.contains(&estimator) {
            chosen.push(estimator);
        }
    }
    let others = all.iter().filter(|estimator| !chosen.contains(estimator));
    let filling: Vec<&RunEstimator> = others.take(FEW.saturating_sub(chosen.len())).collect();
    chosen.extend(filling);
    all.iter().filter(|estimator| chosen.contains(estimator)).collect()
}

/// All estimators in groups of at most [`LOOKS`], each led by the first of the leading ones for comparison. Empty if the
/// leading ones are all.
fn groups(data: &RunData) -> Vec<Vec<&RunEstimator>> {
    let leading = leading(data);
    if leading.len() == data.run.estimators.len() {
        return Vec::new();
    }
    let first = leading[0];
    let others: Vec<&RunEstimator> = data.run.estimators.iter().filter(|estimator| *estimator != first).collect();
    let pictures = others.len().div_ceil(LOOKS - 1);
    let groups = others.chunks(others.len().div_ceil(pictures));
    groups.map(|group| std::iter::once(first).chain(group.iter().copied()).collect()).collect()
}

/// The picture of the leading methods, with those of all methods in groups behind it. `None` if `draw` finds nothing to show
/// for the leading ones.
///
/// # Errors
/// Those of `draw`.
pub(crate) fn picture(
    data: &RunData,
    draw: impl Fn(&RunData, Vec<Method>) -> anyhow::Result<Option<Picture>>,
) -> anyhow::Result<Option<Picture>> {
    let Some(mut picture) = draw(data, Method::of(&leading(data)))? else { return Ok(None) };
    for group in groups(data) {
        picture.all_methods.extend(draw(data, Method::of(&group))?);
    }
    Ok(Some(picture))
}

/// A table of the leading estimators, with that of all of them folded away behind it. `None` if the former is empty.
pub(crate) fn with_all_methods(data: &RunData, table: impl Fn(&[&RunEstimator]) -> Option<Markup>) -> Option<Markup> {
    let leading = leading(data);
    let all: Vec<&RunEstimator> = data.run.estimators.iter().collect();
    let first = table(&leading);
    if leading.len() == all.len() {
        return first;
    }
    let rest = table(&all)?;
    Some(html! {
        @if let Some(first) = first { (first) }
        details.all { summary { "All methods" } (rest) }
    })
}

/// The look of an estimator among the leading ones, for pictures with a selection of their own; the last look if it is
/// none of them.
pub(crate) fn look_of(data: &RunData, name: &str) -> Look {
    Look::of(leading(data).iter().position(|estimator| estimator.name == name).unwrap_or(LOOKS))
}

/// Names in a sentence: `a`, `a and b`, `a, b and c`.
pub(crate) fn in_words<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.into_iter().collect();
    match names.as_slice() {
        [] => String::new(),
        [name] => (*name).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_names_are_joined_as_in_a_sentence() {
        assert_eq!(in_words([]), "");
        assert_eq!(in_words(["a"]), "a");
        assert_eq!(in_words(["a", "b"]), "a and b");
        assert_eq!(in_words(["a", "b", "c"]), "a, b and c");
    }
}
