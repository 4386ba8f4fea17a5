//! The object's radius, where it has one and the estimator states one: judged by the last estimate of a contact, when all is known that can be.

use nalgebra::Vector2;
use trace::Outline;
use whisker::estimators::Radius;

use super::{Metric, Scored, Summary};
use crate::statistics::{NORMAL_95, mean};

/// How far the radius is off.
pub const ERROR: Metric = Metric {
    name: "radius_error",
    about: "error of the object's radius at the end, relative to the true one; only of round objects",
    summary: Summary::Median,
    measure: |scored| {
        let (true_m, stated) = (true_m(scored)?, stated(scored).pop()??);
        Some((stated.radius_m - true_m).abs() / true_m)
    },
};

/// Whether the radius lies in the stated interval.
pub const COVERED: Metric = Metric {
    name: "radius_covered_95",
    about: "1 where the stated 95 % interval of the radius at the end holds the true one, 0 also where a radius was stated before but not at the end; over trials, their share",
    summary: Summary::Mean,
    measure: |scored| is_covered(true_m(scored)?, &stated(scored)).map(f64::from),
};

/// Whether the interval stated last holds the true radius. Who takes back what he stated is not left out, for his silence would flatter him; who never
/// states a radius is not judged.
fn is_covered(true_m: f64, stated: &[Option<Radius>]) -> Option<bool> {
    let holds = |last: Radius| (last.radius_m - true_m).abs() <= NORMAL_95 * last.sd_m;
    let last = *stated.last()?;
    stated.iter().any(Option::is_some).then(|| last.is_some_and(holds))
}

/// What every estimate during a contact says of the radius, in the order of time.
fn stated(scored: &Scored<'_>) -> Vec<Option<Radius>> {
    scored.contacts.iter().filter_map(|contact| Some(scored.estimates[contact.row]?.radius)).collect()
}

/// The object's radius in m, where it is round.
fn true_m(scored: &Scored<'_>) -> Option<f64> {
    let chord_error_m = scored.trial.trace.sidecar.contour.as_ref()?.chord_error_m;
    round_radius_m(scored.trial.outline?, chord_error_m)
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

    #[test]
    fn verif_the_last_estimate_decides_whether_the_radius_is_covered() {
        let near = Some(Radius { radius_m: 0.021, sd_m: 1e-3 });
        let off = Some(Radius { radius_m: 0.03, sd_m: 1e-3 });
        for (stated, expected) in [
            (vec![off, near], Some(true)),
            (vec![near, off], Some(false)),
            (vec![near, None], Some(false)),
            (vec![None, near], Some(true)),
            (vec![None, None], None),
            (vec![], None),
        ] {
            assert_eq!(is_covered(0.02, &stated), expected, "{stated:?}");
        }
    }
}
