//! Occupancy grid: cells swept by a whisker are free, touched cells are occupied.
//!
//! The plane is divided into square cells fixed in World, so that the grids of several whiskers can be added. An
//! instant of a whisker is one scan: the cells covered by its wire are swept and the cell of its contact is touched;
//! touched takes precedence. The log-odds of a cell are the sum over its scans, clamped (Moravec and Elfes 1985;
//! clamping as in OctoMap, Hornung et al. 2013).

use std::collections::{BTreeMap, BTreeSet};

use whisker::frames::{Point, World};

/// Log-odds increment of a swept cell: free with probability 3/5, since the wire's position is known only to about a
/// cell.
const SWEPT: f64 = -0.4;

/// Log-odds increment of a touched cell. A contact with its stated covariance is in its cell with probability 0.9
/// (2.2); the margin allows for underestimated covariances.
const TOUCHED: f64 = 2.0;

/// Bounds of the log-odds.
const LOWEST: f64 = -4.0;
const HIGHEST: f64 = 4.0;

/// Index of a cell along x and y.
pub(crate) type Place = (i32, i32);

/// Numbers of scans that swept and touched a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cell {
    /// Number of scans that swept the cell.
    pub swept: u32,
    /// Number of scans that touched it.
    pub touched: u32,
}

impl Cell {
    fn log_odds(self) -> f64 {
        (f64::from(self.swept) * SWEPT + f64::from(self.touched) * TOUCHED).clamp(LOWEST, HIGHEST)
    }

    /// Probability of occupancy.
    pub fn occupied(self) -> f64 {
        1.0 / (1.0 + (-self.log_odds()).exp())
    }
}

/// Observed cells; all others are unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    cell_m: f64,
    cells: BTreeMap<Place, Cell>,
}

impl Grid {
    /// Grid without observations.
    pub(crate) fn new(cell_m: f64) -> Self {
        Self { cell_m, cells: BTreeMap::new() }
    }

    /// Side length of a cell.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Observed cells in order.
    pub fn cells(&self) -> impl Iterator<Item = (Point<World>, Cell)> {
        let middle = |place: i32| (f64::from(place) + 0.5) * self.cell_m;
        self.cells.iter().map(move |(&(x, y), &cell)| (Point::new(middle(x), middle(y)), cell))
    }

    /// Adds one scan: the wire as a polyline, and its contact.
    pub(crate) fn scan(&mut self, wire: &[Point<World>], contact: Option<Point<World>>) {
        let contact = contact.map(|contact| self.place(contact));
        let swept: BTreeSet<Place> = wire.windows(2).flat_map(|ends| self.along(ends[0], ends[1])).collect();
        for place in swept.into_iter().filter(|place| Some(*place) != contact) {
            self.cells.entry(place).or_default().swept += 1;
        }
        if let Some(place) = contact {
            self.cells.entry(place).or_default().touched += 1;
        }
    }

    /// Adds the observations of another grid with the same cells.
    pub(crate) fn add(&mut self, other: &Self) {
        for (place, seen) in &other.cells {
            let cell = self.cells.entry(*place).or_default();
            cell.swept += seen.swept;
            cell.touched += seen.touched;
        }
    }

    /// Free cells whose neighbours up to `margin` cells away are free too.
    pub(crate) fn open(&self, margin: i32) -> Open {
        let is_free = |place: &Place| self.cells.get(place).is_some_and(|cell| cell.log_odds() < 0.0);
        let around =
            |&(x, y): &Place| (-margin..=margin).flat_map(move |i| (-margin..=margin).map(move |j| (x + i, y + j)));
        let is_open = |place: &&Place| around(place).all(|place| is_free(&place));
        Open { places: self.cells.keys().filter(is_open).copied().collect(), cell_m: self.cell_m }
    }

    fn place(&self, point: Point<World>) -> Place {
        place(point, self.cell_m)
    }

    fn along(&self, from: Point<World>, to: Point<World>) -> impl Iterator<Item = Place> + use<> {
        along(from, to, self.cell_m)
    }
}

/// Free cells with a margin from any surface.
pub(crate) struct Open {
    places: BTreeSet<Place>,
    cell_m: f64,
}

impl Open {
    /// Whether the segment between two points crosses an open cell.
    pub(crate) fn is_crossed(&self, from: Point<World>, to: Point<World>) -> bool {
        along(from, to, self.cell_m).any(|place| self.places.contains(&place))
    }
}

fn place(point: Point<World>, cell_m: f64) -> Place {
    ((point.x() / cell_m).floor() as i32, (point.y() / cell_m).floor() as i32)
}

/// Cells along a segment, in steps of half a cell.
fn along(from: Point<World>, to: Point<World>, cell_m: f64) -> impl Iterator<Item = Place> {
    let way = to.vector() - from.vector();
    let steps = (2.0 * way.norm() / cell_m).ceil().max(1.0) as u32;
    (0..=steps).map(move |step| place(from.shifted(way * (f64::from(step) / f64::from(steps))), cell_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x_mm: f64, y_mm: f64) -> Point<World> {
        Point::new(1e-3 * x_mm, 1e-3 * y_mm)
    }

    #[test]
    fn verif_swept_cells_are_free_and_touched_cells_occupied() {
        let mut grid = Grid::new(2e-3);
        grid.scan(&[point(1.0, 1.0), point(9.0, 1.0)], Some(point(9.0, 1.0)));
        let seen: Vec<(f64, bool)> = grid.cells().map(|(at, cell)| (1e3 * at.x(), cell.occupied() > 0.5)).collect();
        let expected = [(1.0, false), (3.0, false), (5.0, false), (7.0, false), (9.0, true)];
        assert_eq!(seen.len(), expected.len());
        assert!(seen.iter().zip(expected).all(|(a, b)| (a.0 - b.0).abs() < 1e-9 && a.1 == b.1), "{seen:?}");
    }

    #[test]
    fn verif_grids_add_up_in_any_order() {
        let scan = |y_mm: f64| {
            let mut grid = Grid::new(2e-3);
            grid.scan(&[point(-3.0, y_mm), point(5.0, y_mm)], None);
            grid
        };
        let [mut one, mut other] = [scan(1.0), scan(1.5)];
        one.add(&scan(1.5));
        other.add(&scan(1.0));
        assert_eq!(one, other);
        assert!(one.cells().all(|(_, cell)| cell.swept == 2));
    }

    #[test]
    fn verif_open_cells_have_a_free_margin() {
        let mut grid = Grid::new(2e-3);
        for y in 0..10 {
            grid.scan(&[point(1.0, 2.0 * f64::from(y) + 1.0), point(19.0, 2.0 * f64::from(y) + 1.0)], None);
        }
        let open = grid.open(2);
        assert!(open.is_crossed(point(10.0, -5.0), point(10.0, 30.0)));
        assert!(!open.is_crossed(point(3.0, -5.0), point(3.0, 30.0)), "along the border");
    }
}
