//! A contact on a round object in uniform motion.

use filters::{Gaussian, Process, product};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector4};
use serde::{Deserialize, Serialize};

use super::Motion;
use super::round::{Round, Wandering};
use crate::estimators::side::{Side, StateIndices};
use crate::estimators::{Estimate, Sample, Velocity};
use crate::frames::{Base, Pose};
use crate::sensor::CalibratedFace;
use crate::settings::{SettingsError, within};

/// Index of the velocity in the state.
const VELOCITY: usize = 4;

/// A contact on a round object that moves uniformly in the world.
///
/// The state is that of [`Round`], then the velocity `v` of the object relative to the world, in Base. If Base moves by `M`
/// (rotation `R`, translation `t`), the object moves in it by the rotation `R` and the translation `t + R v dt`, and the
/// velocity becomes `R v`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Drifting {
    /// The object.
    pub object: Round,
    /// Prior standard deviation of the velocity in each direction, relative to the speed of the whisker before the touch.
    pub velocity_share: f64,
    /// That speed, if nothing is known about the time before the touch.
    pub speed_m_s: f64,
    /// Random walk of the velocity, as the standard deviation after one second.
    pub velocity_wander_m_s_sqrt_s: f64,
}

impl Default for Drifting {
    /// Slow readings have no time scale of their own, so that a velocity is large or small compared with that of the whisker. An
    /// object that moves along with the whisker explains any constant reading, as that of a tip that slides over a plane.
    fn default() -> Self {
        Self { object: Round::of_any_scale(), velocity_share: 0.2, speed_m_s: 1e-2, velocity_wander_m_s_sqrt_s: 1e-6 }
    }
}

impl Drifting {
    /// The settings relative to the radius of the calibration's pin and wire.
    pub(in crate::estimators) fn beyond_pin(self, face: &CalibratedFace) -> Self {
        Self { object: self.object.beyond_pin(face), ..self }
    }

    /// The settings for a touch after these samples. Their speed is that of the point at the distance `at_m` from the base.
    pub(in crate::estimators) fn after(self, history: &[Sample], at_m: f64) -> Self {
        let way_m: f64 = history.iter().map(|sample| way_m(&sample.motion, at_m)).sum();
        let time_s: f64 = history.iter().map(|sample| sample.dt_s).sum();
        if way_m > 0.0 && time_s > 0.0 { Self { speed_m_s: way_m / time_s, ..self } } else { self }
    }

    pub(in crate::estimators) fn validate(&self) -> Result<(), SettingsError> {
        self.object.validate()?;
        within("velocity_share", self.velocity_share, 1e-6..=10.0)?;
        within("speed_m_s", self.speed_m_s, 1e-6..=10.0)?;
        within("velocity_wander_m_s_sqrt_s", self.velocity_wander_m_s_sqrt_s, 1e-9..=1.0)
    }

    /// The belief with the prior of the velocity.
    fn extended(&self, belief: &Gaussian<4>) -> Gaussian<6> {
        let variance = (self.velocity_share * self.speed_m_s).powi(2);
        let mut covariance = SMatrix::<f64, 6, 6>::identity() * variance;
        covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&belief.covariance);
        let mut mean = SVector::<f64, 6>::zeros();
        mean.fixed_rows_mut::<4>(0).copy_from(&belief.mean);
        Gaussian::new(mean, covariance)
    }
}

/// Way of the point at the distance `at_m` from the base, at most.
fn way_m(motion: &Pose<Base, Base>, at_m: f64) -> f64 {
    motion.origin().vector().norm() + motion.yaw_rad().abs() * at_m
}

/// Process of one step.
pub(in crate::estimators) struct Drift<'a> {
    side: &'a Side,
    object: Round,
    sample: Sample,
    /// Variance that the step adds to the velocity in each direction.
    velocity_m2_s2: f64,
}

impl Motion<6> for Drifting {
    const INDICES: StateIndices = StateIndices { model_error: Some(3), gain: None, friction: None };
    const OBJECT_MOVES: bool = true;

    type Step<'a> = Drift<'a>;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<6> {
        self.extended(&self.object.belief(place))
    }

    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<6>, f64)> {
        self.object.parts(place).iter().map(|(part, log_weight)| (self.extended(part), *log_weight)).collect()
    }

    fn radius(&self) -> Option<usize> {
        Motion::radius(&self.object)
    }

    fn place(&self, _: &Side, belief: &Gaussian<6>, estimate: Estimate) -> Estimate {
        let velocity = Velocity {
            velocity_m_s: belief.mean.fixed_rows::<2>(VELOCITY).into(),
            covariance_m2_s2: belief.covariance.fixed_view::<2, 2>(VELOCITY, VELOCITY).into(),
        };
        Estimate { velocity: Some(velocity), ..estimate }
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Drift<'a> {
        let velocity_m2_s2 = self.velocity_wander_m_s_sqrt_s.powi(2) * sample.dt_s;
        Drift { side, object: self.object, sample: *sample, velocity_m2_s2 }
    }
}

impl Drift<'_> {
    /// The step of the object under the motion of Base relative to it, its state, and its velocity after the step.
    fn of_object(&self, x: &SVector<f64, 6>) -> (Wandering<'_>, Vector4<f64>, Vector2<f64>) {
        let velocity_m_s = self.sample.motion.rotation() * x.fixed_rows::<2>(VELOCITY);
        let way_m = velocity_m_s * self.sample.dt_s;
        let motion = self.sample.motion.then(&Pose::new(way_m.x, way_m.y, 0.0));
        (self.object.step(self.side, &Sample { motion, ..self.sample }), x.fixed_rows::<4>(0).into(), velocity_m_s)
    }
}

impl Process<6> for Drift<'_> {
    fn predict(&self, x: &SVector<f64, 6>) -> SVector<f64, 6> {
        let (step, object, velocity_m_s) = self.of_object(x);
        let mut moved = SVector::<f64, 6>::zeros();
        moved.fixed_rows_mut::<4>(0).copy_from(&step.predict(&object));
        moved.fixed_rows_mut::<2>(VELOCITY).copy_from(&velocity_m_s);
        moved
    }

    fn jacobian(&self, x: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        self.linearised(x).1
    }

    fn noise(&self, x: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        self.linearised(x).2
    }

    fn linearised(&self, x: &SVector<f64, 6>) -> (SVector<f64, 6>, SMatrix<f64, 6, 6>, SMatrix<f64, 6, 6>) {
        let (step, object, velocity_m_s) = self.of_object(x);
        let (place, of_object, object_noise, by_middle) = step.linearised_with_middle(&object);
        let mut moved = SVector::<f64, 6>::zeros();
        moved.fixed_rows_mut::<4>(0).copy_from(&place);
        moved.fixed_rows_mut::<2>(VELOCITY).copy_from(&velocity_m_s);
        let rotation: Matrix2<f64> = self.sample.motion.rotation();
        let mut jacobian = SMatrix::<f64, 6, 6>::zeros();
        jacobian.fixed_view_mut::<4, 4>(0, 0).copy_from(&of_object);
        let by_velocity = product(&by_middle, &rotation) * self.sample.dt_s;
        jacobian.fixed_view_mut::<2, 2>(0, VELOCITY).copy_from(&by_velocity);
        jacobian.fixed_view_mut::<2, 2>(VELOCITY, VELOCITY).copy_from(&rotation);
        let mut noise = SMatrix::<f64, 6, 6>::identity() * self.velocity_m2_s2;
        noise.fixed_view_mut::<4, 4>(0, 0).copy_from(&object_noise);
        (moved, jacobian, noise)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::vector;

    use super::*;
    use crate::estimators::testing::knowledge;
    use crate::frames::{Base, Point, World};
    use crate::sensor::AlongAway;

    fn base(t_s: f64) -> Pose<Base, World> {
        Pose::new(3e-3 * (3.0 * t_s).sin(), 4e-3 * (4.0 * t_s).sin(), 0.1 * (5.0 * t_s).sin())
    }

    fn sample() -> Sample {
        Sample { motion: base(0.1).then(&base(0.2).inverse()), dt_s: 0.1, reading_n_m: 0.0 }
    }

    fn state() -> SVector<f64, 6> {
        SVector::from([0.055, 3e-3, 2e-3, 0.7, 1e-3, -2e-3])
    }

    #[test]
    fn verif_jacobian_is_that_of_the_prediction() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let step = Drifting::default().step(&side, &sample());
        let (x, jacobian) = (state(), step.jacobian(&state()));
        for i in 0..6 {
            let h = if i == 3 { 1e-4 } else { 1e-6 };
            let ahead = step.predict(&(x + SVector::<f64, 6>::ith(i, h)));
            let expected = (ahead - step.predict(&(x - SVector::<f64, 6>::ith(i, h)))) / (2.0 * h);
            // The search for the tangency ends within nanometres.
            let found = jacobian.column(i);
            let places = (found - expected).fixed_rows::<3>(0).norm();
            let velocities = (found - expected).fixed_rows::<2>(VELOCITY).norm();
            assert!(places < 2e-9 / h && velocities < 1e-9, "{i}: {found} {expected}");
        }
    }

    /// A thin object moves in World by its velocity, whatever the motion of the base.
    #[test]
    fn verif_a_thin_object_moves_uniformly_in_the_world() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let mut x = state();
        x[2] = 0.0;
        let seen = |x: &SVector<f64, 6>| side.face.contact_at(AlongAway::of_state(x));
        let moved = Drifting::default().step(&side, &sample()).predict(&x);
        let velocity_m_s = base(0.1).rotation() * x.fixed_rows::<2>(VELOCITY);
        let expected = base(0.1).apply(seen(&x)).shifted(velocity_m_s * sample().dt_s);
        let found: Point<World> = base(0.2).apply(seen(&moved));
        assert!(found.distance(&expected) < 1e-9, "{found:?} {expected:?}");
        let kept = base(0.2).rotation() * moved.fixed_rows::<2>(VELOCITY);
        assert!((kept - velocity_m_s).norm() < 1e-12);
    }

    #[test]
    fn verif_the_prior_of_the_velocity_is_that_of_the_settings() {
        let place = Gaussian::new(vector![0.055, 3e-3], Matrix2::identity() * 1e-12);
        let belief = Drifting::default().belief(&place);
        assert_eq!(belief.mean.fixed_rows::<2>(VELOCITY), Vector2::zeros());
        assert_eq!(belief.covariance.fixed_view::<2, 2>(VELOCITY, VELOCITY), Matrix2::identity() * 4e-6);
    }

    #[test]
    fn verif_the_prior_of_the_velocity_scales_with_the_speed_before_the_touch() {
        // 1 mm and 0.01 rad at 0.1 m in 0.1 s, twice: 20 mm/s.
        let sample = Sample { motion: Pose::new(-6e-4, 8e-4, 0.01), dt_s: 0.1, reading_n_m: 0.0 };
        assert_eq!(Drifting::default().after(&[], 0.1), Drifting::default());
        let found = Drifting::default().after(&[sample; 2], 0.1).speed_m_s;
        assert!((found - 0.02).abs() < 1e-15, "{found}");
    }
}
