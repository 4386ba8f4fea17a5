//! Observability along the motion: base path, reading, condition number and error bound of one trace per whisker.

use anyhow::Result;
use testbed::bound::WINDOW_S;
use testbed::metrics::error;
use testbed::results::{BoundRow, EstimateRow, RunSet};

use crate::axes::{Axis, Panel, Rect, equal, extent, without_dips};
use crate::canvas::{Canvas, Picture};
use crate::color::{Rgb, viridis};
use crate::methods::look_of;
use crate::run_data::RunData;
use crate::style::{INK, LegendEntry, Look, READING, SMALL, VERMILION, legend};

/// Colour of quantities of a window of readings.
const WINDOW: Rgb = VERMILION;
/// Radius of the dots of a path.
const DOT_PX: f64 = 2.6;

/// A quantity over time.
type Series = Vec<(f64, f64)>;

/// One row of panels.
struct Trial {
    title: String,
    estimator: String,
    look: Look,
    touch_s: f64,
    end_s: f64,
    /// Base positions during the contact in mm since the first of them, with the error bound of the window there in mm.
    path: Vec<((f64, f64), f64)>,
    reading_un_m: Series,
    /// Root of the condition number.
    elongation: Series,
    bound_mm: Series,
    window_mm: Series,
    error_mm: Series,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let trials = data.of_leading_sets(trial)?;
    if trials.is_empty() {
        return Ok(None);
    }
    let all =
        |series: fn(&Trial) -> &Series| trials.iter().flat_map(series).map(|(_, value)| *value).collect::<Vec<f64>>();
    let axes = [
        Axis::around("µN·m", all(|trial| &trial.reading_un_m)),
        Axis::logarithmic("semi-axis ratio", without_dips(all(|trial| &trial.elongation))),
        Axis::logarithmic("mm", [all(|trial| &trial.bound_mm), all(|trial| &trial.window_mm)].concat()),
    ];
    let height_px = 66 + 48 + 480 * trials.len() as u32 - 74;
    let (least_mm, most_mm) = extent(all(|trial| &trial.window_mm)).unwrap_or((0.1, 1.0));
    // A scale spans a factor of two at least.
    let shades = (least_mm, most_mm.max(2.0 * least_mm));

    let paint = move |canvas: &Canvas| {
        let window = format!("error bound given the last {WINDOW_S} s");
        let error = format!("error of {}", trials[0].estimator);
        let entries = [
            LegendEntry::line("error bound given all readings so far", INK, 2.0),
            LegendEntry::line(&window, WINDOW, 1.75),
            LegendEntry::line(&error, trials[0].look.color, 1.5),
            LegendEntry::dashes("first touch", INK),
        ];
        legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, 66.0, 16.0, 48.0]);
        for (row, (trial, frame)) in trials.iter().zip(plot.rows(&equal(trials.len()), 74.0)).enumerate() {
            let last = row + 1 == trials.len();
            let columns = frame.columns(&[0.36, 0.64], 136.0);
            trial.paint_path(canvas, columns[0], shades, last)?;
            trial.paint_series(canvas, &columns[1].rows(&[1.0, 1.0, 1.35], 30.0), &axes, last)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, height_px, paint)))
}

fn trial(data: &RunData, set: &RunSet, estimator: &str) -> Result<Option<Trial>> {
    let Some(scores) = data.typical_trial(set, estimator, &error::MEDIAN) else {
        return Ok(None);
    };
    let trace = &scores.head.trace;
    let (Some(rows), Some(bounds)) = (data.estimates(trace, estimator)?, data.bound(trace)?) else {
        return Ok(None);
    };
    // The first window is full from here on.
    let full_s = scores.head.touch_s + WINDOW_S;
    let settled = || bounds.iter().filter(|row| row.t_s >= full_s);
    Ok(Some(Trial {
        title: trace.clone(),
        estimator: estimator.to_owned(),
        look: look_of(data, estimator),
        touch_s: scores.head.touch_s,
        end_s: rows[rows.len() - 1].t_s,
        path: path(&rows, settled()),
        reading_un_m: rows.iter().map(|row| (row.t_s, 1e6 * row.reading_n_m)).collect(),
        elongation: settled().map(|row| (row.t_s, row.condition.unwrap_or(f64::NAN).sqrt())).collect(),
        bound_mm: bounds.iter().map(|row| (row.t_s, 1e3 * row.bound_m)).collect(),
        window_mm: settled().map(|row| (row.t_s, 1e3 * row.window_m.unwrap_or(f64::NAN))).collect(),
        error_mm: rows.iter().map(|row| (row.t_s, 1e3 * row.contact_error_m().unwrap_or(f64::NAN))).collect(),
    }))
}

/// Base positions at the instants of the bound, with the error bound of the window there.
fn path<'a>(rows: &[EstimateRow], bounds: impl Iterator<Item = &'a BoundRow>) -> Vec<((f64, f64), f64)> {
    let mut rows = rows.iter();
    let mut first = None;
    let placed = bounds.filter_map(|bound| {
        let row = rows.find(|row| row.t_s >= bound.t_s)?;
        let &mut (x_m, y_m) = first.get_or_insert((row.base_x_m, row.base_y_m));
        Some(((1e3 * (row.base_x_m - x_m), 1e3 * (row.base_y_m - y_m)), 1e3 * bound.window_m?))
    });
    placed.collect()
}

impl Trial {
    fn paint_path(&self, canvas: &Canvas, frame: Rect, shades_mm: (f64, f64), last: bool) -> Result<()> {
        let (left, right) = extent(self.path.iter().map(|((x, _), _)| *x)).unwrap_or((-1.0, 1.0));
        let (low, high) = extent(self.path.iter().map(|((_, y), _)| *y)).unwrap_or((-1.0, 1.0));
        let spare = 0.06 * (right - left).max(high - low).max(1.0);
        let bounds = [left - spare, right + spare, low - spare, high + spare];
        let x_name = if last { "base x (mm)" } else { "" };
        let title = format!("{}: path of the base", self.title);
        let panel = Panel::with_equal_scales(canvas, frame, &title, (x_name, "base y (mm)"), bounds)?;
        for ((x, y), window_mm) in &self.path {
            panel.discs([(*x, *y)], DOT_PX, shade(*window_mm, shades_mm))?;
        }
        let bar = Rect { left: frame.right + 12.0, right: frame.right + 24.0, ..frame };
        let axis = Axis::logarithmic_between("", shades_mm.0, shades_mm.1);
        let bar_panel = Panel::new(canvas, bar, "", Axis::linear("", 0.0, 1.0).bare(), axis.clone().bare())?;
        let steps = 64;
        for step in 0..steps {
            let at = |step: i32| shades_mm.0 * (shades_mm.1 / shades_mm.0).powf(f64::from(step) / f64::from(steps));
            let (from, to) = (at(step), at(step + 1));
            bar_panel.area([(0.0, from), (1.0, from), (1.0, to), (0.0, to)], shade(from, shades_mm))?;
        }
        for (value, number) in axis.ticks((frame.bottom - frame.top) / 45.0) {
            canvas.text(&number, (bar.right + 6.0, bar_panel.at((0.0, value)).1), SMALL)?;
        }
        canvas.text("mm", (bar.left, bar.top - 13.0), SMALL)
    }

    fn paint_series(&self, canvas: &Canvas, frames: &[Rect], axes: &[Axis; 3], last: bool) -> Result<()> {
        let titles = [
            "reading",
            "ratio of the semi-axes of the uncertainty given the window (root of the condition number)",
            "error bounds and error of the filter",
        ];
        for (row, (frame, title)) in frames.iter().zip(titles).enumerate() {
            let name = if last { "time (s)" } else { "" };
            let time = Axis::linear(name, 0.0, self.end_s);
            let time = if row + 1 == titles.len() { time } else { time.bare() };
            let panel = Panel::new(canvas, *frame, title, time, axes[row].clone())?;
            match row {
                0 => panel.line(self.reading_un_m.iter().copied(), READING, 1.0)?,
                1 => panel.line(self.elongation.iter().copied(), WINDOW, 1.75)?,
                _ => {
                    panel.line(self.error_mm.iter().copied(), self.look.color, 1.25)?;
                    panel.line(self.window_mm.iter().copied(), WINDOW, 1.75)?;
                    panel.line(self.bound_mm.iter().copied(), INK, 2.0)?;
                }
            }
            panel.instant(self.touch_s, INK)?;
        }
        Ok(())
    }
}

/// Dark for a small error bound, pale for a large one.
fn shade(window_mm: f64, (least_mm, most_mm): (f64, f64)) -> Rgb {
    let fraction = (window_mm / least_mm).ln() / (most_mm / least_mm).ln();
    viridis(fraction)
}
