//! What every magnetometer gives.

/// One reading of a 3-axis magnetometer with 16 bits per axis, which wrap around.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time of the reading.
    pub t_s: f64,
    /// The axes x, y and z, in counts.
    pub counts: [u16; 3],
}
