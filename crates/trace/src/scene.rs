//! Comparison of scene files with the scenes that traces were simulated from.
//!
//! A sidecar contains its scene with every default filled in. The defaults are those of the generator's schema,
//! `data/scene.schema.json` (`whisker-sim schema`), so that a key that is absent from a scene file is compared with its
//! default.

use std::sync::LazyLock;

use serde_json::{Map, Value};

/// JSON Schema of scene files, written by the generator. Beside the keywords of JSON Schema it has [`SETTINGS`].
static SCHEMA: LazyLock<Value> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../data/scene.schema.json")).expect("the generator's schema is JSON")
});

/// Keyword of the schema: values by the names that may stand for them in a scene file.
const SETTINGS: &str = "x-settings";

/// Longest value that a difference shows in full.
const SHOWN: usize = 60;

/// First difference between a scene file and the scene of a trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneDifference {
    /// Key with its path, for example `motion.stroke_m`.
    pub key: String,
    /// Value in the scene file as JSON, or its default; `nothing` if there is neither.
    pub in_file: String,
    /// Value in the trace.
    pub in_trace: String,
}

/// Compares a scene file with the scene of a trace, by value: `10` equals `10.0`, and an absent key equals its default.
/// `None` if they are equal.
pub fn scene_difference(in_file: &Value, in_trace: &Value) -> Option<SceneDifference> {
    difference(Some(&SCHEMA), String::new(), Some(in_file), Some(in_trace))
}

/// Compares two values with this schema; `None` as a schema if it is unknown. The scene of a trace is the second one.
fn difference(
    schema: Option<&Value>,
    key: String,
    in_file: Option<&Value>,
    in_trace: Option<&Value>,
) -> Option<SceneDifference> {
    let meant =
        in_file.map(|value| schema.and_then(|schema| schema.get(SETTINGS)?.get(value.as_str()?)).unwrap_or(value));
    match (meant, in_trace) {
        (Some(Value::Object(in_file)), Some(Value::Object(in_trace))) => {
            let schema = schema.and_then(|schema| of_object(schema, in_file));
            difference_of_objects(schema, &key, in_file, in_trace)
        }
        (Some(Value::Array(in_file)), Some(Value::Array(in_trace))) if in_file.len() == in_trace.len() => {
            let items = schema.and_then(|schema| of_array(schema)?.get("items"));
            let mut pairs = in_file.iter().zip(in_trace).enumerate();
            pairs.find_map(|(index, (a, b))| difference(items, format!("{key}[{index}]"), Some(a), Some(b)))
        }
        (Some(Value::Number(a)), Some(Value::Number(b))) if a.as_f64() == b.as_f64() => None,
        (a, b) if a.unwrap_or(&Value::Null) == b.unwrap_or(&Value::Null) => None,
        (a, b) => Some(SceneDifference { key, in_file: shown(a), in_trace: shown(b) }),
    }
}

fn difference_of_objects(
    schema: Option<&Value>,
    key: &str,
    in_file: &Map<String, Value>,
    in_trace: &Map<String, Value>,
) -> Option<SceneDifference> {
    let added = in_trace.keys().filter(|name| !in_file.contains_key(*name));
    in_file.keys().chain(added).find_map(|name| {
        let (a, b) = (in_file.get(name), in_trace.get(name));
        let property = schema.and_then(|schema| schema.get("properties")?.get(name));
        if a.is_none() && property.is_none() {
            // A default of a shape or motion that the schema does not contain.
            return None;
        }
        let default = property.and_then(|property| property.get("default"));
        let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
        difference(property, key, a.or(default), b.or(default))
    })
}

/// Schema of an object: the alternative with its constants of which it lacks the fewest required keys. `None` if it is unknown.
fn of_object<'a>(schema: &'a Value, object: &Map<String, Value>) -> Option<&'a Value> {
    let has_constant = |(name, property): (&String, &Value)| match property.get("enum").and_then(Value::as_array) {
        Some(values) if values.len() == 1 => object.get(name).is_none_or(|found| *found == values[0]),
        _ => true,
    };
    let has_constants = |schema: &&Value| {
        let properties = schema.get("properties").and_then(Value::as_object);
        properties.is_some_and(|properties| properties.iter().all(has_constant))
    };
    let lacking = |schema: &&Value| {
        let required = schema.get("required").and_then(Value::as_array).into_iter().flatten();
        required.filter_map(Value::as_str).filter(|name| !object.contains_key(*name)).count()
    };
    alternatives(schema).into_iter().filter(has_constants).min_by_key(lacking)
}

/// Schema of a list.
fn of_array(schema: &Value) -> Option<&Value> {
    alternatives(schema).into_iter().find(|schema| schema.get("items").is_some())
}

/// Alternatives of a schema with references resolved: one if it has no others.
fn alternatives(schema: &Value) -> Vec<&Value> {
    let resolved = match schema.get("$ref").and_then(Value::as_str) {
        Some(reference) => SCHEMA.pointer(reference.trim_start_matches('#')).unwrap_or(schema),
        None => schema,
    };
    match resolved.get("anyOf").and_then(Value::as_array) {
        Some(several) => several.iter().flat_map(alternatives).collect(),
        None => vec![resolved],
    }
}

/// Value as short JSON.
fn shown(value: Option<&Value>) -> String {
    let text = value.map_or_else(|| "nothing".into(), Value::to_string);
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn scene() -> Value {
        json!({
            "format": 1, "name": "sweep", "role": "trial", "group": "sweep", "face": "left", "whisker": "straight",
            "object": {"shape": "circle", "radius_m": 0.01, "center_m": [0.0, 0.0], "yaw_rad": 0.0},
            "motion": {"kind": "smooth", "arc_min_m": 0.04, "arc_max_m": 0.06, "rotation_rad": 0.08, "frequency_max_hz": 1.4},
            "vibration": null, "seed": 0, "duration_s": 10.0, "rate_hz": 250.0, "simulation": {"timestep_s": 0.0005}
        })
    }

    /// Difference of a scene file that was changed at a pointer; `None` removes the key.
    fn changed(pointer: &str, key: &str, value: Option<Value>) -> Option<SceneDifference> {
        let mut file = scene();
        let parent = file.pointer_mut(pointer).and_then(Value::as_object_mut).expect("an object");
        match value {
            Some(value) => parent.insert(key.into(), value),
            None => parent.shift_remove(key),
        };
        scene_difference(&file, &scene())
    }

    #[test]
    fn verif_defaults_and_number_formats_are_no_difference() {
        assert_eq!(scene_difference(&scene(), &scene()), None);
        for key in ["vibration", "seed", "rate_hz", "simulation"] {
            assert_eq!(changed("", key, None), None, "{key}");
        }
        assert_eq!(changed("/object", "center_m", None), None);
        assert_eq!(changed("", "duration_s", Some(json!(10))), None);
        assert_eq!(changed("", "simulation", Some(json!("default"))), None);
    }

    #[test]
    fn robust_every_change_is_found_with_its_key_and_both_values() {
        for (pointer, key, value, expected) in [
            ("/motion", "arc_max_m", Some(json!(0.07)), ("motion.arc_max_m", "0.07", "0.06")),
            ("", "rate_hz", Some(json!(500)), ("rate_hz", "500", "250.0")),
            ("", "seed", Some(json!(3)), ("seed", "3", "0")),
            ("", "simulation", Some(json!("fast")), ("simulation.timestep_s", "0.001", "0.0005")),
            ("/object", "center_m", Some(json!([0.0, 0.1])), ("object.center_m[1]", "0.1", "0.0")),
            ("/object", "radius_m", None, ("object.radius_m", "nothing", "0.01")),
            (
                "",
                "vibration",
                Some(json!({"acceleration_m_s2": 0.5})),
                ("vibration", r#"{"acceleration_m_s2":0.5}"#, "null"),
            ),
        ] {
            let found = changed(pointer, key, value).expect(key);
            assert_eq!((found.key.as_str(), found.in_file.as_str(), found.in_trace.as_str()), expected);
        }
        // A key that was removed from the file: its default differs from the trace.
        let mut trace = scene();
        trace["rate_hz"] = json!(500.0);
        let mut file = scene();
        file.as_object_mut().expect("an object").shift_remove("rate_hz");
        let found = scene_difference(&file, &trace).expect("a difference");
        assert_eq!((found.in_file.as_str(), found.in_trace.as_str()), ("250.0", "500.0"));
    }
}
