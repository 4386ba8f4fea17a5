//! Description of a run.

use serde_json::Value;
use strict_json::parse_json;
use testbed::results::Run;

use crate::properties::{one_error, same_json};
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let path = scratch::file("run.json", bytes);
    let Some(run) = one_error(Run::read(&path), "run.json") else { return };
    let text = serde_json::to_value(&run).expect("it serialises");
    let mut input: Value = parse_json(bytes).expect("it was read");
    // A detector keeps its former name as an alias.
    if let Some(detector) = input.pointer_mut("/touch/detector").filter(|name| *name == "steadied") {
        *detector = "ring-compensated".into();
    }
    same_json(&input, &text);
    let again: Run = serde_json::from_value(text).expect("written data can be read");
    assert_eq!(again, run);
    let folder = path.parent().expect("a folder");
    for set in &run.sets {
        let picture = folder.join(format!("{}.{}.webp", set.group, set.whisker));
        assert_eq!(picture.parent(), Some(folder));
    }
    for sensor in &run.front_end.sensors {
        assert_eq!(folder.join(sensor.label()).parent(), Some(folder));
    }
}
