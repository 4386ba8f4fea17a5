//! Radius of round objects, for estimators that state one: evaluated at the last estimate of the contact.

use nalgebra::Vector2;
use trace::Outline;
use whisker::estimators::Radius;

use super::{Metric, Scored, Summary};
use crate::statistics::{NORMAL_95, mean};

/// Error of the radius.
pub const ERROR: Metric = Metric {
    name: "radius_error",
    about: "relative error of the object's radius at the end; round objects only",
    summary: Summary::Median,
    measure: |scored| {
        let (true_m, stated) = (true_m(scored)?, stated(scored).pop()??);
        Some((stated.radius_m - true_m).abs() / true_m)
    },
};

/// Coverage of the radius' interval.
pub const COVERED: Metric = Metric {
    name: "radius_covered_95",
    about: "1 if the final 95 % interval of the radius contains the true one, 0 if not or if a radius was stated \
        earlier but not at the end; over trials, the fraction",
    summary: Summary::Mean,
    measure: |scored| is_covered(true_m(scored)?, &stated(scored)).map(f64::from),
};

/// Whether the last stated interval contains the true radius. A radius that was stated and withdrawn counts as not
/// covered, since omitting it would bias the coverage. `None` if no radius was ever stated.
fn is_covered(true_m: f64, stated: &[Option<Radius>]) -> Option<bool> {
    let holds = |last: Radius| (last.radius_m - true_m).abs() <= NORMAL_95 * last.sd_m;
    let last = *stated.last()?;
    stated.iter().any(Option::is_some).then(|| last.is_some_and(holds))
}

/// Stated radius of every estimate during contact, in order of time.
fn stated(scored: &Scored<'_>) -> Vec<Option<Radius>> {
    scored.contacts.iter().filter_map(|contact| Some(scored.estimates[contact.row]?.radius)).collect()
}

/// True radius in m. `None` if the object is not round.
fn true_m(scored: &Scored<'_>) -> Option<f64> {
    let chord_error_m = scored.trial.trace.sidecar.contour.as_ref()?.chord_error_m;
    round_radius_m(scored.trial.outline?, chord_error_m)
}

/// Radius of a round outline given as a polyline with this chord error. `None` if the outline is not round.
fn round_radius_m(outline: &Outline, chord_error_m: f64) -> Option<f64> {
    // Coordinates are stored with ten decimals.
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
    fn verif_coverage_is_that_of_the_last_estimate() {
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
