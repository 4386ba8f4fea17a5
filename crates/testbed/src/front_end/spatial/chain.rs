//! Interface of a front end of traces in space: input and signal chain.

use std::fmt::Debug;

use nalgebra::{Rotation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use trace::{SpatialInstant, SpatialRecording, SpatialSensor, SpatialSidecar, SpatialTrace, StatedSuspension};

use crate::seeds::derived_seed;

/// Axes about which a reading states the bending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BendingAxes {
    /// The y and z axes of Base.
    Base,
    /// The axes of the suspension's springs: z of Base, and y as yaw has turned it. A sensor that measures rotations of
    /// the root reads stiffness times angle, which is the moment about these axes.
    Springs,
}

impl BendingAxes {
    /// Bending moments about y and z for a moment at the root in Base (N m).
    pub fn bending_n_m(self, moment_n_m: Vector3<f64>, suspension: &StatedSuspension) -> [f64; 2] {
        match self {
            Self::Base => [moment_n_m.y, moment_n_m.z],
            Self::Springs => {
                let yaw_rad = moment_n_m.z / suspension.yaw_n_m_rad;
                [yaw_rad.cos() * moment_n_m.y - yaw_rad.sin() * moment_n_m.x, moment_n_m.z]
            }
        }
    }
}

/// Moment at the root in Base (N m); torsion that the trace does not state is zero.
pub(in crate::front_end) fn moment_n_m(instant: &SpatialInstant) -> Vector3<f64> {
    Vector3::new(instant.moment_x_n_m.unwrap_or(0.0), instant.moment_y_n_m, instant.moment_z_n_m)
}

/// Input of a front end: a recording with its noise.
#[derive(Clone, Copy, Debug)]
pub struct SpatialInput<'a> {
    /// Sidecar of the trace.
    pub sidecar: &'a SpatialSidecar,
    /// Recording.
    pub recording: &'a SpatialRecording,
    /// Standard deviation of the white noise added to each bending moment (N m).
    pub noise_sd_n_m: f64,
    /// Seed of the run; the noise of a trace is derived from it and the trace's name.
    pub seed: u64,
    /// Calibration of the sensor, if it requires one.
    pub sensor: Option<&'a SpatialSensor>,
}

impl<'a> SpatialInput<'a> {
    /// Input from a trace, without a calibration.
    pub fn new(trace: &'a SpatialTrace, noise_sd_n_m: f64, seed: u64) -> Self {
        Self { sidecar: &trace.sidecar, recording: &trace.recording, noise_sd_n_m, seed, sensor: None }
    }

    /// Bending moments about y and z of Base with white noise (N m), one entry per instant.
    pub(in crate::front_end) fn bending_n_m(&self) -> impl Iterator<Item = Vector2<f64>> {
        let mut noise = bending_noise(&self.sidecar.name, self.seed);
        let exact = self.recording.instants.iter().map(|instant| moment_n_m(instant).yz());
        exact.map(move |bending_n_m| bending_n_m + self.noise_sd_n_m * Vector2::from(noise()))
    }

    /// Directions of the root in Base, one entry per instant: the x axis as yaw and pitch turn it. Twist about it does
    /// not move it. Rotations that the trace does not state follow from the moments.
    pub(in crate::front_end) fn directions(&self) -> impl Iterator<Item = Vector3<f64>> {
        let suspension = self.sidecar.suspension;
        self.recording.instants.iter().zip(self.bending_n_m()).map(move |(instant, noisy_n_m)| {
            let added_n_m = noisy_n_m - moment_n_m(instant).yz();
            let [y_n_m, z_n_m] = BendingAxes::Springs.bending_n_m(moment_n_m(instant), &suspension);
            let stated = instant.rotation.map(|rotation| [rotation.y, rotation.x]);
            let [pitch_rad, yaw_rad] =
                stated.unwrap_or([y_n_m / suspension.pitch_n_m_rad, z_n_m / suspension.yaw_n_m_rad]);
            let pitch_rad = pitch_rad + added_n_m.x / suspension.pitch_n_m_rad;
            let yaw_rad = yaw_rad + added_n_m.y / suspension.yaw_n_m_rad;
            let yawed = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
            yawed * Rotation3::from_axis_angle(&Vector3::y_axis(), pitch_rad) * Vector3::x()
        })
    }
}

/// Standard normal noise of both bending moments of a trace, one pair per row.
fn bending_noise(trace: &str, seed: u64) -> impl FnMut() -> [f64; 2] + use<> {
    let mut random = Pcg64::seed_from_u64(derived_seed(seed, &["white noise in space", trace]));
    move || std::array::from_fn(|_| random.sample(StandardNormal))
}

/// Signal chain of a front end of traces in space. A chain without a sensor returns the moments themselves; a chain with
/// a sensor converts counts to moments with the sensor's calibration.
pub trait SpatialChain: Debug + Send + Sync {
    /// Whether the chain has a sensor, with its own noise, that must be calibrated.
    fn has_sensor(&self) -> bool {
        false
    }

    /// Axes about which the readings state the bending.
    fn axes(&self) -> BendingAxes {
        BendingAxes::Base
    }

    /// Calibrates the sensor on recordings. `None` for a chain without a sensor.
    ///
    /// # Errors
    /// If the recordings do not determine the calibration.
    fn calibrate(&self, _: &[SpatialInput]) -> anyhow::Result<Option<SpatialSensor>> {
        Ok(None)
    }

    /// Readings of a recording, one entry per instant: bending moments about y and z of [`Self::axes`] (N m).
    ///
    /// # Errors
    /// If a required calibration is missing.
    fn readings_n_m(&self, input: &SpatialInput) -> anyhow::Result<Vec<Vector2<f64>>>;
}
