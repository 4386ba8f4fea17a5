//! Files of a folder, compared by their bytes.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::failure::Failure;

/// Contents of files by their paths in a folder.
pub(super) type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Page of a file system in memory, of which a file takes whole ones.
const PAGE: u64 = 4096;

/// Column of measured times, and the table that has it.
const MEASURED: (&str, &str) = ("summary.csv", "step_ns");

/// Reads every file of a folder and its subfolders.
///
/// # Errors
/// If a folder or file cannot be read.
pub(super) fn read(folder: &Path) -> Result<Files, Failure> {
    let mut files = Files::new();
    collect(folder, folder, &mut files).map_err(|error| failed(folder, &error))?;
    Ok(files)
}

fn collect(root: &Path, folder: &Path, files: &mut Files) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(root, &path, files)?;
        } else {
            files.insert(path.strip_prefix(root).unwrap_or(&path).into(), fs::read(&path)?);
        }
    }
    Ok(())
}

/// Writes files into a folder, which is created.
///
/// # Errors
/// If a file cannot be written.
pub(super) fn write(files: &Files, folder: &Path) -> Result<(), Failure> {
    let write = || {
        fs::create_dir_all(folder)?;
        for (path, bytes) in files {
            let path = folder.join(path);
            fs::create_dir_all(path.parent().unwrap_or(folder))?;
            fs::write(path, bytes)?;
        }
        Ok(())
    };
    write().map_err(|error| failed(folder, &error))
}

/// Space that files take on a file system in memory, in bytes.
pub(super) fn size(files: &Files) -> u64 {
    files.values().map(|bytes| (bytes.len() as u64).div_ceil(PAGE) * PAGE).sum()
}

/// First difference between the files of two folders, apart from measured times.
pub(super) fn difference(found: &Files, expected: &Files) -> Option<String> {
    if let Some(path) = found.keys().find(|path| !expected.contains_key(*path)) {
        return Some(format!("{}: expected no such file", path.display()));
    }
    expected.iter().find_map(|(path, bytes)| match found.get(path) {
        None => Some(format!("{}: is missing", path.display())),
        Some(found) if comparable(path, found) != comparable(path, bytes) => {
            Some(format!("{}: differs", path.display()))
        }
        Some(_) => None,
    })
}

/// Bytes of a file without measured times.
fn comparable(path: &Path, bytes: &[u8]) -> Vec<u8> {
    let (table, column) = MEASURED;
    if path.file_name().is_none_or(|name| name != table) {
        return bytes.into();
    }
    let text = String::from_utf8_lossy(bytes);
    let place = text.lines().next().and_then(|header| header.split(',').position(|name| name == column));
    let without = |line: &str| {
        let fields = line.split(',').enumerate().filter(|(index, _)| Some(*index) != place);
        fields.map(|(_, field)| field).collect::<Vec<_>>().join(",")
    };
    text.lines().map(without).collect::<Vec<_>>().join("\n").into_bytes()
}

/// Failure of a file operation.
pub(super) fn failed(path: &Path, error: &io::Error) -> Failure {
    Failure::new(format!("{}: {error}", path.display()))
}
