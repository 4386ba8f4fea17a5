//! Contact of a whisker in a known pose with a curve.
//!
//! Without friction the whisker's tangent at the contact is the curve's. With the base's yaw `theta`, the point `p =
//! base^-1 P(tau)` and the tangent's angle `phi(p)` in Base, the contact solves
//!
//! ```text
//! F(tau) = theta + phi(p(tau)) - psi(tau) = 0
//! ```
//!
//! F decreases wherever the whisker touches at one point: its slope is `-(e a dphi/ds + (1 - a) / l)`. By the implicit
//! function theorem, a quantity `q` that depends on the contact has the derivative `q_P . P_x + q_tau tau_x` by an
//! entry `x` of the state, with `tau_x = -(phi_P . P_x - psi_x) / F'`.

use nalgebra::{Matrix2, RowVector2, Vector2};

use super::curve::{Curve, PITCH_M, Place};
use crate::estimators::side::Side;
use crate::frames::{Base, Point, Pose, Start};
use crate::sensor::AlongAway;

/// Maximum number of steps of the search along the curve.
const STEPS: usize = 60;

/// Change of `tau`, or width of the bracket, below which the search ends: a thousandth of the accuracy of a contact.
const SETTLED_M: f64 = 1e-7;

/// Largest step before the root is bracketed.
const STRIDE_M: f64 = 20.0 * PITCH_M;

/// Largest distance from the ends of the curve at which a contact is sought.
const REACH_M: f64 = 30e-3;

/// Smallest decrease of F per metre. If whisker and object have the same curvature, the contact is not at one point.
const LEAST_FALL_RAD_PER_M: f64 = 0.2;

/// A contact with a curve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    pub(super) place: Place,
    /// Contact in Base, and along and away from the undeflected whisker.
    pub(super) point: Point<Base>,
    pub(super) at: AlongAway,
    /// Expected reading, and its derivative by the contact's point in Start.
    pub(super) reading_n_m: f64,
    pub(super) reading_by_point: Vector2<f64>,
    /// Derivative of the tangent's angle by that point.
    tangent_by_point: Vector2<f64>,
    /// F'.
    slope_rad_per_m: f64,
}

/// F at a position on the curve.
struct Mismatch {
    place: Place,
    angle_rad: f64,
    slope_rad_per_m: f64,
    tangent_by_point: Vector2<f64>,
    at: AlongAway,
}

fn mismatch(side: &Side, base: &Pose<Base, Start>, to_base: &Pose<Start, Base>, curve: &Curve, tau_m: f64) -> Mismatch {
    let place = curve.at(tau_m);
    let point = to_base.apply(Point::from_vector(place.knot.point));
    let at = side.face.along_and_away(point);
    let (tangent_rad, by_place) = side.tangent_rad(at);
    let tangent_by_point = base.rotation() * in_base(side, at, by_place);
    let angle_rad = base.yaw_rad() + tangent_rad - place.knot.tangent_rad;
    let slope_rad_per_m =
        (tangent_by_point.dot(&place.point_by_tau) - place.tangent_rad_per_m).min(-LEAST_FALL_RAD_PER_M);
    Mismatch { place, angle_rad, slope_rad_per_m, tangent_by_point, at }
}

/// A derivative by the coordinates along and away, converted to one by the point in Base.
fn in_base(side: &Side, at: AlongAway, by_place: Vector2<f64>) -> Vector2<f64> {
    let jacobian: Matrix2<f64> = side.face.contact_jacobian(at);
    // It is singular only at the whisker's centre of curvature.
    jacobian.transpose().try_inverse().map_or(by_place, |inverse| inverse * by_place)
}

/// The contact of a whisker with its base at `base`, sought from `near_m`. `None` if there is no contact within reach
/// or the search does not converge.
pub(super) fn contact(side: &Side, base: &Pose<Base, Start>, curve: &Curve, near_m: f64) -> Option<Contact> {
    let (first_m, last_m) = curve.range_m();
    let (mut low_m, mut high_m) = (first_m - REACH_M, last_m + REACH_M);
    let mut is_bracketed = (false, false);
    let mut tau_m = near_m.clamp(low_m, high_m);
    let to_base = base.inverse();
    for _ in 0..=STEPS {
        let found = mismatch(side, base, &to_base, curve, tau_m);
        if found.angle_rad > 0.0 {
            (low_m, is_bracketed.0) = (tau_m, true);
        } else {
            (high_m, is_bracketed.1) = (tau_m, true);
        }
        let stride_m = (-found.angle_rad / found.slope_rad_per_m).clamp(-STRIDE_M, STRIDE_M);
        if stride_m.abs().min(high_m - low_m) < SETTLED_M {
            return Some(found.contact(side, base));
        }
        let newton_m = tau_m + stride_m;
        if newton_m > low_m && newton_m < high_m {
            tau_m = newton_m;
        } else if is_bracketed == (true, true) {
            tau_m = 0.5 * (low_m + high_m);
        } else {
            return None;
        }
    }
    None
}

impl Mismatch {
    /// The contact, where F is zero.
    fn contact(self, side: &Side, base: &Pose<Base, Start>) -> Contact {
        let Self { place, slope_rad_per_m, tangent_by_point, at, .. } = self;
        let (reading_n_m, by_place): (f64, RowVector2<f64>) = side.expect(at);
        let reading_by_point = base.rotation() * in_base(side, at, by_place.transpose());
        let point = base.inverse().apply(Point::from_vector(place.knot.point));
        Contact { place, point, at, reading_n_m, reading_by_point, tangent_by_point, slope_rad_per_m }
    }
}

impl Contact {
    /// Adds to `gradient` the derivative by the state of a quantity whose derivative by the contact's point is
    /// `by_point`.
    pub(super) fn pull_back(&self, curve: &Curve, by_point: Vector2<f64>, gradient: &mut [f64]) {
        let by_tau = by_point.dot(&self.place.point_by_tau) / self.slope_rad_per_m;
        curve.pull_back(&self.place, by_point - self.tangent_by_point * by_tau, by_tau, gradient);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastica::{Circle, Elastica, Outline, Polygon};
    use crate::estimators::outline::curve::{ANCHOR, SCALE_M};
    use crate::estimators::testing::knowledge;
    use crate::frames::World;
    use crate::rest::direction;
    use crate::sensor::Face;

    const WIRE_RADIUS_M: f64 = 0.125e-3;

    /// World and Start are the same here.
    fn in_world(base: &Pose<Base, Start>) -> Pose<Base, World> {
        Pose::new(base.origin().x(), base.origin().y(), base.yaw_rad())
    }

    /// Largest distance between the contacts on a curve and those of the exact whisker on the same outline.
    fn worst_m(curve: &Curve, outline: &dyn Outline, bases: impl Iterator<Item = Pose<Base, Start>>) -> f64 {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let mut near_m = 0.0;
        let distances = bases.map(|base| {
            let exact = elastica.against(outline, &in_world(&base), Face::Left).unwrap().unwrap();
            let found = contact(&side, &base, curve, near_m).unwrap();
            near_m = found.place.tau_m;
            found.point.distance(&exact.deflection.point)
        });
        distances.fold(0.0, f64::max)
    }

    #[test]
    fn val_contact_on_a_circle_is_that_of_the_exact_whisker() {
        let rest = knowledge().rest;
        for radius_m in [1e-3, 15e-3] {
            let centre = rest.beside(0.055, radius_m - 4e-3).vector();
            let circle = Circle { center: Point::from_vector(centre), radius_m };
            let grown_m = radius_m + WIRE_RADIUS_M;
            let point = centre + Vector2::new(0.0, -grown_m);
            let curve = Curve::new(-1.0, point, 0.0, grown_m);
            let bases = (0..100).map(|i| {
                let t = f64::from(i) / 15.0;
                Pose::new(2e-3 * (t.cos() - 1.0), 1.5e-3 * t.sin(), 0.02 * (2.0 * t).sin())
            });
            let worst_m = worst_m(&curve, &circle, bases);
            assert!(worst_m < 0.05e-3, "{radius_m}: {worst_m}");
        }
    }

    /// Two corners with a side between them, and the sides before and after.
    #[test]
    fn val_contact_on_a_polygon_is_that_of_the_exact_whisker() {
        let (side_cells, corner_cells) = (24, 12);
        let turn_rad = corner_cells as f64 * PITCH_M / (SCALE_M + WIRE_RADIUS_M);
        let first = knowledge().rest.beside(0.052, -5e-3).vector();
        // The tangent angles of the sides before, between and after; an object on the left is traversed from the tip to
        // the root's side.
        let angles = [-0.45 - turn_rad, -0.45, -0.45 + turn_rad];
        let second = first + direction(angles[1]) * (side_cells as f64 * PITCH_M);
        let corners = [first - direction(angles[0]) * 0.05, first, second, second + direction(angles[2]) * 0.05];
        let polygon = Polygon::new(&corners.map(Point::from_vector)).unwrap();

        let start = first + Vector2::new(angles[0].sin(), -angles[0].cos()) * WIRE_RADIUS_M;
        let mut curve = Curve::new(-1.0, start, angles[0], SCALE_M);
        let cells = 2 * corner_cells + side_cells;
        curve.extend(-10.0 * PITCH_M, (cells + 10) as f64 * PITCH_M);
        let (first_m, last_m) = curve.range_m();
        let (before, all) = ((-first_m / PITCH_M).round() as usize, ((last_m - first_m) / PITCH_M).round() as usize);
        let mut step = vec![0.0; curve.size()];
        for cell in 0..all {
            let place = cell as isize - before as isize;
            let between = corner_cells as isize..(corner_cells + side_cells) as isize;
            let is_corner = (0..cells as isize).contains(&place) && !between.contains(&place);
            step[ANCHOR + cell] = if is_corner { (WIRE_RADIUS_M / SCALE_M).ln() } else { 14.0 };
        }
        let curve = curve.moved(&step);
        let bases = (0..200).map(|i| Pose::new(0.0, 5e-3, 0.15 * (f64::from(i) / 30.0).sin()));
        let worst_m = worst_m(&curve, &polygon, bases);
        assert!(worst_m < 0.1e-3, "{worst_m}");
    }

    #[test]
    fn verif_derivatives_are_those_of_the_contact() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let point = knowledge.rest.beside(0.055, -4e-3).vector();
        let mut curve = Curve::new(-1.0, point, -0.25, 10e-3);
        curve.extend(-3e-3, 3e-3);
        let base = Pose::new(0.5e-3, 1e-3, 0.03);
        let found = contact(&side, &base, &curve, 0.0).unwrap();
        let mut gradient = vec![0.0; curve.size()];
        found.pull_back(&curve, found.reading_by_point, &mut gradient);
        let largest = gradient.iter().fold(0.0_f64, |largest, slope| largest.max(slope.abs()));
        for i in 0..curve.size() {
            let reading_n_m = |by: f64| {
                let mut step = vec![0.0; curve.size()];
                step[i] = by;
                contact(&side, &base, &curve.moved(&step), 0.0).unwrap().reading_n_m
            };
            let expected = (reading_n_m(1e-5) - reading_n_m(-1e-5)) / 2e-5;
            assert!((gradient[i] - expected).abs() < 1e-4 * largest, "{i}: {} {expected}", gradient[i]);
        }
    }
}
