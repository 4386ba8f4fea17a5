//! Conversion between decimal microtesla, as printed by sketches with the MLX90393 library, and the sensor's counts.

/// Microtesla a count of x, y and z at the gain and resolution that the library sets (MLX90393 data sheet, table 17:
/// gain 1, resolution 16).
const MICROTESLA_PER_COUNT: [f64; 3] = [0.150, 0.150, 0.242];
/// Largest plausible field, orders of magnitude above the sensor's range: a larger number is damaged.
const MOST_MICROTESLA: f64 = 1e6;

/// Counts of an axis, modulo 2^16, from its printed field. `None` if it is not a decimal number in range. The sensor's
/// counts are signed.
pub(super) fn counts(axis: usize, text: &[u8]) -> Option<u16> {
    // Plain decimals only: sketches print no `inf`, `nan` or exponents.
    let is_plain = text.iter().all(|byte| byte.is_ascii_digit() || matches!(byte, b'-' | b'.'));
    let field: f64 = std::str::from_utf8(text).ok().filter(|_| is_plain)?.parse().ok()?;
    (field.abs() < MOST_MICROTESLA).then(|| (field / MICROTESLA_PER_COUNT[axis]).round() as i64 as u16)
}

/// Printed field of these counts.
pub(super) fn printed(axis: usize, counts: u16) -> String {
    format!("{:.2}", f64::from(counts as i16) * MICROTESLA_PER_COUNT[axis])
}
