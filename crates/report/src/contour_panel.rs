//! Panels with estimated outlines over the true one.

use std::f64::consts::PI;

use anyhow::Result;
use testbed::results::VertexRow;
use testbed::statistics::NORMAL_95;

use crate::axes::{Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Lettering, Picture};
use crate::style::{CURVE_PX, FRAME, INK, LegendEntry, Look, OBJECT, PANEL_TITLE, SMALL, legend, stretch_end};

/// Points in millimetres of the world.
pub(crate) type Points = Vec<(f64, f64)>;

/// Least width and height of the view: a sharp corner is touched in one point.
const LEAST_VIEW_MM: f64 = 1.0;
/// Width of the touched part.
const TOUCHED_PX: f64 = 3.5;
/// Radius of the touched vertices.
const DOT_PX: f64 = 1.5;
/// Panels in a row, height of a panel and distance of panels.
const COLUMNS: usize = 3;
const PANEL_PX: u32 = 210;
const GAP_PX: u32 = 64;
/// Corners of half an ellipse.
const END_STEPS: u32 = 16;
/// Height of the title above a panel, without the lines of text below it, and of one of these.
const HEAD_PX: f64 = 24.0;
const LINE_PX: f64 = 15.0;

/// The outline estimated by one method.
pub(crate) struct Found {
    /// Label of the estimator.
    pub(crate) estimator: String,
    /// Annotation, line by line.
    pub(crate) words: Vec<String>,
    pub(crate) look: Look,
    line: Points,
    /// Touched vertices.
    touched: Points,
    /// The 95 % band, as a closed outline; empty without covariances.
    band: Points,
}

impl Found {
    /// The outline with these vertices.
    pub(crate) fn new(estimator: String, words: Vec<String>, look: Look, vertices: &[VertexRow]) -> Self {
        let place = |row: &VertexRow| (1e3 * row.x_m, 1e3 * row.y_m);
        Self {
            estimator,
            words,
            look,
            line: vertices.iter().map(place).collect(),
            touched: vertices.iter().filter(|row| row.touched).map(place).collect(),
            band: band(vertices).unwrap_or_default(),
        }
    }
}

/// The envelope of the vertices' 95 % ellipses: their outermost points, half of the last ellipse, their innermost
/// points and half of the first. `None` without covariances.
pub(crate) fn band(vertices: &[VertexRow]) -> Option<Points> {
    let farthest = |row: &VertexRow, turn_rad: f64| {
        let (sin, cos) = (row.normal_rad + turn_rad).sin_cos();
        let (xx, xy, yy) = (row.cov_xx_m2?, row.cov_xy_m2?, row.cov_yy_m2?);
        let (x_m2, y_m2) = (xx * cos + xy * sin, xy * cos + yy * sin);
        let per_sd = 1e3 * NORMAL_95 / (x_m2 * cos + y_m2 * sin).sqrt();
        Some((1e3 * row.x_m + per_sd * x_m2, 1e3 * row.y_m + per_sd * y_m2))
    };
    let end = |row: &VertexRow, from_rad: f64| -> Vec<_> {
        (1..END_STEPS).map(|i| farthest(row, from_rad + PI * f64::from(i) / f64::from(END_STEPS))).collect()
    };
    let outer = vertices.iter().map(|row| farthest(row, 0.0));
    let inner = vertices.iter().rev().map(|row| farthest(row, PI));
    outer.chain(end(vertices.last()?, 0.0)).chain(inner).chain(end(vertices.first()?, PI)).collect()
}

/// One panel.
pub(crate) struct ContourPanel {
    pub(crate) title: String,
    /// The true outline, closed; empty if unknown.
    pub(crate) outline: Points,
    /// The touched part of it, from one end to the other; empty if unknown.
    pub(crate) touched: Points,
    pub(crate) found: Vec<Found>,
}

/// Lays panels out under a legend. `None` without panels.
pub(crate) fn picture(panels: Vec<ContourPanel>) -> Option<Picture> {
    if panels.is_empty() {
        return None;
    }
    let columns = panels.len().min(COLUMNS);
    let rows = panels.len().div_ceil(columns);
    let lines = panels.iter().map(|panel| panel.words().count()).max().unwrap_or(0);
    let head_px = HEAD_PX + LINE_PX * lines as f64;
    let mut looks: Vec<(String, Look)> = Vec::new();
    for found in panels.iter().flat_map(|panel| &panel.found) {
        if !looks.iter().any(|(name, _)| *name == found.estimator) {
            looks.push((found.estimator.clone(), found.look));
        }
    }
    let gap_px = f64::from(GAP_PX) + head_px;
    let height_px = 44.0 + head_px + f64::from(rows as u32 * PANEL_PX) + (rows - 1) as f64 * gap_px + 48.0;
    let has_truth = panels.iter().any(|panel| !panel.outline.is_empty());
    let is_touch_known = panels.iter().any(|panel| !panel.touched.is_empty());
    let paint = move |canvas: &Canvas| {
        let mut entries = Vec::new();
        if has_truth {
            entries.push(LegendEntry::line("true outline", FRAME, 1.5));
        }
        if is_touch_known {
            entries.push(LegendEntry::stretch("touched part", INK, TOUCHED_PX));
        }
        entries.extend(looks.iter().map(|(name, look)| LegendEntry::line(name, look.color, CURVE_PX)));
        legend(canvas, (56.0, 18.0), &entries)?;
        let plot = Rect::inside(canvas, [60.0, 44.0 + head_px, 14.0, 48.0]);
        let frames = plot.rows(&equal(rows), gap_px).into_iter().flat_map(|row| row.columns(&equal(columns), 44.0));
        for (index, (panel, frame)) in panels.iter().zip(frames).enumerate() {
            let x_name = if index + columns >= panels.len() { "x (mm)" } else { "" };
            let y_name = if index % columns == 0 { "y (mm)" } else { "" };
            panel.paint(canvas, frame, (x_name, y_name))?;
        }
        Ok(())
    };
    Some(Picture::new(1200, height_px as u32, paint))
}

impl ContourPanel {
    /// Annotations of the outlines, line by line.
    fn words(&self) -> impl Iterator<Item = (&str, Look)> {
        self.found.iter().flat_map(|found| found.words.iter().map(|line| (line.as_str(), found.look)))
    }

    fn paint(&self, canvas: &Canvas, frame: Rect, labels: (&str, &str)) -> Result<()> {
        let near = || self.touched.iter().chain(self.found.iter().flat_map(|found| &found.line));
        let (left, right) = extent(near().map(|point| point.0)).unwrap_or((-1.0, 1.0));
        let (low, high) = extent(near().map(|point| point.1)).unwrap_or((-1.0, 1.0));
        let half = |from: f64, to: f64| 0.5 * (1.16 * (to - from)).max(LEAST_VIEW_MM);
        let (x, y) = (0.5 * (left + right), 0.5 * (low + high));
        let (wide, tall) = (half(left, right), half(low, high));
        let panel = Panel::with_equal_scales(canvas, frame, "", labels, [x - wide, x + wide, y - tall, y + tall])?;
        let head_px = HEAD_PX + LINE_PX * self.words().count() as f64;
        let line_at = |line: usize| (frame.left, frame.top - head_px + 8.0 + LINE_PX * line as f64);
        canvas.text(&self.title, line_at(0), PANEL_TITLE)?;
        for (index, (words, look)) in self.words().enumerate() {
            canvas.text(words, line_at(index + 1), Lettering { color: look.color, ..SMALL })?;
        }
        panel.area(self.outline.iter().copied(), OBJECT)?;
        panel.line(self.outline.iter().copied(), FRAME, 1.5)?;
        panel.line(self.touched.iter().copied(), INK, TOUCHED_PX)?;
        for end in self.touched.first().into_iter().chain(self.touched.last()) {
            stretch_end(canvas, panel.at(*end), INK)?;
        }
        for found in &self.found {
            panel.area(found.band.iter().copied(), found.look.color.mix(0.25))?;
        }
        for found in &self.found {
            panel.line(found.line.iter().copied(), found.look.color, CURVE_PX)?;
            panel.discs(found.touched.iter().copied(), DOT_PX, found.look.color)?;
        }
        Ok(())
    }
}
