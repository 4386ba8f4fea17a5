//! A reading of the magnetometer.

/// A reading of the magnetometer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When it was taken, in seconds since the recording began.
    pub t_s: f64,
    /// Counts of the three axes; they wrap around at 16 bits.
    pub counts: [u16; 3],
}
