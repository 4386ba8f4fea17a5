//! Root mean square error over trials against the posterior Cramér–Rao bound, over time, one column per whisker.

use anyhow::Result;
use whisker::estimators::MethodClass;

use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::methods::{self, Method};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, INK, LABEL, Look, MUTED, SMALL, beside, plain};

/// Width of the bound's curve.
const BOUND_PX: f64 = 3.5;
/// Distance between the markers on a curve.
const MARKER_SPACING_PX: f64 = 84.0;
/// Largest error drawn, longer than a whisker.
const LARGEST_MM: f64 = 100.0;
/// Largest ratio to the bound drawn.
const LARGEST_RATIO: f64 = 4.0;
/// Name of the bound beside its curve.
const BOUND: &str = "Cramér–Rao bound";
/// Room beside a label: the line to its curve.
const LABEL_PX: f64 = 26.0;

/// A quantity over the time since the touch.
type Series = Vec<(f64, f64)>;

/// A method on a set: its error and the ratio of that to the bound, which does not hold with hindsight.
struct Curve {
    look: Look,
    error_mm: Series,
    ratio: Series,
}

/// One set.
struct Column {
    title: String,
    trials: String,
    bound_mm: Series,
    /// In the order of the methods.
    curves: Vec<Curve>,
}

/// The axes that all columns share.
struct Axes {
    time: Axis,
    error: Axis,
    ratio: Axis,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    methods::picture(data, picture)
}

fn picture(data: &RunData, methods: Vec<Method>) -> Result<Option<Picture>> {
    let sets = data.leading_sets();
    let columns: Vec<Column> = sets
        .iter()
        .map(|set| {
            let (mut bound_mm, mut curves) = (Series::new(), Vec::new());
            for method in &methods {
                let rows = data.consistency_of(set, &method.name);
                let bounded = rows.iter().filter_map(|row| Some((row.t_contact_s, row.rmse_m, row.bound_m?)));
                let bounded: Vec<(f64, f64, f64)> = bounded.collect();
                // Estimators that start later have fewer rows.
                if bounded.len() > bound_mm.len() {
                    bound_mm = bounded.iter().map(|&(t, _, bound_m)| (t, 1e3 * bound_m)).collect();
                }
                let is_bound = method.class != MethodClass::Hindsight;
                let ratio = bounded.iter().filter(|_| is_bound).map(|&(t, error_m, bound_m)| (t, error_m / bound_m));
                let error_mm = bounded.iter().map(|&(t, error_m, _)| (t, 1e3 * error_m)).collect();
                curves.push(Curve { look: method.look, error_mm, ratio: ratio.collect() });
            }
            Column { title: format!("{} whisker", set.whisker), trials: data.trials_in_words(set), bound_mm, curves }
        })
        .collect();
    if columns.iter().all(|column| column.bound_mm.is_empty()) {
        return Ok(None);
    }
    let note = format!(
        "Drawn: {}, on the object {}; {}.",
        methods::in_words(methods.iter().map(|method| method.label.as_str())),
        sets.first().map(|set| plain(&set.group)).unwrap_or_default(),
        methods::in_words(columns.iter().map(|column| column.trials.as_str())),
    );
    let axes = axes(&columns);
    let labels: Vec<String> = methods.into_iter().map(|method| method.label).collect();
    let paint = move |canvas: &Canvas| {
        let names = labels.iter().map(String::as_str).chain([BOUND]);
        let names_px = names.map(|name| canvas.text_width_px(name, LABEL)).fold(0.0, f64::max);
        let plot = Rect::inside(canvas, [64.0, 30.0, LABEL_PX + names_px + 4.0, 48.0]);
        let last = columns.len() - 1;
        for (place, (column, frame)) in columns.iter().zip(plot.columns(&equal(columns.len()), 22.0)).enumerate() {
            let named = (place == last).then_some(labels.as_slice());
            column.paint(canvas, frame, &axes, place == 0, named)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(800, 560, paint).noted(note)))
}

fn axes(columns: &[Column]) -> Axes {
    let curves = || columns.iter().flat_map(|column| &column.curves);
    let bounds = columns.iter().flat_map(|column| &column.bound_mm);
    let errors = curves().flat_map(|curve| &curve.error_mm).filter(|(_, error)| *error < LARGEST_MM);
    let ratios = curves().flat_map(|curve| &curve.ratio).map(|(_, ratio)| *ratio);
    let largest = ratios.fold(1.25, f64::max).min(LARGEST_RATIO);
    let (first_s, last_s) = extent(bounds.clone().map(|(t, _)| *t)).unwrap_or((0.1, 10.0));
    Axes {
        time: Axis::logarithmic_between("time since the first touch (s)", 0.9 * first_s, last_s),
        error: Axis::logarithmic("RMS contact error (mm)", bounds.chain(errors).map(|(_, error)| *error)),
        ratio: Axis::linear("error / bound", 0.0, 1.05 * largest),
    }
}

impl Column {
    /// Draws error and ratio; names the curves at their right ends in the last column.
    fn paint(&self, canvas: &Canvas, frame: Rect, axes: &Axes, is_first: bool, names: Option<&[String]>) -> Result<()> {
        let axis = |axis: &Axis| if is_first { axis.clone() } else { axis.clone().bare() };
        let rows = frame.rows(&[1.9, 1.0], 18.0);
        let errors = Panel::new(canvas, rows[0], &self.title, axes.time.clone().bare(), axis(&axes.error))?;
        let ratios = Panel::new(canvas, rows[1], "", axes.time.clone(), axis(&axes.ratio))?;
        ratios.line(ratios.across(1.0), INK, BOUND_PX)?;
        errors.line(self.bound_mm.iter().copied(), INK, BOUND_PX)?;
        // The first method is drawn on top.
        for (index, curve) in self.curves.iter().enumerate().rev() {
            let offset_px = 12.0 + MARKER_SPACING_PX * index as f64 / self.curves.len() as f64;
            for (panel, series) in [(&errors, &curve.error_mm), (&ratios, &curve.ratio)] {
                panel.marked_line(series, curve.look, CURVE_PX, (offset_px, MARKER_SPACING_PX))?;
            }
        }
        let Some(names) = names else { return Ok(()) };
        let mut entries = Vec::new();
        for (name, curve) in names.iter().zip(&self.curves) {
            let end = curve.error_mm.iter().rev().find(|(_, error)| *error < LARGEST_MM);
            entries.extend(end.map(|end| (errors.at(*end).1, name.as_str(), curve.look.color)));
        }
        entries.extend(self.bound_mm.last().map(|end| (errors.at(*end).1, BOUND, INK)));
        beside(canvas, (rows[0].right, rows[0].right + LABEL_PX), (rows[0].top, rows[0].bottom), entries)?;
        let bound_y = ratios.at((1.0, 1.0)).1;
        canvas.text("limit", (rows[1].right + LABEL_PX, bound_y), crate::canvas::Lettering { color: MUTED, ..SMALL })
    }
}
