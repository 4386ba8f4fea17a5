//! The published filters beside values read off the published figures: start-up and steady state, one column per whisker.

use anyhow::Result;
use testbed::metrics::error;
use testbed::results::RunSet;
use testbed::statistics::median_of_scores;
use whisker::estimators::MethodClass;

use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Align, Canvas, Picture};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, INK, LABEL, LegendEntry, Look, MUTED, PANEL_TITLE, legend, plain};

/// End of the start.
const START_S: f64 = 3.0;
/// Distance between the markers on a curve.
const MARKER_SPACING_PX: f64 = 90.0;

/// Values of one filter on one whisker in the plots of Lin et al. (2022, pin experiments), read off the printed figure.
/// On the straight whisker EKF and UKF both pass 1 mm between 0.6 and 0.7 s; here one has either end, so that the
/// markers do not coincide.
struct Published {
    whisker: &'static str,
    /// The estimator that is configured as the published one.
    estimator: &'static str,
    /// From this time on (s) the error stays below this value (mm).
    below: &'static [(f64, f64)],
    /// Range of the steady error, mm.
    steady_mm: (f64, f64),
}

const PUBLISHED: &[Published] = &[
    Published { whisker: "straight", estimator: "paper-ekf", below: &[(0.6, 1.0)], steady_mm: (0.4, 1.9) },
    Published { whisker: "straight", estimator: "paper-ukf", below: &[(0.7, 1.0)], steady_mm: (0.4, 1.5) },
    Published { whisker: "straight", estimator: "paper-particle", below: &[(0.5, 2.0)], steady_mm: (0.7, 2.1) },
    Published { whisker: "curved", estimator: "paper-ekf", below: &[(0.6, 9.0), (2.4, 1.0)], steady_mm: (0.1, 0.5) },
    Published { whisker: "curved", estimator: "paper-ukf", below: &[(0.2, 1.3), (0.7, 0.7)], steady_mm: (0.2, 1.5) },
    Published { whisker: "curved", estimator: "paper-particle", below: &[(0.3, 0.3)], steady_mm: (0.2, 0.6) },
];

/// One filter on one whisker.
struct Curve {
    name: String,
    look: Look,
    /// Median error over trials: seconds since the touch, mm.
    median_mm: Vec<(f64, f64)>,
    /// Steady root mean square error of each trial, mm. `None` without a score.
    steady_mm: Vec<Option<f64>>,
    published: Option<&'static Published>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let filters: Vec<(&str, Look)> =
        data.of_class(MethodClass::Published).enumerate().map(|(place, name)| (name, Look::of(place))).collect();
    let columns: Vec<(String, Vec<Curve>)> = data
        .leading_sets()
        .into_iter()
        .map(|set| {
            let title = format!("{} whisker, {}, {}", set.whisker, plain(&set.group), data.trials_in_words(set));
            (title, filters.iter().map(|(name, look)| curve(data, set, name, *look)).collect())
        })
        .collect();
    let curves = || columns.iter().flat_map(|(_, curves)| curves);
    if curves().all(|curve| curve.median_mm.is_empty()) {
        return Ok(None);
    }
    let errors = curves().flat_map(|curve| {
        let start = curve.median_mm.iter().filter(|(t, _)| *t <= START_S).map(|(_, error)| *error);
        let published = curve.published.iter().flat_map(|published| {
            let (low, high) = published.steady_mm;
            published.below.iter().map(|(_, error)| *error).chain([low, high])
        });
        start.chain(curve.steady_mm.iter().copied().flatten()).chain(published).collect::<Vec<_>>()
    });
    let error = Axis::logarithmic("contact error (mm)", errors);
    let places = filters.len();
    let looks: Vec<(String, Look)> = filters.iter().map(|(name, look)| ((*name).to_owned(), *look)).collect();

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> = looks.iter().map(|(name, look)| LegendEntry::curve(name, *look)).collect();
        if let Some((_, look)) = looks.first() {
            entries.push(LegendEntry::marker(
                "published: error stays below this value from this time on",
                *look,
                false,
            ));
        }
        let below = legend(canvas, (64.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, below + 72.0, 8.0, 62.0]);
        for (place, ((title, curves), frame)) in
            columns.iter().zip(plot.columns(&equal(columns.len()), 34.0)).enumerate()
        {
            // A long name of a whisker would not fit above the left panel alone.
            canvas.text(title, (frame.left, frame.top - 37.0), PANEL_TITLE)?;
            let parts = frame.columns(&[1.0, 0.62], 10.0);
            let axis = if place == 0 { error.clone() } else { error.clone().bare() };
            let time = Axis::linear("time since the first touch (s)", 0.0, START_S);
            let start = Panel::new(canvas, parts[0], "start-up", time, axis)?;
            let steady = Panel::new(canvas, parts[1], "steady state", Axis::places(places), error.clone().bare())?;
            start.level(1.0, "", MUTED)?;
            for (index, curve) in curves.iter().enumerate() {
                curve.paint_start(&start, (24.0 + 30.0 * index as f64, MARKER_SPACING_PX))?;
            }
            for (index, curve) in curves.iter().enumerate() {
                curve.paint_steady(canvas, &steady, parts[1], index as f64)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 544, paint)))
}

fn curve(data: &RunData, set: &RunSet, estimator: &str, look: Look) -> Curve {
    let trials = set.traces.len() * data.run.seeds.len();
    let bands = data.bands_of(set, estimator);
    let steady = data.trials_of(set, estimator).into_iter().map(|trial| trial.get(&error::RMSE));
    Curve {
        name: estimator.to_owned(),
        look,
        // A median over the few trials that estimate early would flatter the estimator.
        median_mm: bands
            .iter()
            .filter(|row| 2 * row.trials >= trials)
            .map(|row| (row.t_contact_s, 1e3 * row.median_m))
            .collect(),
        steady_mm: steady.map(|rmse_m| Some(1e3 * rmse_m?)).collect(),
        published: PUBLISHED.iter().find(|row| row.whisker == set.whisker && row.estimator == estimator),
    }
}

impl Curve {
    fn paint_start(&self, panel: &Panel, markers_px: (f64, f64)) -> Result<()> {
        panel.marked_line(&self.median_mm, self.look, CURVE_PX, markers_px)?;
        self.published.map_or(Ok(()), |published| panel.marks(published.below, self.look, false))
    }

    fn paint_steady(&self, canvas: &Canvas, panel: &Panel, frame: Rect, place: f64) -> Result<()> {
        let (ours, theirs) = (place - 0.18, place + 0.18);
        panel.discs(self.steady_mm.iter().flatten().map(|error| (ours, *error)), 3.0, self.look.color.mix(0.4))?;
        if let Some(median) = median_of_scores(self.steady_mm.iter().copied()) {
            panel.line([(ours - 0.13, median), (ours + 0.13, median)], INK, 2.5)?;
        }
        if let Some(Published { steady_mm: (low, high), .. }) = self.published {
            let corners = [(theirs - 0.1, *low), (theirs + 0.1, *low), (theirs + 0.1, *high), (theirs - 0.1, *high)];
            panel.area(corners, self.look.color.mix(0.25))?;
            panel.line(corners.into_iter().chain([corners[0]]), self.look.color, 1.0)?;
        }
        let (x, _) = panel.at((place, 1.0));
        let name = self.name.trim_start_matches("paper-");
        canvas.text(name, (x, frame.bottom + 15.0), LABEL.aligned(Align::Center))
    }
}
