//! Description of a run.

use serde_json::{Map, Value};
use strict_json::parse_json;
use testbed::results::Run;
use whisker::events::FORMER_NAMES;

use crate::properties::{one_error, same_json};
use crate::scratch;

pub(super) fn run(bytes: &[u8]) {
    let path = scratch::file("run.json", bytes);
    let Some(run) = one_error(Run::read(&path), "run.json") else { return };
    let text = serde_json::to_value(&run).expect("it serialises");
    let mut input: Value = parse_json(bytes).expect("it was read");
    if let Some(touch) = input.get_mut("touch").and_then(Value::as_object_mut) {
        by_present_names(touch);
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

/// Replaces the former names of a detector and of its settings by the present ones.
fn by_present_names(touch: &mut Map<String, Value>) {
    for (former, present) in FORMER_NAMES {
        if let Some(detector) = touch.get_mut("detector").filter(|name| **name == former) {
            *detector = present.into();
        }
        if let Some(value) = touch.shift_remove(former) {
            touch.insert(present.to_owned(), value);
        }
    }
}
