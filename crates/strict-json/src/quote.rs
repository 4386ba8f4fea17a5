//! Quotation of untrusted text in messages.

/// Maximum number of characters quoted from a file in an error message.
const LONGEST: usize = 500;

/// Text in one line. Control characters are escaped as in `\n`, so that they can neither end the line nor control the
/// terminal.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { line.extend(c.escape_default()) } else { line.push(c) }
    }
    line
}

/// A number as messages show it: with an exponent above 1e6 and below 1e-4, where digits would have to be counted.
pub fn shown_number(number: f64) -> String {
    let magnitude = number.abs();
    let is_plain = number == 0.0 || !number.is_finite() || (1e-4..=1e6).contains(&magnitude);
    if is_plain { number.to_string() } else { format!("{number:e}") }
}

/// Excerpt of at most 500 characters in one line, see [`one_line`].
pub fn shown(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => one_line(&text[..end]) + "...",
        None => one_line(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_long_numbers_are_shown_with_an_exponent() {
        for (number, text) in [
            (0.0, "0"),
            (-0.5, "-0.5"),
            (1e-4, "0.0001"),
            (1e6, "1000000"),
            (1e300, "1e300"),
            (-2.5e7, "-2.5e7"),
            (1e-6, "1e-6"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(shown_number(number), text);
        }
    }
}
