//! Detection of lists that were read as objects.

use serde_json::Value;

/// Path (keys and indices) of the first list in `file` that was read as an object. serde assigns such a list to the
/// fields in declaration order. `read` is the parsed value, serialised again. `None` if there is no such list.
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
