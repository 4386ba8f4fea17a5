//! Mode of a fit: a solution with its uncertainty.

use nalgebra::SMatrix;

use super::search::Prior;
use crate::frames::{Base, Start};
use crate::space::estimators::motion::{Fitted, Object, Shape, Swing, moved};
use crate::space::estimators::side::Side;
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Factor of the contact's distance from the undeflected whisker above which the reference pose is renewed: near the undeflected
/// whisker the direction of the force is uncertain.
const FARTHER: f64 = 1.5;

/// An object that explains the readings.
#[derive(Clone, Copy)]
pub(super) struct Mode<Body, const N: usize> {
    /// Pose of the base that the state belongs to.
    pub(super) reference: Pose<Base, Start>,
    pub(super) prior: Prior<N>,
    pub(super) about: Fitted<Body, N>,
    pub(super) covariance: SMatrix<f64, N, N>,
    /// Cost per mean relative to its expectation, at least 1.
    pub(super) excess: f64,
    pub(super) log_weight: f64,
    /// The contact at the present instant, without tilt.
    pub(super) near: Around,
    /// Mean (rad) and variance of the tilt at the present instant.
    pub(super) tilt: (f64, f64),
    /// Swing of the wire along the object.
    pub(super) swing: Swing,
    /// Angular frequency of the wire's oscillation along the object.
    pub(super) oscillation_rad_s: f64,
}

impl<Body: Object, const N: usize> Mode<Body, N> {
    /// Whether it was never weighed against the others.
    pub(super) fn is_new(&self) -> bool {
        self.log_weight == f64::NEG_INFINITY
    }

    /// Refers the state to the present pose of the base if the whisker is deflected farther there.
    pub(super) fn renew<Model: Shape<N, Object = Body>>(
        &mut self,
        side: &Side,
        model: &Model,
        base: &Pose<Base, Start>,
    ) {
        if self.near.away_m() < FARTHER * Around::of_state(&self.about.x).away_m() {
            return;
        }
        let motion = self.reference.then(&base.inverse());
        let Some((x, slopes)) = moved(side, model, &self.about.x, (&motion, 0.0), self.near) else { return };
        let Some(about) = Fitted::new(side, model, &x) else { return };
        (self.reference, self.about) = (*base, about);
        self.covariance = slopes * self.covariance * slopes.transpose();
        self.prior.mean.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(0));
    }
}
