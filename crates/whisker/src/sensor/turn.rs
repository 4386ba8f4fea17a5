//! Rotation of the whisker at a contact.

use nalgebra::{DMatrix, DVector, Vector2};

use super::scales::{Scaled, Scales, places};
use super::{AlongAway, CalibratedFace};
use crate::Whisker;
use crate::elastica::Elastica;

/// Rotation of the whisker at a contact as a smooth function of its coordinates: `v` times a polynomial in `u` and `v` (see
/// [`Scales`]), fitted over the region in which the model is evaluated to that of the sensor model or, if it has none, of
/// the exact whisker.
#[derive(Debug)]
pub(crate) struct Turn {
    scales: Scales,
    coefficients: [f64; TERMS.len()],
}

/// Powers of `u` and `v` in the polynomial.
const TERMS: [(i32, i32); 14] =
    [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (0, 1), (1, 1), (2, 1), (3, 1), (0, 2), (1, 2), (2, 2), (0, 3), (1, 3)]; // fmt: skip

/// Number of positions along and away that are fitted.
const PLACES: (usize, usize) = (12, 6);

impl Turn {
    pub(super) fn fitted(face: &CalibratedFace, whisker: &Whisker) -> Self {
        let scales = Scales::over(&face.modelled);
        let elastica = Elastica::new(whisker).ok();
        let (rows, turns): (Vec<_>, Vec<f64>) = places(&face.modelled, PLACES.0, PLACES.1)
            .filter_map(|at| {
                let contact = face.contact_at(at);
                let solved = || Some(elastica.as_ref()?.at_point(contact).ok()?.deflection.tangent_rad);
                let tangent_rad = face.model.tangent_rad(contact).or_else(solved)?;
                let Scaled { u, v, .. } = scales.scaled(at);
                Some((TERMS.map(|(i, j)| v * u.powi(i) * v.powi(j)), tangent_rad - face.rest.tangent_rad(at.along_m)))
            })
            .unzip();
        let matrix = DMatrix::from_fn(rows.len(), TERMS.len(), |row, term| rows[row][term]);
        let mut coefficients = [0.0; TERMS.len()];
        if let Ok(solution) = matrix.svd(true, true).solve(&DVector::from_vec(turns), 1e-9) {
            coefficients.copy_from_slice(solution.as_slice());
        }
        Self { scales, coefficients }
    }

    /// The rotation (rad) at a contact, and its derivatives along and away.
    #[inline]
    pub(crate) fn at(&self, at: AlongAway) -> (f64, Vector2<f64>) {
        let at = self.scales.scaled(at);
        let Scaled { u, v, .. } = at;
        let [a0, a1, a2, a3, a4, b0, b1, b2, b3, c0, c1, c2, d0, d1] = self.coefficients;
        // The polynomials in u that multiply the powers of v, and their derivatives.
        let values = [
            a0 + u * (a1 + u * (a2 + u * (a3 + u * a4))),
            b0 + u * (b1 + u * (b2 + u * b3)),
            c0 + u * (c1 + u * c2),
            d0 + u * d1,
        ];
        let slopes = [
            a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * 4.0 * a4)),
            b1 + u * (2.0 * b2 + u * 3.0 * b3),
            c1 + u * 2.0 * c2,
            d1,
        ];
        let horner = |of: [f64; 4]| of[0] + v * (of[1] + v * (of[2] + v * of[3]));
        let by_v = values[0] + v * (2.0 * values[1] + v * (3.0 * values[2] + v * 4.0 * values[3]));
        (v * horner(values), self.scales.gradient(v * horner(slopes), by_v, &at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::testing::knowledge_with;

    /// Pre-curvatures of a straight whisker and of one touched on its concave and on its convex side.
    const CURVATURES_PER_M: [f64; 3] = [0.0, 12.5, -12.5];

    /// Largest permitted error of the fitted reading, relative to the largest calibrated reading.
    const MOST: f64 = 1e-4;

    #[test]
    fn val_rotation_and_reading_are_those_of_the_exact_whisker_beyond_the_calibrated_domain_too() {
        for curvature_per_m in CURVATURES_PER_M {
            let knowledge = knowledge_with(curvature_per_m, "elastica");
            let (face, elastica) = (&knowledge.faces[0], Elastica::new(&knowledge.whisker).unwrap());
            let (turn, region) = (face.turn(&knowledge.whisker), &face.modelled);
            let (first_m, last_m) = region.arc_range_m();
            assert!(first_m < face.domain.arc_range_m().0);
            let (mut worst_rad, mut worst, mut compared) = (0.0_f64, 0.0_f64, 0);
            for (i, j) in (0..9).flat_map(|i| (1..9).map(move |j| (i, j))) {
                let (along, away) = (f64::from(i) / 8.0, f64::from(j) / 8.0);
                let along_m = first_m + along * (0.97 * last_m - first_m);
                let at = AlongAway::new(along_m, away * region.away_range_m(along_m).1);
                let contact = face.contact_at(at);
                let Ok(found) = elastica.at_point(contact) else { continue };
                let exact = found.deflection;
                compared += 1;
                let (turn_rad, slope) = turn.at(at);
                worst_rad = worst_rad.max((turn_rad + face.rest.tangent_rad(along_m) - exact.tangent_rad).abs());
                let miss_n_m = face.model.reading_n_m(contact) - exact.moment_n_m;
                worst = worst.max(miss_n_m.abs() / face.largest_reading_n_m);
                let h = 1e-6;
                let after =
                    |along_m: f64, away_m: f64| turn.at(AlongAway::new(at.along_m + along_m, at.away_m + away_m)).0;
                let differences = [after(h, 0.0) - after(-h, 0.0), after(0.0, h) - after(0.0, -h)];
                assert!((0..2).all(|i| (slope[i] - 0.5 * differences[i] / h).abs() < 1e-6 * (1.0 + slope[i].abs())));
            }
            assert!(
                compared > 60 && worst_rad < 2e-4 && worst < MOST,
                "{curvature_per_m}: {compared}, {worst_rad} rad, {worst}"
            );
        }
    }
}
