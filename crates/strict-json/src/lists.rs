//! Lists in the place of objects.

use serde_json::Value;

/// Where a list of a file was read as an object, whose values serde takes in the order of the fields: keys and places. `read` is what was made of `file`, written
/// again.
pub fn list_for_object(file: &Value, read: &Value) -> Option<String> {
    let place = found(file, read)?;
    Some(if place.is_empty() { "the whole".into() } else { place.trim_start_matches('.').into() })
}

fn found(file: &Value, read: &Value) -> Option<String> {
    match (file, read) {
        (Value::Array(_), Value::Object(_)) => Some(String::new()),
        (Value::Array(file), Value::Array(read)) => {
            let mut pairs = file.iter().zip(read).enumerate();
            pairs.find_map(|(place, (file, read))| Some(format!("[{place}]{}", found(file, read)?)))
        }
        (Value::Object(file), Value::Object(read)) => {
            let mut pairs = file.iter().filter_map(|(key, value)| Some((key, value, read.get(key)?)));
            pairs.find_map(|(key, file, read)| Some(format!(".{key}{}", found(file, read)?)))
        }
        _ => None,
    }
}
