//! The object's radius, where it has one and the estimator states one: judged at the end of the contact, when all is known that can be.

use nalgebra::Vector2;
use trace::Outline;
use whisker::estimators::Radius;

use super::{Metric, Scored, Summary};
use crate::statistics::mean;

/// Two-sided standard deviations of a 95 % interval.
const SDS_95: f64 = 1.959_963_984_540_054;

/// How far the radius is off.
pub const ERROR: Metric = Metric {
    name: "radius_error",
    about: "error of the object's radius at the end, relative to the true one; only of round objects",
    summary: Summary::Median,
    measure: |scored| {
        let (stated, true_m) = at_end(scored)?;
        Some((stated.radius_m - true_m).abs() / true_m)
    },
};

/// Whether the radius lies in the stated interval.
pub const COVERED: Metric = Metric {
    name: "radius_covered_95",
    about: "1 where the stated 95 % interval of the radius at the end holds the true one; over trials, their share",
    summary: Summary::Mean,
    measure: |scored| {
        let (stated, true_m) = at_end(scored)?;
        Some(f64::from((stated.radius_m - true_m).abs() <= SDS_95 * stated.sd_m))
    },
};

/// The last radius stated during a contact, and the true one in m.
fn at_end(scored: &Scored<'_>) -> Option<(Radius, f64)> {
    let trial = scored.trial;
    let chord_error_m = trial.trace.sidecar.contour.as_ref()?.chord_error_m;
    let true_m = round_radius_m(trial.outline?, chord_error_m)?;
    let stated = scored.contacts.iter().rev().find_map(|contact| scored.estimates[contact.row]?.radius)?;
    Some((stated, true_m))
}

/// The radius of a round outline, of which the polyline is nowhere farther away than `chord_error_m`; nothing if it is not round.
fn round_radius_m(outline: &Outline, chord_error_m: f64) -> Option<f64> {
    // Coordinates are written with ten decimals.
    const ROUNDING_M: f64 = 1e-9;
    let points: Vec<Vector2<f64>> = outline.vertices().iter().map(|vertex| vertex.vector()).collect();
    let corners = &points[1..];
    let middle = corners.iter().sum::<Vector2<f64>>() / corners.len() as f64;
    let radius_m = mean(corners.iter().map(|corner| (corner - middle).norm()))?;
    let is_near = |point: Vector2<f64>| ((point - middle).norm() - radius_m).abs() <= chord_error_m + ROUNDING_M;
    let halves = points.windows(2).map(|edge| 0.5 * (edge[0] + edge[1]));
    corners.iter().copied().chain(halves).all(is_near).then_some(radius_m)
}

#[cfg(test)]
mod tests {
    use whisker::frames::Point;

    use super::*;

    fn polygon(corners: usize) -> Outline {
        let corner = |i: usize| {
            let angle = std::f64::consts::TAU * (i % corners) as f64 / corners as f64;
            Point::new(0.3 + 0.02 * angle.cos(), 0.02 * angle.sin())
        };
        Outline::new((0..=corners).map(corner).collect()).unwrap()
    }

    #[test]
    fn verif_a_circle_has_a_radius_and_an_octagon_has_none() {
        assert!((round_radius_m(&polygon(400), 1e-6).unwrap() - 0.02).abs() < 1e-9);
        assert_eq!(round_radius_m(&polygon(8), 0.0), None);
    }
}
