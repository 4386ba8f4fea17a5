//! Space that a whisker has swept while it touched: no object is there.

use nalgebra::Vector2;
use trace::{Trace, TruthInstant};
use whisker::elastica::Elastica;
use whisker::frames::{Base, Point, Pose, World};

use super::{Contour, direction};

/// Displacement of the contact in Base between two instants whose wires are kept.
const STEP_M: f64 = 1e-4;

/// Distance between the sampled points of a wire.
const WIRE_STEP_M: f64 = 1e-3;

/// Wires at the instants of a single true contact, which bound the swept space.
#[derive(Clone, Debug, PartialEq)]
pub struct Swept {
    wires: Vec<Vec<Place>>,
}

/// Point of a wire's surface, on the side of the object.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    at: Vector2<f64>,
    /// Unit normal from the object to the wire.
    outward: Vector2<f64>,
}

impl Swept {
    /// The space swept in a trace, by the shape that the elastica has at the true contacts. `None` if the whisker's shape is
    /// unknown.
    pub fn new(trace: &Trace) -> Option<Self> {
        let elastica = Elastica::new(&trace.sidecar.whisker).ok()?;
        let mut wires = Vec::new();
        let mut last: Option<Point<Base>> = None;
        for (known, truth) in trace.recording.instants.iter().zip(&trace.truth.instants) {
            let Some(seen) = single_contact(truth).map(|contact| known.base.inverse().apply(contact)) else { continue };
            if last.is_some_and(|last| last.distance(&seen) < STEP_M) {
                continue;
            }
            last = Some(seen);
            wires.extend(wire(trace, &elastica, &known.base, seen));
        }
        Some(Self { wires })
    }

    /// Largest depth of a contour's vertices in the swept space, zero if none lies there. A vertex lies there if the wire has been
    /// on both of its sides.
    pub fn depth_m(&self, contour: &Contour) -> f64 {
        contour.vertices.iter().map(|vertex| self.depth_at_m(vertex.at.vector())).fold(0.0, f64::max)
    }

    fn depth_at_m(&self, at: Vector2<f64>) -> f64 {
        let heights_m = self.wires.iter().filter_map(|wire| height_m(wire, at));
        let (low_m, high_m) = heights_m
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), height| (low.min(height), high.max(height)));
        if low_m < 0.0 { high_m } else { 0.0 }
    }
}

fn single_contact(truth: &TruthInstant) -> Option<Point<World>> {
    truth.contact.filter(|_| truth.split != Some(true) && truth.second.is_none() && truth.tip != Some(true))
}

/// The wire's surface from root to tip. `None` if the contact is not reachable.
fn wire(trace: &Trace, elastica: &Elastica, base: &Pose<Base, World>, seen: Point<Base>) -> Option<Vec<Place>> {
    let whisker = &trace.sidecar.whisker;
    let line = elastica.line(elastica.at_point(seen).ok()?.load).ok()?;
    let steps = (whisker.length_m / WIRE_STEP_M).ceil() as u32;
    let place = |step: u32| {
        let arc_m = whisker.length_m * f64::from(step) / f64::from(steps);
        let (point, tangent_rad) = line.at(arc_m);
        let tangent = direction(base.yaw_rad() + tangent_rad);
        let outward = Vector2::new(-tangent.y, tangent.x) * trace.sidecar.face.away_sign();
        let radius_m = 0.5 * whisker.diameter_m(arc_m);
        Place { at: base.apply(point).vector() - outward * radius_m, outward }
    };
    Some((0..=steps).map(place).collect())
}

/// Height of a point over a wire, away from the object. `None` beside its ends.
fn height_m(wire: &[Place], at: Vector2<f64>) -> Option<f64> {
    let nearest = (0..wire.len()).min_by(|&a, &b| {
        let square_m2 = |i: usize| (wire[i].at - at).norm_squared();
        square_m2(a).total_cmp(&square_m2(b))
    })?;
    let is_beside = nearest == 0 || nearest + 1 == wire.len();
    (!is_beside).then(|| (at - wire[nearest].at).dot(&wire[nearest].outward))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contour::Vertex;

    /// A wire along the x axis of 10 mm, at a height, over an object below it.
    fn level(height_m: f64) -> Vec<Place> {
        let place = |i: u32| Place { at: Vector2::new(1e-3 * f64::from(i), height_m), outward: Vector2::y() };
        (0..=10).map(place).collect()
    }

    #[test]
    fn verif_a_point_is_in_free_space_by_as_much_as_the_wire_has_passed_it() {
        let swept = Swept { wires: vec![level(2e-3), level(1e-3), level(0.0)] };
        let depth_m = |x_m: f64, y_m: f64| {
            let at = Point::new(x_m, y_m);
            let vertex = Vertex { at, normal_rad: 0.0, covariance_m2: None, touched: true };
            swept.depth_m(&Contour { vertices: vec![vertex] })
        };
        assert!((depth_m(5e-3, 5e-4) - 5e-4).abs() < 1e-12);
        // Below all wires, above all of them, and beside their ends.
        assert_eq!([depth_m(5e-3, -1e-4), depth_m(5e-3, 3e-3), depth_m(-5e-3, 5e-4)], [0.0; 3]);
    }
}
