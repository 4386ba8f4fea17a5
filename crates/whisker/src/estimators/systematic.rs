//! Systematic errors of readings and poses beside a filter that does not have them.
//!
//! A filter that does not know a constant error `b` keeps its gain. With the Jacobians `F` of its process and `H` of its
//! measurement model and its gain `K`, the error of its mean is `s b`, with the sensitivity
//!
//! ```text
//! s <- F s,   s <- s + K (g - H s)
//! ```
//!
//! where `g` is the derivative of the reading by `b` (Schmidt, "Application of state-space methods to navigation problems",
//! Advances in Control Systems 3, 1966; Jazwinski, *Stochastic Processes and Filtering Theory*, 1970, section 8.4). The
//! errors add `s s' sd^2` to the stated covariance, with their prior standard deviations `sd`. Mean, gain and evidence remain those
//! of the filter without errors. Of several hypotheses, the sensitivities are those of the most probable one; when another takes
//! the lead, they begin as at a touch.

use filters::{Gaussian, Measurement};
use nalgebra::{Matrix1x3, Matrix2, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use crate::settings::{SettingsError, within};

/// Number of errors.
const ERRORS: usize = 3;

/// Prior standard deviations of systematic errors. 0: the error does not occur.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct SystematicSettings {
    /// Offset of the readings, relative to the largest calibrated one.
    pub offset: f64,
    /// Drift of the offset since the first touch (1/s).
    pub drift_per_s: f64,
    /// Time by which the poses are late.
    pub latency_s: f64,
}

impl SystematicSettings {
    /// No systematic errors.
    pub(super) const NONE: Self = Self { offset: 0.0, drift_per_s: 0.0, latency_s: 0.0 };

    /// The settings of `recommended`, seven eighths of the RMS errors of the random suites' miscalibrated sets: of 4/8, 6/8, 7/8
    /// and 8/8, the smallest multiple with the fewest sets of the training suite in which the stated covariances are too small.
    pub(super) const EXPECTED: Self = Self { offset: 7e-3, drift_per_s: 1.75e-3, latency_s: 1.75e-3 };

    /// Whether there are any.
    pub(super) fn is_on(&self) -> bool {
        *self != Self::NONE
    }

    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("systematic.offset", self.offset, 0.0..=1.0)?;
        within("systematic.drift_per_s", self.drift_per_s, 0.0..=1.0)?;
        within("systematic.latency_s", self.latency_s, 0.0..=1.0)
    }
}

impl Default for SystematicSettings {
    fn default() -> Self {
        Self::NONE
    }
}

/// Sensitivities of the mean of a filter with a state of `N` entries to the systematic errors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Systematic<const N: usize> {
    /// Derivatives of the error of the mean by the errors.
    by_error: SMatrix<f64, N, ERRORS>,
    /// Time since the tracker began.
    time_s: f64,
    /// Largest calibrated reading.
    unit_n_m: f64,
    /// Expected reading at the last step of the touch.
    last_n_m: Option<f64>,
}

impl<const N: usize> Systematic<N> {
    /// Errors of readings whose largest calibrated one is `unit_n_m`.
    pub(super) fn new(unit_n_m: f64) -> Self {
        Self { by_error: SMatrix::zeros(), time_s: 0.0, unit_n_m, last_n_m: None }
    }

    /// Begins a touch, whose deflection (the second entry of the state) was found from the reading.
    pub(super) fn begin(&mut self, belief: &Gaussian<N>, measurement: &impl Measurement<N, 1>) {
        let Some((expected, h)) = measurement.linearised(&belief.mean) else { return };
        self.by_error = SMatrix::zeros();
        if h[1] != 0.0 {
            self.by_error.set_row(1, &(self.by_reading(0.0) / h[1]));
        }
        self.last_n_m = Some(expected.x);
    }

    /// Lets time pass without a reading.
    pub(super) fn wait(&mut self, dt_s: f64) {
        self.time_s += dt_s;
        self.last_n_m = None;
    }

    /// Derivatives of a reading by the errors, if the motion changes it at this rate. A reading is ahead of a late pose.
    fn by_reading(&self, rate_n_m_s: f64) -> Matrix1x3<f64> {
        Matrix1x3::new(self.unit_n_m, self.unit_n_m * self.time_s, rate_n_m_s)
    }

    /// Takes a step of the filter of `dt_s` with the Jacobian `transition` of its process, after which the belief before the
    /// reading is `predicted`. A residual beyond the gate has the weight of one at the gate. Returns the mean after the reading.
    pub(super) fn advance(
        &mut self,
        dt_s: f64,
        transition: &SMatrix<f64, N, N>,
        predicted: &Gaussian<N>,
        measurement: &impl Measurement<N, 1>,
        reading_n_m: f64,
        gate_sds: f64,
    ) -> SVector<f64, N> {
        self.time_s += dt_s;
        self.by_error = transition * self.by_error;
        let Some((expected, h, noise)) = measurement.linearised_with_noise(&predicted.mean) else {
            return predicted.mean;
        };
        let last_n_m = self.last_n_m.replace(expected.x).filter(|_| dt_s > 0.0);
        let by_reading = self.by_reading(last_n_m.map_or(0.0, |last_n_m| (expected.x - last_n_m) / dt_s));
        let cross = predicted.covariance * h.transpose();
        let variance = ((h * cross).x + noise.x).max(((reading_n_m - expected.x) / gate_sds).powi(2));
        self.by_error += cross * (by_reading - h * self.by_error) / variance;
        if self.by_error.iter().any(|value| !value.is_finite()) {
            self.by_error = SMatrix::zeros();
        }
        predicted.mean + cross * ((reading_n_m - expected.x) / variance)
    }

    /// Second moments of the errors of the first two entries of the state, the contact's coordinates (m2).
    pub(super) fn of_place_m2(&self, settings: &SystematicSettings) -> Matrix2<f64> {
        let sds = Vector3::new(settings.offset, settings.drift_per_s, settings.latency_s);
        let errors = self.by_error.fixed_view::<2, ERRORS>(0, 0) * SMatrix::<f64, ERRORS, ERRORS>::from_diagonal(&sds);
        errors * errors.transpose()
    }
}

#[cfg(test)]
mod tests {
    use filters::extended;
    use nalgebra::{Matrix1, RowVector2, Vector1, Vector2, vector};

    use super::*;

    /// A reading that is a linear function of place and deflection.
    struct Linear(RowVector2<f64>);

    impl Measurement<2, 1> for Linear {
        fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
            Some(self.0 * x)
        }

        fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
            Matrix1::new(1e-2)
        }
    }

    /// Means of a filter on a contact at rest with these offsets and drifts of the readings, and the sensitivities of the first.
    fn means(errors: &[(f64, f64)]) -> (Vec<Vector2<f64>>, Systematic<2>) {
        let gain = |i: usize| Linear(RowVector2::new(0.3 + 0.1 * (0.3 * i as f64).sin(), 1.0));
        let belief = Gaussian::new(vector![0.0, 0.0], Matrix2::identity());
        let mut beliefs = vec![belief; errors.len()];
        let mut systematic = Systematic::new(1.0);
        for i in 1..=40 {
            let (measurement, time_s) = (gain(i), 0.1 * i as f64);
            systematic.advance(0.1, &Matrix2::identity(), &beliefs[0], &measurement, 0.0, 1e6);
            for (belief, (offset, drift_per_s)) in beliefs.iter_mut().zip(errors) {
                let reading = Vector1::new(offset + drift_per_s * time_s);
                extended::update(belief, &measurement, &reading).unwrap();
            }
        }
        (beliefs.iter().map(|belief| belief.mean).collect(), systematic)
    }

    #[test]
    fn verif_the_sensitivity_is_the_error_of_the_mean() {
        let (means, systematic) = means(&[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]);
        for (i, mean) in means[1..].iter().enumerate() {
            let found: Vector2<f64> = systematic.by_error.column(i).into();
            assert!((mean - found).norm() < 1e-9 * mean.norm(), "{i}: {mean} {found}");
        }
        let settings = SystematicSettings { offset: 0.5, ..SystematicSettings::NONE };
        let expected = means[1] * means[1].transpose() * 0.25;
        assert!((systematic.of_place_m2(&settings) - expected).norm() < 1e-9 * expected.norm());
    }

    #[test]
    fn verif_a_late_pose_acts_as_the_change_of_the_reading_within_the_latency() {
        let (mut systematic, measurement) = (Systematic::<2>::new(1.0), Linear(RowVector2::new(0.0, 1.0)));
        let certain = |away: f64| Gaussian::new(vector![0.0, away], Matrix2::new(1e-12, 0.0, 0.0, 1e6));
        systematic.begin(&certain(0.0), &measurement);
        // The reading changes by 2 per second and determines the deflection.
        systematic.advance(0.1, &Matrix2::identity(), &certain(0.2), &measurement, 0.2, 1e6);
        assert!((systematic.by_error[(1, 2)] - 2.0).abs() < 1e-6, "{systematic:?}");
    }
}
