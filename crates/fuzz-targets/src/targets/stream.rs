//! Line of a live stream.

use live::wire::{Line, parse};
use serde_json::Value;
use strict_json::parse_json;

use crate::properties::{one_error, same_json};

pub(super) fn run(bytes: &[u8]) {
    // A line is text; other bytes are refused before.
    let Ok(line) = std::str::from_utf8(bytes) else { return };
    let Some(parsed) = one_error(parse(line), "expected") else { return };
    let file: Value = parse_json(line.as_bytes()).expect("it was read");
    match parsed {
        Line::Prior(prior) => same_json(&file, &serde_json::to_value(&prior).expect("it serialises")),
        Line::Sample(sample) => {
            assert_eq!(file["t_s"].as_f64(), Some(sample.t_s));
            assert_eq!(file.get("reading_n_m").and_then(Value::as_f64), sample.reading_n_m);
            assert!(sample.t_s.is_finite() && sample.reading_n_m.is_none_or(f64::is_finite));
            assert!(sample.reading_n_m.is_some() || sample.base.is_some());
            assert_eq!(file.get("base_yaw_rad").and_then(Value::as_f64), sample.base.map(|base| base.yaw_rad()));
        }
    }
}
