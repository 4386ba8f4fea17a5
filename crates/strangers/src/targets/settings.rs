//! Settings: of every estimator by its name, of front ends under `front_end`, of the detection of contacts, the map and the encoders.

use serde_json::Value;
use testbed::encoders::Encoders;
use testbed::front_end::{Choice, FRONT_ENDS, FrontEnd};
use testbed::map::MapConfig;
use testbed::settings::merged;
use trace::parse_json;
use whisker::estimators::{ESTIMATORS, Estimator};
use whisker::events::{ContactDetector, TouchConfig};

use crate::claims::one_error;
use crate::golden::KNOWLEDGE;

pub(super) fn run(bytes: &[u8]) {
    let Some(file) = one_error(parse_json::<Value>(bytes), "") else { return };
    for row in ESTIMATORS {
        let settings = file.get(row.name).map(|settings| merged((row.defaults)(), settings));
        let Some(settings) = settings.and_then(|settings| one_error(settings, "")) else { continue };
        if let Some(method) = one_error((row.build)(&settings, &KNOWLEDGE), "") {
            Estimator::new(method, KNOWLEDGE.clone(), TouchConfig::default(), 1);
        }
    }
    if let Some(touch) = file.get("touch").and_then(|touch| serde_json::from_value::<TouchConfig>(touch.clone()).ok())
        && one_error(touch.validate(), "").is_some()
    {
        let mut detector = ContactDetector::new(touch, &KNOWLEDGE.sensing());
        for reading_n_m in [0.0, 1e-5, -2e-5] {
            detector.judge(reading_n_m, 4e-3);
        }
    }
    if let Some(map) = file.get("map").and_then(|map| serde_json::from_value::<MapConfig>(map.clone()).ok()) {
        one_error(map.validate(), "map");
    }
    if let Some(encoders) = file.get("encoders").and_then(|it| serde_json::from_value::<Encoders>(it.clone()).ok())
        && one_error(encoders.validate(), "encoders").is_some()
    {
        assert!(!encoders.label().contains(['/', '\\']));
    }
    for row in FRONT_ENDS {
        if let Some(config) = file.get("front_end").and_then(|front_ends| front_ends.get(row.name)) {
            one_error(FrontEnd::new(&Choice { name: row.name.into(), config: config.clone() }), "");
        }
    }
}
