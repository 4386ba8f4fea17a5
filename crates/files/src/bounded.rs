//! Reading of whole files with a size limit.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::Error;

/// Largest JSON file that is read, in bytes.
pub(crate) const MOST_JSON_BYTES: u64 = 1 << 26;

/// Largest table that is read whole, in bytes.
const MOST_TABLE_BYTES: u64 = 1 << 30;

/// Reads the bytes of a table of at most 2^30 bytes.
///
/// # Errors
/// [`Error`] with the path.
pub fn read_table(path: &Path) -> Result<Vec<u8>, Error> {
    read_at_most(path, MOST_TABLE_BYTES)
}

/// Reads a file of at most `most` bytes. The limit bounds memory when a link in an untrusted folder leads to an endless
/// device.
pub(crate) fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let mut read = || File::open(path)?.take(most + 1).read_to_end(&mut bytes);
    let length = read().map_err(Error::io(path))? as u64;
    if length > most {
        return Err(Error::value(path, "size", format!("more than {most} bytes"), "a smaller file"));
    }
    Ok(bytes)
}
