//! A reading of the magnetometer.

/// A reading of the magnetometer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the beginning of the recording (s).
    pub t_s: f64,
    /// Counts of the three axes, modulo 2^16.
    pub counts: [u16; 3],
}
