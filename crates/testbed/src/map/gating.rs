//! Which touches are of the same object: by what convex objects can be, without knowing any.
//!
//! The points of one touch are of one object. Two touches may be of the same convex object only if two things hold for pairs of their places:
//!
//! 1. **No tangent is crossed.** A convex object lies behind each of its tangents: seen from a place `a` with the outward normal `n`, no other place `b` of it lies
//!    in front, `n' (b - a) <= 0`, to within what is known of both places and of the normal (a gate of [`GATE`] standard deviations).
//! 2. **Nothing passed between.** The straight line from `a` to `b` lies in the object: where a whisker has swept across it, there is none.
//!
//! The first tells objects that face each other, or whose near sides are rounded, apart; the second those behind a gap. Touches are joined, the best agreement first, as long as
//! they agree (agglomerative clustering with the pairs of all members). Estimates are now and then wrong by more than they say, so that a tenth of the pairs may be against it.
//!
//! The first also tells single places that an object cannot have: where a whisker hangs at a corner, an estimator may go on along the face that ends there, in front of the next.

use nalgebra::Vector2;

use super::grid::Open;
use crate::contour::{Vertex, direction};

// The settings below are rounded guesses of their order, and that is all that is asked of them: with any one of them, or of those of the grid, a quarter, a half, twice or four times as large the
// maps of the arm's recordings (four objects, shaking and still, Hall sensors and 1 % noise, two seeds) have the same objects, none split or merged.

/// Standard deviations beyond which a place lies in front of a tangent: by chance one pair in a thousand.
const GATE: f64 = 3.0;

/// Standard deviation of a normal, which follows from the estimated bend of the whisker.
const NORMAL_SD_RAD: f64 = 0.05;

/// Standard deviation of a place beyond what is stated: what neighbouring errors of a sensor model come to.
const PLACE_SD_M: f64 = 3e-4;

/// Share of the pairs that may be against it.
const MOST_AGAINST: f64 = 0.1;

/// Most places by which a touch is judged.
const PLACES: usize = 16;

/// How pairs of places speak on two touches, counted.
#[derive(Clone, Copy, Debug, Default)]
struct Pairs {
    all: usize,
    /// One lies in front of the tangent at the other.
    in_front: usize,
    /// A whisker passed between.
    apart: usize,
}

impl Pairs {
    fn of(one: &[Vertex], other: &[Vertex], open: &Open) -> Self {
        let mut pairs = Self::default();
        for a in one {
            for b in other {
                pairs.all += 1;
                pairs.in_front += usize::from(is_in_front(a, b) || is_in_front(b, a));
                pairs.apart += usize::from(open.is_crossed(a.at, b.at));
            }
        }
        pairs
    }

    fn plus(self, other: Self) -> Self {
        Self { all: self.all + other.all, in_front: self.in_front + other.in_front, apart: self.apart + other.apart }
    }

    /// Whether nearly all of them allow one object. Where there is no pair, nothing speaks for it.
    fn agree(self) -> bool {
        self.all > 0 && self.in_front.max(self.apart) as f64 <= MOST_AGAINST * self.all as f64
    }
}

/// Whether `b` lies in front of the tangent at `a`.
fn is_in_front(a: &Vertex, b: &Vertex) -> bool {
    let normal = direction(a.normal_rad);
    let way: Vector2<f64> = b.at.vector() - a.at.vector();
    let stated_m2: f64 =
        [a, b].iter().filter_map(|vertex| vertex.covariance_m2).map(|c| normal.dot(&(c * normal))).sum();
    let turned_m = NORMAL_SD_RAD * way.perp(&normal);
    let variance_m2 = stated_m2 + 2.0 * PLACE_SD_M * PLACE_SD_M + turned_m * turned_m;
    normal.dot(&way) > GATE * variance_m2.sqrt()
}

/// Whether a place is of a convex object with these tangents: not in front of more of them than may be wrong.
pub(crate) fn is_behind(place: &Vertex, tangents: &[Vertex]) -> bool {
    let in_front = tangents.iter().filter(|tangent| is_in_front(tangent, place)).count();
    in_front as f64 <= MOST_AGAINST * tangents.len() as f64
}

/// Puts touches, each given by places along its outline, together to objects: the indices of the touches of each, in order.
pub(crate) fn objects(touches: &[Vec<Vertex>], open: &Open) -> Vec<Vec<usize>> {
    let judged: Vec<Vec<Vertex>> = touches.iter().map(|touch| thinned(touch)).collect();
    let mut objects: Vec<Vec<usize>> = (0..touches.len()).map(|touch| vec![touch]).collect();
    let mut pairs: Vec<Vec<Pairs>> =
        judged.iter().map(|one| judged.iter().map(|other| Pairs::of(one, other, open)).collect()).collect();
    let nearest_m = |one: &[Vertex], other: &[Vertex]| {
        let distances = one.iter().flat_map(|a| other.iter().map(move |b| a.at.distance(&b.at)));
        distances.fold(f64::INFINITY, f64::min)
    };
    let mut gaps_m: Vec<Vec<f64>> =
        judged.iter().map(|one| judged.iter().map(|other| nearest_m(one, other)).collect()).collect();
    loop {
        let candidates = (0..objects.len()).flat_map(|i| (i + 1..objects.len()).map(move |j| (i, j)));
        let agreeing = candidates.filter(|&(i, j)| pairs[i][j].agree());
        // Those that lie closest know most of each other.
        let Some((i, j)) = agreeing.min_by(|&(a, b), &(c, d)| gaps_m[a][b].total_cmp(&gaps_m[c][d])) else { break };
        let joined = objects.remove(j);
        objects[i].extend(joined);
        let (pairs_of_j, gaps_of_j) = (pairs.remove(j), gaps_m.remove(j));
        for (other, (pairs_j, gap_m)) in pairs_of_j.iter().zip(&gaps_of_j).enumerate() {
            pairs[i][other] = pairs[i][other].plus(*pairs_j);
            gaps_m[i][other] = gaps_m[i][other].min(*gap_m);
        }
        for (row, gaps) in pairs.iter_mut().zip(&mut gaps_m) {
            row.remove(j);
            gaps.remove(j);
        }
        for other in 0..objects.len() {
            pairs[other][i] = pairs[i][other];
            gaps_m[other][i] = gaps_m[i][other];
        }
    }
    for object in &mut objects {
        object.sort_unstable();
    }
    objects
}

/// At most [`PLACES`] of the touched vertices, evenly spread.
fn thinned(vertices: &[Vertex]) -> Vec<Vertex> {
    let touched: Vec<Vertex> = vertices.iter().filter(|vertex| vertex.touched).copied().collect();
    let count = touched.len().min(PLACES);
    (0..count).map(|i| touched[i * (touched.len() - 1) / (count - 1).max(1)]).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use whisker::frames::Point;

    use super::super::grid::Grid;
    use super::*;

    /// An arc of a circle in millimetres and degrees.
    fn arc((x_mm, y_mm): (f64, f64), radius_mm: f64, from_deg: f64, to_deg: f64) -> Vec<Vertex> {
        let vertex = |i: u32| {
            let deg = from_deg + (to_deg - from_deg) * f64::from(i) / 20.0;
            let (sin, cos) = deg.to_radians().sin_cos();
            Vertex {
                at: Point::new(1e-3 * (x_mm + radius_mm * cos), 1e-3 * (y_mm + radius_mm * sin)),
                normal_rad: deg.to_radians(),
                covariance_m2: Some(Matrix2::identity() * 1e-8),
                touched: true,
            }
        };
        (0..=20).map(vertex).collect()
    }

    fn nowhere() -> Open {
        Grid::new(2e-3).open(2)
    }

    #[test]
    fn val_touches_of_one_circle_are_one_object_and_of_two_are_two() {
        let touches = [
            arc((0.0, 0.0), 45.0, -40.0, 30.0),
            arc((0.0, 110.0), 36.0, -30.0, 30.0),
            arc((0.0, 0.0), 45.0, -20.0, 40.0),
            // On the other side of a corridor.
            arc((140.0, 20.0), 45.0, 150.0, 210.0),
        ];
        assert_eq!(objects(&touches, &nowhere()), [vec![0, 2], vec![1], vec![3]]);
    }

    /// Two flat faces in a line could be one: only what was swept between them tells.
    #[test]
    fn val_what_was_swept_between_two_flats_makes_them_two() {
        let flat = |from_mm: f64| -> Vec<Vertex> {
            let vertex = |i: u32| Vertex {
                at: Point::new(0.0, 1e-3 * (from_mm + f64::from(i))),
                normal_rad: 0.0,
                covariance_m2: Some(Matrix2::identity() * 1e-8),
                touched: true,
            };
            (0..=20).map(vertex).collect()
        };
        let touches = [flat(0.0), flat(60.0)];
        assert_eq!(objects(&touches, &nowhere()).len(), 1);
        let mut grid = Grid::new(2e-3);
        for step in 0..40 {
            let y_m = 1e-3 * (25.0 + f64::from(step) * 0.8);
            grid.scan(&[Point::new(0.05, y_m), Point::new(-0.02, y_m)], None);
        }
        assert_eq!(objects(&touches, &grid.open(2)).len(), 2);
    }

    /// The face of a box, the next around the corner, and what runs on past it.
    #[test]
    fn val_what_runs_past_a_corner_is_not_of_the_object() {
        let vertex = |x_mm: f64, y_mm: f64, deg: f64| Vertex {
            at: Point::new(1e-3 * x_mm, 1e-3 * y_mm),
            normal_rad: deg.to_radians(),
            covariance_m2: Some(Matrix2::identity() * 1e-8),
            touched: true,
        };
        let lower = (0..40).map(|i| vertex(f64::from(i), 0.0, -90.0));
        let right = (0..20).map(|i| vertex(40.0, f64::from(i), 0.0));
        let tangents: Vec<Vertex> = lower.chain(right).collect();
        assert!(tangents.iter().all(|place| is_behind(place, &tangents)));
        assert!(!is_behind(&vertex(49.0, 0.0, -90.0), &tangents));
    }

    #[test]
    fn robust_nothing_touched_is_no_object() {
        assert!(objects(&[], &nowhere()).is_empty());
        let bridge = arc((0.0, 0.0), 45.0, -40.0, 30.0).into_iter().map(|vertex| Vertex { touched: false, ..vertex });
        let touches = [bridge.collect(), arc((0.0, 0.0), 45.0, -20.0, 40.0)];
        assert_eq!(objects(&touches, &nowhere()), [vec![0], vec![1]], "what was nowhere touched agrees with nothing");
    }
}
