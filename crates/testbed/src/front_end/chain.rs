//! Interface of a front end: input and signal chain.

use std::fmt::Debug;

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use trace::{Instant, Recording, SensorFile, Sidecar, Trace};

use super::mounting::Mounting;
use crate::seeds::derived_seed;

/// Streaming front end: returns the reading in N m of each instant, in order of time.
pub type Reader = Box<dyn FnMut(&Instant) -> f64>;

/// Signal chain of a front end. A chain without a sensor returns the moments themselves; a chain with a sensor converts
/// counts to moments with the sensor's calibration.
pub trait Chain: Debug + Send + Sync {
    /// Whether the chain has a sensor, with its own noise, that must be calibrated.
    fn has_sensor(&self) -> bool {
        false
    }

    /// Calibrates the sensor of a mounting on recordings. `None` for a chain without a sensor.
    ///
    /// # Errors
    /// If the recordings do not determine the calibration.
    fn calibrate(&self, _: &Mounting, _: &[SensorInput]) -> anyhow::Result<Option<SensorFile>> {
        Ok(None)
    }

    /// Readings of a recording, one entry per instant.
    ///
    /// # Errors
    /// If a required calibration is missing.
    fn readings_n_m(&self, input: &SensorInput) -> anyhow::Result<Vec<f64>>;

    /// Streaming equivalent of [`Self::readings_n_m`] with this noise in N m, for recordings that do not fit into
    /// memory. `None` if the chain requires the whole recording.
    fn reader(&self, _noise_n_m: Box<dyn FnMut() -> f64>) -> Option<Reader> {
        None
    }

    /// Names of the report tables of a calibrated sensor.
    fn tables(&self) -> &'static [&'static str] {
        &[]
    }

    /// Contents of these tables, in the same order.
    ///
    /// # Errors
    /// If a row cannot be serialised.
    fn table_bytes(&self, _: &SensorFile) -> anyhow::Result<Vec<Vec<u8>>> {
        Ok(Vec::new())
    }
}

/// Input of a front end: a recording with its noise and the mounting of its sensor.
#[derive(Clone, Copy, Debug)]
pub struct SensorInput<'a> {
    /// Mounting of the sensor.
    pub mounting: &'a Mounting,
    /// Sidecar of the trace.
    pub sidecar: &'a Sidecar,
    /// Recording.
    pub recording: &'a Recording,
    /// Standard deviation of the white noise added to the moments.
    pub noise_sd_n_m: f64,
    /// Seed of the run; the noise of a trace is derived from it and the trace's name.
    pub seed: u64,
    /// Calibration of the sensor, if it requires one.
    pub sensor: Option<&'a SensorFile>,
    /// Simultaneous recordings of other whiskers of the board. Whiskers that are missing are at rest.
    pub neighbours: &'a [SensorInput<'a>],
}

impl<'a> SensorInput<'a> {
    /// Input from a trace, without a calibration and neighbours.
    pub fn new(trace: &'a Trace, mounting: &'a Mounting, noise_sd_n_m: f64, seed: u64) -> Self {
        let (sidecar, recording) = (&trace.sidecar, &trace.recording);
        Self { mounting, sidecar, recording, noise_sd_n_m, seed, sensor: None, neighbours: &[] }
    }

    /// Noise to add to the moments, one entry per instant.
    pub(super) fn noise_n_m(&self) -> impl Iterator<Item = f64> {
        let mut standard = noise(self.sidecar, self.seed);
        self.recording.instants.iter().map(move |_| self.noise_sd_n_m * standard())
    }
}

/// Generator of standard normal noise for a trace and a seed.
pub(super) fn noise(sidecar: &Sidecar, seed: u64) -> impl FnMut() -> f64 + use<> {
    let mut rng = Pcg64::seed_from_u64(derived_seed(seed, &["front end", &sidecar.name]));
    move || rng.sample(StandardNormal)
}
