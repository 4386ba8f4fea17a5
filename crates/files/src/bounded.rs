//! Whole files of bounded size.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::Error;

/// Longest JSON file that is read.
pub(crate) const MOST_JSON_BYTES: u64 = 1 << 26;

/// Longest table that is read whole.
const MOST_TABLE_BYTES: u64 = 1 << 30;

/// The bytes of a table that is read whole.
///
/// # Errors
/// [`Error`] names the file.
pub fn read_table(path: &Path) -> Result<Vec<u8>, Error> {
    read_at_most(path, MOST_TABLE_BYTES)
}

/// A whole file. What is longer is refused before memory runs out: a link in a strange folder may lead to a device that never ends.
pub(crate) fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let mut read = || File::open(path)?.take(most + 1).read_to_end(&mut bytes);
    let length = read().map_err(Error::io(path))? as u64;
    if length > most {
        return Err(Error::value(path, "size", format!("more than {most} bytes"), "a smaller file"));
    }
    Ok(bytes)
}
