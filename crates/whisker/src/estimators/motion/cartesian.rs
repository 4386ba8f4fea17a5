//! Motions in other coordinates.

use filters::{Process, congruence, product};
use nalgebra::{SMatrix, SVector};

use crate::estimators::side::Side;
use crate::frames::Point;

/// A motion of the contact with its place in Cartesian coordinates of Base instead of along and away from the whisker.
pub(in crate::estimators) struct Cartesian<'a, Step> {
    pub(super) side: &'a Side,
    pub(super) step: Step,
}

impl<Step> Cartesian<'_, Step> {
    /// The state with its place along and away.
    fn along_and_away<const N: usize>(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let mut found = *x;
        (found[0], found[1]) = self.side.face.along_and_away(Point::new(x[0], x[1]));
        found
    }

    /// The state that has its place along and away at `x` as it stands here, and its derivatives.
    fn in_base<const N: usize>(&self, x: &SVector<f64, N>) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let (contact, of_contact) = self.side.face.contact_with_jacobian(x[0], x[1]);
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
        // Only in the whisker's centre of curvature there is no inverse; a contact there says nothing of where along the whisker it was.
        let jacobian = product(&product(&to, &by_before), &from.try_inverse().unwrap_or_else(SMatrix::zeros));
        (found, jacobian, congruence(&from, &noise))
    }
}
