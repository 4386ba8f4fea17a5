//! The moment itself, with white noise.

use anyhow::ensure;
use serde_json::Value;
use trace::SensorFile;

use super::{Chain, Occasion, Reader};

pub(super) fn build(config: &Value) -> anyhow::Result<Box<dyn Chain>> {
    let known = config.as_object().and_then(|settings| settings.keys().next());
    ensure!(known.is_none(), "unknown key `{}`, expected none", known.map_or("", |key| key));
    Ok(Box::new(White))
}

/// Adds nothing to the noise that every front end is given.
#[derive(Debug)]
struct White;

impl Chain for White {
    fn reader<'a>(&'a self, on: &Occasion<'a>, _: Option<&'a SensorFile>) -> anyhow::Result<Reader<'a>> {
        let mut noise_n_m = on.noise();
        Ok(Box::new(move |instant| instant.moment_z_n_m + noise_n_m()))
    }
}
