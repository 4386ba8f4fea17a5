//! A contact on a round object, with an error of the sensor's gain and of the whisker's mounting.

use filters::{Gaussian, Process, product};
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector4, vector};
use serde::{Deserialize, Serialize};

use super::Motion;
use super::round::{Round, Wandering};
use crate::estimators::side::{Side, StateIndices};
use crate::estimators::{Estimate, Installation, Sample, Uncertain};
use crate::frames::{Base, Pose};
use crate::sensor::CalibratedFace;
use crate::settings::{SettingsError, within};

/// Indices in the state.
const GAIN: usize = 4;
const YAW: usize = 5;
const PLACE: usize = 6;

/// A contact on a round object, by a whisker whose gain and mounting differ from the calibrated ones.
///
/// The state is that of [`Round`], then the relative error `g` of the gain, and yaw `alpha` and position `b` of the
/// whisker in its nominal frame, all constant. The reading is `(1 + g) h(s, d)`. The whisker's frame moves by `T^-1 M T`,
/// if the nominal one moves by `M` (rotation `R`, translation `t`) and `T` is the mounting, `T p = R_alpha p + b`: a
/// rotation `R` and the translation `R_-alpha (t + (R - I) b)`. The contact is stated in the nominal frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Installed {
    /// The object.
    pub object: Round,
    /// Prior standard deviation of the gain's relative error.
    pub gain_sd: f64,
    /// Prior standard deviation of the mounting's yaw.
    pub yaw_sd_rad: f64,
    /// Prior standard deviation of the mounting's position in each direction.
    pub place_sd_m: f64,
}

impl Default for Installed {
    fn default() -> Self {
        Self { object: Round::of_any_scale(), gain_sd: 0.03, yaw_sd_rad: 6e-3, place_sd_m: 2e-4 }
    }
}

impl Installed {
    /// The settings relative to the radius of the calibration's pin and wire.
    pub(in crate::estimators) fn beyond_pin(self, face: &CalibratedFace) -> Self {
        Self { object: self.object.beyond_pin(face), ..self }
    }

    pub(in crate::estimators) fn validate(&self) -> Result<(), SettingsError> {
        self.object.validate()?;
        within("gain_sd", self.gain_sd, 1e-6..=1.0)?;
        within("yaw_sd_rad", self.yaw_sd_rad, 1e-6..=1.0)?;
        within("place_sd_m", self.place_sd_m, 1e-9..=1e-1)
    }

    /// The belief with the prior of gain and mounting.
    fn extended(&self, belief: &Gaussian<4>) -> Gaussian<8> {
        let (gain, yaw, place) = (self.gain_sd.powi(2), self.yaw_sd_rad.powi(2), self.place_sd_m.powi(2));
        let variances = SVector::<f64, 8>::from([0.0, 0.0, 0.0, 0.0, gain, yaw, place, place]);
        let mut covariance = SMatrix::<f64, 8, 8>::from_diagonal(&variances);
        covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&belief.covariance);
        let mut mean = SVector::<f64, 8>::zeros();
        mean.fixed_rows_mut::<4>(0).copy_from(&belief.mean);
        Gaussian::new(mean, covariance)
    }
}

/// Process of one step.
pub(in crate::estimators) struct Moving<'a> {
    side: &'a Side,
    object: Round,
    sample: Sample,
}

impl Motion<8> for Installed {
    const INDICES: StateIndices = StateIndices { model_error: Some(3), gain: Some(GAIN), friction: None };

    type Step<'a> = Moving<'a>;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<8> {
        self.extended(&self.object.belief(place))
    }

    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<8>, f64)> {
        self.object.parts(place).iter().map(|(part, log_weight)| (self.extended(part), *log_weight)).collect()
    }

    fn radius(&self) -> Option<usize> {
        Motion::radius(&self.object)
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Moving<'a> {
        Moving { side, object: self.object, sample: *sample }
    }

    /// The contact in the nominal frame.
    fn place(&self, side: &Side, belief: &Gaussian<8>, estimate: Estimate) -> Estimate {
        let mounting = mounting(&belief.mean);
        let contact = mounting.apply(estimate.contact);
        let turned = contact.vector() - mounting.origin().vector();
        let of_contact = mounting.rotation() * side.contact_jacobian(&belief.mean);
        let mut of_mounting = SMatrix::<f64, 2, 3>::zeros();
        of_mounting.set_column(0, &vector![-turned.y, turned.x]);
        of_mounting.fixed_view_mut::<2, 2>(0, 1).copy_from(&Matrix2::identity());
        let by_mounting = belief.covariance.fixed_view::<3, 3>(YAW, YAW);
        let joint = of_contact * belief.covariance.fixed_view::<2, 3>(0, YAW) * of_mounting.transpose();
        let added = joint + joint.transpose() + of_mounting * by_mounting * of_mounting.transpose();
        let covariance_m2 = estimate.covariance_m2.map(|covariance| {
            let covariance = mounting.turn(covariance);
            let together = covariance + added;
            if together.cholesky().is_some() { together } else { covariance }
        });
        Estimate { contact, covariance_m2, installation: Some(installation(belief)), ..estimate }
    }
}

/// The whisker's frame in its nominal one.
fn mounting(x: &SVector<f64, 8>) -> Pose<Base, Base> {
    Pose::new(x[PLACE], x[PLACE + 1], x[YAW])
}

/// The deviation of the sensor: gain, and the inverse of the mounting, which has the yaw `-alpha` and the position `-R_-alpha b`.
fn installation(belief: &Gaussian<8>) -> Installation {
    let x = &belief.mean;
    let calibrated = mounting(x).inverse();
    let (yaw_rad, position) = (calibrated.yaw_rad(), calibrated.origin().vector());
    let mut jacobian = Matrix3::zeros();
    jacobian[(0, 0)] = -1.0;
    jacobian.fixed_view_mut::<2, 1>(1, 0).copy_from(&vector![position.y, -position.x]);
    jacobian.fixed_view_mut::<2, 2>(1, 1).copy_from(&-calibrated.rotation());
    let covariance = jacobian * belief.covariance.fixed_view::<3, 3>(YAW, YAW) * jacobian.transpose();
    let of_mounting = |value, i: usize| Uncertain { value, sd: covariance[(i, i)].max(0.0).sqrt() };
    Installation {
        gain: Uncertain { value: x[GAIN], sd: belief.covariance[(GAIN, GAIN)].max(0.0).sqrt() },
        mount_rad: of_mounting(yaw_rad, 0),
        mount_x_m: of_mounting(position.x, 1),
        mount_y_m: of_mounting(position.y, 2),
    }
}

impl Moving<'_> {
    /// The step of the object under the motion of the whisker's own frame.
    fn of_object(&self, x: &SVector<f64, 8>) -> (Wandering<'_>, Vector4<f64>) {
        let mounting = mounting(x);
        let motion = mounting.then(&self.sample.motion).then(&mounting.inverse());
        (self.object.step(self.side, &Sample { motion, ..self.sample }), x.fixed_rows::<4>(0).into())
    }
}

impl Process<8> for Moving<'_> {
    fn predict(&self, x: &SVector<f64, 8>) -> SVector<f64, 8> {
        let (step, object) = self.of_object(x);
        let mut moved = *x;
        moved.fixed_rows_mut::<4>(0).copy_from(&step.predict(&object));
        moved
    }

    fn jacobian(&self, x: &SVector<f64, 8>) -> SMatrix<f64, 8, 8> {
        self.linearised(x).1
    }

    fn noise(&self, x: &SVector<f64, 8>) -> SMatrix<f64, 8, 8> {
        self.linearised(x).2
    }

    fn linearised(&self, x: &SVector<f64, 8>) -> (SVector<f64, 8>, SMatrix<f64, 8, 8>, SMatrix<f64, 8, 8>) {
        let (step, object) = self.of_object(x);
        let (place, of_object, object_noise, by_middle) = step.linearised_with_middle(&object);
        let mut moved = *x;
        moved.fixed_rows_mut::<4>(0).copy_from(&place);
        let mut jacobian = SMatrix::<f64, 8, 8>::identity();
        jacobian.fixed_view_mut::<4, 4>(0, 0).copy_from(&of_object);
        let shift: Vector2<f64> = step.translation();
        let turned = self.sample.motion.rotation() - Matrix2::identity();
        let back = mounting(x).rotation().transpose();
        jacobian.fixed_view_mut::<2, 1>(0, YAW).copy_from(&product(&by_middle, &vector![shift.y, -shift.x]));
        jacobian.fixed_view_mut::<2, 2>(0, PLACE).copy_from(&product(&by_middle, &(back * turned)));
        let mut noise = SMatrix::<f64, 8, 8>::zeros();
        noise.fixed_view_mut::<4, 4>(0, 0).copy_from(&object_noise);
        (moved, jacobian, noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::testing::knowledge;
    use crate::frames::World;
    use crate::sensor::AlongAway;

    fn base(t_s: f64) -> Pose<Base, World> {
        Pose::new(3e-3 * (3.0 * t_s).sin(), 4e-3 * (4.0 * t_s).sin(), 0.1 * (5.0 * t_s).sin())
    }

    fn sample() -> Sample {
        Sample { motion: base(0.1).then(&base(0.2).inverse()), dt_s: 0.1, reading_n_m: 0.0 }
    }

    fn state() -> SVector<f64, 8> {
        SVector::from([0.055, 3e-3, 2e-3, 0.7, 0.02, 0.01, 3e-4, -2e-4])
    }

    #[test]
    fn verif_jacobian_is_that_of_the_prediction() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let step = Installed::default().step(&side, &sample());
        let (x, jacobian) = (state(), step.jacobian(&state()));
        for i in 0..8 {
            let h = if (3..6).contains(&i) { 1e-4 } else { 1e-6 };
            let ahead = step.predict(&(x + SVector::<f64, 8>::ith(i, h)));
            let expected = (ahead - step.predict(&(x - SVector::<f64, 8>::ith(i, h)))) / (2.0 * h);
            let found = jacobian.column(i);
            // The search for the tangency ends within nanometres.
            let differs = (found - expected).fixed_rows::<3>(0).norm();
            assert!(differs < 2e-9 / h, "{i}: {found} {expected}");
        }
    }

    /// A contact that rests in World appears at rest in the nominal frame, whatever the mounting.
    #[test]
    fn verif_a_mounting_moves_with_the_base() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let mut x = state();
        x[2] = 0.0;
        let nominal = |x: &SVector<f64, 8>| mounting(x).apply(side.face.contact_at(AlongAway::of_state(x)));
        let moved = Installed::default().step(&side, &sample()).predict(&x);
        let expected = sample().motion.apply(nominal(&x));
        assert!(nominal(&moved).distance(&expected) < 1e-9);
    }

    /// The stated mounting is the inverse of that of the state, and its covariance is the linearised one.
    #[test]
    fn verif_the_stated_mounting_is_the_calibrated_frame_in_the_actual_one() {
        let x = state();
        let covariance =
            SMatrix::<f64, 8, 8>::from_diagonal(&SVector::from([1.0, 1.0, 1.0, 1.0, 4e-4, 1e-6, 4e-8, 9e-8]));
        let found = installation(&Gaussian::new(x, covariance));
        let stated = Pose::<Base, Base>::new(found.mount_x_m.value, found.mount_y_m.value, found.mount_rad.value);
        let together = stated.then(&mounting(&x));
        assert!(together.origin().vector().norm() < 1e-15 && together.yaw_rad().abs() < 1e-15, "{together:?}");
        assert_eq!((found.gain, found.mount_rad.sd), (Uncertain { value: 0.02, sd: 0.02 }, 1e-3));
        let at = |x: &SVector<f64, 8>| mounting(x).inverse().origin().vector();
        let slopes = [(YAW, 1e-3), (PLACE, 2e-4), (PLACE + 1, 3e-4)].map(|(i, sd)| {
            (at(&(x + SVector::<f64, 8>::ith(i, 1e-6))) - at(&(x - SVector::<f64, 8>::ith(i, 1e-6)))) / 2e-6 * sd
        });
        let expected = slopes.map(|slope| slope.component_mul(&slope)).iter().sum::<Vector2<f64>>().map(f64::sqrt);
        let sds = vector![found.mount_x_m.sd, found.mount_y_m.sd];
        assert!((sds - expected).norm() < 1e-9 * expected.norm().max(1.0), "{sds} {expected}");
    }

    #[test]
    fn verif_the_error_of_the_mounting_is_part_of_the_covariance() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let sensor = Installed::default();
        let place = Gaussian::new(vector![0.055, 3e-3], Matrix2::identity() * 1e-12);
        let belief = sensor.belief(&place);
        let estimate = sensor.place(&side, &belief, side.estimate(None, &belief, None));
        let found = estimate.covariance_m2.unwrap();
        let (x_m, y_m) = (estimate.contact.x(), estimate.contact.y());
        let lever = vector![-y_m, x_m] * sensor.yaw_sd_rad;
        let expected = lever * lever.transpose() + Matrix2::identity() * (sensor.place_sd_m.powi(2) + 1e-12);
        assert!((found - expected).norm() < 1e-3 * expected.norm(), "{found} {expected}");
    }
}
