//! The sensor front end: turns the physics of a recording into what a sensor would read.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use trace::{Digest, Recording, Sidecar};

/// Measurement noise to add where none is asked for, as a fraction of the largest reading: none to a recording, which has its own.
pub fn default_noise(sidecar: &Sidecar) -> f64 {
    if sidecar.recorded.is_some() { 0.0 } else { 0.01 }
}

/// White measurement noise from a seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontEnd {
    /// Standard deviation of the noise.
    pub noise_sd_n_m: f64,
    /// Seed of the run; every trace draws its own noise from it.
    pub seed: u64,
}

impl FrontEnd {
    /// Readings of a recording, one an instant.
    pub fn readings_n_m(&self, trace_name: &str, recording: &Recording) -> Vec<f64> {
        let mut rng = Pcg64::seed_from_u64(derived_seed(self.seed, &["front end", trace_name]));
        recording
            .instants
            .iter()
            .map(|instant| instant.moment_z_n_m + self.noise_sd_n_m * rng.sample::<f64, _>(StandardNormal))
            .collect()
    }
}

/// A seed that depends on the run's seed and on what it is for, and on nothing else: not on order or threads.
pub fn derived_seed(seed: u64, purpose: &[&str]) -> u64 {
    let mut digest = Digest::default();
    digest.add(seed.to_le_bytes());
    for word in purpose {
        digest.add(word);
    }
    u64::from_str_radix(&digest.finish()[..16], 16).expect("a hash is hexadecimal")
}
