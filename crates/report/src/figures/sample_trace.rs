//! One trial per whisker: reading, motion and error over time.

use anyhow::Result;
use testbed::metrics::error;
use testbed::results::{EstimateRow, RunSet};

use crate::axes::{Axis, Panel, Rect, equal, without_dips};
use crate::canvas::{Canvas, Picture};
use crate::color::Rgb;
use crate::methods::look_of;
use crate::run_data::RunData;
use crate::style::{BLUE, INK, LegendEntry, Look, PURPLE, READING, STATED, VERMILION, legend};

/// Colours of the three coordinates of the base.
const MOTION: [(&str, Rgb); 3] = [("base x", BLUE), ("base y", VERMILION), ("base yaw", PURPLE)];
/// Relative heights of the rows: reading, position, yaw, error.
const ROWS: [f64; 4] = [1.0, 1.0, 0.6, 1.1];

/// A quantity over time.
type Series = Vec<(f64, f64)>;

/// One column of panels.
struct Trial {
    title: String,
    error_title: String,
    look: Look,
    touch_s: f64,
    end_s: f64,
    reading_un_m: Series,
    position_mm: [Series; 2],
    yaw_deg: Series,
    error_mm: Series,
    claimed_mm: Series,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let trials = data.of_leading_sets(trial)?;
    if trials.is_empty() {
        return Ok(None);
    }
    let all = |series: fn(&Trial) -> Vec<f64>| trials.iter().flat_map(series).collect::<Vec<f64>>();
    let rows = [
        Axis::around("reading (µN·m)", all(|trial| values(&trial.reading_un_m))),
        Axis::around("position (mm)", all(|trial| trial.position_mm.iter().flat_map(values).collect())),
        Axis::around("yaw (°)", all(|trial| values(&trial.yaw_deg))),
        Axis::logarithmic("contact error (mm)", without_dips(all(|trial| values(&trial.error_mm)))),
    ];

    let paint = move |canvas: &Canvas| {
        let mut entries: Vec<_> = MOTION.iter().map(|(name, color)| LegendEntry::line(name, *color, 1.75)).collect();
        entries.push(LegendEntry::line("stated standard deviation", STATED, 1.75));
        entries.push(LegendEntry::dashes("first touch", INK));
        legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, 64.0, 16.0, 48.0]);
        for (column, (trial, frame)) in trials.iter().zip(plot.columns(&equal(trials.len()), 26.0)).enumerate() {
            let frames = frame.rows(&ROWS, 36.0);
            let axis = |row: usize| if column == 0 { rows[row].clone() } else { rows[row].clone().bare() };
            trial.paint(canvas, &frames, axis)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 900, paint)))
}

fn values(series: &Series) -> Vec<f64> {
    series.iter().map(|(_, value)| *value).collect()
}

fn trial(data: &RunData, set: &RunSet, estimator: &str) -> Result<Option<Trial>> {
    let Some(scores) = data.typical_trial(set, estimator, &error::MEDIAN) else {
        return Ok(None);
    };
    let Some(rows) = data.estimates(&scores.head.trace, estimator)? else {
        return Ok(None);
    };
    let first = rows[0].clone();
    let series =
        |value: &dyn Fn(&EstimateRow) -> f64| -> Series { rows.iter().map(|row| (row.t_s, value(row))).collect() };
    Ok(Some(Trial {
        title: format!("{} whisker: {}", set.whisker, scores.head.trace),
        error_title: format!("error of {estimator}"),
        look: look_of(data, estimator),
        touch_s: scores.head.touch_s,
        end_s: rows[rows.len() - 1].t_s,
        reading_un_m: series(&|row| 1e6 * row.reading_n_m),
        position_mm: [
            series(&|row| 1e3 * (row.base_x_m - first.base_x_m)),
            series(&|row| 1e3 * (row.base_y_m - first.base_y_m)),
        ],
        yaw_deg: series(&|row| (row.base_yaw_rad - first.base_yaw_rad).to_degrees()),
        error_mm: series(&|row| 1e3 * row.contact_error_m().unwrap_or(f64::NAN)),
        claimed_mm: series(&|row| 1e3 * claimed_deviation_m(row).unwrap_or(f64::NAN)),
    }))
}

/// Root of the trace of the covariance: the RMS error that the estimator states.
fn claimed_deviation_m(row: &EstimateRow) -> Option<f64> {
    row.contact_x_m?;
    Some((row.cov_xx_m2? + row.cov_yy_m2?).sqrt())
}

impl Trial {
    fn paint(&self, canvas: &Canvas, frames: &[Rect], axis: impl Fn(usize) -> Axis) -> Result<()> {
        let time = Axis::linear("time (s)", 0.0, self.end_s);
        let titles = [
            self.title.as_str(),
            "position of the base since the start",
            "yaw of the base since the start",
            self.error_title.as_str(),
        ];
        let panel = |row: usize| {
            let time = if row + 1 == titles.len() { time.clone() } else { time.clone().bare() };
            Panel::new(canvas, frames[row], titles[row], time, axis(row))
        };
        let reading = panel(0)?;
        reading.line(self.reading_un_m.iter().copied(), READING, 1.0)?;
        let [(_, x_color), (_, y_color), (_, yaw_color)] = MOTION;
        let position = panel(1)?;
        for (series, color) in self.position_mm.iter().zip([x_color, y_color]) {
            position.line(series.iter().copied(), color, 1.75)?;
        }
        let yaw = panel(2)?;
        yaw.line(self.yaw_deg.iter().copied(), yaw_color, 1.75)?;
        let error = panel(3)?;
        error.line(self.claimed_mm.iter().copied(), STATED, 1.75)?;
        error.line(self.error_mm.iter().copied(), self.look.color, 1.5)?;
        for panel in [&reading, &position, &yaw, &error] {
            panel.instant(self.touch_s, INK)?;
        }
        Ok(())
    }
}
