//! Messages of parse errors in terms of JSON.

/// Message of a parse error without its place. The parser names Rust types; here a `usize` is a whole number of 0 or more, and a
/// struct an object.
pub fn reason(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    let text = text.strip_suffix(&place).unwrap_or(&text);
    if let Some(unfinished) = text.strip_prefix("EOF while parsing ") {
        return format!("found the end within {unfinished}");
    }
    if ["expected value", "expected ident"].contains(&text) {
        return "expected a JSON value".into();
    }
    // After the value, or after the last entry of a list of fixed length.
    if text == "trailing characters" {
        return "found further characters, expected the end of the value".into();
    }
    let Some((found, expected)) = text.rsplit_once(", expected ") else { return text.into() };
    if let Some(length) = found.strip_prefix("invalid length ") {
        return format!("found a list of {length}, expected {}", kind(expected));
    }
    let found = ["invalid type: ", "invalid value: "].iter().find_map(|start| found.strip_prefix(start));
    found.map_or_else(|| text.into(), |found| format!("found {}, expected {}", value(found), kind(expected)))
}

/// A value as the parser names it, in terms of JSON.
fn value(found: &str) -> &str {
    let literal = |kind: &str| found.strip_prefix(kind)?.strip_suffix('`');
    match found {
        "sequence" => "a list",
        "map" => "an object",
        _ => {
            let kinds = ["integer `", "floating point `", "boolean `"];
            kinds.into_iter().find_map(literal).or_else(|| found.strip_prefix("string ")).unwrap_or(found)
        }
    }
}

/// A type as the parser names it, in terms of JSON.
fn kind(expected: &str) -> String {
    let name = match expected {
        "f64" | "f32" => "a number",
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number",
        "u64" | "usize" => "a whole number of 0 or more",
        "u8" => return format!("a whole number of 0 to {}", u8::MAX),
        "u16" => return format!("a whole number of 0 to {}", u16::MAX),
        "u32" => return format!("a whole number of 0 to {}", u32::MAX),
        "a boolean" => "true or false",
        "a sequence" => "a list",
        "a map" | "map" => "an object",
        "string or map" => "a string or an object",
        "map with a single key" => "an object with one key",
        _ if expected.starts_with("struct ") || expected.starts_with("internally tagged enum ") => "an object",
        _ => {
            let length =
                ["an array of length ", "a tuple of size "].iter().find_map(|start| expected.strip_prefix(start));
            return length.map_or_else(|| expected.into(), |length| format!("a list of {length}"));
        }
    };
    name.into()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Deserialize;
    use serde::de::DeserializeOwned;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Settings {
        #[serde(rename = "gain")]
        _gain: f64,
    }

    #[derive(Debug, Deserialize)]
    #[serde(tag = "kind")]
    enum Tagged {
        #[serde(rename = "one")]
        One,
    }

    fn of<T: DeserializeOwned + std::fmt::Debug>(text: &str) -> String {
        reason(&serde_json::from_str::<T>(text).unwrap_err())
    }

    #[test]
    fn robust_messages_name_the_types_of_json() {
        assert_eq!(of::<f64>(r#""a""#), r#"found "a", expected a number"#);
        assert_eq!(of::<f64>(r#""x at line 3""#), r#"found "x at line 3", expected a number"#);
        assert_eq!(of::<f64>("[1]"), "found a list, expected a number");
        assert_eq!(of::<usize>("-1"), "found -1, expected a whole number of 0 or more");
        assert_eq!(of::<u32>("4294967296"), "found 4294967296, expected a whole number of 0 to 4294967295");
        assert_eq!(of::<u8>("1.5"), "found 1.5, expected a whole number of 0 to 255");
        assert_eq!(of::<bool>("null"), "found null, expected true or false");
        assert_eq!(of::<Vec<f64>>("{}"), "found an object, expected a list");
        assert_eq!(of::<BTreeMap<String, f64>>("true"), "found true, expected an object");
        assert_eq!(of::<Settings>("[]"), "found a list of 0, expected an object");
        assert_eq!(of::<[f64; 2]>("[1]"), "found a list of 1, expected a list of 2");
        assert_eq!(of::<(f64, f64)>("[1]"), "found a list of 1, expected a list of 2");
        assert_eq!(of::<[f64; 2]>("[1, 2, 3]"), "found further characters, expected the end of the value");
        assert_eq!(of::<Settings>("3"), "found 3, expected an object");
        assert_eq!(of::<Tagged>("3"), "found 3, expected an object");
        assert_eq!(of::<Settings>(r#"{"gian": 1}"#), "unknown field `gian`, expected `gain`");
        assert_eq!(of::<Settings>("{}"), "missing field `gain`");
        assert_eq!(of::<Settings>("{"), "found the end within an object");
        assert_eq!(of::<f64>("NaN"), "expected a JSON value");
    }
}
