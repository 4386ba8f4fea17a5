//! Settings of estimators (by name), of front ends (under `front_end`), of contact detection, maps and encoders.

use std::fmt::Display;

use serde_json::Value;
use strict_json::{one_line, parse_json};
use testbed::encoders::Encoders;
use testbed::front_end::{FRONT_ENDS, FrontEnd, FrontEndConfig};
use testbed::map::MapConfig;
use testbed::settings::merged;
use whisker::estimators::{ESTIMATORS, Runner};
use whisker::events::{ContactDetector, TouchConfig};

use crate::golden::KNOWLEDGE;
use crate::properties::one_error;

/// Result of a constructor; an error is formatted as the command prints it.
fn one_line_of<T, E: Display>(made: Result<T, E>) -> Option<T> {
    one_error(made.map_err(|error| one_line(&format!("{error:#}"))), "")
}

pub(super) fn run(bytes: &[u8]) {
    let Some(file) = one_line_of(parse_json::<Value>(bytes)) else { return };
    for row in ESTIMATORS {
        let settings = file.get(row.name).map(|settings| merged((row.defaults)(), settings));
        let Some(settings) = settings.and_then(one_line_of) else { continue };
        if let Some(method) = one_line_of((row.build)(&settings, &KNOWLEDGE)) {
            Runner::new(method, KNOWLEDGE.clone(), 1);
        }
    }
    if let Some(touch) = file.get("touch").and_then(|touch| serde_json::from_value::<TouchConfig>(touch.clone()).ok())
        && one_line_of(touch.validate()).is_some()
    {
        let mut detector = ContactDetector::new(touch, &KNOWLEDGE.sensing());
        for reading_n_m in [0.0, 1e-5, -2e-5] {
            detector.judge(reading_n_m, 4e-3);
        }
    }
    if let Some(map) = file.get("map").and_then(|map| serde_json::from_value::<MapConfig>(map.clone()).ok()) {
        one_line_of(map.validate());
    }
    if let Some(encoders) = file.get("encoders").and_then(|it| serde_json::from_value::<Encoders>(it.clone()).ok())
        && one_line_of(encoders.validate()).is_some()
    {
        assert!(!encoders.label().contains(['/', '\\']));
    }
    for row in FRONT_ENDS {
        if let Some(config) = file.get("front_end").and_then(|front_ends| front_ends.get(row.name)) {
            one_line_of(FrontEnd::new(&FrontEndConfig { name: row.name.into(), config: config.clone() }));
        }
    }
}
