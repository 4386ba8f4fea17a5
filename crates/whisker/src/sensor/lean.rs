//! Effect of friction on a contact at a given place.

use nalgebra::{DMatrix, DVector, Vector2};

use super::scales::{Scaled, Scales, places};
use super::{AlongAway, CalibratedFace};
use crate::Whisker;
use crate::elastica::{Elastica, Friction};

/// Moment, tangent and arc length of a contact as smooth functions of its coordinates and of the ratio `q` of friction to
/// normal force (positive if the friction on the whisker is towards its tip), fitted to the exact whisker over the region in
/// which the model is evaluated.
///
/// Each effect is a polynomial in `u` and `v` (see [`Scales`]) for each of the first three powers of `q`. The effect on the
/// moment is relative, so that it applies to the reading of any sensor model. Those on tangent and arc length vanish with
/// the deflection, with which the force vanishes.
#[derive(Debug)]
pub(crate) struct Lean {
    scales: Scales,
    moment: Effect,
    turn_rad: Effect,
    arc_m: Effect,
    /// Arc length without friction, less `s`, divided by the relative deflection.
    straight_arc_m: Coefficients,
}

/// A quantity with its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Leaning {
    pub(crate) value: f64,
    /// Derivatives along and away.
    pub(crate) by_place: Vector2<f64>,
    /// Derivative by the ratio of friction to normal force.
    pub(crate) by_ratio: f64,
}

/// Powers of `u` and `v` in the polynomials.
const TERMS: [(usize, usize); 12] =
    [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (0, 1), (1, 1), (2, 1), (3, 1), (0, 2), (1, 2), (2, 2)]; // fmt: skip

/// Number of positions along and away that are fitted.
const PLACES: (usize, usize) = (10, 5);

/// Ratios of friction to normal force, of either sign, that are fitted.
const RATIOS: [f64; 2] = [0.35, 0.7];

/// Largest ratio at which the polynomials are evaluated; beyond it the effect is constant.
const MOST_RATIO: f64 = 1.0;

type Coefficients = [f64; TERMS.len()];

/// Polynomials in `u` and `v` by which the powers of `q` from the first on are multiplied.
type Effect = [Coefficients; 3];

/// Coefficients of `q`, `q^2` and `q^3` of a function that vanishes at zero, given at `-b, -a, a, b` with [`RATIOS`] `a, b`.
fn powers([low, less, more, high]: [f64; 4]) -> [f64; 3] {
    let [a, b] = RATIOS;
    let (odd_a, odd_b) = (0.5 * (more - less) / a, 0.5 * (high - low) / b);
    let (even_a, even_b) = (0.5 * (more + less), 0.5 * (high + low));
    let cubic = (odd_b - odd_a) / (b * b - a * a);
    [odd_a - cubic * a * a, (even_a * a * a + even_b * b * b) / (a.powi(4) + b.powi(4)), cubic]
}

impl Lean {
    pub(super) fn fitted(face: &CalibratedFace, whisker: &Whisker) -> Self {
        let scales = Scales::over(&face.modelled);
        let map = Self {
            scales,
            moment: Effect::default(),
            turn_rad: Effect::default(),
            arc_m: Effect::default(),
            straight_arc_m: Coefficients::default(),
        };
        let Ok(elastica) = Elastica::new(whisker) else { return map };
        let solved = |at: &AlongAway| {
            let contact = face.contact_at(*at);
            let with = |ratio| {
                let found = elastica.continued_at_point(contact, None, Friction { face: face.face, ratio })?;
                Some([found.deflection.moment_n_m, found.deflection.tangent_rad, found.load.arc_m])
            };
            let [moment, tangent, arc] = with(0.0)?;
            let [a, b] = RATIOS;
            let [v1, v2, v3, v4] = [with(-b)?, with(-a)?, with(a)?, with(b)?];
            let change = |quantity: usize, from: f64, scale: f64| {
                powers([v1, v2, v3, v4].map(|found| (found[quantity] - from) / scale))
            };
            let scaled = scales.scaled(*at);
            let deflection = scaled.v;
            let effects = [change(0, moment, moment), change(1, tangent, deflection), change(2, arc, deflection)];
            Some((scaled, effects, (arc - at.along_m) / deflection))
        };
        let found: Vec<_> = places(&face.modelled, PLACES.0, PLACES.1).filter_map(|at| solved(&at)).collect();
        let matrix = DMatrix::from_fn(found.len(), TERMS.len(), |row, term| {
            let (Scaled { u, v, .. }, (i, j)) = (found[row].0, TERMS[term]);
            u.powi(i as i32) * v.powi(j as i32)
        });
        let svd = matrix.svd(true, true);
        let fit = |values: Vec<f64>| {
            let solution = svd.solve(&DVector::from_vec(values), 1e-9).ok();
            solution.map_or([0.0; TERMS.len()], |solution| std::array::from_fn(|term| solution[term]))
        };
        let effect = |quantity: usize| {
            [0, 1, 2].map(|power| fit(found.iter().map(|(_, effects, _)| effects[quantity][power]).collect()))
        };
        let (moment, turn_rad, arc_m) = (effect(0), effect(1), effect(2));
        let straight_arc_m = fit(found.iter().map(|(_, _, arc)| *arc).collect());
        Self { moment, turn_rad, arc_m, straight_arc_m, ..map }
    }

    /// Value of a polynomial, and its derivatives along and away.
    fn polynomial(&self, coefficients: &Coefficients, at: &Scaled) -> (f64, Vector2<f64>) {
        let Scaled { u, v, .. } = *at;
        let [a0, a1, a2, a3, a4, b0, b1, b2, b3, c0, c1, c2] = *coefficients;
        // The polynomials in u that multiply the powers of v, and their derivatives.
        let values =
            [a0 + u * (a1 + u * (a2 + u * (a3 + u * a4))), b0 + u * (b1 + u * (b2 + u * b3)), c0 + u * (c1 + u * c2)];
        let slopes = [
            a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * 4.0 * a4)),
            b1 + u * (2.0 * b2 + u * 3.0 * b3),
            c1 + u * 2.0 * c2,
        ];
        let value = values[0] + v * (values[1] + v * values[2]);
        let by_u = slopes[0] + v * (slopes[1] + v * slopes[2]);
        let by_v = values[1] + 2.0 * v * values[2];
        (value, self.scales.gradient(by_u, by_v, at))
    }

    /// The effect at a contact.
    fn effect(&self, effect: &Effect, at: &Scaled, ratio: f64) -> Leaning {
        let q = ratio.clamp(-MOST_RATIO, MOST_RATIO);
        let [first, second, third] = effect;
        let at_ratio: Coefficients = std::array::from_fn(|i| q * (first[i] + q * (second[i] + q * third[i])));
        let (value, by_place) = self.polynomial(&at_ratio, at);
        let by_ratio = if q == ratio {
            let slope: Coefficients = std::array::from_fn(|i| first[i] + q * (2.0 * second[i] + q * 3.0 * third[i]));
            self.polynomial(&slope, at).0
        } else {
            0.0
        };
        Leaning { value, by_place, by_ratio }
    }

    /// The same times the relative deflection.
    fn deflected(of: Leaning, &Scaled { v, gradient_v, .. }: &Scaled) -> Leaning {
        Leaning { value: v * of.value, by_place: v * of.by_place + of.value * gradient_v, by_ratio: v * of.by_ratio }
    }

    /// Ratio of the moment to that without friction.
    pub(crate) fn moment_ratio(&self, at: AlongAway, ratio: f64) -> Leaning {
        let effect = self.effect(&self.moment, &self.scales.scaled(at), ratio);
        Leaning { value: 1.0 + effect.value, ..effect }
    }

    /// Angle (rad) from the tangent without friction to that with friction.
    pub(crate) fn turn_rad(&self, at: AlongAway, ratio: f64) -> Leaning {
        let scaled = self.scales.scaled(at);
        Self::deflected(self.effect(&self.turn_rad, &scaled, ratio), &scaled)
    }

    /// Arc length of the contact, less its coordinate along.
    pub(crate) fn beyond_m(&self, at: AlongAway, ratio: f64) -> Leaning {
        let scaled = self.scales.scaled(at);
        let Leaning { value, by_place, by_ratio } = self.effect(&self.arc_m, &scaled, ratio);
        let (straight_m, slope) = self.polynomial(&self.straight_arc_m, &scaled);
        Self::deflected(Leaning { value: value + straight_m, by_place: by_place + slope, by_ratio }, &scaled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::testing::knowledge_with;

    const RATIOS: [f64; 5] = [-0.6, -0.2, 0.1, 0.3, 0.5];

    fn places(face: &CalibratedFace) -> Vec<AlongAway> {
        let (low_m, high_m) = face.modelled.arc_range_m();
        let at = |(i, j): (u32, u32)| {
            let along_m = low_m + (high_m - low_m) * (f64::from(i) + 0.5) / 6.0;
            AlongAway::new(along_m, face.modelled.away_range_m(along_m).1 * (f64::from(j) + 0.5) / 4.0)
        };
        (0..6).flat_map(|i| (0..4).map(move |j| at((i, j)))).collect()
    }

    #[test]
    fn val_effects_are_those_of_the_exact_whisker() {
        let knowledge = knowledge_with(-6.0, "elastica");
        let face = &knowledge.faces[0];
        let (lean, elastica) = (face.lean(&knowledge.whisker), Elastica::new(&knowledge.whisker).unwrap());
        let (mut largest, mut worst) = ([0.0_f64; 3], [0.0_f64; 3]);
        for at in places(face) {
            let solved = |ratio| {
                let friction = Friction { face: face.face, ratio };
                elastica.at_point_with_friction(face.contact_at(at), friction).unwrap()
            };
            let free = solved(0.0);
            for ratio in RATIOS {
                let rubbed = solved(ratio);
                let expected = [
                    rubbed.deflection.moment_n_m / free.deflection.moment_n_m - 1.0,
                    rubbed.deflection.tangent_rad - free.deflection.tangent_rad,
                    rubbed.load.arc_m - free.load.arc_m,
                ];
                let found = [
                    lean.moment_ratio(at, ratio).value - 1.0,
                    lean.turn_rad(at, ratio).value,
                    lean.beyond_m(at, ratio).value - lean.beyond_m(at, 0.0).value,
                ];
                for i in 0..3 {
                    largest[i] = largest[i].max(expected[i].abs());
                    worst[i] = worst[i].max((found[i] - expected[i]).abs());
                }
                let arc_m = at.along_m + lean.beyond_m(at, ratio).value;
                assert!((arc_m - rubbed.load.arc_m).abs() < 5e-6, "{at:?} {ratio}: {arc_m} {}", rubbed.load.arc_m);
            }
        }
        assert!((0..3).all(|i| worst[i] < 0.02 * largest[i]), "{worst:?} of {largest:?}");
    }

    #[test]
    fn verif_derivatives_are_differences() {
        let knowledge = knowledge_with(-6.0, "elastica");
        let face = &knowledge.faces[0];
        let lean = face.lean(&knowledge.whisker);
        type Quantity = fn(&Lean, AlongAway, f64) -> Leaning;
        for quantity in [Lean::moment_ratio as Quantity, Lean::turn_rad, Lean::beyond_m] {
            for at in places(face) {
                let found = quantity(lean, at, 0.3);
                let value = |along_m: f64, away_m: f64, ratio: f64| {
                    quantity(lean, AlongAway::new(at.along_m + along_m, at.away_m + away_m), 0.3 + ratio).value
                };
                let h = 1e-6;
                let expected = [
                    value(h, 0.0, 0.0) - value(-h, 0.0, 0.0),
                    value(0.0, h, 0.0) - value(0.0, -h, 0.0),
                    value(0.0, 0.0, h) - value(0.0, 0.0, -h),
                ]
                .map(|change| change / (2.0 * h));
                for (found, expected) in
                    [found.by_place[0], found.by_place[1], found.by_ratio].into_iter().zip(expected)
                {
                    assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{at:?}: {found} {expected}");
                }
            }
        }
    }
}
