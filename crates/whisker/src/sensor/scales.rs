//! Coordinates in which quantities of the deflected whisker are nearly polynomials of low degree.

use nalgebra::{Vector2, vector};

use super::{AlongAway, Domain};

/// Coordinates of a contact for polynomials: `u` is the arc length `s`, scaled to -1 to 1 over the region, and `v` the
/// slope `d / s` divided by the largest slope of the region. A given slope deflects a whisker to similar shapes anywhere
/// along it, so that polynomials of low degree suffice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scales {
    centre_m: f64,
    half_m: f64,
    /// Smallest arc length by which a distance is divided.
    least_m: f64,
    /// Largest slope.
    steepest: f64,
}

/// `u` and `v` of a contact, with the gradient of `v` (1/m) along and away.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scaled {
    pub(super) u: f64,
    pub(super) v: f64,
    pub(super) gradient_v: Vector2<f64>,
}

/// Smallest arc length by which a distance is divided, relative to the largest of the region.
const LEAST_ARC: f64 = 0.02;

impl Scales {
    pub(super) fn over(region: &Domain) -> Self {
        let (low_m, high_m) = region.arc_range_m();
        let least_m = LEAST_ARC * high_m;
        let slopes = region.upper_nodes().map(|(arc_m, upper_m)| upper_m / arc_m.max(least_m));
        let steepest = slopes.fold(f64::EPSILON, f64::max);
        Self { centre_m: 0.5 * (low_m + high_m), half_m: 0.5 * (high_m - low_m), least_m, steepest }
    }

    pub(super) fn scaled(&self, at: AlongAway) -> Scaled {
        let along_m = at.along_m.max(self.least_m);
        let by_away = 1.0 / (along_m * self.steepest);
        let v = at.away_m * by_away;
        let by_along = if at.along_m > self.least_m { -v / along_m } else { 0.0 };
        Scaled { u: (at.along_m - self.centre_m) / self.half_m, v, gradient_v: vector![by_along, by_away] }
    }

    /// Gradient along and away of a function with these derivatives by `u` and `v`.
    pub(super) fn gradient(&self, by_u: f64, by_v: f64, at: &Scaled) -> Vector2<f64> {
        at.gradient_v * by_v + vector![by_u / self.half_m, 0.0]
    }
}

/// Deflected contacts, `along` by `away` of them, spread over a region.
pub(super) fn places(region: &Domain, along: usize, away: usize) -> impl Iterator<Item = AlongAway> {
    let (low_m, high_m) = region.arc_range_m();
    let at = move |(i, j): (usize, usize)| {
        let arc_m = low_m + (high_m - low_m) * i as f64 / (along - 1) as f64;
        AlongAway::new(arc_m, region.away_range_m(arc_m).1 * j as f64 / away as f64)
    };
    let numbers = (0..along).flat_map(move |i| (1..=away).map(move |j| (i, j)));
    numbers.map(at).filter(|at| at.away_m > 0.0)
}
