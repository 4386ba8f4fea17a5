//! The side of the whisker that touches, as a filter sees it: coordinates, the tangent of the deflected whisker, and the reading's model.
//!
//! A contact is written `(s, d)`, along and away from the undeflected whisker. In these coordinates what is known at the touch is a Gaussian
//! even on a strongly curved whisker, where in Cartesian coordinates it is a crescent that no Gaussian describes, and the reading is nearly
//! a product of a stiffness that depends on `s` and the deflection `d`.

use std::sync::Arc;

use filters::unscented::{self, Spread};
use filters::{Gaussian, Innovation, Measurement, Process, product};
use nalgebra::{Matrix1, Matrix2, RowVector2, SMatrix, SVector, Vector1, Vector2, vector};

use super::{BaseNoise, Estimate, Knowledge, Radius};
use crate::Whisker;
use crate::frames::{Base, Point};
use crate::sensor::{CalibratedFace, Turn};

/// How far a contact may lie beyond the calibrated region, as a share of the region's extent along the whisker.
const MARGIN: f64 = 0.1;

/// What a filter knows of the side that touches.
pub(super) struct Side {
    pub(super) face: Arc<CalibratedFace>,
    whisker: Whisker,
    /// Variance of the sensor's measurement noise.
    sensor_noise_n2_m2: f64,
    pub(super) base_noise: BaseNoise,
    /// Whether there is any.
    base_is_noisy: bool,
}

impl Side {
    pub(super) fn new(face: &Arc<CalibratedFace>, knowledge: &Knowledge) -> Self {
        let whisker = knowledge.whisker.clone();
        // Fitted here, the first time, so that no step has to.
        face.turn(&whisker);
        Self {
            face: face.clone(),
            whisker,
            sensor_noise_n2_m2: knowledge.noise_sd_n_m.powi(2),
            base_noise: knowledge.base_noise,
            base_is_noisy: !knowledge.base_noise.is_none(),
        }
    }

    /// How the whisker turns at a contact.
    fn turn(&self) -> &Turn {
        self.face.turn(&self.whisker)
    }

    /// Angle from the undeflected whisker's tangent at arc length `s` to that of the deflected whisker at the contact, and its
    /// derivatives along and away. Beyond the calibrated region it stays as it is at the border.
    pub(super) fn turn_rad(&self, arc_m: f64, away_m: f64) -> (f64, Vector2<f64>) {
        let (arc_m, away_m) = self.face.domain.clamp(arc_m, away_m);
        self.turn().at(arc_m, away_m)
    }

    /// Angle in Base of the deflected whisker's tangent at a contact, and its derivatives along and away. Beyond the calibrated region it is
    /// continued linearly.
    pub(super) fn tangent_rad(&self, arc_m: f64, away_m: f64) -> (f64, Vector2<f64>) {
        let held = self.face.domain.clamp(arc_m, away_m);
        let (turn_rad, slope) = self.turn().at(held.0, held.1);
        let beyond = slope.dot(&vector![arc_m - held.0, away_m - held.1]);
        let rest_rad = self.face.rest.tangent_rad(arc_m);
        (rest_rad + turn_rad + beyond, slope + vector![self.face.rest.curvature_per_m(arc_m), 0.0])
    }

    /// Expected reading of a contact, and its derivatives along and away. Beyond the calibrated region it is continued linearly from the nearest
    /// calibrated contact, so that a belief that reaches over the border is drawn back; the sensor model itself is never asked there.
    pub(super) fn expect(&self, arc_m: f64, away_m: f64) -> (f64, RowVector2<f64>) {
        let held = self.face.domain.clamp(arc_m, away_m);
        let (contact, jacobian) = self.face.contact_with_jacobian(held.0, held.1);
        let expected = self.face.model.predict(contact);
        let gradient = product(&expected.gradient_n.transpose(), &jacobian);
        let beyond_n_m = gradient.transpose().dot(&vector![arc_m - held.0, away_m - held.1]);
        (expected.reading_n_m + beyond_n_m, gradient)
    }

    /// Expected reading alone.
    pub(super) fn reading_n_m(&self, arc_m: f64, away_m: f64) -> f64 {
        if self.face.domain.clamp(arc_m, away_m) == (arc_m, away_m) {
            self.face.model.reading_n_m(self.face.contact_at(arc_m, away_m))
        } else {
            self.expect(arc_m, away_m).0
        }
    }

    /// Variance of the sensor model's own error at a contact; beyond the calibrated region that at its border.
    pub(super) fn model_variance_n2_m2(&self, arc_m: f64, away_m: f64) -> f64 {
        self.face.model_variance_at_n2_m2(arc_m, away_m)
    }

    /// Variance of the noise of a contact's reading: that of the sensor, and what the noise of the base makes of it.
    fn noise_n2_m2(&self, arc_m: f64, away_m: f64) -> f64 {
        if !self.base_is_noisy {
            return self.sensor_noise_n2_m2;
        }
        let (arc_m, away_m) = self.face.domain.clamp(arc_m, away_m);
        let contact = self.face.contact_at(arc_m, away_m);
        let gradient_n = self.face.model.predict(contact).gradient_n;
        self.sensor_noise_n2_m2 + self.base_noise.of_reading_n2_m2(contact, &gradient_n)
    }

    /// Variance of the reading of a contact: measurement noise and the sensor model's own error.
    pub(super) fn variance_n2_m2(&self, arc_m: f64, away_m: f64) -> f64 {
        self.noise_n2_m2(arc_m, away_m) + self.model_variance_n2_m2(arc_m, away_m)
    }

    /// Variance of the mean of some readings of one contact: their noise averages out, the sensor model's error does not.
    pub(super) fn variance_of_mean_n2_m2(&self, arc_m: f64, away_m: f64, count: f64) -> f64 {
        self.noise_n2_m2(arc_m, away_m) / count + self.model_variance_n2_m2(arc_m, away_m)
    }

    /// Holds a place near the calibrated region. Not within it: objects push the whisker farther than its calibration did, and a belief held back there
    /// would be wrong from then on.
    pub(super) fn hold<const N: usize>(&self, x: &mut SVector<f64, N>) {
        let (arc_m, away_m) = self.face.domain.clamp(x[0], x[1]);
        let (low_m, high_m) = self.face.domain.arc_range_m();
        let most_m = MARGIN * (high_m - low_m);
        (x[0], x[1]) = (x[0].clamp(arc_m - most_m, arc_m + most_m), x[1].clamp(away_m - most_m, away_m + most_m));
    }

    /// StateArray a belief under a model of the contact's motion.
    pub(super) fn estimate<const N: usize>(
        &self,
        radius: Option<usize>,
        belief: &Gaussian<N>,
        innovation: Option<Innovation<1>>,
    ) -> Estimate {
        let (arc_m, away_m) = (belief.mean[0], belief.mean[1]);
        let place = Gaussian::new(vector![arc_m, away_m], belief.covariance.fixed_view::<2, 2>(0, 0).into());
        let contact = self.in_base(&place);
        let radius = self.radius(radius, belief, self.face.contact_at(arc_m, away_m));
        let is_calibrated = self.face.domain.contains(arc_m, away_m);
        let stated = self.estimate_at(Point::from_vector(contact.mean), is_calibrated, contact.covariance, innovation);
        Estimate { radius, ..stated }
    }

    /// A belief about the place in coordinates of Base. At the touch it reaches centimetres along the whisker and microns across, and where the whisker is
    /// curved so is the band that it fills there. Its mean and covariance are those of sigma points on the bend ([`filters::unscented`]); a linear
    /// map would state a straight band, as thin, beside which the contact lies.
    fn in_base(&self, place: &Gaussian<2>) -> Gaussian<2> {
        const SPREAD: Spread = Spread { alpha: 1.0, beta: 0.0, kappa: 1.0 };
        let mut found = *place;
        if unscented::predict(&mut found, &Placing(&self.face), &SPREAD).is_ok() {
            return found;
        }
        let jacobian = self.face.contact_jacobian(place.mean[0], place.mean[1]);
        let contact = self.face.contact_at(place.mean[0], place.mean[1]);
        Gaussian::new(contact.vector(), jacobian * place.covariance * jacobian.transpose())
    }

    /// Radius of the wire at an arc length.
    pub(super) fn wire_radius_m(&self, arc_m: f64) -> f64 {
        0.5 * self.whisker.diameter_m(arc_m)
    }

    /// Radius of the object alone that a belief states, where its model of the motion has one; no object is smaller than a point.
    pub(super) fn radius<const N: usize>(
        &self,
        radius: Option<usize>,
        belief: &Gaussian<N>,
        contact: Point<Base>,
    ) -> Option<Radius> {
        let i = radius?;
        let wire_m = self.wire_radius_m(self.face.along_and_away(contact).0);
        let sd_m = belief.covariance[(i, i)].max(0.0).sqrt();
        Some(Radius { radius_m: (belief.mean[i] - wire_m).max(0.0), sd_m })
    }

    /// StateArray a contact with its covariance in Base.
    pub(super) fn estimate_at(
        &self,
        contact: Point<Base>,
        calibrated: bool,
        covariance_m2: Matrix2<f64>,
        innovation: Option<Innovation<1>>,
    ) -> Estimate {
        let covariance_m2 = Some(covariance_m2);
        let face = self.face.face;
        Estimate { contact, face, covariance_m2, calibrated, at_tip: false, innovation, radius: None, models: None }
    }
}

/// From along and away to Base.
struct Placing<'a>(&'a CalibratedFace);

impl Process<2> for Placing<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.0.contact_at(x[0], x[1]).vector()
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::zeros()
    }
}

/// The reading of a contact that is the first two numbers of a state.
#[derive(Clone, Copy)]
pub(super) struct ContactReading<'a> {
    side: &'a Side,
    /// Which number of the state is the sensor model's error, in standard deviations; without one the error is part of the noise.
    model_error: Option<usize>,
}

impl<'a> ContactReading<'a> {
    /// The measurement that belongs to a model of the contact's motion.
    pub(super) fn new(side: &'a Side, model_error: Option<usize>) -> Self {
        Self { side, model_error }
    }
}

impl<const N: usize> Measurement<N, 1> for ContactReading<'_> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector1<f64>> {
        let error_n_m = self.model_error.map_or(0.0, |e| x[e] * self.side.model_variance_n2_m2(x[0], x[1]).sqrt());
        Some(Vector1::new(self.side.reading_n_m(x[0], x[1]) + error_n_m))
    }

    /// The error's own change along and away is left out: it is far smaller than that of the reading.
    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 1, N>> {
        Some(self.linearised(x)?.1)
    }

    /// The sensor model is asked once.
    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>)> {
        let (mut expected_n_m, gradient) = self.side.expect(x[0], x[1]);
        let mut jacobian = SMatrix::<f64, 1, N>::zeros();
        jacobian.fixed_view_mut::<1, 2>(0, 0).copy_from(&gradient);
        if let Some(e) = self.model_error {
            let sd_n_m = self.side.model_variance_n2_m2(x[0], x[1]).sqrt();
            expected_n_m += x[e] * sd_n_m;
            jacobian[e] = sd_n_m;
        }
        Some((Vector1::new(expected_n_m), jacobian))
    }

    /// The sensor model's error counts here, too: part of it may change from one sample to the next, as where friction sets in, and the
    /// calibration does not tell how much.
    fn noise(&self, x: &SVector<f64, N>) -> Matrix1<f64> {
        Matrix1::new(self.side.variance_n2_m2(x[0], x[1]))
    }
}
