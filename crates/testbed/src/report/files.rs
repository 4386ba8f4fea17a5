//! Writing files so that a file that exists is complete.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result};

/// Writes a file under a temporary name in the same folder, with the same extension, then renames it.
///
/// # Errors
/// When `write` fails or the file cannot be renamed; the error names `path`.
pub(super) fn replace(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = path.with_file_name(format!(".partial-{name}"));
    write(&temporary)
        .and_then(|()| Ok(fs::rename(&temporary, path)?))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

/// Removes a file, if it is there.
///
/// # Errors
/// When it is there and cannot be removed; the error names `path`.
pub(super) fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", path.display()))
        }
        _ => Ok(()),
    }
}
