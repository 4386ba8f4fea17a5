//! Root mean square error over trials against the posterior Cramer-Rao bound, over time, one column a whisker.

use anyhow::Result;

use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, INK, LegendEntry, Look, MUTED, legend, plain};

/// Width of the bound's curve.
const BOUND_PX: f64 = 3.0;
/// Distance between the markers on a curve.
const MARKER_SPACING_PX: f64 = 130.0;
/// Errors beyond, longer than a whisker, leave the picture.
const LARGEST_MM: f64 = 100.0;
/// So do larger ratios to the bound.
const LARGEST_RATIO: f64 = 4.0;

/// A quantity over the time since the touch.
type Series = Vec<(f64, f64)>;

/// One column: a set.
struct Column {
    title: String,
    bound_mm: Series,
    /// By estimator: error and, without hindsight, its ratio to the bound.
    curves: Vec<(Look, Series, Series)>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let shown: Vec<usize> = data.under_test().map(|estimator| data.place_of(estimator)).collect();
    let columns: Vec<Column> = data
        .leading_sets()
        .into_iter()
        .map(|set| {
            let mut bound_mm = Series::new();
            let curves = data.under_test().map(|estimator| {
                let rows = data.consistency_of(set, estimator);
                let bounded: Vec<(f64, f64, f64)> =
                    rows.iter().filter_map(|row| Some((row.t_contact_s, row.rmse_m, row.bound_m?))).collect();
                // Estimators that start later have fewer rows.
                if bounded.len() > bound_mm.len() {
                    bound_mm = bounded.iter().map(|&(t, _, bound_m)| (t, 1e3 * bound_m)).collect();
                }
                let error_mm = bounded.iter().map(|&(t, error_m, _)| (t, 1e3 * error_m)).collect();
                // The bound is not for those who know the readings to come.
                let is_bound = data.filters().any(|filter| filter == estimator);
                let ratio = bounded.iter().filter(|_| is_bound).map(|&(t, error_m, bound_m)| (t, error_m / bound_m));
                let ratio = ratio.collect();
                (Look::of(data.place_of(estimator)), error_mm, ratio)
            });
            let curves = curves.collect();
            let title = format!("{} whisker, {}, {}", set.whisker, plain(&set.group), data.trials_in_words(set));
            Column { title, bound_mm, curves }
        })
        .collect();
    if columns.iter().all(|column| column.bound_mm.is_empty()) {
        return Ok(None);
    }
    let curves = || columns.iter().flat_map(|column| &column.curves);
    let bounds = columns.iter().flat_map(|column| &column.bound_mm);
    let errors = curves().flat_map(|(_, error_mm, _)| error_mm).filter(|(_, error)| *error < LARGEST_MM);
    let error = Axis::logarithmic("RMS contact error (mm)", bounds.clone().chain(errors).map(|(_, error)| *error));
    let ratios = curves().flat_map(|(.., ratio)| ratio).map(|(_, ratio)| *ratio);
    let largest = ratios.fold(1.25, f64::max).min(LARGEST_RATIO);
    let ratio = Axis::linear("over the bound", 0.0, 1.1 * largest);
    let (first_s, last_s) = extent(bounds.map(|(t, _)| *t)).unwrap_or((0.1, 10.0));
    let time = Axis::logarithmic_between("time since the first touch (s)", 0.9 * first_s, last_s);
    let names = data.labels();

    let paint = move |canvas: &Canvas| {
        let mut entries = vec![LegendEntry::line("posterior Cramér–Rao bound", INK, BOUND_PX)];
        entries.extend(shown.iter().map(|&place| LegendEntry::curve(&names[place], Look::of(place))));
        let below = legend(canvas, (64.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, below + 46.0, 56.0, 48.0]);
        for (place, (column, frame)) in columns.iter().zip(plot.columns(&equal(columns.len()), 62.0)).enumerate() {
            let axis = |axis: &Axis| if place == 0 { axis.clone() } else { axis.clone().bare() };
            let rows = frame.rows(&[1.25, 1.0], 40.0);
            let errors = Panel::new(canvas, rows[0], &column.title, time.clone().bare(), axis(&error))?;
            let ratios = Panel::new(canvas, rows[1], "the same over the bound", time.clone(), axis(&ratio))?;
            for (level, word) in [(1.0, "limit"), (1.25, "1.25")] {
                ratios.level(level, word, MUTED)?;
            }
            // The first estimator lies on top.
            for (index, (look, error_mm, ratio)) in column.curves.iter().enumerate().rev() {
                let offset_px = 24.0 + MARKER_SPACING_PX * index as f64 / column.curves.len() as f64;
                for (panel, series) in [(&errors, error_mm), (&ratios, ratio)] {
                    panel.marked_line(series, *look, CURVE_PX, (offset_px, MARKER_SPACING_PX))?;
                }
            }
            errors.line(column.bound_mm.iter().copied(), INK, BOUND_PX)?;
        }
        Ok(())
    };
    Ok(Some(Picture { width_px: 1200, height_px: 820, paint: Box::new(paint) }))
}
