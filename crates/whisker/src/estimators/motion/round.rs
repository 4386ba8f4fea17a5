//! A contact that slides over a round object at rest as the whisker turns on it.

use filters::{Gaussian, Process, product};
use nalgebra::{Matrix2, Matrix4, Vector2, Vector4, vector};
use serde::{Deserialize, Serialize};

use super::Motion;
use crate::estimators::Sample;
use crate::estimators::side::{Side, StateIndices};
use crate::frames::{Base, Point, Pose};
use crate::rest::direction;
use crate::sensor::{AlongAway, CalibratedFace};
use crate::settings::{SettingsError, within};

/// A contact on a round object at rest. The state is `(s, d, rho, e)`: its coordinates along and away, the radius of
/// object and wire together, and the sensor model's error.
///
/// Without friction the whisker is tangent to the object at the contact, and the object's centre lies at the distance
/// `rho` on the whisker's normal. If the tangent turns in the world by `dpsi`, the contact slides along it by `ds =
/// -rho dpsi` (the object on the right of the whisker; the opposite sign on its left), and the rotation of the tangent
/// depends on the new position of the contact. The step solves for both at once: the centre rests in the world, and
/// Newton's method finds the position on the whisker whose normal passes through the centre at the distance `rho`. So
/// no error accumulates over the steps, for any step size.
///
/// The sensor model errs by `e` standard deviations of its calibrated error. This error does not average out: it is
/// nearly the same at nearby positions. Over a path of length `l` in Base its correlation is `exp(-l / error_length_m)`
/// (an Ornstein-Uhlenbeck process, first-order Gauss-Markov).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Round {
    /// Prior mean of the radius of object and wire, less that of the calibration's pin and wire.
    pub radius_m: f64,
    /// Prior standard deviation of the radius.
    pub radius_sd_m: f64,
    /// Number of parts into which a filter splits the prior of the radius: if the radius is unknown, the contact's
    /// motion is strongly nonlinear in it.
    pub radius_parts: usize,
    /// Random walk of the radius, as the standard deviation after one second.
    pub radius_wander_m_sqrt_s: f64,
    /// Number of further parts of the prior, which are larger than those above: each has three times the radius of the
    /// one before. They have the same weight, so that the prior is log-uniform.
    pub larger_parts: usize,
    /// Random walk of the contact along the object, as the standard deviation in radii after the whisker has turned by
    /// one radian on it: the error of the tangent's rotation, on which the sliding depends.
    pub slip_sqrt_rad: f64,
    /// Process noise of the contact's position, as the standard deviation after one second.
    pub wander_m_sqrt_s: f64,
    /// Logarithm of the prior odds of the first part to one of the larger ones.
    pub thin_log_odds: f64,
    /// Correlation length of the sensor model's error.
    pub error_length_m: f64,
    /// Radius of the calibration's pin and wire, zero if unknown.
    #[serde(skip)]
    pin_radius_m: f64,
}

impl Default for Round {
    fn default() -> Self {
        Self {
            radius_m: 0.0,
            radius_sd_m: 1e-4,
            radius_parts: 1,
            radius_wander_m_sqrt_s: 1e-6,
            larger_parts: 0,
            slip_sqrt_rad: 0.0,
            wander_m_sqrt_s: 3e-6,
            thin_log_odds: 0.0,
            error_length_m: 1e-2,
            pin_radius_m: 0.0,
        }
    }
}

impl Round {
    /// Settings for an object of any size: a diffuse radius that may change along the outline.
    pub(in crate::estimators) fn of_any_size() -> Self {
        Self {
            radius_m: 1e-2,
            radius_sd_m: 4e-2,
            radius_parts: 4,
            radius_wander_m_sqrt_s: 3e-4,
            wander_m_sqrt_s: 4e-5,
            ..Self::default()
        }
    }

    /// Settings for an object of constant radius, from a thin object to a plane.
    pub(in crate::estimators) fn of_any_scale() -> Self {
        Self { larger_parts: 5, thin_log_odds: 3.0, slip_sqrt_rad: 0.02, ..Self::default() }
    }

    /// Settings for an object from a thin one to a plane whose radius may change along the outline.
    pub(in crate::estimators) fn of_changing_scale() -> Self {
        let Self { radius_wander_m_sqrt_s, wander_m_sqrt_s, .. } = Self::of_any_size();
        Self { slip_sqrt_rad: 0.0, radius_wander_m_sqrt_s, wander_m_sqrt_s, ..Self::of_any_scale() }
    }

    /// The settings relative to the radius of the calibration's pin and wire.
    pub(in crate::estimators) fn beyond_pin(self, face: &CalibratedFace) -> Self {
        Self { pin_radius_m: face.pin_radius_m, ..self }
    }

    /// Prior mean and standard deviation of the radius of object and wire: the settings added to the calibration's pin,
    /// from which the object's radius differs by about half the pin's.
    pub(in crate::estimators) fn expected_radius_m(&self) -> (f64, f64) {
        (self.radius_m + self.pin_radius_m, self.radius_sd_m.hypot(PIN_SHARE_SD * self.pin_radius_m))
    }

    pub(in crate::estimators) fn validate(&self) -> Result<(), SettingsError> {
        within("radius_m", self.radius_m, 0.0..=1.0)?;
        within("radius_sd_m", self.radius_sd_m, 1e-9..=1.0)?;
        within("radius_parts", self.radius_parts as f64, 1.0..=100.0)?;
        within("larger_parts", self.larger_parts as f64, 0.0..=10.0)?;
        within("slip_sqrt_rad", self.slip_sqrt_rad, 0.0..=10.0)?;
        within("thin_log_odds", self.thin_log_odds, -20.0..=20.0)?;
        within("radius_wander_m_sqrt_s", self.radius_wander_m_sqrt_s, 1e-9..=0.1)?;
        // Without process noise a covariance can lose its last digits; a whisker's length per second discards all
        // memory.
        within("wander_m_sqrt_s", self.wander_m_sqrt_s, 1e-9..=0.1)?;
        within("error_length_m", self.error_length_m, 1e-6..=10.0)
    }
}

/// Prior standard deviation of a thin object's radius over the radius of the calibration's pin: it may be a corner, or
/// thicker than the pin.
const PIN_SHARE_SD: f64 = 0.5;

/// Standard deviation in the settings up to which a radius counts as known, that of a thin object.
const SETTLED_SD_M: f64 = 5e-4;

/// Step of the search for a tangency from which it has none.
const FARTHEST_STEP_M: f64 = 1.0;

/// Ratio of the radii of successive larger parts, the relative standard deviation of one, and the smallest radius from
/// which they grow.
const SCALE_RATIO: f64 = 3.0;
const SCALE_SD: f64 = 0.5;
const LEAST_SCALE_M: f64 = 0.5e-3;

/// Lower bound of `1 + rho dphi/ds`. At zero whisker and object have the same curvature, and the contact is not at one
/// point.
const LEAST_PLAY: f64 = 0.1;

/// Maximum number of Newton steps for the point of contact, and the largest step that ends them: the error after it is of
/// the order of its square over the smallest radius of curvature, nanometres at most.
const NEWTON_STEPS: usize = 8;
const LAST_STEP_M: f64 = 1e-6;

/// Lower bound of the error variance that a step adds. Without it the process noise would be singular while the base
/// is at rest.
const LEAST_RENEWAL: f64 = 1e-9;

/// Process of one step.
pub(in crate::estimators) struct Wandering<'a> {
    pub(super) side: &'a Side,
    pub(super) motion: Pose<Base, Base>,
    /// Variances that the step adds to the position and to the radius (m2).
    place_m2: f64,
    radius_m2: f64,
    /// Variance of the position, in squared radii, per radian.
    slip_per_rad: f64,
    error_length_m: f64,
}

impl Motion<4> for Round {
    const INDICES: StateIndices = StateIndices { model_error: Some(3), gain: None, friction: None };

    type Step<'a> = Wandering<'a>;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<4> {
        let (radius_m, radius_sd_m) = self.expected_radius_m();
        let mut covariance = Matrix4::from_diagonal(&vector![0.0, 0.0, radius_sd_m.powi(2), 1.0]);
        covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&place.covariance);
        Gaussian::new(vector![place.mean[0], place.mean[1], radius_m, 0.0], covariance)
    }

    /// Equal intervals from zero to two standard deviations above the mean, and larger parts in proportion.
    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<4>, f64)> {
        if self.radius_parts == 1 {
            let larger = (1..=self.larger_parts).map(|i| {
                let mut part = self.belief(place);
                part.mean[2] = part.mean[2].max(LEAST_SCALE_M) * SCALE_RATIO.powi(i as i32);
                part.covariance[(2, 2)] = (SCALE_SD * part.mean[2]).powi(2);
                (part, -self.thin_log_odds)
            });
            return std::iter::once((self.belief(place), 0.0)).chain(larger).collect();
        }
        let (radius_m, radius_sd_m) = self.expected_radius_m();
        let stretch_m = (radius_m + 2.0 * radius_sd_m) / self.radius_parts as f64;
        let parts = (0..self.radius_parts).map(|i| {
            let mut part = self.belief(place);
            part.mean[2] = (i as f64 + 0.5) * stretch_m;
            part.covariance[(2, 2)] = (0.5 * stretch_m).powi(2);
            (part, -0.5 * ((part.mean[2] - radius_m) / radius_sd_m).powi(2))
        });
        parts.collect()
    }

    /// A radius that is known beforehand is not estimated.
    fn radius(&self) -> Option<usize> {
        (self.radius_sd_m > SETTLED_SD_M || self.larger_parts > 0).then_some(2)
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Wandering<'a> {
        Wandering {
            side,
            motion: sample.motion,
            place_m2: self.wander_m_sqrt_s.powi(2) * sample.dt_s,
            radius_m2: self.radius_wander_m_sqrt_s.powi(2) * sample.dt_s,
            slip_per_rad: self.slip_sqrt_rad.powi(2),
            error_length_m: self.error_length_m,
        }
    }
}

/// Unit vector from a contact to the centre of the object, and the direction of the whisker there, if it has turned by `turn_rad`.
pub(super) fn inward_and_ahead(side: &Side, along_m: f64, turn_rad: f64) -> (Vector2<f64>, Vector2<f64>) {
    let ahead = direction(side.face.rest.tangent_rad(along_m) + turn_rad);
    (vector![-ahead.y, ahead.x] * -side.face.face.away_sign(), ahead)
}

/// Tangency of whisker and object.
pub(super) struct Tangency {
    /// The contact.
    pub(super) contact: Point<Base>,
    /// Centre of the object in Base.
    pub(super) middle_m: Vector2<f64>,
    /// Unit vector from the contact to the centre.
    pub(super) inward: Vector2<f64>,
    /// Inverse of the derivatives of the centre by the coordinates.
    pub(super) inverse: Matrix2<f64>,
    /// Derivatives of the centre by the coordinates.
    pub(super) by_place: Matrix2<f64>,
}

impl Tangency {
    /// Tangency of the whisker and an object of radius `radius_m` at a contact, where the whisker has turned by `turn_rad`
    /// with the derivatives `by_place` along and away.
    pub(super) fn new(
        side: &Side,
        place: &Vector2<f64>,
        radius_m: f64,
        (turn_rad, by_place): (f64, Vector2<f64>),
    ) -> Self {
        let face = &side.face;
        let at = AlongAway::of_state(place);
        let (inward, ahead) = inward_and_ahead(side, at.along_m, turn_rad);
        // The inward normal turns in the opposite direction to the tangent.
        let turning = product(
            &(ahead * face.face.away_sign() * radius_m),
            &(vector![face.rest.curvature_per_m(at.along_m), 0.0] + by_place).transpose(),
        );
        let (contact, of_contact) = face.contact_with_jacobian(at);
        // The inverse fails only at the whisker's centre of curvature; a contact there does not determine its position
        // along the whisker.
        let to_place = of_contact.try_inverse().unwrap_or_default();
        let bent = product(&to_place, &turning);
        let play = (1.0 + bent.trace()).max(LEAST_PLAY);
        Self {
            contact,
            middle_m: contact.vector() + inward * radius_m,
            inward,
            // Sherman-Morrison formula: the second part is of rank one.
            inverse: to_place - product(&bent, &to_place) / play,
            by_place: of_contact + turning,
        }
    }

    /// The contact, found from `place` on, at which the object's centre is `middle_m`, if `at` is the tangency at a contact; and
    /// the tangency there, to within [`LAST_STEP_M`].
    pub(super) fn place_with_middle(
        middle_m: &Vector2<f64>,
        mut place: Vector2<f64>,
        at: impl Fn(&Vector2<f64>) -> Self,
    ) -> (Vector2<f64>, Self) {
        let mut found = at(&place);
        for _ in 0..NEWTON_STEPS {
            let step = product(&found.inverse, &(middle_m - found.middle_m));
            // Without a tangency, as behind a whisker's centre of curvature, the iteration diverges.
            let step_m = step.norm();
            if step_m.is_nan() || step_m > FARTHEST_STEP_M {
                break;
            }
            place += step;
            if step_m < LAST_STEP_M {
                break;
            }
            found = at(&place);
        }
        (place, found)
    }
}

impl Wandering<'_> {
    /// Tangency of the whisker and an object of radius `rho` at a contact.
    pub(super) fn tangency(&self, place: &Vector2<f64>, radius_m: f64) -> Tangency {
        Tangency::new(self.side, place, radius_m, self.side.turn_rad(AlongAway::of_state(place)))
    }

    /// Coordinates one step later of a contact with an object whose centre is at rest in the world, and the tangency there.
    fn moved(&self, contact: Point<Base>, middle_m: Vector2<f64>, radius_m: f64) -> (Vector2<f64>, Tangency) {
        let middle_m = self.motion.apply(Point::from_vector(middle_m)).vector();
        let start = self.side.face.along_and_away(self.motion.apply(contact)).vector();
        Tangency::place_with_middle(&middle_m, start, |place| self.tangency(place, radius_m))
    }

    /// Process noise of a step over which the sensor model's error has the correlation `kept` and the whisker turns by
    /// `turn_rad` on an object of radius `radius_m`.
    pub(super) fn noise_over(&self, kept: f64, turn_rad: f64, radius_m: f64) -> Matrix4<f64> {
        let renewed = (1.0 - kept * kept).max(LEAST_RENEWAL);
        let slip_m2 = self.slip_per_rad * turn_rad.abs() * radius_m.powi(2);
        Matrix4::from_diagonal(&vector![self.place_m2 + slip_m2, self.place_m2, self.radius_m2, renewed])
    }

    /// Angle by which the whisker's tangent turns on the object from one tangency to the next.
    pub(super) fn turn_rad(&self, before: &Tangency, after: &Tangency) -> f64 {
        product(&self.motion.rotation(), &before.inward).perp(&after.inward)
    }

    /// Displacement of the contact in Base by the base's motion. The variance of the two measured poses, which would
    /// give a displacement even at standstill, is subtracted from its square.
    pub(super) fn way_m(&self, before: Point<Base>) -> f64 {
        let noise_m2 = 2.0 * self.side.base_noise.of_point_m2(before).trace();
        (self.motion.apply(before).distance(&before).powi(2) - noise_m2).max(0.0).sqrt()
    }

    /// Correlation of the sensor model's error over the step, from a contact.
    pub(super) fn kept(&self, before: Point<Base>) -> f64 {
        (-self.way_m(before) / self.error_length_m).exp()
    }
}

impl Process<4> for Wandering<'_> {
    /// The coordinates of the object's centre suffice; the derivatives of [`Tangency`] are not needed.
    fn predict(&self, x: &Vector4<f64>) -> Vector4<f64> {
        let at = AlongAway::of_state(x);
        let contact = self.side.face.contact_at(at);
        let (inward, _) = inward_and_ahead(self.side, at.along_m, self.side.turn_rad(at).0);
        let (place, _) = self.moved(contact, contact.vector() + inward * x[2], x[2]);
        vector![place[0], place[1], x[2], x[3] * self.kept(contact)]
    }

    fn jacobian(&self, x: &Vector4<f64>) -> Matrix4<f64> {
        self.linearised(x).1
    }

    fn noise(&self, x: &Vector4<f64>) -> Matrix4<f64> {
        if self.slip_per_rad > 0.0 {
            return self.linearised(x).2;
        }
        self.noise_over(self.kept(self.side.face.contact_at(AlongAway::of_state(x))), 0.0, x[2])
    }

    fn linearised(&self, x: &Vector4<f64>) -> (Vector4<f64>, Matrix4<f64>, Matrix4<f64>) {
        let (place, jacobian, noise, _) = self.linearised_with_middle(x);
        (place, jacobian, noise)
    }
}

impl Wandering<'_> {
    /// Translation of the motion.
    pub(super) fn translation(&self) -> Vector2<f64> {
        self.motion.origin().vector()
    }

    /// As [`Process::linearised`], solving for the motion once; and the derivative of the coordinates one step later by
    /// the object's centre.
    pub(super) fn linearised_with_middle(
        &self,
        x: &Vector4<f64>,
    ) -> (Vector4<f64>, Matrix4<f64>, Matrix4<f64>, Matrix2<f64>) {
        let before = self.tangency(&x.fixed_rows::<2>(0).into(), x[2]);
        let (place, after) = self.moved(before.contact, before.middle_m, x[2]);
        let kept = self.kept(before.contact);
        let turned = self.motion.rotation();
        let mut jacobian = Matrix4::from_diagonal(&vector![0.0, 0.0, 1.0, kept]);
        jacobian.fixed_view_mut::<2, 2>(0, 0).copy_from(&product(&product(&after.inverse, &turned), &before.by_place));
        let inward = product(&turned, &before.inward) - after.inward;
        jacobian.fixed_view_mut::<2, 1>(0, 2).copy_from(&product(&after.inverse, &inward));
        let noise = self.noise_over(kept, self.turn_rad(&before, &after), x[2]);
        (vector![place[0], place[1], x[2], x[3] * kept], jacobian, noise, after.inverse)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Matrix3;

    use super::*;
    use crate::elastica::{Circle, Elastica};
    use crate::estimators::testing::knowledge;
    use crate::estimators::{BaseNoise, Knowledge};
    use crate::frames::World;
    use crate::sensor::Face;

    fn base(step: u32) -> Pose<Base, World> {
        let t = f64::from(step) * 0.004;
        Pose::new(1e-3 * (3.0 * t).sin(), 2e-3 * (4.0 * t).sin(), 0.05 * (5.0 * t).sin())
    }

    fn sample(from: u32, to: u32) -> Sample {
        Sample { motion: base(from).then(&base(to).inverse()), dt_s: 0.004 * f64::from(to - from), reading_n_m: 0.0 }
    }

    #[test]
    fn val_contact_slides_on_a_circle_as_on_the_exact_whisker() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        for radius_m in [0.5e-3, 15e-3] {
            let middle = knowledge.rest.beside(0.055, radius_m - 6e-3);
            let center = Point::<World>::from_vector(middle.vector());
            let circle = Circle { center, radius_m };
            let state = |step: u32| {
                let touch = elastica.against(&circle, &base(step), Face::Left).unwrap().unwrap();
                let AlongAway { along_m, away_m } = side.face.along_and_away(touch.deflection.point);
                vector![along_m, away_m, radius_m + 0.125e-3, 0.0]
            };
            let mut followed = state(0);
            let mut rested = followed;
            let mut worst_m = 0.0_f64;
            for step in 1..250 {
                let wandering = Round::default().step(&side, &sample(step - 1, step));
                followed = wandering.predict(&followed);
                rested[2] = 0.0;
                rested = wandering.predict(&rested);
                worst_m = worst_m.max((followed - state(step)).fixed_rows::<2>(0).norm());
            }
            let slid_m = (rested - state(249)).fixed_rows::<2>(0).norm();
            // Within two hundredths of the distance that the contact slides over the object in that time.
            assert!(worst_m < 0.02 * (slid_m + 0.2 * radius_m), "{radius_m}: {worst_m} of {slid_m}");
        }
    }

    #[test]
    fn robust_a_negative_mean_radius_gives_the_estimate_zero() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let motion = Round::of_any_size();
        let mut belief = motion.belief(&Gaussian::new(vector![0.055, 3e-3], Matrix2::identity() * 1e-8));
        belief.mean[2] = -1e-3;
        let radius = side.estimate(motion.radius(), &belief, None).radius.unwrap();
        assert!(radius.radius_m == 0.0 && radius.sd_m == motion.radius_sd_m, "{radius:?}");
    }

    #[test]
    fn verif_the_radius_of_a_thin_object_is_not_estimated_for_any_pin() {
        let mut knowledge = knowledge();
        let thick = Arc::get_mut(&mut knowledge.faces[0]).unwrap();
        thick.pin_radius_m = 5e-3;
        let thin = Round::default().beyond_pin(thick);
        assert!(Motion::radius(&thin).is_none() && thin.expected_radius_m().1 > SETTLED_SD_M);
        let round = Round::of_any_size().beyond_pin(thick);
        assert_eq!((Motion::radius(&round), round.expected_radius_m().0), (Some(2), 15e-3));
    }

    #[test]
    fn verif_noise_of_the_base_is_no_displacement() {
        let knowledge = Knowledge { base_noise: BaseNoise(Matrix3::from_diagonal_element(1e-8)), ..knowledge() };
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let way_m = |motion| {
            let step = Round::default().step(&side, &Sample { motion, dt_s: 0.004, reading_n_m: 0.0 });
            step.way_m(side.face.contact_at(AlongAway::new(0.055, 3e-3)))
        };
        assert_eq!(way_m(Pose::new(1e-4, 1e-4, 0.0)), 0.0);
        assert!((way_m(Pose::new(0.0, 1e-2, 0.0)) - 1e-2).abs() < 1e-5);
    }

    #[test]
    fn robust_process_noise_is_definite_at_standstill() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let still = Sample { motion: Pose::new(0.0, 0.0, 0.0), dt_s: 0.004, reading_n_m: 0.0 };
        let noise = Round::default().step(&side, &still).noise(&vector![0.055, 3e-3, 2e-3, 0.7]);
        assert!(noise.cholesky().is_some(), "{noise}");
    }

    #[test]
    fn verif_parts_overlap_from_a_thin_object_to_a_plane() {
        let knowledge = knowledge();
        let motion = Round::of_any_scale().beyond_pin(&knowledge.faces[0]);
        let parts = motion.parts(&Gaussian::new(vector![0.055, 3e-3], Matrix2::identity() * 1e-8));
        let radii: Vec<_> = parts.iter().map(|(part, _)| (part.mean[2], part.covariance[(2, 2)].sqrt())).collect();
        for pair in radii.windows(2) {
            let [(smaller_m, smaller_sd_m), (larger_m, larger_sd_m)] = pair else { unreachable!() };
            assert!(larger_m - smaller_m < 2.0 * (smaller_sd_m + larger_sd_m), "{radii:?}");
        }
        assert!(radii[0].0 < 1e-3 && radii[radii.len() - 1].0 > 0.1, "{radii:?}");
        assert_eq!(Motion::radius(&motion), Some(2));
    }

    #[test]
    fn verif_slip_is_in_proportion_to_the_radius() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let slip_m2 = |radius_m: f64| {
            let x = vector![0.055, 3e-3, radius_m, 0.0];
            let (with, without) = (Round::of_any_scale(), Round::default());
            let noise = |motion: &Round| motion.step(&side, &sample(20, 45)).noise(&x)[(0, 0)];
            noise(&with) - noise(&without)
        };
        let ratio = slip_m2(4e-3) / slip_m2(2e-3);
        assert!((ratio - 4.0).abs() < 0.5, "{ratio}");
    }

    #[test]
    fn verif_jacobian_is_that_of_the_prediction() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let step = Round::default().step(&side, &sample(20, 45));
        let x = vector![0.055, 3e-3, 2e-3, 0.7];
        let jacobian = step.jacobian(&x);
        for i in 0..4 {
            let h = if i == 3 { 1e-3 } else { 1e-6 };
            let change = step.predict(&(x + Vector4::ith(i, h))) - step.predict(&(x - Vector4::ith(i, h)));
            let expected = change / (2.0 * h);
            // The derivative of the error's decay by the position is neglected.
            let found = jacobian.column(i);
            assert!((found.fixed_rows::<3>(0) - expected.fixed_rows::<3>(0)).norm() < 2e-3, "{i}: {found} {expected}");
        }
    }
}
