//! Motion models in Cartesian coordinates.

use filters::{Process, congruence, product};
use nalgebra::{SMatrix, SVector};

use crate::estimators::side::Side;
use crate::frames::Point;
use crate::sensor::AlongAway;

/// A motion model whose state has the contact in Cartesian coordinates of Base instead of along and away from the
/// whisker.
pub(in crate::estimators) struct Cartesian<'a, Step> {
    pub(super) side: &'a Side,
    pub(super) step: Step,
}

impl<Step> Cartesian<'_, Step> {
    /// The state with the contact in coordinates along and away.
    fn along_and_away<const N: usize>(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let mut found = *x;
        let at = self.side.face.along_and_away(Point::new(x[0], x[1]));
        (found[0], found[1]) = (at.along_m, at.away_m);
        found
    }

    /// The state with the contact in Base, of a state with the contact along and away, and its derivatives.
    fn in_base<const N: usize>(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let (contact, of_contact) = self.side.face.contact_with_jacobian(AlongAway::of_state(x));
        let mut found = *x;
        (found[0], found[1]) = (contact.x(), contact.y());
        let mut jacobian = SMatrix::<f64, N, N>::identity();
        jacobian.fixed_view_mut::<2, 2>(0, 0).copy_from(&of_contact);
        (found, jacobian)
    }
}

impl<const N: usize, Step: Process<N>> Process<N> for Cartesian<'_, Step> {
    fn predict(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        self.in_base(&self.step.predict(&self.along_and_away(x))).0
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        self.linearised(x).1
    }

    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        let before = self.along_and_away(x);
        let (_, from) = self.in_base(&before);
        congruence(&from, &self.step.noise(&before))
    }

    fn linearised(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>, SMatrix<f64, N, N>) {
        let before = self.along_and_away(x);
        let (_, from) = self.in_base(&before);
        let (moved, by_before, noise) = self.step.linearised(&before);
        let (found, to) = self.in_base(&moved);
        // The inverse fails only at the whisker's centre of curvature; a contact there does not determine its position
        // along the whisker.
        let jacobian = product(&product(&to, &by_before), &from.try_inverse().unwrap_or_else(SMatrix::zeros));
        (found, jacobian, congruence(&from, &noise))
    }
}
