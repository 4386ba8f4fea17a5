//! The calibrated map from contact to reading and its residuals.

use anyhow::Result;
use testbed::results::{ResidualRow, SurfaceRow};

use crate::axes::{Axis, Panel, Rect, equal, extent};
use crate::canvas::{Canvas, Picture};
use crate::color::{Rgb, viridis};
use crate::run_data::RunData;
use crate::style::{INK, Look, MUTED, SMALL, two_digits};

/// Cells of the map: at most along the whisker, where the reading changes slowly, and across it.
const MAP_CELLS: (usize, usize) = (40, 40);
/// Lines of equal reading in a panel.
const ISOLINES: usize = 9;

/// A node of the model's grid: x and y in millimetres, reading in µN·m, distance from the undeflected whisker.
#[derive(Clone, Copy)]
struct Node {
    at: (f64, f64),
    reading: f64,
    distance_m: f64,
}

/// One calibration.
struct Model {
    title: String,
    residual_title: String,
    /// Lines of nodes across the whisker, from root to tip.
    grid: Vec<Vec<Node>>,
    /// The map between them.
    cells: Vec<[Node; 4]>,
    /// (reading in µN·m, residual in percent of the largest reading).
    residuals: Vec<(f64, f64)>,
}

/// Lays the figure out.
pub(crate) fn draw(data: &RunData) -> Result<Option<Picture>> {
    let mut models = Vec::new();
    for calibration in &data.run.calibrations {
        let Some(surface) = data.surface(calibration)? else {
            continue;
        };
        let largest = calibration.largest_reading_n_m;
        let residuals = data.residuals(calibration)?.unwrap_or_default();
        let grid = grid(&surface);
        models.push(Model {
            title: format!("{} whisker, {} face", calibration.whisker, calibration.face),
            residual_title: format!(
                "held-out residuals: {} % RMS, {} % worst",
                two_digits(100.0 * calibration.heldout_rms_n_m / largest),
                two_digits(100.0 * calibration.heldout_worst_n_m / largest)
            ),
            cells: cells(&grid),
            grid,
            residuals: residuals
                .iter()
                .map(|row: &ResidualRow| (1e6 * row.reading_n_m, 100.0 * row.residual_n_m / largest))
                .collect(),
        });
    }
    if models.is_empty() {
        return Ok(None);
    }
    let rows = models.len();
    let paint = move |canvas: &Canvas| {
        let plot = Rect::inside(canvas, [64.0, 36.0, 16.0, 48.0]);
        for (index, (model, frame)) in models.iter().zip(plot.rows(&equal(rows), 66.0)).enumerate() {
            model.paint(canvas, frame, index + 1 == rows)?;
        }
        Ok(())
    };
    Ok(Some(Picture::new(1200, 36 + 48 + rows as u32 * 236 + (rows as u32 - 1) * 66, paint)))
}

/// The rows of the surface, which run along the whisker line by line of equal arc length.
fn grid(surface: &[SurfaceRow]) -> Vec<Vec<Node>> {
    surface
        .chunk_by(|a, b| a.arc_m == b.arc_m)
        .map(|line| {
            let node = |row: &SurfaceRow| Node {
                at: (1e3 * row.x_m, 1e3 * row.y_m),
                reading: 1e6 * row.reading_n_m,
                distance_m: row.distance_m,
            };
            line.iter().map(node).collect()
        })
        .collect()
}

impl Model {
    fn nodes(&self) -> impl Iterator<Item = &Node> {
        self.grid.iter().flatten()
    }

    fn paint(&self, canvas: &Canvas, frame: Rect, last: bool) -> Result<()> {
        let columns = frame.columns(&[0.5, 0.016, 0.4], 0.0);
        let [map, bar, scatter] = [columns[0], columns[1], columns[2]];
        let map = Rect { right: map.right - 40.0, ..map };
        let bar = Rect { left: bar.left - 26.0, right: bar.right - 26.0, ..bar };
        let scatter = Rect { left: scatter.left + 90.0, ..scatter };
        self.paint_map(canvas, map, last)?;
        self.paint_bar(canvas, bar)?;
        self.paint_residuals(canvas, scatter, last)
    }

    fn readings(&self) -> (f64, f64) {
        extent(self.nodes().map(|node| node.reading)).unwrap_or((0.0, 1.0))
    }

    fn paint_map(&self, canvas: &Canvas, frame: Rect, last: bool) -> Result<()> {
        let (left, right) = extent(self.nodes().map(|node| node.at.0)).unwrap_or((0.0, 1.0));
        let (low, high) = extent(self.nodes().map(|node| node.at.1)).unwrap_or((0.0, 1.0));
        let spare = 0.04 * (right - left);
        let bounds = [left - spare, right + spare, low - spare, high + spare];
        let x_name = if last { "x in Base (mm)" } else { "" };
        let panel = Panel::with_equal_scales(canvas, frame, &self.title, (x_name, "y in Base (mm)"), bounds)?;
        for cell in &self.cells {
            let reading = cell.iter().map(|node| node.reading).sum::<f64>() / 4.0;
            panel.tile(cell.map(|node| node.at), shade(reading, self.readings()))?;
        }
        self.paint_isolines(&panel)?;
        let whisker = self.grid.iter().filter_map(|line| undeflected(line));
        panel.line(whisker, INK, 2.5)
    }

    fn paint_isolines(&self, panel: &Panel) -> Result<()> {
        let (lowest, highest) = self.readings();
        for step in 1..=ISOLINES {
            let level = lowest + (highest - lowest) * step as f64 / (ISOLINES + 1) as f64;
            for [a, b, c, d] in &self.cells {
                for triangle in [[a, b, d], [b, c, d]] {
                    if let Some(segment) = crossing(triangle, level) {
                        panel.line(segment, Rgb::WHITE.mix(0.75), 1.0)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn paint_bar(&self, canvas: &Canvas, frame: Rect) -> Result<()> {
        let (lowest, highest) = self.readings();
        let axis = Axis::linear("", lowest, highest).bare();
        let panel = Panel::new(canvas, frame, "", Axis::linear("", 0.0, 1.0).bare(), axis.clone())?;
        let steps = 64;
        for step in 0..steps {
            let from = lowest + (highest - lowest) * f64::from(step) / f64::from(steps);
            let color = shade(from, (lowest, highest));
            panel.area([(0.0, from), (1.0, from), (1.0, highest), (0.0, highest)], color)?;
        }
        for (value, number) in axis.ticks((frame.bottom - frame.top) / 45.0) {
            canvas.text(&number, (frame.right + 6.0, panel.at((0.0, value)).1), SMALL)?;
        }
        canvas.text("µN·m", (frame.left, frame.top - 13.0), SMALL)
    }

    fn paint_residuals(&self, canvas: &Canvas, frame: Rect, last: bool) -> Result<()> {
        let reading_name = if last { "reading (µN·m)" } else { "" };
        let reading = Axis::around(reading_name, self.residuals.iter().map(|point| point.0));
        let residual = Axis::around("residual (% of largest)", self.residuals.iter().map(|point| point.1));
        let panel = Panel::new(canvas, frame, &self.residual_title, reading, residual)?;
        panel.level(0.0, "", MUTED)?;
        panel.discs(self.residuals.iter().copied(), 1.6, Look::of(0).color.mix(0.5))
    }
}

/// Dark at zero, light at the largest magnitude of either sign.
fn shade(reading: f64, (lowest, highest): (f64, f64)) -> Rgb {
    let largest = lowest.abs().max(highest.abs());
    viridis(reading.abs() / largest)
}

/// The map cut into cells, whose corners follow each other around. Neighbouring lines reach differently far from the
/// whisker; cells join nodes of equal distance, and shrink to triangles where only one of the lines goes on.
fn cells(grid: &[Vec<Node>]) -> Vec<[Node; 4]> {
    let last = grid.len().saturating_sub(1);
    let steps = last.min(MAP_CELLS.0).max(1);
    let lines: Vec<&[Node]> = (0..=steps).filter_map(|step| grid.get(step * last / steps)).map(Vec::as_slice).collect();
    let mut cells = Vec::new();
    for pair in lines.windows(2) {
        let distances = pair.iter().flat_map(|line| line.iter().map(|node| node.distance_m));
        let (lower, upper) = extent(distances).unwrap_or((0.0, 0.0));
        let rungs: Vec<(Node, Node)> = (0..=MAP_CELLS.1)
            .map(|step| lower + (upper - lower) * step as f64 / MAP_CELLS.1 as f64)
            .filter_map(|distance_m| Some((node_at(pair[0], distance_m)?, node_at(pair[1], distance_m)?)))
            .collect();
        cells.extend(rungs.windows(2).map(|rungs| [rungs[0].0, rungs[1].0, rungs[1].1, rungs[0].1]));
    }
    cells
}

/// The node at a distance on a line, linear between its nodes, or the end of the line nearest to it.
fn node_at(line: &[Node], distance_m: f64) -> Option<Node> {
    let above = line.partition_point(|node| node.distance_m < distance_m);
    let (Some(to), Some(from)) = (line.get(above), above.checked_sub(1).map(|below| &line[below])) else {
        return if above == 0 { line.first() } else { line.last() }.copied();
    };
    let share = (distance_m - from.distance_m) / (to.distance_m - from.distance_m);
    Some(Node {
        at: between(from.at, to.at, share),
        reading: from.reading + share * (to.reading - from.reading),
        distance_m,
    })
}

/// Where a line of nodes, which runs straight away from the whisker, starts on it.
fn undeflected(line: &[Node]) -> Option<(f64, f64)> {
    let (first, last) = (line.first()?, line.last()?);
    let span = last.distance_m - first.distance_m;
    (span > 0.0).then(|| between(first.at, last.at, -first.distance_m / span))
}

/// The line on which the reading, linear in a triangle, takes a level.
fn crossing(triangle: [&Node; 3], level: f64) -> Option<[(f64, f64); 2]> {
    let mut ends = (0..3).filter_map(|corner| {
        let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
        ((from.reading < level) != (to.reading < level))
            .then(|| between(from.at, to.at, (level - from.reading) / (to.reading - from.reading)))
    });
    Some([ends.next()?, ends.next()?])
}

fn between(from: (f64, f64), to: (f64, f64), share: f64) -> (f64, f64) {
    (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(x: f64, y: f64, reading: f64) -> Node {
        Node { at: (x, y), reading, distance_m: y }
    }

    #[test]
    fn verif_a_level_crosses_a_triangle_where_the_linear_reading_takes_it() {
        let triangle = [&node(0.0, 0.0, 0.0), &node(2.0, 0.0, 2.0), &node(0.0, 2.0, 2.0)];
        assert_eq!(crossing(triangle, 1.0), Some([(1.0, 0.0), (0.0, 1.0)]));
        assert_eq!(crossing(triangle, 3.0), None);
    }

    #[test]
    fn verif_cells_cover_the_domain_between_lines_of_unlike_reach() {
        let line = |x: f64, reach: f64| vec![node(x, 0.0, 0.0), node(x, 0.5 * reach, 1.0), node(x, reach, 2.0)];
        let grid = [line(0.0, 1.0), line(1.0, 2.0), line(2.0, 2.0)];
        let area = |cell: &[Node; 4]| {
            let at = |corner: usize| cell[corner % 4].at;
            (0..4).map(|i| 0.5 * (at(i).0 * at(i + 1).1 - at(i + 1).0 * at(i).1)).sum::<f64>().abs()
        };
        let total: f64 = cells(&grid).iter().map(area).sum();
        assert!((total - 3.5).abs() < 1e-12, "{total}");
    }
}
