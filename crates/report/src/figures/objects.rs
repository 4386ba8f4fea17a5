//! Contact error and mean distance of the estimated outline from the true one, on every object.

use anyhow::Result;
use testbed::metrics::{Metric, contour, error};
use testbed::results::RunSet;

use crate::axes::{Axis, Panel, Rect, equal};
use crate::canvas::{Align, Canvas, Picture};
use crate::methods::{self, Method};
use crate::run_data::RunData;
use crate::style::{LABEL, LegendEntry, Look, MARKER_PX, legend, plain};

/// One panel: a metric with one whisker.
struct Cell {
    title: String,
    groups: Vec<String>,
    /// (place of the group, place of the method, value in millimetres).
    dots: Vec<(usize, usize, f64)>,
}

/// Rows of panels: name, label of the axis and metric, a length.
const SHOWN: [(&str, &str, Metric); 2] = [
    ("contact", "RMS contact error (mm)", error::RMSE),
    ("outline", "mean distance of the outline (mm)", contour::MEAN),
];

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    methods::picture(data, picture)
}

fn picture(data: &RunData, methods: Vec<Method>) -> Result<Option<Picture>> {
    let mut whiskers: Vec<&str> = Vec::new();
    for set in &data.run.sets {
        if !whiskers.contains(&set.whisker.as_str()) {
            whiskers.push(&set.whisker);
        }
    }
    let rows: Vec<(&str, Vec<Cell>)> = SHOWN
        .into_iter()
        .map(|(name, label, metric)| {
            let cells = whiskers.iter().map(|whisker| cell(data, whisker, name, &metric, &methods));
            (label, cells.collect())
        })
        .collect();
    if rows.iter().any(|(_, cells)| cells.iter().all(|cell| cell.dots.is_empty())) {
        return Ok(None);
    }
    let paint = move |canvas: &Canvas| {
        let entries: Vec<_> =
            methods.iter().map(|method| LegendEntry::marker(&method.label, method.look, true)).collect();
        let below = legend(canvas, (60.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [64.0, below + 46.0, 16.0, 34.0]);
        for ((label, cells), frame) in rows.iter().zip(plot.rows(&equal(rows.len()), 66.0)) {
            let values = cells.iter().flat_map(|cell| cell.dots.iter().map(|dot| dot.2));
            let axis = Axis::logarithmic(label, values);
            for (column, (cell, frame)) in cells.iter().zip(frame.columns(&equal(cells.len()), 26.0)).enumerate() {
                let axis = if column == 0 { axis.clone() } else { axis.clone().bare() };
                cell.paint(canvas, frame, axis, methods.len())?;
            }
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 680, paint)))
}

fn cell(data: &RunData, whisker: &str, name: &str, metric: &Metric, methods: &[Method]) -> Cell {
    let sets: Vec<&RunSet> = data.run.sets.iter().filter(|set| set.whisker == whisker).collect();
    let mut dots = Vec::new();
    for (place, set) in sets.iter().enumerate() {
        for (index, method) in methods.iter().enumerate() {
            let value_m = data.summary_of(set, &method.name).and_then(|row| row.get(metric));
            dots.extend(value_m.map(|value_m| (place, index, 1e3 * value_m)));
        }
    }
    Cell {
        title: format!("{whisker} whisker: {name}"),
        groups: sets.iter().map(|set| plain(&set.group)).collect(),
        dots,
    }
}

impl Cell {
    fn paint(&self, canvas: &Canvas, frame: Rect, error: Axis, estimators: usize) -> Result<()> {
        let panel = Panel::new(canvas, frame, &self.title, Axis::places(self.groups.len()), error)?;
        for (place, group) in self.groups.iter().enumerate() {
            let (x, _) = panel.at((place as f64, 1.0));
            canvas.text(group, (x, frame.bottom + 15.0), LABEL.aligned(Align::Center))?;
            if place > 0 {
                panel.rule(place as f64 - 0.5)?;
            }
        }
        for &(place, index, value) in &self.dots {
            let shift = 0.7 * ((index as f64 + 0.5) / estimators as f64 - 0.5);
            let at = panel.at((place as f64 + shift, value));
            Look::of(index).mark(canvas, at, MARKER_PX + 1.0, true)?;
        }
        Ok(())
    }
}
