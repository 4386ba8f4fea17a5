//! Gate of readings that no contact explains, such as a glitch of the sensor or of its bus.

use nalgebra::Vector2;

/// Largest plausible reading relative to the largest calibrated one. Objects may push a whisker farther than its
/// calibration did, but not by a multiple; glitches are orders of magnitude larger.
const MOST_OVER_CALIBRATED: f64 = 10.0;

/// Gate in front of contact detection and estimators. A gated reading counts as missing: the next admitted sample
/// covers its motion and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadingGate {
    most_n_m: f64,
}

impl ReadingGate {
    /// Gate of a sensor with this largest calibrated reading.
    pub fn new(largest_calibrated_n_m: f64) -> Self {
        Self { most_n_m: MOST_OVER_CALIBRATED * largest_calibrated_n_m }
    }

    /// Largest magnitude of an admitted reading.
    pub fn most_n_m(&self) -> f64 {
        self.most_n_m
    }

    /// Whether a reading is finite and within the gate.
    pub fn admits(&self, reading_n_m: f64) -> bool {
        reading_n_m.abs() <= self.most_n_m
    }

    /// Whether both bending moments of a reading in space (N m), 2x1, are finite and within the gate.
    pub fn admits_both(&self, reading_n_m: &Vector2<f64>) -> bool {
        reading_n_m.iter().all(|moment_n_m| self.admits(*moment_n_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_glitches_and_missing_numbers_are_gated() {
        let gate = ReadingGate::new(5e-5);
        assert!([0.0, -5e-5, 1e-4, gate.most_n_m()].into_iter().all(|reading_n_m| gate.admits(reading_n_m)));
        assert!(![1.0, -1.0, f64::NAN, f64::INFINITY].into_iter().any(|reading_n_m| gate.admits(reading_n_m)));
    }
}
