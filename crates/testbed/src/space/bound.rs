//! Posterior Cramer-Rao bound of a trace in space.
//!
//! As the planar bound ([`crate::bound`]): along the true contacts, with the calibrated sensor model and the measurement noise,
//! without model errors. The state is the contact in World; its displacement is taken as known, so that the bound is that
//! of an estimator with exact knowledge of the sliding motion, and for a fixed point that of any estimator. The prior at a touch
//! is the calibrated part of the undeflected whisker. Readings of contacts outside the calibrated domain, at the tip or at several
//! places add no information.

use filters::bound::{Bound, information};
use filters::{Measurement, Process};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};
use trace::SpatialTrace;
use whisker::frames::{Base, World};
use whisker::space::frames::{Point, Pose};
use whisker::space::sensor::CalibratedSpace;

use super::to_base;

/// Prior standard deviation of the contact's displacement across the whisker at the touch.
const START_AWAY_SD_M: f64 = 1e-3;

/// Bound at one instant of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialBoundAt {
    /// Time since the start of the touch.
    pub since_touch_s: f64,
    /// Lower bound of the error covariance in World (m2), 3x3.
    pub covariance_m2: Matrix3<f64>,
}

/// Bound at every instant of a trace; `None` while the whisker is free.
pub fn bound(trace: &SpatialTrace, face: &CalibratedSpace, noise_sd_n_m: f64) -> Vec<Option<SpatialBoundAt>> {
    let mut touch: Option<(f64, Bound<3>)> = None;
    let rows = trace.recording.instants.iter().zip(&trace.truth.instants);
    let at = rows.map(|(known, truth)| {
        let Some(contact) = truth.contact else {
            touch = None;
            return None;
        };
        let to_base = to_base(&known.base);
        if touch.is_none() {
            let prior = prior_m2(face, &to_base, to_base.apply(Point::from_vector(contact.contact)));
            touch = Some((known.t_s, Bound::new(&prior)?));
        }
        let (touch_s, bound) = touch.as_mut()?;
        bound.predict(&KnownSlide, &contact.contact);
        let reading = Reading { face, to_base: &to_base, noise_sd_n_m };
        if let Some(gained) = information(&reading, &contact.contact).filter(|_| !contact.tip && !contact.split) {
            bound.update(gained);
        }
        Some(SpatialBoundAt { since_touch_s: known.t_s - *touch_s, covariance_m2: bound.covariance()? })
    });
    at.collect()
}

/// Prior covariance in World of a contact at a touch that is seen at `seen`.
fn prior_m2(face: &CalibratedSpace, to_base: &Pose<World, Base>, seen: Point<Base>) -> Matrix3<f64> {
    let (low, high) = face.domain.arc_range_m();
    // A uniform distribution has the variance of its squared length divided by 12.
    let variances = Vector3::new((high - low).powi(2) / 12.0, START_AWAY_SD_M.powi(2), START_AWAY_SD_M.powi(2));
    let jacobian = to_base.rotation().transpose() * face.around(seen).contact_with_jacobian(&face.rest).1;
    jacobian * Matrix3::from_diagonal(&variances) * jacobian.transpose()
}

/// Process model of a contact whose displacement in World is known: the covariance is unchanged.
struct KnownSlide;

impl Process<3> for KnownSlide {
    fn predict(&self, contact: &Vector3<f64>) -> Vector3<f64> {
        *contact
    }

    fn jacobian(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::identity()
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::zeros()
    }
}

/// Measurement model of a contact in World.
struct Reading<'a> {
    face: &'a CalibratedSpace,
    to_base: &'a Pose<World, Base>,
    noise_sd_n_m: f64,
}

impl Measurement<3, 2> for Reading<'_> {
    fn predict(&self, contact: &Vector3<f64>) -> Option<Vector2<f64>> {
        Some(self.face.predict(self.to_base.apply(Point::from_vector(*contact)))?.reading_n_m)
    }

    fn jacobian(&self, contact: &Vector3<f64>) -> Option<Matrix2x3<f64>> {
        let expected = self.face.predict(self.to_base.apply(Point::from_vector(*contact)))?;
        Some(expected.gradient_n * self.to_base.rotation())
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.noise_sd_n_m.powi(2)
    }
}
