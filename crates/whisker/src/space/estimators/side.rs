//! Measurement model of a contact in space, and the estimate that belongs to a belief.
//!
//! A contact is written `(s, u, v)`: along the undeflected whisker, and displaced to its left and upwards ([`Around`]). In these
//! coordinates the prior at the touch is Gaussian even on a strongly curved whisker, as in the plane.

use std::f64::consts::PI;
use std::sync::Arc;

use filters::unscented::{self, Spread};
use filters::{Gaussian, Innovation, Measurement, Process};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::ringing::{Beam, Masses};
use super::{Estimate, Knowledge};
use crate::frames::Base;
use crate::regained::Unknown;
use crate::space::frames::{Point, Pose};
use crate::space::sensor::{Around, Axis, CalibratedSpace, Directions};

/// Largest distance of a contact from the calibrated domain, as a share of its extent along the whisker.
const MARGIN: f64 = 0.1;

/// Largest distance from the calibrated domain of a contact that is stated.
const STATED_M: f64 = 1e-3;

/// Relative standard deviation of the part of a reading that is extrapolated beyond the calibrated domain.
const BEYOND_SD: f64 = 0.3;

/// Moment at the root of a wire held at both ends, by its inertia, relative to mass, acceleration and length: that of a uniform
/// load on a beam clamped at one end and supported at the other.
const INERTIA: f64 = 0.125;

/// Readings of a contact by the sensor model, with the errors of the model.
pub(super) struct Expected {
    /// Readings, and their derivatives by the coordinates about the whisker.
    pub(super) reading_n_m: Vector2<f64>,
    pub(super) slopes: Matrix2x3<f64>,
    /// Covariance of the model's error.
    pub(super) model_n2_m2: Matrix2<f64>,
    /// Error of the part of the readings that is extrapolated beyond the calibrated domain, one standard deviation with the sign of
    /// this part.
    pub(super) beyond_n_m: Vector2<f64>,
}

impl Expected {
    /// Covariance of both errors.
    pub(super) fn covariance_n2_m2(&self) -> Matrix2<f64> {
        self.model_n2_m2 + self.beyond_n_m * self.beyond_n_m.transpose()
    }

    /// Half the logarithm of the ratio `det S / det S0`, where `S0` is a covariance of the readings without the error of the
    /// extrapolation, and `S` the same with it: beyond the calibrated domain, the predictive density is wider and lower. `None`
    /// unless `S0` is positive definite.
    pub(super) fn log_spread(&self, without_n2_m2: &Matrix2<f64>) -> Option<f64> {
        // By the matrix determinant lemma.
        let solved = without_n2_m2.cholesky()?.solve(&self.beyond_n_m);
        Some(0.5 * self.beyond_n_m.dot(&solved).ln_1p())
    }
}

/// The whisker in contact.
#[derive(Clone)]
pub(super) struct Side {
    pub(super) calibrated: Arc<CalibratedSpace>,
    beam: Beam,
    /// Middle of the undeflected whisker.
    pub(super) middle: Point<Base>,
    /// Variance of the measurement noise of each moment.
    noise_n2_m2: f64,
}

impl Side {
    pub(super) fn new(knowledge: &Knowledge) -> Self {
        let CalibratedSpace { whisker, axis, .. } = &*knowledge.calibrated;
        Self {
            calibrated: knowledge.calibrated.clone(),
            beam: Beam::new(&whisker.whisker),
            middle: Around::new(0.5 * axis.rest().length_m(), 0.0, 0.0).contact(axis),
            noise_n2_m2: knowledge.noise_sd_n_m.powi(2),
        }
    }

    /// Axis of the coordinates about the whisker.
    pub(super) fn axis(&self) -> &Axis {
        &self.calibrated.axis
    }

    /// Length of the whisker.
    pub(super) fn length_m(&self) -> f64 {
        self.axis().rest().length_m()
    }

    /// Standard deviation of the arc length of a contact that is uniformly distributed over the calibrated part (m).
    pub(super) fn along_sd_m(&self) -> f64 {
        let (low_m, high_m) = self.calibrated.domain.arc_range_m();
        (high_m - low_m) / 12_f64.sqrt()
    }

    /// Share of the error of the sensor model that counts as new after a motion of the base. The path of the contact is
    /// approximated by that of the whisker's middle.
    pub(super) fn new_share(&self, motion: &Pose<Base, Base>) -> f64 {
        self.calibrated.error.new_share(motion.apply(self.middle).distance(&self.middle))
    }

    /// Directions at a contact. `None` if the whisker has none.
    pub(super) fn directions(&self, at: Around) -> Option<Directions> {
        Some(self.calibrated.geometry()?.at(at))
    }

    /// Readings of a contact by the sensor model. Beyond the calibrated domain they are extrapolated linearly from the nearest
    /// calibrated contact: a belief that extends over the border is thus drawn back. The model error there is that at the border.
    pub(super) fn expect(&self, at: Around) -> Expected {
        let CalibratedSpace { domain, model, .. } = &*self.calibrated;
        let (held, shares) = domain.held(at);
        let (reading_n_m, slopes) = model.predict_around(self.axis(), held);
        let extrapolated_n_m = slopes * (at.vector() - held.vector());
        Expected {
            reading_n_m: reading_n_m + extrapolated_n_m,
            slopes,
            model_n2_m2: self.calibrated.held_covariance_n2_m2(held, shares),
            beyond_n_m: extrapolated_n_m * BEYOND_SD,
        }
    }

    /// Covariance of the measurement noise of the mean of `count` readings (N2 m2), 2x2.
    pub(super) fn noise_of_mean_n2_m2(&self, count: f64) -> Matrix2<f64> {
        Matrix2::identity() * (self.noise_n2_m2 / count)
    }

    /// Covariance (N2 m2), 2x2, to which the evidence compares that of a reading, for a contact where the error of the sensor model
    /// has the covariance `model_n2_m2`: the logarithm of a Gaussian density decreases by half that of the ratio of determinants.
    ///
    /// The errors of a real sensor are those on held-out lines, and this covariance is their mean square, the same for all
    /// contacts: a contact where the errors are large explains many readings, but none of them is probable there. The errors of a
    /// simulated sensor are upper bounds. A smaller one alone is no evidence, and this covariance is the one at the contact.
    pub(super) fn reference_n2_m2(&self, model_n2_m2: Matrix2<f64>) -> Matrix2<f64> {
        let CalibratedSpace { error, heldout_rms_n_m, .. } = &*self.calibrated;
        let mean_n2_m2 = error.correlation_m.map(|_| Matrix2::identity() * heldout_rms_n_m.powi(2));
        mean_n2_m2.unwrap_or(model_n2_m2) + self.noise_of_mean_n2_m2(1.0)
    }

    /// Readings without a contact: those of a free whisker, or of any size up to the largest calibrated one, in any direction.
    pub(super) fn unknown(&self) -> Unknown<2> {
        let any_n2_m2 = PI * self.calibrated.largest_reading_n_m.powi(2);
        Unknown { noise_n2_m2: self.noise_n2_m2, of_any: 1.0 / any_n2_m2 }
    }

    /// Covariance of the readings of a contact: measurement noise, model error, and error of the part that is extrapolated.
    pub(super) fn covariance_n2_m2(&self, at: Around) -> Matrix2<f64> {
        self.expect(at).covariance_n2_m2() + self.noise_of_mean_n2_m2(1.0)
    }

    /// Standard deviation of the moments by the inertia of the wire under an acceleration of the base (N m).
    pub(super) fn inertia_n_m(&self, at: Around, acceleration_m_s2: f64) -> f64 {
        INERTIA * self.beam.mass_kg() * acceleration_m_s2 * at.along_m
    }

    /// Effective masses of the wire at a contact.
    pub(super) fn masses(&self, at: Around) -> Masses {
        self.beam.masses(at.along_m)
    }

    /// Limits the distance of a contact from the calibrated domain, which objects may push the whisker beyond.
    pub(super) fn hold<const N: usize>(&self, x: &mut SVector<f64, N>) {
        let held = self.calibrated.domain.clamp(Around::of_state(x)).vector();
        let (low_m, high_m) = self.calibrated.domain.arc_range_m();
        let most_m = MARGIN * (high_m - low_m);
        for axis in 0..3 {
            x[axis] = x[axis].clamp(held[axis] - most_m, held[axis] + most_m);
        }
    }

    /// The estimate that belongs to a belief, whose first three entries are the contact's coordinates. The distance from the
    /// calibrated domain is added to its standard deviation. `None` beyond 1 mm from it, or if the geometry of the whisker is
    /// unknown.
    pub(super) fn estimate<const N: usize>(
        &self,
        belief: &Gaussian<N>,
        innovation: Option<Innovation<2>>,
    ) -> Option<Estimate> {
        let at = Around::of_state(&belief.mean);
        let covariance: Matrix3<f64> = belief.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let place = self.in_base(&Gaussian::new(at.vector(), covariance));
        let outside_m = (at.vector() - self.calibrated.domain.clamp(at).vector()).norm();
        if outside_m > STATED_M {
            return None;
        }
        let Directions { normal, normal_slopes, .. } = self.directions(at)?;
        Some(Estimate {
            contact: Point::from_vector(place.mean),
            covariance_m2: place.covariance + Matrix3::identity() * outside_m.powi(2),
            normal,
            normal_covariance: normal_slopes * covariance * normal_slopes.transpose(),
            direction: None,
            radius: None,
            calibrated: self.calibrated.domain.contains(at),
            innovation,
            models: None,
            model_doubtful: None,
        })
    }

    /// The belief about the contact's position, transformed to Base by sigma points: at the touch its support is bent along a
    /// curved whisker.
    fn in_base(&self, place: &Gaussian<3>) -> Gaussian<3> {
        const SPREAD: Spread = Spread { alpha: 1.0, beta: 0.0, kappa: 0.0 };
        let mut found = *place;
        if unscented::predict(&mut found, &Placing(self.axis()), &SPREAD).is_ok() {
            return found;
        }
        let (contact, jacobian) = Around::of_state(&place.mean).contact_with_jacobian(self.axis());
        Gaussian::new(contact.vector(), jacobian * place.covariance * jacobian.transpose())
    }
}

/// The map from coordinates about the whisker to Base.
struct Placing<'a>(&'a Axis);

impl Process<3> for Placing<'_> {
    fn predict(&self, x: &Vector3<f64>) -> Vector3<f64> {
        Around::of_state(x).contact(self.0).vector()
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::zeros()
    }
}

/// Measurement model of a contact whose coordinates are the first three entries of the state.
#[derive(Clone, Copy)]
pub(super) struct ContactReading<'a> {
    pub(super) side: &'a Side,
    /// Acceleration of the base (m/s2), by which the inertia of the wire bends it.
    pub(super) acceleration_m_s2: f64,
    /// Share of the error of the sensor model that counts as new since the previous reading.
    pub(super) new_share: f64,
    /// Number of readings of which this is the mean.
    pub(super) count: f64,
}

impl<const N: usize> Measurement<N, 2> for ContactReading<'_> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector2<f64>> {
        Some(self.side.expect(Around::of_state(x)).reading_n_m)
    }

    fn noise(&self, x: &SVector<f64, N>) -> Matrix2<f64> {
        let at = Around::of_state(x);
        self.noise_n2_m2(at, &self.side.expect(at))
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 2, N>> {
        Some(jacobian(&self.side.expect(Around::of_state(x))))
    }

    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector2<f64>, SMatrix<f64, 2, N>)> {
        let expected = self.side.expect(Around::of_state(x));
        Some((expected.reading_n_m, jacobian(&expected)))
    }

    fn linearised_with_noise(&self, x: &SVector<f64, N>) -> Option<(Vector2<f64>, SMatrix<f64, 2, N>, Matrix2<f64>)> {
        let at = Around::of_state(x);
        let expected = self.side.expect(at);
        Some((expected.reading_n_m, jacobian(&expected), self.noise_n2_m2(at, &expected)))
    }
}

impl ContactReading<'_> {
    /// Noise covariance (N2 m2), 2x2, at a contact with this expected reading.
    fn noise_n2_m2(&self, at: Around, expected: &Expected) -> Matrix2<f64> {
        let inertia_n_m = self.side.inertia_n_m(at, self.acceleration_m_s2);
        // Readings within twice the correlation length share one error, and determine the contact no better than one of them.
        let repeated_n2_m2 = expected.model_n2_m2 * (self.new_share.recip() - 1.0);
        let once_n2_m2 = expected.covariance_n2_m2() + self.side.noise_of_mean_n2_m2(self.count);
        once_n2_m2 + repeated_n2_m2 + Matrix2::identity() * inertia_n_m.powi(2)
    }
}

/// Derivatives of the expected reading by the state, whose first three entries are the coordinates of the contact.
fn jacobian<const N: usize>(expected: &Expected) -> SMatrix<f64, 2, N> {
    let mut jacobian = SMatrix::<f64, 2, N>::zeros();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&expected.slopes);
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_spread_is_that_of_the_error_of_the_extrapolation() {
        let expected = |beyond_n_m| Expected {
            reading_n_m: Vector2::zeros(),
            slopes: Matrix2x3::zeros(),
            model_n2_m2: Matrix2::identity(),
            beyond_n_m,
        };
        let of = |beyond_n_m| {
            let expected = expected(beyond_n_m);
            expected.log_spread(&expected.model_n2_m2).unwrap()
        };
        assert_eq!(of(Vector2::zeros()), 0.0, "none in the calibrated domain");
        assert!((of(Vector2::new(3.0, -4.0)) - 0.5 * 26_f64.ln()).abs() < 1e-12);
        assert!((of(Vector2::new(3e9, -4e9)) - 5e9_f64.ln()).abs() < 1e-9, "without loss of precision");
    }
}
