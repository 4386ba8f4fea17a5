//! Localisation of the contact between a whisker and a pin.
//!
//! The state is the contact in Base (m). It rests in World, so it moves in Base by the inverse of the base's motion,
//! with a small random walk as process noise. The reading is a polynomial of degree 5 in the contact's coordinates,
//! with noise (Lin et al. 2022).

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use filters::unscented::Spread;
use filters::{Gaussian, Measurement, Process, StateArray, vectorised};
use nalgebra::{Matrix1, Matrix2, RowVector2, Vector1, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::Serialize;
use serde_json::Value;
use trace::{CalibrationFile, Trace};
use whisker::frames::Point;
use whisker::sensor::CalibratedFace;

use crate::polynomial::Polynomial;

/// Name of the sensor model in the calibration.
const MODEL: &str = "polynomial-5";

/// Standard deviation of the measurement noise, as a fraction of the largest reading of the calibration, and its seed.
const NOISE: f64 = 0.01;
const SEED: u64 = 1;

/// Standard deviation of the contact's random walk after one second, in each direction.
const WANDER_M_SQRT_S: f64 = 2e-4;

/// Error of the initial belief, and its standard deviation in each direction.
const START_OFF_M: Vector2<f64> = Vector2::new(2e-3, 1e-3);
const START_SD_M: f64 = 2e-3;

/// Largest difference between two evaluations of the sensor model, relative to the largest reading.
const ROUNDING: f64 = 1e-12;

/// Problem. The serialised fields suffice for a program in another language.
#[derive(Serialize)]
pub(crate) struct Problem {
    /// Name of the trace.
    trace: String,
    /// Steps, one per reading.
    pub(crate) steps: Vec<Step>,
    /// True contact at each reading, in Base.
    truth_m: Vec<Vector2<f64>>,
    /// Sensor model, in the format of calibration files.
    model: Value,
    /// The same for many contacts at once.
    #[serde(skip)]
    polynomial: Polynomial,
    /// Calibrated face with the sensor model.
    #[serde(skip)]
    pub(crate) face: Arc<CalibratedFace>,
    /// Variance of a reading: noise plus the sensor model's error.
    pub(crate) variance_n2_m2: f64,
    /// Process noise variance of one step, in each direction.
    pub(crate) wander_m2: f64,
    /// Initial belief: mean, and variance in each direction.
    pub(crate) start_m: Vector2<f64>,
    pub(crate) start_m2: f64,
    /// Number of particles, and the effective sample size below which they are resampled, as a share of their number.
    pub(crate) particles: usize,
    pub(crate) resample_share: f64,
    /// Scaling of the sigma points (Wan and van der Merwe 2000).
    pub(crate) alpha: f64,
    pub(crate) beta: f64,
    pub(crate) kappa: f64,
}

/// Motion of the base up to a reading, and the reading.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Step {
    /// Rotation and subsequent translation of the Base coordinates of a contact at rest. The matrix is serialised column by column.
    pub(crate) turn: Matrix2<f64>,
    pub(crate) shift_m: Vector2<f64>,
    /// Reading.
    pub(crate) reading_n_m: f64,
}

impl Problem {
    /// Problem of the touch in a simulated trace, with added noise.
    pub(crate) fn new(trace: &Path, calibration: &Path) -> anyhow::Result<Self> {
        let Trace { sidecar, recording, truth } = Trace::read(trace)?;
        let file = CalibrationFile::read(calibration)?;
        let faces = file.calibrated(calibration, Some(MODEL))?;
        let face = faces.iter().find(|face| face.face == sidecar.face).context("the face is not calibrated")?;
        let of_face = file.faces.iter().find(|of| of.face == face.face).and_then(|of| of.model(Some(MODEL)));
        let model = of_face.context("the model is not in the file")?.model.clone();
        let noise_sd_n_m = NOISE * face.largest_reading_n_m;
        let mut rng = Pcg64::seed_from_u64(SEED);

        let (mut steps, mut truth_m) = (Vec::new(), Vec::new());
        for (i, pair) in recording.instants.windows(2).enumerate() {
            let Some(contact) = truth.instants[i + 1].contact else { continue };
            let motion = pair[0].base.then(&pair[1].base.inverse());
            let shift_m = motion.origin().vector();
            let reading_n_m = pair[1].moment_z_n_m + noise_sd_n_m * rng.sample::<f64, _>(StandardNormal);
            steps.push(Step { turn: motion.rotation(), shift_m, reading_n_m });
            truth_m.push(pair[1].base.inverse().apply(contact).vector());
        }
        let polynomial = Polynomial::of(&model)?;
        for contact in &truth_m {
            let mut reading_n_m = [0.0];
            polynomial.readings_n_m(&[contact.x], &[contact.y], &mut reading_n_m);
            let expected_n_m = face.model.reading_n_m(Point::from_vector(*contact));
            let is_equal = (reading_n_m[0] - expected_n_m).abs() <= ROUNDING * face.largest_reading_n_m;
            anyhow::ensure!(is_equal, "the polynomials differ: found {} N m, expected {expected_n_m}", reading_n_m[0]);
        }
        Ok(Self {
            trace: sidecar.name,
            start_m: *truth_m.first().context("the trace has no touch")? + START_OFF_M,
            start_m2: START_SD_M * START_SD_M,
            steps,
            truth_m,
            polynomial,
            model,
            face: face.clone(),
            variance_n2_m2: noise_sd_n_m * noise_sd_n_m + face.heldout_rms_n_m * face.heldout_rms_n_m,
            wander_m2: WANDER_M_SQRT_S * WANDER_M_SQRT_S / sidecar.rate_hz,
            particles: 1000,
            resample_share: 0.5,
            alpha: 0.5,
            beta: 2.0,
            kappa: 1.0,
        })
    }

    /// Initial belief.
    pub(crate) fn start(&self) -> Gaussian<2> {
        Gaussian::new(self.start_m, Matrix2::identity() * self.start_m2)
    }

    /// Scaling of the sigma points.
    pub(crate) fn spread(&self) -> Spread {
        Spread { alpha: self.alpha, beta: self.beta, kappa: self.kappa }
    }

    /// Reading expected at the contact `x`.
    pub(crate) fn reading_n_m(&self, x: &Vector2<f64>) -> f64 {
        self.face.model.reading_n_m(Point::from_vector(*x))
    }

    /// Gradient of the expected reading.
    pub(crate) fn gradient_n(&self, x: &Vector2<f64>) -> RowVector2<f64> {
        self.face.model.predict(Point::from_vector(*x)).gradient_n.transpose()
    }
}

impl Step {
    /// Contact in Base after the motion.
    pub(crate) fn moved(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.turn * x + self.shift_m
    }
}

/// Process model of one step.
pub(crate) struct Motion<'a> {
    pub(crate) step: &'a Step,
    pub(crate) wander_m2: f64,
}

impl Process<2> for Motion<'_> {
    fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.step.moved(x)
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.wander_m2
    }

    fn constant_noise(&self) -> Option<Matrix2<f64>> {
        Some(Matrix2::identity() * self.wander_m2)
    }

    fn jacobian(&self, _: &Vector2<f64>) -> Matrix2<f64> {
        self.step.turn
    }

    fn predict_each(&self, states: &mut StateArray<2>) {
        vectorised!(move_each(self.step, states));
    }
}

#[inline(always)]
fn move_each(step: &Step, states: &mut StateArray<2>) {
    let [x_m, y_m] = states.columns_mut();
    let ([[a, b], [c, d]], [dx_m, dy_m]) = (step.turn.data.0, step.shift_m.data.0[0]);
    for (x_m, y_m) in x_m.iter_mut().zip(y_m) {
        (*x_m, *y_m) = (a.mul_add(*x_m, c.mul_add(*y_m, dx_m)), b.mul_add(*x_m, d.mul_add(*y_m, dy_m)));
    }
}

/// Measurement model.
impl Measurement<2, 1> for &Problem {
    fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
        Some(Vector1::new(self.reading_n_m(x)))
    }

    fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
        Matrix1::new(self.variance_n2_m2)
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Option<RowVector2<f64>> {
        Some(self.gradient_n(x))
    }

    fn linearised(&self, x: &Vector2<f64>) -> Option<(Vector1<f64>, RowVector2<f64>)> {
        let expected = self.face.model.predict(Point::from_vector(*x));
        Some((Vector1::new(expected.reading_n_m), expected.gradient_n.transpose()))
    }

    fn predict_each(&self, states: &StateArray<2>, expected: &mut StateArray<1>) {
        let [readings_n_m] = expected.columns_mut();
        self.polynomial.readings_n_m(states.column(0), states.column(1), readings_n_m);
    }

    fn constant_noise(&self) -> Option<Matrix1<f64>> {
        Some(Matrix1::new(self.variance_n2_m2))
    }
}
