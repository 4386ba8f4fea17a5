//! Residuals of the sensor models on held-out traces.

use super::Claim;

/// The faces that the standard suite calibrates.
const FACES: [(&str, &str); 3] = [("straight", "left"), ("curved", "left"), ("curved", "right")];

pub(super) fn claims() -> Vec<Claim> {
    let on_face = |(whisker, face): (&'static str, &'static str)| {
        Claim::at_most(
            format!("sensor_model_{whisker}_{face}"),
            format!(
                "sensor model, {whisker} whisker, {face} face: residual on held-out traces, RMS over largest reading"
            ),
            0.2,
            "%",
            move |context| {
                let calibrations = &context.standard().run.calibrations;
                let calibration = calibrations.iter().find(|row| row.whisker == whisker && row.face == face);
                Ok(calibration.map(|row| 100.0 * row.heldout_rms_n_m / row.largest_reading_n_m))
            },
        )
    };
    FACES.into_iter().map(on_face).collect()
}
