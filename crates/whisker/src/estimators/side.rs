//! The side of the whisker in contact: coordinates, tangent of the deflected whisker, and measurement model.
//!
//! A contact is written `(s, d)`, along and away from the undeflected whisker. In these coordinates the prior at the
//! touch is Gaussian even on a strongly curved whisker, where in Cartesian coordinates it is a crescent that no
//! Gaussian describes, and the reading is nearly the product of a stiffness that depends on `s` and the deflection `d`.

use std::sync::Arc;

use filters::unscented::{self, Spread};
use filters::{Gaussian, Innovation, Measurement, Process, product};
use nalgebra::{Matrix1, Matrix2, RowVector2, SMatrix, SVector, Vector1, Vector2, vector};

use super::{BENT_STRETCH, BaseNoise, Estimate, Knowledge, Radius};
use crate::Whisker;
use crate::frames::{Base, Point};
use crate::regained::Unknown;
use crate::sensor::{AlongAway, CalibratedFace, Lean, Leaning, Turn};

/// Largest distance of a contact from the modelled region, as a share of its extent along the whisker.
const MARGIN: f64 = 0.1;

/// Relative standard deviation of the part of a reading that is extrapolated linearly beyond the modelled region.
const LINEAR_SD: f64 = 0.3;

/// Relative standard deviation of the part of a reading that mechanics add between the calibrated domain and the border of the
/// modelled region.
const MECHANICS_SD: f64 = 0.1;

/// Part of the whisker's length that counts as its tip.
const TIP_SHARE: f64 = 0.01;

/// The side in contact.
pub(super) struct Side {
    pub(super) face: Arc<CalibratedFace>,
    pub(super) whisker: Whisker,
    /// Variance of the sensor's measurement noise.
    sensor_noise_n2_m2: f64,
    pub(super) base_noise: BaseNoise,
    /// Whether `base_noise` is not zero.
    base_is_noisy: bool,
}

impl Side {
    pub(super) fn new(face: &Arc<CalibratedFace>, knowledge: &Knowledge) -> Self {
        let whisker = knowledge.whisker.clone();
        // Fitted at the first call, so that no step has to.
        face.turn(&whisker);
        Self {
            face: face.clone(),
            whisker,
            sensor_noise_n2_m2: knowledge.noise_sd_n_m.powi(2),
            base_noise: knowledge.base_noise,
            base_is_noisy: !knowledge.base_noise.is_none(),
        }
    }

    /// Rotation of the whisker at its contacts.
    fn turn(&self) -> &Turn {
        self.face.turn(&self.whisker)
    }

    /// Angle (rad) from the undeflected whisker's tangent at arc length `s` to that of the deflected whisker at the
    /// contact, and its derivatives along and away. Constant beyond the border of the modelled region.
    pub(super) fn turn_rad(&self, at: AlongAway) -> (f64, Vector2<f64>) {
        self.turn().at(self.face.modelled.clamp(at))
    }

    /// Angle in Base (rad) of the deflected whisker's tangent at a contact, and its derivatives along and away.
    /// Extrapolated linearly beyond the modelled region.
    pub(super) fn tangent_rad(&self, at: AlongAway) -> (f64, Vector2<f64>) {
        let held = self.face.modelled.clamp(at);
        let (turn_rad, slope) = self.turn().at(held);
        let beyond = slope.dot(&(at.vector() - held.vector()));
        let rest_rad = self.face.rest.tangent_rad(at.along_m);
        (rest_rad + turn_rad + beyond, slope + vector![self.face.rest.curvature_per_m(at.along_m), 0.0])
    }

    /// Readings without a contact on this side, with noise of this variance.
    pub(super) fn unknown(&self, noise_n2_m2: f64) -> Unknown<1> {
        Unknown { noise_n2_m2, of_any: 1.0 / self.face.largest_reading_n_m }
    }

    /// Effect of friction on the whisker's contacts.
    fn lean(&self) -> &Lean {
        self.face.lean(&self.whisker)
    }

    /// As [`Self::turn_rad`], with the ratio of friction to normal force; and the derivative by the ratio.
    pub(super) fn turn_with_friction_rad(&self, at: AlongAway, ratio: f64) -> ((f64, Vector2<f64>), f64) {
        let (turn_rad, slope) = self.turn_rad(at);
        let lean = self.lean().turn_rad(self.face.modelled.clamp(at), ratio);
        ((turn_rad + lean.value, slope + lean.by_place), lean.by_ratio)
    }

    /// Arc length of a contact with a ratio of friction to normal force. Beyond the border of the modelled region, the
    /// difference from the coordinate along is constant.
    pub(super) fn arc_with_friction_m(&self, at: AlongAway, ratio: f64) -> Leaning {
        let beyond = self.lean().beyond_m(self.face.modelled.clamp(at), ratio);
        Leaning { value: at.along_m + beyond.value, by_place: vector![1.0, 0.0] + beyond.by_place, ..beyond }
    }

    /// Factor of the expected reading of a contact with a ratio of friction to normal force.
    fn friction_factor(&self, at: AlongAway, ratio: f64) -> Leaning {
        self.lean().moment_ratio(self.face.modelled.clamp(at), ratio)
    }

    /// Expected reading of a contact, and its derivatives along and away. Beyond the modelled region
    /// ([`CalibratedFace::modelled`]) it is extrapolated linearly from the region's nearest contact, so that a belief that
    /// extends over the border is drawn back; the sensor model itself is never evaluated there.
    pub(super) fn expect(&self, at: AlongAway) -> (f64, RowVector2<f64>) {
        let held = self.face.modelled.clamp(at);
        let (contact, jacobian) = self.face.contact_with_jacobian(held);
        let expected = self.face.model.predict(contact);
        let gradient = product(&expected.gradient_n.transpose(), &jacobian);
        let beyond_n_m = gradient.transpose().dot(&(at.vector() - held.vector()));
        (expected.reading_n_m + beyond_n_m, gradient)
    }

    /// Distance of a contact from the calibrated domain.
    pub(super) fn distance_outside_m(&self, at: AlongAway) -> f64 {
        (at.vector() - self.face.domain.clamp(at).vector()).norm()
    }

    /// Standard deviation (N m) of the error of the expected reading of a contact outside the calibrated domain: proportional
    /// to the difference from the reading of the nearest calibrated contact. Zero inside the domain.
    pub(super) fn extrapolation_sd_n_m(&self, at: AlongAway) -> f64 {
        let calibrated = self.face.domain.clamp(at);
        if calibrated == at {
            return 0.0;
        }
        let modelled = self.face.modelled.clamp(at);
        let [wanted_n_m, modelled_n_m] = [at, modelled].map(|at| self.reading_n_m(at));
        let by_mechanics_n_m = if modelled == calibrated { 0.0 } else { modelled_n_m - self.reading_n_m(calibrated) };
        LINEAR_SD * (wanted_n_m - modelled_n_m).abs() + MECHANICS_SD * by_mechanics_n_m.abs()
    }

    /// Expected reading of a contact.
    pub(super) fn reading_n_m(&self, at: AlongAway) -> f64 {
        if self.face.modelled.clamp(at) == at {
            self.face.model.reading_n_m(self.face.contact_at(at))
        } else {
            self.expect(at).0
        }
    }

    /// Variance of the sensor model's error at a contact; beyond the calibrated domain, that at its border.
    pub(super) fn model_variance_n2_m2(&self, at: AlongAway) -> f64 {
        self.face.model_variance_at_n2_m2(at)
    }

    /// Variance of the measurement noise of a contact's reading: that of the sensor and that which the noise of the
    /// base causes.
    #[inline]
    pub(super) fn noise_n2_m2(&self, at: AlongAway) -> f64 {
        if !self.base_is_noisy {
            return self.sensor_noise_n2_m2;
        }
        let contact = self.face.contact_at(self.face.modelled.clamp(at));
        let gradient_n = self.face.model.predict(contact).gradient_n;
        self.sensor_noise_n2_m2 + self.base_noise.of_reading_n2_m2(contact, &gradient_n)
    }

    /// Variance of the reading of a contact: measurement noise and sensor model error.
    pub(super) fn variance_n2_m2(&self, at: AlongAway) -> f64 {
        self.noise_n2_m2(at) + self.model_variance_n2_m2(at)
    }

    /// Variance of the mean of `count` readings of one contact: the noise averages out, the sensor model's error does
    /// not.
    pub(super) fn variance_of_mean_n2_m2(&self, at: AlongAway, count: f64) -> f64 {
        self.noise_n2_m2(at) / count + self.model_variance_n2_m2(at)
    }

    /// Arc length on the bent whisker of a contact; see [`Knowledge::may_be_tip`].
    pub(super) fn bent_arc_m(&self, at: AlongAway) -> f64 {
        at.along_m + BENT_STRETCH * at.away_m.powi(2) / at.along_m.max(f64::MIN_POSITIVE)
    }

    /// Whether a contact lies at the tip, where its reading has another meaning.
    pub(super) fn is_tip(&self, at: AlongAway) -> bool {
        self.bent_arc_m(at) >= (1.0 - TIP_SHARE) * self.face.rest.length_m()
    }

    /// Whether a contact deflects the whisker and lies off the tip.
    pub(super) fn is_beside(&self, at: AlongAway) -> bool {
        at.away_m > 0.0 && !self.is_tip(at)
    }

    /// Limits the distance of a contact from the modelled region. The contact is not moved into the region: objects push the
    /// whisker farther than its calibration did, and a belief held within the region would be biased from then on.
    pub(super) fn hold<const N: usize>(&self, x: &mut SVector<f64, N>) {
        let AlongAway { along_m, away_m } = self.face.modelled.clamp(AlongAway::of_state(x));
        let (low_m, high_m) = self.face.modelled.arc_range_m();
        let most_m = MARGIN * (high_m - low_m);
        x[0] = x[0].clamp((along_m - most_m).max(0.5 * low_m), along_m + most_m);
        x[1] = x[1].clamp(away_m - most_m, away_m + most_m);
    }

    /// The estimate that belongs to a belief, whose entry `radius` is that of object and wire together. `None` stands
    /// for a state without a radius.
    pub(super) fn estimate<const N: usize>(
        &self,
        radius: Option<usize>,
        belief: &Gaussian<N>,
        innovation: Option<Innovation<1>>,
    ) -> Estimate {
        let at = AlongAway::of_state(&belief.mean);
        let place = Gaussian::new(at.vector(), belief.covariance.fixed_view::<2, 2>(0, 0).into());
        let contact = self.in_base(&place);
        let radius = self.radius(radius, belief, self.face.contact_at(at));
        let is_calibrated = self.face.domain.contains(at);
        let stated = self.estimate_at(Point::from_vector(contact.mean), is_calibrated, contact.covariance, innovation);
        Estimate { radius, ..stated }
    }

    /// The belief about the contact's position, transformed to Base. At the touch its standard deviation is centimetres
    /// along the whisker and micrometres across, so on a curved whisker its support is bent. Mean and covariance are
    /// those of sigma points ([`filters::unscented`]); a linearised map would give a straight, equally thin ellipse
    /// that misses the contact.
    fn in_base(&self, place: &Gaussian<2>) -> Gaussian<2> {
        const SPREAD: Spread = Spread { alpha: 1.0, beta: 0.0, kappa: 1.0 };
        let mut found = *place;
        if unscented::predict(&mut found, &Placing(&self.face), &SPREAD).is_ok() {
            return found;
        }
        let (contact, jacobian) = self.face.contact_with_jacobian(AlongAway::of_state(&place.mean));
        Gaussian::new(contact.vector(), jacobian * place.covariance * jacobian.transpose())
    }

    /// Derivative of a state's contact by its coordinates.
    pub(super) fn contact_jacobian<const N: usize>(&self, x: &SVector<f64, N>) -> Matrix2<f64> {
        self.face.contact_jacobian(AlongAway::of_state(x))
    }

    /// Radius of the wire at an arc length.
    pub(super) fn wire_radius_m(&self, arc_m: f64) -> f64 {
        0.5 * self.whisker.diameter_m(arc_m)
    }

    /// Radius of the object alone from the entry `radius` of a belief, at least zero. `None` if the state has no
    /// radius.
    pub(super) fn radius<const N: usize>(
        &self,
        radius: Option<usize>,
        belief: &Gaussian<N>,
        contact: Point<Base>,
    ) -> Option<Radius> {
        let i = radius?;
        let wire_m = self.wire_radius_m(self.face.along_and_away(contact).along_m);
        let sd_m = belief.covariance[(i, i)].max(0.0).sqrt();
        Some(Radius { radius_m: (belief.mean[i] - wire_m).max(0.0), sd_m })
    }

    /// The estimate of a contact with its covariance in Base.
    pub(super) fn estimate_at(
        &self,
        contact: Point<Base>,
        calibrated: bool,
        covariance_m2: Matrix2<f64>,
        innovation: Option<Innovation<1>>,
    ) -> Estimate {
        Estimate { covariance_m2: Some(covariance_m2), calibrated, innovation, ..Estimate::at(contact, self.face.face) }
    }
}

/// The map from coordinates along and away to Base.
struct Placing<'a>(&'a CalibratedFace);

impl Process<2> for Placing<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.0.contact_at(AlongAway::of_state(x)).vector()
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::zeros()
    }
}

/// Measurement model of a contact whose coordinates are the first two entries of the state.
#[derive(Clone, Copy)]
pub(super) struct ContactReading<'a> {
    side: &'a Side,
    indices: StateIndices,
    /// Variance of a further error of the reading.
    added_n2_m2: f64,
    /// Number of readings of which this is the mean.
    count: f64,
}

/// Indices in the state of the errors of a reading.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateIndices {
    /// Error of the sensor model, in standard deviations. `None` if it is part of the measurement noise.
    pub(super) model_error: Option<usize>,
    /// Relative error of the gain. `None` if the gain is exact.
    pub(super) gain: Option<usize>,
    /// Ratio of friction to normal force. `None` without friction.
    pub(super) friction: Option<usize>,
}

impl<'a> ContactReading<'a> {
    /// The measurement model for a state with errors of the reading at `indices`.
    pub(super) fn new(side: &'a Side, indices: StateIndices) -> Self {
        Self { side, indices, added_n2_m2: 0.0, count: 1.0 }
    }

    /// The same with a further error of this standard deviation.
    pub(super) fn with_error(self, sd_n_m: f64) -> Self {
        Self { added_n2_m2: sd_n_m.powi(2), ..self }
    }

    /// The same for the mean of `count` readings.
    pub(super) fn of_mean(self, count: f64) -> Self {
        Self { count, ..self }
    }

    /// Factor of the expected reading.
    fn gain<const N: usize>(&self, x: &SVector<f64, N>) -> f64 {
        self.indices.gain.map_or(1.0, |g| 1.0 + x[g])
    }
}

impl<const N: usize> Measurement<N, 1> for ContactReading<'_> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector1<f64>> {
        let error_n_m = self
            .indices
            .model_error
            .map_or(0.0, |e| x[e] * self.side.model_variance_n2_m2(AlongAway::of_state(x)).sqrt());
        let at = AlongAway::of_state(x);
        let leaning = self.indices.friction.map_or(1.0, |q| self.side.friction_factor(at, x[q]).value);
        Some(Vector1::new(self.gain(x) * leaning * self.side.reading_n_m(at) + error_n_m))
    }

    /// Neglects the change of the error along and away, which is far smaller than that of the reading.
    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 1, N>> {
        Some(self.linearised(x)?.1)
    }

    /// Evaluates the sensor model once.
    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>)> {
        let (mut expected_n_m, mut gradient) = self.side.expect(AlongAway::of_state(x));
        let mut jacobian = SMatrix::<f64, 1, N>::zeros();
        if let Some(q) = self.indices.friction {
            let factor = self.side.friction_factor(AlongAway::of_state(x), x[q]);
            jacobian[q] = self.gain(x) * expected_n_m * factor.by_ratio;
            gradient = gradient * factor.value + factor.by_place.transpose() * expected_n_m;
            expected_n_m *= factor.value;
        }
        if let Some(g) = self.indices.gain {
            jacobian[g] = expected_n_m;
        }
        let gain = self.gain(x);
        expected_n_m *= gain;
        jacobian.fixed_view_mut::<1, 2>(0, 0).copy_from(&(gradient * gain));
        if let Some(e) = self.indices.model_error {
            let sd_n_m = self.side.model_variance_n2_m2(AlongAway::of_state(x)).sqrt();
            expected_n_m += x[e] * sd_n_m;
            jacobian[e] = sd_n_m;
        }
        Some((Vector1::new(expected_n_m), jacobian))
    }

    /// Includes the sensor model's error even if the state has it: part of it may change from one sample to the next,
    /// such as the effect of friction, and the calibration does not determine how much.
    fn noise(&self, x: &SVector<f64, N>) -> Matrix1<f64> {
        Matrix1::new(self.side.variance_of_mean_n2_m2(AlongAway::of_state(x), self.count) + self.added_n2_m2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::testing::knowledge;

    #[test]
    fn verif_the_tip_is_the_end_of_the_bent_whisker() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let length_m = knowledge.whisker.length_m;
        assert!(side.is_tip(AlongAway::new(length_m, 0.0)) && !side.is_tip(AlongAway::new(0.9 * length_m, 0.0)));
        // A deflection of a third of the length brings the tip nearer to the root.
        assert!(side.is_tip(AlongAway::new(0.95 * length_m, 0.33 * length_m)));
    }
}
