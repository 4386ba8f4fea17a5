//! Consistency: NEES and NIS over time and the coverage of the 95 % ellipses, one column per whisker.

use anyhow::Result;
use testbed::consistency::{ConsistencyTest, NEES_TEST, NIS_TEST, interval};
use testbed::metrics::consistency;
use testbed::results::{ConsistencyRow, RunSet};
use whisker::estimators::MethodClass;

use crate::axes::{Axis, Panel, Rect, equal, without_dips};
use crate::canvas::{Canvas, Picture};
use crate::color::Rgba;
use crate::methods::{self, Method};
use crate::run_data::RunData;
use crate::style::{CURVE_PX, LABEL, LegendEntry, Look, MUTED, STATED, legend, plain};

/// Shade of the interval that holds 95 % of the averages of a consistent estimator.
const INTERVAL: Rgba = STATED.mix(0.28);
/// Largest average drawn.
const LARGEST: f64 = 1e3;
/// Distance between the markers on a curve.
const MARKER_SPACING_PX: f64 = 130.0;
/// Height of the bar of one estimator.
const BAR_PX: f64 = 24.0;
/// Space between panels.
const GAP_PX: f64 = 40.0;
/// Height of the numbers and the name of an axis.
const AXIS_PX: f64 = 40.0;
/// Height of a panel over time.
const PANEL_PX: f64 = 250.0;

/// An average over runs that has an interval.
struct Average {
    title: &'static str,
    label: &'static str,
    judged: ConsistencyTest,
    value: fn(&ConsistencyRow) -> Option<f64>,
}

const AVERAGES: [Average; 2] = [
    Average {
        title: "normalised estimation error squared (NEES)",
        label: "average over runs",
        judged: NEES_TEST,
        value: |row| row.anees,
    },
    Average {
        title: "normalised innovation squared (NIS)",
        label: "average over runs",
        judged: NIS_TEST,
        value: |row| row.anis,
    },
];

/// An average over the time since the touch, with the look of its estimator.
type Curve = (Look, Vec<(f64, f64)>);

/// One set.
struct Column {
    title: String,
    runs: usize,
    /// By estimator, for each of [`AVERAGES`].
    curves: [Vec<Curve>; 2],
    /// By estimator: look, name, share of the ellipses that contain the true contact, verdict.
    coverage: Vec<(Look, String, f64, String)>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    methods::picture(data, picture)
}

fn picture(data: &RunData, mut methods: Vec<Method>) -> Result<Option<Picture>> {
    methods.retain(|method| method.class != MethodClass::Baseline);
    let columns: Vec<Column> = data.leading_sets().into_iter().map(|set| column(data, set, &methods)).collect();
    let has_curves =
        columns.iter().flat_map(|column| column.curves.iter().flatten()).any(|(_, series)| !series.is_empty());
    if !has_curves || columns.iter().all(|column| column.coverage.is_empty()) {
        return Ok(None);
    }
    let bars = columns.iter().map(|column| column.coverage.len()).max().unwrap_or(0);
    let axes = [0, 1].map(|row| {
        let points = columns.iter().flat_map(|column| &column.curves[row]).flat_map(|(_, series)| series);
        let values = points.map(|(_, value)| *value).filter(|value| *value < LARGEST);
        let ends = columns.iter().map(|column| interval(AVERAGES[row].judged.freedom, column.runs as f64));
        let shown = without_dips(values).into_iter().chain(ends.flat_map(|(low, high)| [low, high]));
        Axis::logarithmic(AVERAGES[row].label, shown)
    });
    let end_s = columns.iter().flat_map(|column| column.curves.iter().flatten()).flat_map(|(_, series)| series);
    let end_s = end_s.map(|(t, _)| *t).fold(0.0, f64::max);
    let names: Vec<(String, Look)> = columns
        .iter()
        .max_by_key(|column| column.coverage.len())
        .map_or_else(Vec::new, |column| column.coverage.iter().map(|(look, name, ..)| (name.clone(), *look)).collect());

    let paint = move |canvas: &Canvas| {
        let mut entries = vec![LegendEntry::bands("95 % interval of a consistent estimator", vec![INTERVAL])];
        entries.extend(names.iter().map(|(name, look)| LegendEntry::curve(name, *look)));
        let below = legend(canvas, (64.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, below + 46.0, 56.0, 48.0]);
        for (place, (column, frame)) in columns.iter().zip(plot.columns(&equal(columns.len()), 62.0)).enumerate() {
            let rows = frame.rows(&[PANEL_PX, PANEL_PX, AXIS_PX + BAR_PX * bars as f64], GAP_PX);
            for (row, average) in AVERAGES.iter().enumerate() {
                let title =
                    if row == 0 { format!("{}: {}", column.title, average.title) } else { average.title.into() };
                let axis = if place == 0 { axes[row].clone() } else { axes[row].clone().bare() };
                let time = Axis::linear("time since the first touch (s)", 0.0, end_s);
                let time = if row == 0 { time.bare() } else { time };
                let panel = Panel::new(canvas, rows[row], &title, time, axis)?;
                column.paint_average(&panel, row, end_s)?;
            }
            column.paint_coverage(canvas, Rect { top: rows[2].top + AXIS_PX, ..rows[2] })?;
        }
        Ok(())
    };
    let height_px = 88.0 + 48.0 + 2.0 * (PANEL_PX + GAP_PX) + AXIS_PX + BAR_PX * bars as f64;
    Ok(Some(Picture::new(1200, height_px as u32, paint)))
}

fn column(data: &RunData, set: &RunSet, methods: &[Method]) -> Column {
    let curves = AVERAGES.map(|average| {
        methods
            .iter()
            .map(|method| {
                let rows = data.consistency_of(set, &method.name);
                let series = rows.iter().filter_map(|row| Some((row.t_contact_s, (average.value)(row)?))).collect();
                (method.look, series)
            })
            .collect()
    });
    let coverage = methods.iter().filter_map(|method| {
        let row = data.summary_of(set, &method.name)?;
        let verdict = data.errors_of(set, &method.name)?.verdict().word();
        Some((method.look, method.label.clone(), row.get(&consistency::COVERAGE)?, verdict.to_owned()))
    });
    Column {
        title: format!("{} whisker, {}", set.whisker, plain(&set.group)),
        runs: set.traces.len() * data.run.seeds.len(),
        curves,
        coverage: coverage.collect(),
    }
}

impl Column {
    fn paint_average(&self, panel: &Panel, row: usize, end_s: f64) -> Result<()> {
        let freedom = AVERAGES[row].judged.freedom;
        let (low, high) = interval(freedom, self.runs as f64);
        panel.area([(0.0, low), (end_s, low), (end_s, high), (0.0, high)], INTERVAL)?;
        panel.level(freedom as f64, if freedom == 1 { "1" } else { "2" }, MUTED)?;
        let curves = &self.curves[row];
        // The first estimator is drawn on top.
        for (index, (look, series)) in curves.iter().enumerate().rev() {
            let offset_px = 24.0 + MARKER_SPACING_PX * index as f64 / curves.len() as f64;
            panel.marked_line(series, *look, CURVE_PX, (offset_px, MARKER_SPACING_PX))?;
        }
        Ok(())
    }

    fn paint_coverage(&self, canvas: &Canvas, frame: Rect) -> Result<()> {
        let bars = self.coverage.len();
        let share = Axis::linear("95 % ellipses that contain the true contact (%)", 0.0, 100.0);
        let panel = Panel::new(canvas, frame, "coverage, with the verdict", share, Axis::places(bars))?;
        panel.area([(90.0, -1.0), (98.0, -1.0), (98.0, bars as f64), (90.0, bars as f64)], INTERVAL)?;
        // The first estimator is at the top.
        for (row, (look, name, share, verdict)) in self.coverage.iter().rev().enumerate() {
            let (row, end) = (row as f64, 100.0 * share);
            panel
                .area([(0.0, row - 0.3), (end, row - 0.3), (end, row + 0.3), (0.0, row + 0.3)], look.color.mix(0.4))?;
            let (x, y) = panel.at((0.0, row));
            canvas.text(&format!("{name}: {end:.0} %, {verdict}"), (x + 10.0, y), LABEL)?;
        }
        Ok(())
    }
}
