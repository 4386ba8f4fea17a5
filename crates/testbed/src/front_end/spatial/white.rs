//! Front end without a sensor: the bending moments at the root plus white noise on each.

use nalgebra::Vector2;
use serde_json::Value;

use super::{SpatialChain, SpatialInput};
use crate::front_end::white::check_none;

pub(super) fn build(config: &Value) -> anyhow::Result<Box<dyn SpatialChain>> {
    check_none(config)?;
    Ok(Box::new(White))
}

/// Reads the moments with the white noise that every front end receives.
#[derive(Debug)]
struct White;

impl SpatialChain for White {
    fn readings_n_m(&self, input: &SpatialInput) -> anyhow::Result<Vec<Vector2<f64>>> {
        Ok(input.bending_n_m().collect())
    }
}
