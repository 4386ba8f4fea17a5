//! The process and measurement model that the filters share: a contact at rest in the world, and its reading.
//!
//! The state is the contact in coordinates along and away from the undeflected whisker, `x = (s, d)`. In them the knowledge at the touch is a
//! Gaussian even on a strongly curved whisker, where in Cartesian coordinates it is a crescent that no Gaussian describes, and the reading is nearly a product
//! of a stiffness that depends on `s` and the deflection `d`.

use filters::{Gaussian, Innovation, Measurement, Process};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2, vector};

use super::{Estimate, Sample};
use crate::frames::{Base, Pose};
use crate::sensor::CalibratedFace;

/// A contact that rests in the world, seen from the moving base, and wanders a little.
///
/// With the twist (v, w) of the base it moves in Base by `dp/dt = -v - w x p` (Lin et al. 2022); here the step is exact, from the pose of the
/// base's last frame in its present one.
pub(super) struct StaticContact<'a> {
    face: &'a CalibratedFace,
    motion: Pose<Base, Base>,
    /// Variance that one step adds in each direction.
    wander_m2: f64,
}

impl<'a> StaticContact<'a> {
    /// One step in which the contact wanders by `wander_m_sqrt_s`, the standard deviation after one second.
    pub(super) fn new(face: &'a CalibratedFace, sample: &Sample, wander_m_sqrt_s: f64) -> Self {
        Self { face, motion: sample.motion, wander_m2: wander_m_sqrt_s * wander_m_sqrt_s * sample.dt_s }
    }
}

impl Process<2> for StaticContact<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        let (arc_m, away_m) = self.face.along_and_away(self.motion.apply(self.face.contact_at(x[0], x[1])));
        vector![arc_m, away_m]
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Matrix2<f64> {
        let moved = self.predict(x);
        let before = self.face.contact_jacobian(x[0], x[1]);
        // Only in the whisker's centre of curvature there is no inverse; a contact there says nothing of where along the whisker it was.
        let after = self.face.contact_jacobian(moved[0], moved[1]).try_inverse().unwrap_or_default();
        after * self.motion.rotation() * before
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.wander_m2
    }
}

/// The reading of a contact. Beyond the calibrated region it is continued linearly from the nearest calibrated contact, so that a belief
/// that reaches over the border is drawn back; the sensor model itself is never asked there.
pub(super) struct ContactReading<'a> {
    face: &'a CalibratedFace,
    /// Variance of the reading: measurement noise and the sensor model's own error.
    variance_n2_m2: f64,
}

impl<'a> ContactReading<'a> {
    pub(super) fn new(face: &'a CalibratedFace, noise_sd_n_m: f64) -> Self {
        let model = face.heldout_rms_n_m;
        Self { face, variance_n2_m2: noise_sd_n_m * noise_sd_n_m + model * model }
    }

    /// Reading and gradient along and away.
    fn expect(&self, x: &Vector2<f64>) -> (f64, RowVector2<f64>) {
        let (arc_m, away_m) = self.face.domain.clamp(x[0], x[1]);
        let expected = self.face.model.predict(self.face.contact_at(arc_m, away_m));
        let gradient = expected.gradient_n.transpose() * self.face.contact_jacobian(arc_m, away_m);
        let beyond = vector![x[0] - arc_m, x[1] - away_m];
        (expected.reading_n_m + (gradient * beyond)[0], gradient)
    }
}

impl Measurement<2, 1> for ContactReading<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        let (arc_m, away_m) = self.face.domain.clamp(x[0], x[1]);
        let is_calibrated = arc_m == x[0] && away_m == x[1];
        Some(Vector1::new(if is_calibrated {
            self.face.model.reading_n_m(self.face.contact_at(arc_m, away_m))
        } else {
            self.expect(x).0
        }))
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Option<RowVector2<f64>> {
        Some(self.expect(x).1)
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(self.variance_n2_m2)
    }
}

/// What is known at the touch: the contact lies on the undeflected whisker, anywhere along its calibrated part. The Gaussian has the variance of
/// an even spread along it and `away_sd_m` across.
pub(super) fn start(face: &CalibratedFace, away_sd_m: f64) -> Gaussian<2> {
    let (low, high) = face.domain.arc_range_m();
    let variances = vector![(high - low).powi(2) / 12.0, away_sd_m * away_sd_m];
    Gaussian::new(vector![0.5 * (low + high), 0.0], Matrix2::from_diagonal(&variances))
}

/// Holds the mean of a belief within the calibrated region, since the touch is known to lie there, and states it. The covariance stays as it is:
/// near the border the ellipse reaches over it, on the side of caution.
pub(super) fn hold(belief: &mut Gaussian<2>, face: &CalibratedFace, innovation: Option<Innovation<1>>) -> Estimate {
    let (arc_m, away_m) = face.domain.clamp(belief.mean[0], belief.mean[1]);
    let held = vector![arc_m, away_m];
    let calibrated = held == belief.mean;
    belief.mean = held;
    let jacobian = face.contact_jacobian(arc_m, away_m);
    Estimate {
        contact: face.contact_at(arc_m, away_m),
        face: face.face,
        covariance_m2: Some(jacobian * belief.covariance * jacobian.transpose()),
        calibrated,
        innovation,
    }
}
