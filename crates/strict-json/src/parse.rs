//! Strict parsing into typed values.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::keys_once::KeysOnce;
use crate::{list_for_object, shown};

/// Byte order mark that editors on Windows write before UTF-8.
const MARK: &[u8] = b"\xEF\xBB\xBF";

/// Parses JSON into a typed value. Skips a byte order mark at the beginning. Rejects objects with duplicate keys, and lists where
/// an object is expected, which serde would assign to the fields in declaration order.
///
/// # Errors
/// Syntax or type errors with line and column; duplicate keys and lists with their place.
pub fn parse_json<T: DeserializeOwned + Serialize>(bytes: &[u8]) -> serde_json::Result<T> {
    let bytes = bytes.strip_prefix(MARK).unwrap_or(bytes);
    let value = serde_json::from_slice(bytes)?;
    let KeysOnce = serde_json::from_slice(bytes)?;
    match list_for_object(&serde_json::from_slice(bytes)?, &serde_json::to_value(&value)?) {
        None => Ok(value),
        Some(place) => Err(serde::de::Error::custom(format!("{}: found a list, expected an object", shown(&place)))),
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize, Serialize, PartialEq)]
    struct Inner {
        x_m: f64,
        y_m: f64,
    }

    #[derive(Debug, Deserialize, Serialize, PartialEq)]
    struct Outer {
        pair: (f64, f64),
        inner: Vec<Inner>,
    }

    #[test]
    fn robust_a_list_is_not_accepted_for_an_object() {
        let outer = Outer { pair: (1.0, 2.0), inner: vec![Inner { x_m: 3.0, y_m: 4.0 }] };
        let sound = r#"{"pair": [1, 2], "inner": [{"x_m": 3, "y_m": 4}]}"#;
        assert_eq!(parse_json::<Outer>(sound.as_bytes()).unwrap(), outer);
        assert_eq!(parse_json::<Outer>(&[MARK, sound.as_bytes()].concat()).unwrap(), outer);
        for (list, place) in [(r#"{"pair": [1, 2], "inner": [[3, 4]]}"#, "inner[0]"), ("[[1, 2], []]", "the whole")] {
            let error = parse_json::<Outer>(list.as_bytes()).unwrap_err().to_string();
            assert_eq!(error, format!("{place}: found a list, expected an object"));
        }
    }
}
