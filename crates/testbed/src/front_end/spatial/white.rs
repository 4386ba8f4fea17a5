//! Front end without a sensor: the loads at the root plus white noise on each component.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{SpatialChain, SpatialInput, SpatialReading, check_keys};

/// Settings: the components beyond the bending that are read, if the trace has them.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct White {
    /// Whether the torsion is read.
    torsion: bool,
    /// Whether the axial force is read.
    axial: bool,
}

pub(super) fn defaults() -> Value {
    json!(White { torsion: true, axial: true })
}

pub(super) fn build(config: &Value) -> anyhow::Result<Box<dyn SpatialChain>> {
    check_keys(config, &defaults())?;
    Ok(Box::new(serde_json::from_value::<White>(config.clone())?))
}

impl SpatialChain for White {
    fn readings(&self, input: &SpatialInput) -> anyhow::Result<Vec<SpatialReading>> {
        let mut axial = input.standard("axial force");
        let read = input.recording.instants.iter().zip(input.moments_n_m()).map(|(instant, noisy_n_m)| {
            let axial_noise_n = input.noise.axial_n * axial();
            SpatialReading {
                bending_n_m: [noisy_n_m.y, noisy_n_m.z],
                torsion_n_m: instant.moment_x_n_m.filter(|_| self.torsion).map(|_| noisy_n_m.x),
                axial_n: instant.force_x_n.filter(|_| self.axial).map(|force_n| force_n + axial_noise_n),
            }
        });
        Ok(read.collect())
    }
}
