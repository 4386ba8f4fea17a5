//! Line of a live stream.

use live::wire::{Given, Line, parse};
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
            let number = |key: &str| file.get(key).and_then(Value::as_f64);
            match sample.reading {
                Some(Given::Moment(n_m)) => assert!(n_m.is_finite() && number("reading_n_m") == Some(n_m)),
                Some(Given::Counts(counts, _)) => assert!(counts.is_finite() && number("counts") == Some(counts)),
                None => assert!(number("reading_n_m").is_none() && number("counts").is_none() && sample.base.is_some()),
            }
            assert!(sample.t_s.is_finite());
            assert_eq!(file.get("base_yaw_rad").and_then(Value::as_f64), sample.base.map(|base| base.yaw_rad()));
        }
    }
}
