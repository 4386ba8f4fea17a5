//! Suite with an optional scene `scene.json`.

use serde_json::Value;
use strict_json::parse_json;
use trace::{Suite, is_plain_name, scene_difference};

use crate::properties::{one_error, same_json};
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let [suite, scene] = scratch::parts(bytes);
    scratch::file("scene.json", scene);
    let path = scratch::file("suite.json", suite);
    let Some(read) = one_error(Suite::read(&path), "suite.json") else { return };
    assert!(is_plain_name(&read.name));
    let file: Value = parse_json(suite).expect("it was read");
    same_json(&file, &serde_json::to_value(&read).expect("it serialises"));
    let Some(runs) = one_error(read.runs(&path), "") else { return };
    for run in runs {
        assert!(is_plain_name(&run.name), "{}", run.name);
        assert_eq!(scene_difference(&run.scene, &run.scene), None);
    }
}
