//! How well the sensor model fits what it has not seen.

use super::{Claim, Relation};

/// The faces that the standard suite calibrates.
const FACES: [(&str, &str); 3] = [("straight", "left"), ("curved", "left"), ("curved", "right")];

pub(super) fn claims() -> Vec<Claim> {
    FACES
        .iter()
        .map(|&(whisker, face)| Claim {
            id: format!("sensor_model_{whisker}_{face}"),
            claim: format!(
                "sensor model, {whisker} whisker, {face} face: residual on held-out traces, RMS over largest reading"
            ),
            unit: "%",
            relation: Relation::AtMost,
            bound: 0.2,
            measure: Box::new(move |context| {
                let calibration =
                    context.run.calibrations.iter().find(|row| row.whisker == whisker && row.face == face);
                Ok(calibration.map(|row| 100.0 * row.heldout_rms_n_m / row.largest_reading_n_m))
            }),
        })
        .collect()
}
