//! Decimal microtesla, as sketches with the library of the MLX90393 print them, and the sensor's own counts.

/// Microtesla a count of x, y and z at the gain and resolution that the library sets (MLX90393 data sheet, table 17: gain 1, resolution 16).
const MICROTESLA_PER_COUNT: [f64; 3] = [0.150, 0.150, 0.242];
/// More than the sensor can see by orders of magnitude, so a damaged number.
const MOST_MICROTESLA: f64 = 1e6;

/// Counts of an axis from its printed field; `None` where it is no such number. Counts are signed in the sensor, and wrap around at 16 bits.
pub(super) fn counts(axis: usize, text: &[u8]) -> Option<u16> {
    // Plain decimal alone: `inf`, `nan` and exponents are Rust's, not a sketch's.
    let is_plain = text.iter().all(|byte| byte.is_ascii_digit() || matches!(byte, b'-' | b'.'));
    let field: f64 = std::str::from_utf8(text).ok().filter(|_| is_plain)?.parse().ok()?;
    (field.abs() < MOST_MICROTESLA).then(|| (field / MICROTESLA_PER_COUNT[axis]).round() as i64 as u16)
}

/// The field that a sketch prints for these counts.
pub(super) fn printed(axis: usize, counts: u16) -> String {
    format!("{:.2}", f64::from(counts as i16) * MICROTESLA_PER_COUNT[axis])
}
