//! A convex curve as the state of an estimator.
//!
//! An outline turns by `psi` over the arc length `sigma`. Neither is a suitable parameter of a polygon: at a corner
//! `psi` changes while `sigma` is constant, on a straight side vice versa. Their sum `tau = sigma + l psi`, with a
//! length `l`, increases everywhere (Minty's parametrisation of a monotone graph). In cells of equal `tau` the share
//!
//! ```text
//! a = dsigma / dtau = rho / (rho + l)    l dpsi / dtau = 1 - a
//! ```
//!
//! is constant: arcs of the radius `rho = l exp(u)`, which is never negative. A corner is a sequence of cells with `u`
//! far below zero, a side one with `u` far above zero, and on a circle `u` is constant.
//!
//! The curve is that of the whisker's centre line, hence the object's outline offset by the wire's radius. Its tangent
//! is the whisker's: `dP = -e rho t dpsi`, with `e` = +1 for an object on the right of the whisker.

use std::ops::Range;

use nalgebra::Vector2;

use crate::rest::direction;

/// Length of a cell in `tau`.
pub(super) const PITCH_M: f64 = 0.4e-3;

/// The length `l`.
pub(super) const SCALE_M: f64 = 10e-3;

/// Entries of the state before those of the cells: position and tangent of the anchor.
pub(super) const ANCHOR: usize = 3;

/// A convex curve of circular arcs.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    /// +1 if the object lies on the right of the whisker, -1 otherwise.
    sign: f64,
    /// Cells before the anchor, which lies at `tau = 0`.
    before: usize,
    /// Point and tangent at the anchor.
    anchor: Knot,
    /// `u` of every cell.
    logs: Vec<f64>,
    /// Ends of the cells, and their arcs from the end nearer to the anchor; both follow from the state.
    knots: Vec<Knot>,
    cells: Vec<Cell>,
}

/// A cell: its share, the derivative of the share by `u`, and the whole arc.
#[derive(Clone, Copy, Debug)]
struct Cell {
    share: f64,
    share_by_log: f64,
    arc: Arc,
}

/// A point of the curve and the tangent there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Knot {
    pub(super) point: Vector2<f64>,
    pub(super) tangent_rad: f64,
    /// Unit vector of the tangent.
    pub(super) tangent: Vector2<f64>,
}

/// A position on the curve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) tau_m: f64,
    pub(super) knot: Knot,
    /// Derivatives by `tau`.
    pub(super) point_by_tau: Vector2<f64>,
    pub(super) tangent_rad_per_m: f64,
}

/// The increment of a knot along an arc, and its derivative by the share.
#[derive(Clone, Copy, Debug)]
struct Arc {
    offset: Vector2<f64>,
    turn_rad: f64,
    /// Unit vector of the tangent at the end.
    tangent: Vector2<f64>,
    offset_by_share: Vector2<f64>,
    turn_by_share: f64,
}

fn left(v: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

impl Curve {
    /// An arc through `point`, the anchor, of one cell on either side.
    pub(super) fn new(sign: f64, point: Vector2<f64>, tangent_rad: f64, radius_m: f64) -> Self {
        let logs = vec![(radius_m / SCALE_M).ln(); 2];
        let anchor = Knot { point, tangent_rad, tangent: direction(tangent_rad) };
        let mut curve = Self { sign, before: 1, anchor, logs, knots: Vec::new(), cells: Vec::new() };
        curve.lay();
        curve
    }

    /// Number of entries of the state.
    pub(super) fn size(&self) -> usize {
        ANCHOR + self.logs.len()
    }

    /// Whether the state is the same as that of another curve.
    pub(super) fn is_in_state_of(&self, other: &Self) -> bool {
        (self.before, self.anchor, &self.logs) == (other.before, other.anchor, &other.logs)
    }

    /// `u` of every cell.
    pub(super) fn logs(&self) -> &[f64] {
        &self.logs
    }

    /// First and last `tau`.
    pub(super) fn range_m(&self) -> (f64, f64) {
        (-(self.before as f64) * PITCH_M, (self.logs.len() - self.before) as f64 * PITCH_M)
    }

    /// +1 if the object lies on the right of the whisker: its outward normal is then to the left of the tangent.
    pub(super) fn sign(&self) -> f64 {
        self.sign
    }

    /// Extends the curve by cells like those at its ends, so that it covers the range. Returns whether it was extended.
    pub(super) fn extend(&mut self, low_m: f64, high_m: f64) -> bool {
        let (first_m, last_m) = self.range_m();
        let missing = |short_m: f64| (short_m / PITCH_M).ceil().max(0.0) as usize;
        let (front, back) = (missing(first_m - low_m), missing(high_m - last_m));
        if front + back == 0 {
            return false;
        }
        let (first, last) = (self.logs[0], self.logs[self.logs.len() - 1]);
        self.logs.splice(0..0, std::iter::repeat_n(first, front));
        self.logs.extend(std::iter::repeat_n(last, back));
        self.before += front;
        self.lay();
        true
    }

    /// Removes the cells beyond a range, except those at the anchor. Returns the index of the first remaining cell.
    pub(super) fn trim(&mut self, low_m: f64, high_m: f64) {
        let first = self.cell(low_m.min(-0.5 * PITCH_M));
        let last = self.cell(high_m.max(0.5 * PITCH_M));
        self.logs.truncate(last + 1);
        self.logs.drain(..first);
        self.before -= first;
        self.lay();
    }

    /// The curve with its state changed by a step.
    pub(super) fn moved(&self, step: &[f64]) -> Self {
        let mut moved = self.clone();
        moved.anchor.point += Vector2::new(step[0], step[1]);
        moved.anchor.tangent_rad += step[2];
        moved.anchor.tangent = direction(moved.anchor.tangent_rad);
        for (log, step) in moved.logs.iter_mut().zip(&step[ANCHOR..]) {
            *log += step;
        }
        moved.lay();
        moved
    }

    /// Computes the knots from the anchor outwards in both directions.
    fn lay(&mut self) {
        let blank = Arc {
            offset: Vector2::zeros(),
            turn_rad: 0.0,
            tangent: self.anchor.tangent,
            offset_by_share: Vector2::zeros(),
            turn_by_share: 0.0,
        };
        let cell = |log: &f64| {
            let share = 1.0 / (1.0 + (-log).exp());
            Cell { share, share_by_log: share * (1.0 - share), arc: blank }
        };
        self.cells.clear();
        self.cells.extend(self.logs.iter().map(cell));
        self.knots.clear();
        self.knots.resize(self.logs.len() + 1, self.anchor);
        for cell in self.before..self.logs.len() {
            self.cells[cell].arc = self.arc(&self.knots[cell], PITCH_M, self.cells[cell].share);
            self.knots[cell + 1] = self.cells[cell].arc.end(&self.knots[cell]);
        }
        for cell in (0..self.before).rev() {
            self.cells[cell].arc = self.arc(&self.knots[cell + 1], -PITCH_M, self.cells[cell].share);
            self.knots[cell] = self.cells[cell].arc.end(&self.knots[cell + 1]);
        }
    }

    /// The arc from a knot over a change `way_m` of `tau`, of either sign.
    fn arc(&self, from: &Knot, way_m: f64, share: f64) -> Arc {
        let (length_m, half_rad) = (way_m * share, 0.5 * way_m * (1.0 - share) / SCALE_M);
        let half_by_share = -0.5 * way_m / SCALE_M;
        let HalfTurn { sinc, sinc_rate, cos } = HalfTurn::of(half_rad);
        let turn = |v: Vector2<f64>| v * cos + left(v) * (half_rad * sinc);
        let middle = turn(from.tangent);
        let chord = middle * -self.sign;
        let along = way_m * sinc + length_m * sinc_rate * half_by_share;
        Arc {
            offset: chord * (length_m * sinc),
            turn_rad: 2.0 * half_rad,
            tangent: turn(middle),
            offset_by_share: chord * along + left(chord) * (length_m * sinc * half_by_share),
            turn_by_share: 2.0 * half_by_share,
        }
    }

    fn cell(&self, tau_m: f64) -> usize {
        let position = (tau_m / PITCH_M).floor() + self.before as f64;
        position.clamp(0.0, (self.logs.len() - 1) as f64) as usize
    }

    /// The cells between two `tau`, at least one.
    pub(super) fn cells_between(&self, low_m: f64, high_m: f64) -> Range<usize> {
        self.cell(low_m)..self.cell(high_m) + 1
    }

    /// The end of a cell that is nearer to the anchor, and the change of `tau` from there to `tau_m`.
    fn reached(&self, cell: usize, tau_m: f64) -> (&Knot, f64) {
        let near = if cell >= self.before { cell } else { cell + 1 };
        (&self.knots[near], tau_m - (near as f64 - self.before as f64) * PITCH_M)
    }

    /// The position at `tau`; beyond the ends the last arcs are continued.
    pub(super) fn at(&self, tau_m: f64) -> Place {
        let cell = self.cell(tau_m);
        let (from, way_m) = self.reached(cell, tau_m);
        let share = self.cells[cell].share;
        let knot = self.arc(from, way_m, share).end(from);
        let point_by_tau = knot.tangent * (-self.sign * share);
        Place { tau_m, knot, point_by_tau, tangent_rad_per_m: (1.0 - share) / SCALE_M }
    }

    /// Adds to `gradient` the derivative by the state of a quantity whose derivatives by point and tangent at a fixed
    /// `tau` are `by_point` and `by_tangent`.
    pub(super) fn pull_back(&self, place: &Place, by_point: Vector2<f64>, by_tangent: f64, gradient: &mut [f64]) {
        let (point, last) = (place.knot.point, self.cell(place.tau_m));
        gradient[0] += by_point.x;
        gradient[1] += by_point.y;
        gradient[2] += by_tangent + by_point.dot(&left(point - self.anchor.point));
        let mut add = |cell: usize, arc: &Arc, end: Vector2<f64>| {
            let carried = arc.offset_by_share + left(point - end) * arc.turn_by_share;
            let by_share = by_point.dot(&carried) + by_tangent * arc.turn_by_share;
            gradient[ANCHOR + cell] += by_share * self.cells[cell].share_by_log;
        };
        if last >= self.before {
            for cell in self.before..last {
                add(cell, &self.cells[cell].arc, self.knots[cell + 1].point);
            }
        } else {
            for cell in last + 1..self.before {
                add(cell, &self.cells[cell].arc, self.knots[cell].point);
            }
        }
        let (from, way_m) = self.reached(last, place.tau_m);
        add(last, &self.arc(from, way_m, self.cells[last].share), point);
    }

    /// Cells on which the curve between the anchor and `tau` depends.
    pub(super) fn cells_to(&self, tau_m: f64) -> Range<usize> {
        let last = self.cell(tau_m);
        let (first, end) = if last >= self.before { (self.before, last + 1) } else { (last, self.before) };
        ANCHOR + first..ANCHOR + end
    }
}

/// sin(h)/h, its derivative by h, and cos(h) of half the angle of an arc.
struct HalfTurn {
    sinc: f64,
    sinc_rate: f64,
    cos: f64,
}

impl HalfTurn {
    /// By Taylor series within 0.05 rad, to which the arc of a cell is limited: without loss of digits near zero, and
    /// in a fraction of the time.
    fn of(h: f64) -> Self {
        if h.abs() > 0.05 {
            let (sin, cos) = h.sin_cos();
            let sinc = sin / h;
            return Self { sinc, sinc_rate: (cos - sinc) / h, cos };
        }
        let q = h * h;
        Self {
            sinc: 1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0)),
            sinc_rate: -h / 3.0 * (1.0 - q / 10.0 * (1.0 - q / 28.0 * (1.0 - q / 54.0))),
            cos: 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0))),
        }
    }
}

impl Arc {
    fn end(&self, from: &Knot) -> Knot {
        Knot { point: from.point + self.offset, tangent_rad: from.tangent_rad + self.turn_rad, tangent: self.tangent }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A curve with small and large radii, touched on both sides of its anchor.
    fn wavy() -> Curve {
        let mut curve = Curve::new(-1.0, Vector2::new(0.05, -0.01), 0.3, 8e-3);
        curve.extend(-3e-3, 4e-3);
        let step: Vec<f64> = (0..curve.size()).map(|i| if i < ANCHOR { 0.0 } else { 5.0 * (i as f64).sin() }).collect();
        curve.moved(&step)
    }

    #[test]
    fn val_a_constant_radius_is_a_circle() {
        for sign in [-1.0, 1.0] {
            let mut curve = Curve::new(sign, Vector2::new(0.02, 0.01), 0.4, 15e-3);
            curve.extend(-20e-3, 20e-3);
            let centre = curve.at(0.0).knot.point - Vector2::new(-(0.4_f64.sin()), 0.4_f64.cos()) * (sign * 15e-3);
            for tau_m in [-20e-3, -3.1e-3, 0.0, 7.77e-3, 20e-3] {
                let place = curve.at(tau_m);
                assert!(((place.knot.point - centre).norm() - 15e-3).abs() < 1e-12);
                assert!((place.knot.tangent_rad - 0.4 - tau_m / 25e-3).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn verif_series_and_functions_of_a_half_turn_agree() {
        for h in [0.05_f64, -0.05] {
            let (series, functions) = (HalfTurn::of(h), HalfTurn::of(h * (1.0 + 1e-12)));
            assert!((series.sinc - functions.sinc).abs() < 1e-15 && (series.cos - functions.cos).abs() < 1e-14);
            assert!((series.sinc_rate - functions.sinc_rate).abs() < 1e-13);
        }
    }

    #[test]
    fn verif_derivatives_are_those_of_the_curve() {
        let curve = wavy();
        let (by_point, by_tangent) = (Vector2::new(0.3, -0.8), 2e-3);
        let value = |curve: &Curve, tau_m: f64| {
            let knot = curve.at(tau_m).knot;
            by_point.dot(&knot.point) + by_tangent * knot.tangent_rad
        };
        for tau_m in [-2.9e-3, -0.1e-3, 0.1e-3, 1.3e-3, 3.9e-3, 5e-3] {
            let place = curve.at(tau_m);
            let mut gradient = vec![0.0; curve.size()];
            curve.pull_back(&place, by_point, by_tangent, &mut gradient);
            for (i, found) in gradient.iter().enumerate() {
                let mut step = vec![0.0; curve.size()];
                step[i] = 1e-6;
                let ahead = value(&curve.moved(&step), tau_m);
                step[i] = -1e-6;
                let expected = (ahead - value(&curve.moved(&step), tau_m)) / 2e-6;
                assert!((found - expected).abs() < 1e-8, "{tau_m} {i}: {found} {expected}");
                let is_touched = i < ANCHOR || curve.cells_to(tau_m).contains(&i);
                assert!(is_touched || *found == 0.0);
            }
            let rate = (value(&curve, tau_m + 1e-8) - value(&curve, tau_m - 1e-8)) / 2e-8;
            let found = by_point.dot(&place.point_by_tau) + by_tangent * place.tangent_rad_per_m;
            assert!((found - rate).abs() < 1e-6, "{tau_m}");
        }
    }

    #[test]
    fn verif_length_does_not_change_the_shape() {
        let curve = wavy();
        let mut other = curve.clone();
        assert!(other.extend(-5e-3, 6e-3));
        let same = |other: &Curve, tau_m: f64| (curve.at(tau_m).knot.point - other.at(tau_m).knot.point).norm() < 1e-15;
        assert!([-4e-3, -3e-3, 0.0, 2.2e-3, 5e-3].iter().all(|&tau_m| same(&other, tau_m)));
        other.trim(-1e-3, 1e-3);
        assert!([-1e-3, -0.3e-3, 0.0, 0.9e-3].iter().all(|&tau_m| same(&other, tau_m)));
        assert!(other.size() < curve.size());
    }

    #[test]
    fn robust_radii_are_positive_after_any_step() {
        let curve = wavy();
        let step: Vec<f64> = (0..curve.size()).map(|i| if i % 2 == 0 { 30.0 } else { -30.0 }).collect();
        let moved = curve.moved(&step);
        assert!(moved.cells.iter().all(|cell| (0.0..=1.0).contains(&cell.share)));
    }
}
