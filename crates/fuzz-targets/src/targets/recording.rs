//! Array recording: sidecar, joint table and pose table, with corrected hashes and the golden outline.

use files::sha256;
use serde_json::{Value, json};
use strict_json::parse_json;
use trace::{ArrayRecording, is_plain_name};

use crate::properties::{one_error, same_json};
use crate::{golden, scratch};

const NAME: &str = "untrusted_recording";

pub(super) fn run(bytes: &[u8]) {
    let [file, joints, objects] = scratch::parts(bytes);
    scratch::file("joints.csv", joints);
    scratch::file("objects.csv", objects);
    scratch::kept("outline.csv", golden::CONTOUR);
    let name = format!("{NAME}.json");
    let path = match parse_json::<Value>(file) {
        Ok(mut value) => {
            for (key, bytes) in [("joints", joints), ("poses", objects)] {
                if let Some(part) = value.get_mut(key).and_then(Value::as_object_mut) {
                    part.insert("sha256".into(), json!(sha256(bytes)));
                }
            }
            scratch::file(&name, value.to_string())
        }
        Err(_) => scratch::file(&name, file),
    };
    one_error(ArrayRecording::is_one(&path), NAME);
    let Some(recording) = one_error(ArrayRecording::read(&path), "") else { return };
    let sidecar = &recording.sidecar;
    let text = serde_json::to_value(sidecar).expect("it serialises");
    same_json(&parse_json(&std::fs::read(&path).expect("it is there")).expect("it was read"), &text);
    let names = sidecar.whiskers.iter().flat_map(|whisker| [&whisker.name, &whisker.trace, &whisker.array]);
    assert!(names.chain(sidecar.objects.iter().map(|object| &object.name)).all(|name| is_plain_name(name)));
    assert!(recording.joints.len() == sidecar.rows && recording.moved_m.len() == sidecar.objects.len());
    for whisker in &sidecar.whiskers {
        assert_eq!(sidecar.arm.carry(&whisker.mount, &recording.joints).len(), sidecar.rows);
    }
}
