//! Panels: a pair of axes and the curves, areas and markers between them, clipped to their frame.

use std::iter;

use anyhow::Result;

use super::canvas::{Align, Canvas, Px};
use super::color::{Rgb, Rgba};
use super::style::{FINE_GRID, FRAME, GRID, HAIRLINE_PX, LABEL, Look, MARKER_PX, PANEL_TITLE, SMALL};

/// Distance by which [`Panel::tile`] moves corners outwards along either axis, in CSS pixels.
const TILE_GROWTH_PX: f64 = 0.4;

/// Least distance of the vertical axis' name from the frame; larger beside long numbers.
const LEAST_NAME_PX: f64 = 46.0;

/// Fewest numbers along an axis.
const LEAST_TICKS: usize = 3;

/// A rectangle in CSS pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rect {
    /// Left edge.
    pub(crate) left: f64,
    /// Upper edge.
    pub(crate) top: f64,
    /// Right edge.
    pub(crate) right: f64,
    /// Lower edge.
    pub(crate) bottom: f64,
}

impl Rect {
    /// The whole canvas less margins (left, top, right, bottom).
    pub(crate) fn inside(canvas: &Canvas, margins: [f64; 4]) -> Self {
        Self {
            left: margins[0],
            top: margins[1],
            right: canvas.width_px() - margins[2],
            bottom: canvas.height_px() - margins[3],
        }
    }

    /// Width over height.
    pub(crate) fn aspect(&self) -> f64 {
        (self.right - self.left) / (self.bottom - self.top)
    }

    /// Cuts the rectangle into columns of the given relative widths, `gap` apart.
    pub(crate) fn columns(&self, weights: &[f64], gap: f64) -> Vec<Self> {
        split(self.left, self.right, weights, gap).map(|(left, right)| Self { left, right, ..*self }).collect()
    }

    /// Cuts the rectangle into rows of the given relative heights, `gap` apart.
    pub(crate) fn rows(&self, weights: &[f64], gap: f64) -> Vec<Self> {
        split(self.top, self.bottom, weights, gap).map(|(top, bottom)| Self { top, bottom, ..*self }).collect()
    }

    fn contains(&self, (x, y): Px) -> bool {
        (self.left..=self.right).contains(&x) && (self.top..=self.bottom).contains(&y)
    }
}

fn split(from: f64, to: f64, weights: &[f64], gap: f64) -> impl Iterator<Item = (f64, f64)> {
    let unit = (to - from - gap * (weights.len() as f64 - 1.0)) / weights.iter().sum::<f64>();
    weights.iter().scan(from, move |start, weight| {
        let span = (*start, *start + weight * unit);
        *start = span.1 + gap;
        Some(span)
    })
}

/// Equal weights for [`Rect::columns`] and [`Rect::rows`].
pub(crate) fn equal(count: usize) -> Vec<f64> {
    vec![1.0; count]
}

/// One axis of a panel.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// Quantity and unit; empty if a neighbour carries the name.
    label: String,
    from: f64,
    to: f64,
    logarithmic: bool,
    numbered: bool,
    grid: bool,
    /// The values with a number, unless the axis chooses them.
    marks: Option<Vec<f64>>,
}

impl Axis {
    /// A linear axis from `from` to `to`.
    pub(crate) fn linear(label: &str, from: f64, to: f64) -> Self {
        Self { label: label.to_owned(), from, to, logarithmic: false, numbered: true, grid: true, marks: None }
    }

    /// A linear axis that holds all finite values with 5 % to spare on either side.
    pub(crate) fn around(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (from, to) = extent(values).unwrap_or((0.0, 1.0));
        let spare = if to > from { 0.05 * (to - from) } else { 0.5 * from.abs().max(1.0) };
        Self::linear(label, from - spare, to + spare)
    }

    /// A logarithmic axis that holds all positive values, from a 1, 2 or 5 to a 1, 2 or 5.
    pub(crate) fn logarithmic(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let positive = values.into_iter().filter(|value| *value > 0.0);
        let (from, to) = extent(positive).unwrap_or((0.1, 10.0));
        let decade = |value: f64| 10f64.powf(value.log10().floor());
        let steps = |value: f64| [1.0, 2.0, 5.0, 10.0].map(|step| step * decade(value));
        // 8 % to spare, so that no marker lies on the frame.
        let (from, to) = (from / 1.08, to * 1.08);
        let lower = steps(from).into_iter().rfind(|step| *step <= from);
        let upper = steps(to).into_iter().find(|step| *step >= to);
        let (from, to) = (lower.unwrap_or(from), upper.unwrap_or(to));
        Self::logarithmic_between(label, from, if to > from { to } else { 2.0 * from })
    }

    /// A logarithmic axis from `from` to `to`, both positive.
    pub(crate) fn logarithmic_between(label: &str, from: f64, to: f64) -> Self {
        Self { logarithmic: true, ..Self::linear(label, from, to) }
    }

    /// A logarithmic axis that holds the positive values and has a number at each of them and nowhere else.
    pub(crate) fn marked(label: &str, mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        values.dedup();
        let (first, last) = extent(values.iter().copied()).unwrap_or((1.0, 10.0));
        // A tenth of the axis to spare on either side.
        let spare = (last / first).powf(0.1);
        Self {
            from: first / spare,
            to: last * spare,
            logarithmic: true,
            marks: Some(values),
            ..Self::linear(label, 0.0, 1.0)
        }
    }

    /// An axis with places 0, 1 .. for `count` categories, without grid and numbers.
    pub(crate) fn places(count: usize) -> Self {
        Self { grid: false, ..Self::linear("", -0.5, count as f64 - 0.5).bare() }
    }

    /// The same axis without name and numbers, because the neighbouring panel carries them.
    pub(crate) fn bare(mut self) -> Self {
        self.label.clear();
        self.numbered = false;
        self
    }

    /// The same axis with numbers but without a name.
    pub(crate) fn unnamed(mut self) -> Self {
        self.label.clear();
        self
    }

    /// Position of the value between the ends: 0 to 1.
    fn fraction(&self, value: f64) -> f64 {
        if self.logarithmic {
            (value / self.from).ln() / (self.to / self.from).ln()
        } else {
            (value - self.from) / (self.to - self.from)
        }
    }

    /// Grid values with their numbers, about `count` of them on a linear axis and at least three, so that the scale can be
    /// read.
    pub(crate) fn ticks(&self, count: f64) -> Vec<(f64, String)> {
        if !self.grid {
            return Vec::new();
        }
        if let Some(marks) = &self.marks {
            return marks.iter().map(|&value| (value, format_log(value))).collect();
        }
        if self.logarithmic {
            let few_decades = self.decade_steps().filter(|(step, _)| *step == 1).count() < LEAST_TICKS;
            return self
                .decade_steps()
                .filter(|(step, _)| *step == 1 || (few_decades && [2, 5].contains(step)))
                .map(|(_, value)| (value, format_log(value)))
                .collect();
        }
        // The next finer of the round steps is 0.4 or 0.5 of one.
        let steps =
            iter::successors(Some(round_step((self.to - self.from) / count)), |step| Some(round_step(0.4 * step)));
        let mut numbers = steps.take(3).map(|step| self.multiples(step));
        numbers.find(|numbers| numbers.len() >= LEAST_TICKS).unwrap_or_default()
    }

    /// The multiples of a step on a linear axis with their numbers.
    fn multiples(&self, step: f64) -> Vec<(f64, String)> {
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let first = (self.from / step - 1e-9).ceil() as i64;
        let last = (self.to / step + 1e-9).floor() as i64;
        (first..=last)
            .map(|index| {
                let value = index as f64 * step;
                (value, format!("{value:.decimals$}").replace('-', "−"))
            })
            .collect()
    }

    /// Values between the numbered ones; none on a linear axis.
    fn fine_ticks(&self) -> Vec<f64> {
        if !self.logarithmic || self.marks.is_some() {
            return Vec::new();
        }
        self.decade_steps().map(|(_, value)| value).collect()
    }

    /// The values 1, 2 .. 9 times a power of ten on the axis, with that factor.
    fn decade_steps(&self) -> impl Iterator<Item = (i32, f64)> {
        let exponents = (self.from.log10().floor() as i32)..=(self.to.log10().ceil() as i32);
        let (from, to) = (self.from * (1.0 - 1e-9), self.to * (1.0 + 1e-9));
        exponents
            .flat_map(|exponent| (1..10).map(move |step| (step, f64::from(step) * 10f64.powi(exponent))))
            .filter(move |(_, value)| (from..=to).contains(value))
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is not below the step.
fn round_step(step: f64) -> f64 {
    let decade = 10f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * decade >= step * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * decade
}

fn format_log(value: f64) -> String {
    let decimals = (-value.log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

/// The smallest and largest finite value.
pub(crate) fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values.into_iter().filter(|value| value.is_finite()).fold(None, |extent, value| match extent {
        None => Some((value, value)),
        Some((low, high)) => Some((value.min(low), value.max(high))),
    })
}

/// The finite values without the smallest 2 %, so that a logarithmic axis does not extend to the zero crossings of an error.
pub(crate) fn without_dips(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.split_off(sorted.len() / 50)
}

/// A pair of axes with a frame. Everything is given in data coordinates; a point that is not finite interrupts a line.
pub(crate) struct Panel<'a> {
    canvas: &'a Canvas,
    frame: Rect,
    x: Axis,
    y: Axis,
}

impl<'a> Panel<'a> {
    /// Draws grid, frame, numbers, names (outside the frame) and the title (above it).
    pub(crate) fn new(canvas: &'a Canvas, frame: Rect, title: &str, x: Axis, y: Axis) -> Result<Self> {
        let panel = Self { canvas, frame, x, y };
        panel.draw_axes()?;
        canvas.text(title, (frame.left, frame.top - 13.0), PANEL_TITLE)?;
        Ok(panel)
    }

    /// A panel with one scale on both axes that shows the whole box (x from, to, y from, to).
    pub(crate) fn with_equal_scales(
        canvas: &'a Canvas,
        frame: Rect,
        title: &str,
        labels: (&str, &str),
        bounds: [f64; 4],
    ) -> Result<Self> {
        let [left, right, low, high] = bounds;
        let height = (high - low).max((right - left) / frame.aspect());
        let width = height * frame.aspect();
        let (x, y) = (0.5 * (left + right), 0.5 * (low + high));
        Self::new(
            canvas,
            frame,
            title,
            Axis::linear(labels.0, x - 0.5 * width, x + 0.5 * width),
            Axis::linear(labels.1, y - 0.5 * height, y + 0.5 * height),
        )
    }

    fn draw_axes(&self) -> Result<()> {
        let Rect { left, top, right, bottom } = self.frame;
        let x_ticks = self.x.ticks((right - left) / 75.0);
        let y_ticks = self.y.ticks((bottom - top) / 45.0);
        for (values, color) in [(self.x.fine_ticks(), FINE_GRID), (values_of(&x_ticks), GRID)] {
            for value in values {
                let x = self.x_at(value);
                self.canvas.line(&[(x, top), (x, bottom)], color, HAIRLINE_PX)?;
            }
        }
        for (values, color) in [(self.y.fine_ticks(), FINE_GRID), (values_of(&y_ticks), GRID)] {
            for value in values {
                let y = self.y_at(value);
                self.canvas.line(&[(left, y), (right, y)], color, HAIRLINE_PX)?;
            }
        }
        let corners = [(left, top), (left, bottom), (right, bottom), (right, top), (left, top)];
        self.canvas.line(&corners, FRAME, HAIRLINE_PX)?;
        if self.x.numbered {
            for (value, number) in &x_ticks {
                let x = self.x_at(*value);
                let anchor = (x, bottom + 13.0);
                self.canvas.text(number, anchor, SMALL.aligned(Align::Center))?;
            }
        }
        let mut name_px = LEAST_NAME_PX;
        if self.y.numbered {
            for (value, number) in &y_ticks {
                let y = self.y_at(*value);
                let anchor = (left - 6.0, y);
                self.canvas.text(number, anchor, SMALL.aligned(Align::Right))?;
                name_px = name_px.max(self.canvas.text_width_px(number, SMALL) + 18.0);
            }
        }
        let below = (0.5 * (left + right), bottom + 32.0);
        self.canvas.text(&self.x.label, below, LABEL.aligned(Align::Center))?;
        let beside = (left - name_px, 0.5 * (top + bottom));
        self.canvas.text(&self.y.label, beside, LABEL.aligned(Align::Upwards))
    }

    /// Position of a data point on the canvas.
    pub(crate) fn at(&self, (x, y): (f64, f64)) -> Px {
        (self.x_at(x), self.y_at(y))
    }

    fn x_at(&self, value: f64) -> f64 {
        self.frame.left + self.x.fraction(value) * (self.frame.right - self.frame.left)
    }

    fn y_at(&self, value: f64) -> f64 {
        self.frame.bottom - self.y.fraction(value) * (self.frame.bottom - self.frame.top)
    }

    /// The ends of a horizontal line across the panel.
    pub(crate) fn across(&self, y: f64) -> [(f64, f64); 2] {
        [(self.x.from, y), (self.x.to, y)]
    }

    /// A line through the points.
    pub(crate) fn line(
        &self,
        points: impl IntoIterator<Item = (f64, f64)>,
        color: impl Into<Rgba>,
        width_px: f64,
    ) -> Result<()> {
        let color = color.into();
        let path: Vec<Px> = points.into_iter().map(|point| self.at(point)).collect();
        for run in clip_line(&path, &self.frame) {
            self.canvas.line(&run, color, width_px)?;
        }
        Ok(())
    }

    /// A line with markers every `spacing_px` of its width, the first after `offset_px`.
    pub(crate) fn marked_line(
        &self,
        points: &[(f64, f64)],
        look: Look,
        width_px: f64,
        (offset_px, spacing_px): (f64, f64),
    ) -> Result<()> {
        self.line(points.iter().copied(), look.color, width_px)?;
        let mut next = self.frame.left + offset_px;
        for &point in points {
            let at = self.at(point);
            if at.0 >= next && self.frame.contains(at) {
                look.mark(self.canvas, at, MARKER_PX, true)?;
                next = at.0 + spacing_px;
            }
        }
        Ok(())
    }

    /// A filled polygon.
    pub(crate) fn area(&self, corners: impl IntoIterator<Item = (f64, f64)>, color: impl Into<Rgba>) -> Result<()> {
        let corners: Vec<Px> = corners.into_iter().map(|corner| self.at(corner)).collect();
        let clipped = clip_polygon(corners, &self.frame);
        if clipped.len() < 3 {
            return Ok(());
        }
        self.canvas.polygon(&clipped, color)
    }

    /// A polygon of a mosaic: grown a little, so that no seam shows beside its neighbours.
    pub(crate) fn tile(&self, corners: [(f64, f64); 4], color: impl Into<Rgba>) -> Result<()> {
        let corners = corners.map(|corner| self.at(corner));
        let sum = corners.iter().fold((0.0, 0.0), |sum, corner| (sum.0 + corner.0, sum.1 + corner.1));
        let center = (0.25 * sum.0, 0.25 * sum.1);
        let grown = corners
            .map(|(x, y)| (x + TILE_GROWTH_PX * (x - center.0).signum(), y + TILE_GROWTH_PX * (y - center.1).signum()));
        self.canvas.polygon(&grown, color)
    }

    /// The area between a lower and an upper curve, given as (x, lower, upper).
    pub(crate) fn band(&self, rows: &[(f64, f64, f64)], color: impl Into<Rgba>) -> Result<()> {
        let upper = rows.iter().map(|(x, _, high)| (*x, *high));
        let lower = rows.iter().rev().map(|(x, low, _)| (*x, *low));
        self.area(upper.chain(lower), color)
    }

    /// Small discs at those points that lie in the frame; of neighbours within half a pixel only the first is drawn.
    pub(crate) fn discs(
        &self,
        points: impl IntoIterator<Item = (f64, f64)>,
        radius_px: f64,
        color: impl Into<Rgba>,
    ) -> Result<()> {
        let color = color.into();
        let mut last = (f64::NAN, f64::NAN);
        for at in points.into_iter().map(|point| self.at(point)) {
            let hidden = (at.0 - last.0).hypot(at.1 - last.1) < 0.5;
            if self.frame.contains(at) && !hidden {
                self.canvas.disc(at, radius_px, color)?;
                last = at;
            }
        }
        Ok(())
    }

    /// A dashed line across the whole panel at a height, with a word to the right of the frame.
    pub(crate) fn level(&self, y: f64, word: &str, color: Rgb) -> Result<()> {
        let height = self.y_at(y);
        let Rect { left, top, right, bottom } = self.frame;
        if !(top..=bottom).contains(&height) {
            return Ok(());
        }
        self.canvas.dashes((left, height), (right, height), color)?;
        self.canvas.text(word, (right + 6.0, height), SMALL)
    }

    /// A dashed line between two points.
    pub(crate) fn dashes(&self, from: (f64, f64), to: (f64, f64), color: Rgb) -> Result<()> {
        match clip_segment(self.at(from), self.at(to), &self.frame) {
            Some((from, to)) => self.canvas.dashes(from, to, color),
            None => Ok(()),
        }
    }

    /// A marker at every point in the frame; `filled` or only its outline.
    pub(crate) fn marks(&self, points: &[(f64, f64)], look: Look, filled: bool) -> Result<()> {
        let inside = points.iter().map(|&point| self.at(point)).filter(|at| self.frame.contains(*at));
        inside.into_iter().try_for_each(|at| look.mark(self.canvas, at, MARKER_PX, filled))
    }

    /// The outline of a marker on the upper edge of the frame, for each of some values beyond all numbers.
    pub(crate) fn marks_on_top(&self, places: impl IntoIterator<Item = f64>, look: Look) -> Result<()> {
        let points: Vec<(f64, f64)> = places.into_iter().map(|x| (x, self.y.to)).collect();
        self.marks(&points, look, false)
    }

    /// A grid line from bottom to top.
    pub(crate) fn rule(&self, x: f64) -> Result<()> {
        let across = self.x_at(x);
        let ends = [(across, self.frame.top + HAIRLINE_PX), (across, self.frame.bottom - HAIRLINE_PX)];
        self.canvas.line(&ends, GRID, HAIRLINE_PX)
    }

    /// A dashed line from bottom to top at an instant.
    pub(crate) fn instant(&self, x: f64, color: Rgb) -> Result<()> {
        let across = self.x_at(x);
        let ends = ((across, self.frame.top), (across, self.frame.bottom));
        self.canvas.dashes(ends.0, ends.1, color)
    }
}

fn values_of(ticks: &[(f64, String)]) -> Vec<f64> {
    ticks.iter().map(|(value, _)| *value).collect()
}

/// The parts of a path inside the rectangle (Liang and Barsky, ACM Trans. Graphics 3, 1984). A point that is not finite
/// interrupts the path.
fn clip_line(path: &[Px], frame: &Rect) -> Vec<Vec<Px>> {
    let mut runs: Vec<Vec<Px>> = Vec::new();
    for pair in path.windows(2) {
        let Some((from, to)) = clip_segment(pair[0], pair[1], frame) else {
            continue;
        };
        match runs.last_mut() {
            Some(run) if run.last() == Some(&from) => run.push(to),
            _ => runs.push(vec![from, to]),
        }
    }
    runs
}

fn clip_segment(from: Px, to: Px, frame: &Rect) -> Option<(Px, Px)> {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    if !(dx.is_finite() && dy.is_finite()) {
        return None;
    }
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for (towards, room) in
        [(-dx, from.0 - frame.left), (dx, frame.right - from.0), (-dy, from.1 - frame.top), (dy, frame.bottom - from.1)]
    {
        if towards == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if towards < 0.0 {
            enter = enter.max(room / towards);
        } else {
            leave = leave.min(room / towards);
        }
    }
    let point = |share: f64| (from.0 + share * dx, from.1 + share * dy);
    let start = if enter > 0.0 { point(enter) } else { from };
    let end = if leave < 1.0 { point(leave) } else { to };
    (enter <= leave).then_some((start, end))
}

/// The part of a polygon inside the rectangle (Sutherland and Hodgman, Comm. ACM 17, 1974).
fn clip_polygon(corners: Vec<Px>, frame: &Rect) -> Vec<Px> {
    // Signed distances to the four edges, positive inside.
    let edges: [fn(Px, &Rect) -> f64; 4] = [
        |(x, _), frame| x - frame.left,
        |(x, _), frame| frame.right - x,
        |(_, y), frame| y - frame.top,
        |(_, y), frame| frame.bottom - y,
    ];
    let finite = corners.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite());
    edges.iter().fold(finite.collect(), |corners: Vec<Px>, inside| {
        let mut kept = Vec::with_capacity(corners.len() + 4);
        for (index, &corner) in corners.iter().enumerate() {
            let before = corners[(index + corners.len() - 1) % corners.len()];
            let (d_before, d_here) = (inside(before, frame), inside(corner, frame));
            if (d_before < 0.0) != (d_here < 0.0) {
                let share = d_before / (d_before - d_here);
                kept.push((before.0 + share * (corner.0 - before.0), before.1 + share * (corner.1 - before.1)));
            }
            if d_here >= 0.0 {
                kept.push(corner);
            }
        }
        kept
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Rect = Rect { left: 0.0, top: 0.0, right: 1.0, bottom: 1.0 };

    #[test]
    fn verif_a_line_is_cut_at_the_frame_and_at_gaps() {
        let path = [(-1.0, 0.5), (0.5, 0.5), (2.0, 0.5), (f64::NAN, 0.0), (0.2, 0.2), (0.2, 0.4)];
        let expected = vec![vec![(0.0, 0.5), (0.5, 0.5), (1.0, 0.5)], vec![(0.2, 0.2), (0.2, 0.4)]];
        assert_eq!(clip_line(&path, &UNIT), expected);
        assert!(clip_line(&[(-1.0, 2.0), (2.0, 2.0)], &UNIT).is_empty());
    }

    #[test]
    fn verif_a_polygon_is_cut_at_the_frame() {
        let around = vec![(-1.0, -1.0), (2.0, -1.0), (2.0, 0.5), (-1.0, 0.5)];
        let mut clipped = clip_polygon(around, &UNIT);
        clipped.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
        assert_eq!(clipped, [(0.0, 0.0), (0.0, 0.5), (1.0, 0.0), (1.0, 0.5)]);
        let outside = vec![(2.0, 2.0), (3.0, 2.0), (3.0, 3.0)];
        assert!(clip_polygon(outside, &UNIT).is_empty());
    }

    #[test]
    fn verif_ticks_are_round_numbers() {
        let numbers =
            |axis: Axis, count| -> Vec<String> { axis.ticks(count).into_iter().map(|(_, number)| number).collect() };
        assert_eq!(numbers(Axis::linear("", -0.5, 1.0), 3.0), ["−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(numbers(Axis::linear("", 0.0, 40.0), 4.0), ["0", "10", "20", "30", "40"]);
        assert_eq!(numbers(Axis::linear("", -13.1, -4.9), 2.0), ["−12", "−10", "−8", "−6"]);
        assert_eq!(numbers(Axis::logarithmic("", [0.03, 8.0]), 0.0), ["0.1", "1", "10"]);
        assert_eq!(numbers(Axis::logarithmic("", [0.3, 1.5]), 0.0), ["0.2", "0.5", "1", "2"]);
    }

    #[test]
    fn verif_rows_and_columns_fill_the_rectangle() {
        let columns = UNIT.columns(&[1.0, 3.0], 0.2);
        assert_eq!(columns.len(), 2);
        assert!((columns[0].right - 0.2).abs() < 1e-12);
        assert!((columns[1].left - 0.4).abs() < 1e-12);
        assert!((columns[1].right - 1.0).abs() < 1e-12);
    }
}
