//! Rotation of the whisker at a contact.

use nalgebra::{DMatrix, DVector, Vector2};

use super::scales::{Scaled, Scales, places};
use super::{AlongAway, CalibratedFace};
use crate::Whisker;
use crate::elastica::Elastica;

/// Rotation of the whisker at a contact as a smooth function of its coordinates: `v` times a polynomial in `s` and
/// `v = d / s`, fitted over the region in which the model is evaluated to that of the sensor model or, if it has none, of the
/// exact whisker.
#[derive(Debug)]
pub(crate) struct Turn {
    scales: Scales,
    coefficients: [f64; TERMS.len()],
}

/// Powers of `s` and `v` in the polynomial.
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
