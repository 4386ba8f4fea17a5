//! RMS error of every trial in start-up and steady state, and its ratio to that of the baseline in the latter.

use anyhow::Result;
use testbed::statistics::median_of_scores;

use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Align, Canvas, Picture};
use crate::compare::{Phase, factor_over_baseline, format_factor, phase_errors};
use crate::methods::{self, Method};
use crate::run_data::RunData;
use crate::style::{INK, LABEL, Look, PANEL_TITLE, SMALL, plain};

/// Height of the row of one estimator.
const ROW_PX: u32 = 34;

/// One estimator in one panel.
struct Strip {
    label: String,
    look: Look,
    errors_mm: Vec<f64>,
    /// Number of trials without a score.
    missing: usize,
    factor: Option<f64>,
}

impl Strip {
    /// Median over all trials, of which those without a score count as the largest.
    fn median_mm(&self) -> Option<f64> {
        let scores = self.errors_mm.iter().copied().map(Some);
        median_of_scores(scores.chain(std::iter::repeat_n(None, self.missing)))
    }
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    methods::picture(data, picture)
}

fn picture(data: &RunData, methods: Vec<Method>) -> Result<Option<Picture>> {
    let sets = data.leading_sets();
    let panels: Vec<Vec<(String, Vec<Strip>)>> = Phase::ALL
        .into_iter()
        .map(|phase| {
            sets.iter()
                .map(|set| {
                    let strip = |method: &Method| {
                        let errors_mm: Vec<f64> =
                            phase_errors(data, set, &method.name, phase).map(|error| 1e3 * error).collect();
                        Strip {
                            label: method.label.clone(),
                            look: method.look,
                            missing: data.trials_of(set, &method.name).len() - errors_mm.len(),
                            errors_mm,
                            // In start-up the dots of filter and baseline cover different times, the factor common ones.
                            factor: match phase {
                                Phase::Start => None,
                                Phase::Steady => factor_over_baseline(data, set, &method.name, phase),
                            },
                        }
                    };
                    let title = format!("{} whisker, {}: {}", set.whisker, plain(&set.group), phase.words());
                    (title, methods.iter().map(strip).collect())
                })
                .collect()
        })
        .collect();
    let errors: Vec<f64> = panels
        .iter()
        .flatten()
        .flat_map(|(_, strips)| strips.iter().flat_map(|strip| strip.errors_mm.clone()))
        .collect();
    if errors.is_empty() {
        return Ok(None);
    }
    let axis = Axis::logarithmic("RMS contact error (mm)", errors);
    let rows = methods.len();

    let paint = move |canvas: &Canvas| {
        let mut names_px = 0.0f64;
        for (_, strips) in panels.iter().flatten() {
            for strip in strips {
                names_px = names_px.max(canvas.text_width_px(&strip.label, LABEL));
            }
        }
        let plot = Rect::inside(canvas, [names_px + 32.0, 36.0, 8.0, 48.0]);
        for (row, (frame, panels)) in plot.rows(&equal(2), 62.0).into_iter().zip(&panels).enumerate() {
            let columns = frame.columns(&equal(panels.len()), 26.0);
            for (column, (frame, (title, strips))) in columns.into_iter().zip(panels).enumerate() {
                let axis = if row == 0 { axis.clone().unnamed() } else { axis.clone() };
                paint_panel(canvas, frame, title, axis, strips, column == 0)?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 36 + 48 + 62 + 2 * (rows as u32 * ROW_PX + 10), paint)))
}

fn paint_panel(canvas: &Canvas, frame: Rect, title: &str, axis: Axis, strips: &[Strip], named: bool) -> Result<()> {
    let rows = Axis::places(strips.len());
    let split = frame.columns(&[1.0, 0.13], 0.0);
    let panel = Panel::new(canvas, split[0], title, axis, rows)?;
    let factors_x = 0.5 * (split[1].left + split[1].right);
    if strips.iter().any(|strip| strip.factor.is_some()) {
        canvas.text("factor", (factors_x, frame.top - 13.0), PANEL_TITLE.aligned(Align::Center))?;
    }
    // The first estimator is at the top.
    for (row, strip) in strips.iter().rev().enumerate() {
        let row = row as f64;
        for (index, error) in strip.errors_mm.iter().enumerate() {
            // Trials of equal error would hide each other on one line.
            let offset = (index % 5) as f64 * 0.1 - 0.2;
            panel.discs([(*error, row + offset)], 3.2, strip.look.color.mix(0.55))?;
        }
        let (_, y) = panel.at((1.0, row));
        if let Some(middle) = strip.median_mm() {
            panel.line([(middle, row - 0.34), (middle, row + 0.34)], INK, 2.5)?;
        }
        if let Some(factor) = strip.factor {
            let text = format_factor(factor);
            canvas.text(&text, (factors_x, y), LABEL.aligned(Align::Center))?;
        }
        if named {
            canvas.text(&strip.label, (frame.left - 24.0, y), LABEL.aligned(Align::Right))?;
            strip.look.mark(canvas, (frame.left - 12.0, y), 4.0, true)?;
        }
        if strip.errors_mm.is_empty() {
            let lettering = SMALL.aligned(Align::Center);
            canvas.text("no score", (0.5 * (split[0].left + split[0].right), y), lettering)?;
        } else if strip.missing > 0 {
            let trials = strip.errors_mm.len() + strip.missing;
            let text = format!("{} of {trials} without a score", strip.missing);
            // On the side with fewer errors.
            let middle_x = 0.5 * (split[0].left + split[0].right);
            let left = strip.errors_mm.iter().filter(|error| panel.at((**error, row)).0 < middle_x).count();
            let (x, align) = match 2 * left > strip.errors_mm.len() {
                true => (split[0].right - 6.0, Align::Right),
                false => (split[0].left + 6.0, Align::Left),
            };
            canvas.text(&text, (x, y), SMALL.aligned(align))?;
        }
    }
    Ok(())
}
