//! Front end without a sensor: the root moment plus white noise.

use anyhow::ensure;
use serde_json::Value;

use super::chain::{Chain, Reader, SensorInput};

pub(super) fn build(config: &Value) -> anyhow::Result<Box<dyn Chain>> {
    check_none(config)?;
    Ok(Box::new(White))
}

/// Checks that there are no settings.
pub(super) fn check_none(config: &Value) -> anyhow::Result<()> {
    let known = config.as_object().and_then(|settings| settings.keys().next());
    ensure!(known.is_none(), "unknown key `{}`, expected none", known.map_or("", |key| key));
    Ok(())
}

/// Reads the moment with the white noise that every front end receives.
#[derive(Debug)]
struct White;

impl Chain for White {
    fn readings_n_m(&self, input: &SensorInput) -> anyhow::Result<Vec<f64>> {
        let instants = &input.recording.instants;
        Ok(instants
            .iter()
            .zip(input.noise_n_m())
            .map(|(instant, noise_n_m)| instant.moment_z_n_m + noise_n_m)
            .collect())
    }

    fn reader(&self, mut noise_n_m: Box<dyn FnMut() -> f64>) -> Option<Reader> {
        Some(Box::new(move |instant| instant.moment_z_n_m + noise_n_m()))
    }
}
