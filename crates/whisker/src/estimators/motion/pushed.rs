//! A contact on a round object that stands freely on a table and is pushed along.

use filters::{Gaussian, Process, product};
use nalgebra::{Matrix2, RowVector2, SMatrix, SVector, Vector2, Vector4, vector};
use serde::{Deserialize, Serialize};

use super::Motion;
use super::round::{Round, Tangency, Wandering, inward_and_ahead};
use crate::estimators::Sample;
use crate::estimators::side::{Side, StateIndices};
use crate::sensor::{AlongAway, CalibratedFace};
use crate::settings::{SettingsError, within};

/// Index of the friction limit in the state.
const LIMIT: usize = 4;

/// Logarithm of the friction limit (N) of an object that has not slid yet: larger than the force of any whisker.
const AT_REST: f64 = 20.0;

/// Variance of that value, so that covariances are definite.
const AT_REST_VARIANCE: f64 = 1e-6;

/// Variance that a step without displacement adds to the limit, so that the process noise is definite.
const LEAST_LIMIT_NOISE: f64 = 1e-12;

/// Largest number of Newton steps for a pushed object, the largest step, and the length of the one that ends them.
const NEWTON_STEPS: usize = 10;
const LONGEST_STEP_M: f64 = 5e-3;
const LAST_STEP_M: f64 = 1e-7;

/// A contact without friction on a round object that slides on a table as soon as the contact force exceeds the friction limit.
///
/// The state is that of [`Round`], then the logarithm of the friction limit in N. The contact force is the moment at the root over
/// the lever arm of the contact's normal. It acts through the centre of the object, which therefore does not turn. While the force
/// is below the limit, the object rests (Coulomb's law). When a step would make it larger, the object moves along the force by as
/// much as keeps it at the limit.
///
/// The limit is observable only once the object slides. Its prior is log-uniform: whenever the expected reading has risen by the
/// factor `1 + reading_step` since the last split of this touch, each hypothesis of an object that has not slid is split, and the
/// new hypothesis has the present force as its limit ([`Motion::departure`]). The first reading of a touch splits none, so that no
/// hypothesis describes an object that slides from the first instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Pushed {
    /// The object.
    pub object: Round,
    /// Relative step of the reading, and thereby of the contact force, between two hypotheses on the friction limit.
    pub reading_step: f64,
    /// Prior probability per unit of the logarithm of the reading that the object begins to slide.
    pub onset_share: f64,
    /// Random walk of the object's place across the force while it is pushed, as the standard deviation after one metre.
    pub wander_sqrt_m: f64,
    /// Random walk of the limit while the object is pushed, as the relative standard deviation after one metre.
    pub limit_wander_per_sqrt_m: f64,
}

impl Default for Pushed {
    /// Thin objects are not favoured, so that the covariance contains the error due to the unknown size. The random walk of the
    /// limit stands for the inertia of the object, which accelerates and decelerates. The values were chosen on the suite
    /// `yielding_training`.
    fn default() -> Self {
        let mut object = Round::of_any_scale();
        object.thin_log_odds = 0.0;
        Self { object, reading_step: 0.05, onset_share: 0.15, wander_sqrt_m: 2e-3, limit_wander_per_sqrt_m: 1.5 }
    }
}

impl Pushed {
    /// The settings relative to the radius of the calibration's pin and wire.
    pub(in crate::estimators) fn beyond_pin(self, face: &CalibratedFace) -> Self {
        Self { object: self.object.beyond_pin(face), ..self }
    }

    pub(in crate::estimators) fn validate(&self) -> Result<(), SettingsError> {
        self.object.validate()?;
        within("reading_step", self.reading_step, 1e-3..=1.0)?;
        within("onset_share", self.onset_share, 1e-6..=1.0)?;
        within("wander_sqrt_m", self.wander_sqrt_m, 1e-9..=1.0)?;
        within("limit_wander_per_sqrt_m", self.limit_wander_per_sqrt_m, 1e-9..=100.0)
    }

    fn extended(belief: &Gaussian<4>) -> Gaussian<5> {
        let mut covariance = SMatrix::<f64, 5, 5>::zeros();
        covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&belief.covariance);
        covariance[(LIMIT, LIMIT)] = AT_REST_VARIANCE;
        Gaussian::new(vector![belief.mean[0], belief.mean[1], belief.mean[2], belief.mean[3], AT_REST], covariance)
    }
}

impl Motion<5> for Pushed {
    const INDICES: StateIndices = StateIndices { model_error: Some(3), gain: None, friction: None };
    const OBJECT_MOVES: bool = true;

    type Step<'a> = Push<'a>;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<5> {
        Self::extended(&self.object.belief(place))
    }

    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<5>, f64)> {
        self.object.parts(place).iter().map(|(part, log_weight)| (Self::extended(part), *log_weight)).collect()
    }

    fn radius(&self) -> Option<usize> {
        Motion::radius(&self.object)
    }

    fn rise(&self) -> Option<f64> {
        Some(self.reading_step)
    }

    fn departure(&self, side: &Side, belief: &Gaussian<5>, step: f64) -> Option<(Gaussian<5>, f64)> {
        if has_slid(belief.mean[LIMIT]) {
            return None;
        }
        let at = AlongAway::of_state(&belief.mean);
        let (log_force, gradient) = log_force(side, at, side.turn_rad(at))?;
        // The limit is the force at the contact, as uncertain as that is and correlated with it.
        let mut sliding = *belief;
        sliding.mean[LIMIT] = log_force;
        let mut to_limit = SMatrix::<f64, 1, 5>::zeros();
        to_limit.fixed_view_mut::<1, 2>(0, 0).copy_from(&gradient);
        let cross = belief.covariance * to_limit.transpose();
        sliding.covariance.fixed_view_mut::<4, 1>(0, LIMIT).copy_from(&cross.fixed_rows::<4>(0));
        sliding.covariance.fixed_view_mut::<1, 4>(LIMIT, 0).copy_from(&cross.fixed_rows::<4>(0).transpose());
        sliding.covariance[(LIMIT, LIMIT)] = (to_limit * cross)[0] + step.powi(2) / 12.0;
        Some((sliding, (self.onset_share * step).min(0.5)))
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Push<'a> {
        Push {
            object: self.object.step(side, sample),
            wander_m: self.wander_sqrt_m.powi(2),
            limit_wander_per_m: self.limit_wander_per_sqrt_m.powi(2),
        }
    }
}

/// Whether this is the limit of an object that has slid. Rounding changes [`AT_REST`] as hypotheses are merged.
fn has_slid(limit: f64) -> bool {
    limit < 0.5 * AT_REST
}

/// Logarithm of the force (N) of a contact without friction, and its derivatives along and away, where the whisker has turned by
/// `turn_rad` with the derivatives `by_place`. `None` if the whisker would pull.
fn log_force(side: &Side, at: AlongAway, (turn_rad, by_place): (f64, Vector2<f64>)) -> Option<(f64, RowVector2<f64>)> {
    let (inward, ahead) = inward_and_ahead(side, at.along_m, turn_rad);
    let (moment_n_m, slope_n) = side.expect(at);
    let (contact, of_contact) = side.face.contact_with_jacobian(at);
    // The object exerts the force against `inward` on the whisker.
    let arm_m = -contact.vector().perp(&inward);
    let force_n = moment_n_m / arm_m;
    if !(force_n > 0.0 && force_n.is_finite()) {
        return None;
    }
    let turning = RowVector2::new(side.face.rest.curvature_per_m(at.along_m), 0.0) + by_place.transpose();
    let across = RowVector2::new(inward.y, -inward.x) * of_contact;
    let by_turn_m = contact.vector().perp(&ahead) * side.face.face.away_sign();
    let arm_slope = -(across + turning * by_turn_m);
    Some((force_n.ln(), slope_n / moment_n_m - arm_slope / arm_m))
}

/// Process of one step.
pub(in crate::estimators) struct Push<'a> {
    object: Wandering<'a>,
    /// Variance of the object's place, and relative variance of the limit, that a displacement adds, over its length.
    wander_m: f64,
    limit_wander_per_m: f64,
}

/// A contact at which the force has the friction limit.
struct Sliding {
    place: Vector2<f64>,
    /// Displacement of the object.
    way_m: f64,
    ahead: Vector2<f64>,
    /// Inverse of the derivatives by the place of the logarithm of the force and of the displacement across it.
    inverse: Matrix2<f64>,
}

impl Push<'_> {
    fn side(&self) -> &Side {
        self.object.side
    }

    /// The contact after the push, if the force on an object that stayed at rest would exceed the limit: the centre has moved along
    /// the force, which is now at the limit. `before` is the tangency before the step, `at_rest` the contact after it without a
    /// push. `None` if the object rests or no such contact is found.
    fn pushed(&self, before: &Tangency, at_rest: &Vector2<f64>, radius_m: f64, limit: f64) -> Option<Sliding> {
        let middle_m = product(&self.object.motion.rotation(), &before.middle_m) + self.object.translation();
        let mut place = *at_rest;
        for i in 0..NEWTON_STEPS {
            let at = AlongAway::of_state(&place);
            let turn = self.side().turn_rad(at);
            let (log_force, slope) = log_force(self.side(), at, turn)?;
            if i == 0 && log_force <= limit {
                return None;
            }
            let (inward, ahead) = inward_and_ahead(self.side(), at.along_m, turn.0);
            let tangency = Tangency::new(self.side(), &place, radius_m, turn);
            let moved_m = tangency.middle_m - middle_m;
            let turning = RowVector2::new(self.side().face.rest.curvature_per_m(at.along_m), 0.0) + turn.1.transpose();
            let across = ahead.transpose() * tangency.by_place + turning * vector![-ahead.y, ahead.x].dot(&moved_m);
            let inverse = Matrix2::from_rows(&[slope, across]).try_inverse()?;
            let step = -product(&inverse, &vector![log_force - limit, ahead.dot(&moved_m)]);
            let step_m = step.norm();
            if !step_m.is_finite() {
                return None;
            }
            place += step * (LONGEST_STEP_M / step_m).min(1.0);
            if step_m < LAST_STEP_M {
                let way_m = inward.dot(&moved_m);
                return (way_m > 0.0).then_some(Sliding { place, way_m, ahead, inverse });
            }
        }
        None
    }
}

impl Process<5> for Push<'_> {
    fn predict(&self, x: &SVector<f64, 5>) -> SVector<f64, 5> {
        self.linearised(x).0
    }

    fn jacobian(&self, x: &SVector<f64, 5>) -> SMatrix<f64, 5, 5> {
        self.linearised(x).1
    }

    fn noise(&self, x: &SVector<f64, 5>) -> SMatrix<f64, 5, 5> {
        self.linearised(x).2
    }

    fn linearised(&self, x: &SVector<f64, 5>) -> (SVector<f64, 5>, SMatrix<f64, 5, 5>, SMatrix<f64, 5, 5>) {
        let object: Vector4<f64> = x.fixed_rows::<4>(0).into();
        let (mut place, of_object, mut object_noise, _) = self.object.linearised_with_middle(&object);
        let mut jacobian = SMatrix::<f64, 5, 5>::identity();
        jacobian.fixed_view_mut::<4, 4>(0, 0).copy_from(&of_object);
        let mut limit_variance = LEAST_LIMIT_NOISE;
        let before = has_slid(x[LIMIT]).then(|| self.object.tangency(&object.fixed_rows::<2>(0).into(), x[2]));
        let at_rest: Vector2<f64> = place.fixed_rows::<2>(0).into();
        if let Some(before) = before
            && let Some(Sliding { place: pushed, way_m, ahead, inverse }) =
                self.pushed(&before, &at_rest, x[2], x[LIMIT])
        {
            place.fixed_rows_mut::<2>(0).copy_from(&pushed);
            // Derivatives of both conditions by the state before, with the place after held.
            let across = ahead.transpose() * self.object.motion.rotation();
            let by_place = -(across * before.by_place);
            let by_radius = -(across * before.inward)[0];
            let conditions = SMatrix::<f64, 2, 5>::from_rows(&[
                SMatrix::<f64, 1, 5>::new(0.0, 0.0, 0.0, 0.0, -1.0),
                SMatrix::<f64, 1, 5>::new(by_place[0], by_place[1], by_radius, 0.0, 0.0),
            ]);
            jacobian.fixed_view_mut::<2, 5>(0, 0).copy_from(&-(inverse * conditions));
            let astray = inverse.column(1).into_owned();
            let added = astray * astray.transpose() * (self.wander_m * way_m);
            let mut noise = object_noise.fixed_view_mut::<2, 2>(0, 0);
            noise += added;
            limit_variance += self.limit_wander_per_m * way_m;
        }
        let mut noise = SMatrix::<f64, 5, 5>::zeros();
        noise.fixed_view_mut::<4, 4>(0, 0).copy_from(&object_noise);
        noise[(LIMIT, LIMIT)] = limit_variance;
        (vector![place[0], place[1], place[2], place[3], x[LIMIT]], jacobian, noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastica::{Circle, Elastica, Touch};
    use crate::estimators::testing::{knowledge, pushed};
    use crate::frames::{Base, Point, Pose, World};
    use crate::sensor::Face;

    const RADIUS_M: f64 = 5e-3;
    /// Radius of the wire.
    const WIRE_M: f64 = 0.125e-3;

    /// Pose of the base that presses the whisker against an object on its left by a further 0.02 mm per step, and turns it.
    fn base(step: u32) -> Pose<Base, World> {
        let t = f64::from(step);
        Pose::new(5e-6 * t, 2e-5 * t, -1e-4 * t)
    }

    fn sample(step: u32) -> Sample {
        Sample { motion: base(step - 1).then(&base(step).inverse()), dt_s: 0.004, reading_n_m: 0.0 }
    }

    fn touch(elastica: &Elastica, center: Point<World>, step: u32) -> Touch {
        elastica.against(&Circle { center, radius_m: RADIUS_M }, &base(step), Face::Left).unwrap().unwrap()
    }

    fn state(side: &Side, touch: &Touch, limit: f64) -> SVector<f64, 5> {
        let AlongAway { along_m, away_m } = side.face.along_and_away(touch.deflection.point);
        vector![along_m, away_m, RADIUS_M + WIRE_M, 0.0, limit]
    }

    fn start() -> Point<World> {
        Point::from_vector(knowledge().rest.beside(0.055, RADIUS_M - 1e-3).vector())
    }

    #[test]
    fn val_the_force_is_that_of_the_exact_whisker() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        for step in [0, 100, 200] {
            let touch = touch(&elastica, start(), step);
            let x = state(&side, &touch, AT_REST);
            let at = AlongAway::of_state(&x);
            let found = log_force(&side, at, side.turn_rad(at)).unwrap().0;
            assert!((found - touch.force_n.ln()).abs() < 0.01, "{step}: {} {}", found.exp(), touch.force_n);
        }
    }

    #[test]
    fn val_an_object_is_pushed_as_by_the_exact_whisker() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let limit_n = touch(&elastica, start(), 100).force_n;
        let touches = pushed(&elastica, &Circle { center: start(), radius_m: RADIUS_M }, limit_n, (0..300).map(base));
        let mut followed = state(&side, &touches[0].0, limit_n.ln());
        for step in 1..300 {
            followed = Pushed::default().step(&side, &sample(step)).predict(&followed);
        }
        let (last, moved_m) = &touches[299];
        let error_m = (followed - state(&side, last, limit_n.ln())).fixed_rows::<2>(0).norm();
        assert!(*moved_m > 2e-3 && error_m < 0.02 * moved_m, "{error_m} of {moved_m}");
    }

    #[test]
    fn verif_jacobian_is_that_of_the_prediction() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let touched = touch(&elastica, start(), 150);
        for (log_ratio, is_pushed) in [(0.1, false), (-0.1, true)] {
            let x = state(&side, &touched, touched.force_n.ln() + log_ratio);
            let process = Pushed::default().step(&side, &sample(151));
            let (moved, jacobian, noise) = process.linearised(&x);
            assert_eq!(noise[(LIMIT, LIMIT)] > AT_REST_VARIANCE, is_pushed);
            assert!(noise.cholesky().is_some());
            assert_eq!(moved[LIMIT], x[LIMIT]);
            for i in 0..5 {
                let h = if i == LIMIT { 1e-4 } else { 1e-6 };
                let change = process.predict(&(x + SVector::ith(i, h))) - process.predict(&(x - SVector::ith(i, h)));
                let (found, expected) = (jacobian.column(i), change / (2.0 * h));
                let apart = (found.fixed_rows::<3>(0) - expected.fixed_rows::<3>(0)).norm();
                assert!(apart < 5e-3 * (1.0 + expected.norm()), "{is_pushed} {i}: {found} {expected}");
            }
        }
    }

    #[test]
    fn verif_the_limit_of_a_new_hypothesis_is_the_present_force() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let motion = Pushed::default();
        let touched = touch(&elastica, start(), 60);
        let belief = Gaussian::new(state(&side, &touched, AT_REST), SMatrix::<f64, 5, 5>::identity() * 1e-10);
        let (sliding, share) = motion.departure(&side, &belief, 0.05).unwrap();
        assert!((sliding.mean[LIMIT] - touched.force_n.ln()).abs() < 0.01, "{sliding:?}");
        assert_eq!(share, 0.05 * motion.onset_share);
        // The limit follows the place of the contact, on which the force depends.
        assert!(sliding.covariance[(LIMIT, 0)] < 0.0 && sliding.covariance[(LIMIT, 1)] > 0.0, "{sliding:?}");
        assert!(sliding.covariance.cholesky().is_some());
        assert!(motion.departure(&side, &sliding, 0.05).is_none(), "an object that slides begins no other");
    }
}
