//! Association of touches to objects: gating of pairs by convexity, without a model of the objects.
//!
//! All points of a touch belong to one object. Two touches may belong to the same convex object only if two conditions
//! hold for pairs of their points:
//!
//! 1. **Tangents.** A convex object is behind each of its tangents: for a point `a` with outward normal `n`, every
//!    other point `b` satisfies `n' (b - a) <= 0`, up to the uncertainty of both points and of the normal (gate of
//!    [`GATE`] standard deviations).
//! 2. **Free space.** The segment from `a` to `b` is inside the object: it does not cross space that a whisker has
//!    swept.
//!
//! The first condition separates objects that face each other or whose near sides are rounded; the second separates
//! objects behind a gap. Compatible touches are merged by agglomerative clustering, the closest first, using the pairs
//! of all members. Since estimates occasionally have errors beyond their stated covariance, a tenth of the pairs may
//! violate a condition.
//!
//! The first condition also rejects single points of a touch: at a corner, an estimator may extrapolate the current
//! face in front of the next.

use nalgebra::Vector2;

use super::grid::Open;
use crate::contour::{Vertex, direction};

// The following settings are order-of-magnitude estimates, and the result is insensitive to them: with any one of them,
// or of those of the grid, multiplied by 0.25, 0.5, 2 or 4, the maps of the arm's recordings (four objects, shaking and
// still, Hall sensors and 1 % noise, two seeds) contain the same objects, none split or merged.

/// Gate in standard deviations for a point in front of a tangent; exceeded by chance for one pair in a thousand.
const GATE: f64 = 3.0;

/// Standard deviation of a normal, which is derived from the estimated deflection of the whisker.
const NORMAL_SD_RAD: f64 = 0.05;

/// Standard deviation of a point in addition to its stated covariance, for the locally correlated error of the sensor
/// model.
const PLACE_SD_M: f64 = 3e-4;

/// Largest fraction of pairs that may violate a condition.
const MOST_AGAINST: f64 = 0.1;

/// Maximum number of points that represent a touch.
const PLACES: usize = 16;

/// Counts of point pairs of two touches.
#[derive(Clone, Copy, Debug, Default)]
struct Pairs {
    all: usize,
    /// Pairs with one point in front of the tangent at the other.
    in_front: usize,
    /// Pairs separated by free space.
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

    /// Whether at most [`MOST_AGAINST`] of the pairs violate each condition. `false` without pairs.
    fn agree(self) -> bool {
        self.all > 0 && self.in_front.max(self.apart) as f64 <= MOST_AGAINST * self.all as f64
    }
}

/// Whether `b` is in front of the tangent at `a`.
fn is_in_front(a: &Vertex, b: &Vertex) -> bool {
    let normal = direction(a.normal_rad);
    let way: Vector2<f64> = b.at.vector() - a.at.vector();
    let stated_m2: f64 =
        [a, b].iter().filter_map(|vertex| vertex.covariance_m2).map(|c| normal.dot(&(c * normal))).sum();
    let turned_m = NORMAL_SD_RAD * way.perp(&normal);
    let variance_m2 = stated_m2 + 2.0 * PLACE_SD_M * PLACE_SD_M + turned_m * turned_m;
    normal.dot(&way) > GATE * variance_m2.sqrt()
}

/// Whether a point is compatible with a convex object with these tangents, up to [`MOST_AGAINST`] of them.
pub(crate) fn is_behind(place: &Vertex, tangents: &[Vertex]) -> bool {
    let in_front = tangents.iter().filter(|tangent| is_in_front(tangent, place)).count();
    in_front as f64 <= MOST_AGAINST * tangents.len() as f64
}

/// Groups touches, each given by points along its outline, into objects. Returns the indices of the touches of each
/// object, in order.
pub(crate) fn objects(touches: &[Vec<Vertex>], open: &Open) -> Vec<Vec<usize>> {
    let sampled: Vec<Vec<Vertex>> = touches.iter().map(|touch| thinned(touch)).collect();
    let mut objects: Vec<Vec<usize>> = (0..touches.len()).map(|touch| vec![touch]).collect();
    let mut pairs: Vec<Vec<Pairs>> =
        sampled.iter().map(|one| sampled.iter().map(|other| Pairs::of(one, other, open)).collect()).collect();
    let nearest_m = |one: &[Vertex], other: &[Vertex]| {
        let distances = one.iter().flat_map(|a| other.iter().map(move |b| a.at.distance(&b.at)));
        distances.fold(f64::INFINITY, f64::min)
    };
    let mut gaps_m: Vec<Vec<f64>> =
        sampled.iter().map(|one| sampled.iter().map(|other| nearest_m(one, other)).collect()).collect();
    loop {
        let candidates = (0..objects.len()).flat_map(|i| (i + 1..objects.len()).map(move |j| (i, j)));
        let agreeing = candidates.filter(|&(i, j)| pairs[i][j].agree());
        // The closest pair of touches has the most reliable association.
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

/// At most [`PLACES`] of the touched vertices, evenly spaced.
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

    /// Arc of a circle in millimetres and degrees.
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
            // On the opposite side of a corridor.
            arc((140.0, 20.0), 45.0, 150.0, 210.0),
        ];
        assert_eq!(objects(&touches, &nowhere()), [vec![0, 2], vec![1], vec![3]]);
    }

    /// Two collinear flat faces could belong to one object; only free space between them separates them.
    #[test]
    fn val_free_space_between_collinear_faces_separates_them() {
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

    /// Face of a box, the adjacent face around the corner, and a point beyond the corner.
    #[test]
    fn val_points_extrapolated_beyond_a_corner_are_rejected() {
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
    fn robust_untouched_points_form_no_object() {
        assert!(objects(&[], &nowhere()).is_empty());
        let bridge = arc((0.0, 0.0), 45.0, -40.0, 30.0).into_iter().map(|vertex| Vertex { touched: false, ..vertex });
        let touches = [bridge.collect(), arc((0.0, 0.0), 45.0, -20.0, 40.0)];
        assert_eq!(objects(&touches, &nowhere()), [vec![0], vec![1]], "a touch without touched points is not merged");
    }
}
