//! Reading and writing of JSON files.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use strict_json::parse_json;

use crate::bounded::{MOST_JSON_BYTES, read_at_most};
use crate::{Error, write_atomically};

/// Reads a JSON file into a typed value.
///
/// # Errors
/// [`Error::Io`] or [`Error::Json`], with line and column.
pub fn read_json<T: DeserializeOwned + Serialize>(path: &Path) -> Result<T, Error> {
    let bytes = read_at_most(path, MOST_JSON_BYTES)?;
    parse_json(&bytes).map_err(Error::json(path))
}

/// Whether a JSON file states this `kind`.
pub fn is_of_kind(path: &Path, kind: &str) -> bool {
    read_json::<Value>(path).is_ok_and(|value| value["kind"] == kind)
}

/// Writes a value as JSON with two spaces of indentation and a newline at the end, atomically.
///
/// # Errors
/// [`Error::Io`] with the path.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut bytes = serde_json::to_vec_pretty(value).map_err(Error::json(path))?;
    bytes.push(b'\n');
    write_atomically(path, &bytes)
}
