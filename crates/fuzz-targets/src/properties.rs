//! Properties asserted for every parser.

use std::fmt::Display;

use serde_json::Value;

/// Maximum length of an error message in bytes.
const LONGEST: usize = 4000;

/// Returns the parsed value. Asserts that an error is a single line that contains the file name.
pub fn one_error<T, E: Display>(read: Result<T, E>, file: &str) -> Option<T> {
    read.map_err(|error| {
        // Formatted with all causes, as the command prints it.
        let line = format!("{error:#}");
        assert!(line.contains(file), "does not name `{file}`: {line}");
        assert!(!line.contains(char::is_control), "more than one line: {line:?}");
        assert!(line.len() <= LONGEST, "an error of {} bytes: {line}", line.len());
    })
    .ok()
}

/// Non-empty lines, for any line ending.
pub(crate) fn lines(bytes: &[u8]) -> Vec<&[u8]> {
    bytes.split(|byte| matches!(byte, b'\n' | b'\r')).filter(|line| !line.is_empty()).collect()
}

/// Whether a text is a plain decimal number such as `-1.5e-3`, in contrast to `inf`, `0x1p3`, `1_000` or digits of
/// other scripts.
pub fn is_decimal(text: &str) -> bool {
    let text = text.strip_prefix(['+', '-']).unwrap_or(text);
    let (mantissa, exponent) =
        text.split_once(['e', 'E']).map_or((text, None), |(mantissa, exponent)| (mantissa, Some(exponent)));
    let are_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let (whole, part) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let exponent = exponent.map(|exponent| exponent.strip_prefix(['+', '-']).unwrap_or(exponent));
    are_digits(whole)
        && are_digits(part)
        && !(whole.is_empty() && part.is_empty())
        && exponent.is_none_or(|digits| !digits.is_empty() && are_digits(digits))
}

/// Asserts that the parsed value contains every value of the file: numbers are compared as numbers, and `null` may be
/// omitted.
pub fn same_json(file: &Value, read: &Value) {
    assert!(is_same(file, read), "read {read} from {file}");
}

fn is_same(file: &Value, read: &Value) -> bool {
    match (file, read) {
        (Value::Object(file), Value::Object(read)) => {
            file.iter().all(|(key, value)| read.get(key).map_or(value.is_null(), |read| is_same(value, read)))
        }
        (Value::Array(file), Value::Array(read)) => {
            file.len() == read.len() && file.iter().zip(read).all(|(file, read)| is_same(file, read))
        }
        (Value::Number(file), Value::Number(read)) => file == read || file.as_f64() == read.as_f64(),
        _ => file == read,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_decimals() {
        for text in ["0", "-1.5e-3", "+.5", "5.", "1E9", "007"] {
            assert!(is_decimal(text), "{text}");
        }
        for text in [
            "",
            ".",
            "-",
            "1e",
            "e5",
            "inf",
            "NaN",
            "0x1p3",
            "1_000",
            "1,5",
            " 1",
            "1 ",
            "١",
            "1.5.2",
            "--1",
            "\u{feff}1",
        ] {
            assert!(!is_decimal(text), "{text}");
        }
    }
}
