//! Files that are restored from a recording and its attachments.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::ensure;
use bag::Attachment;
use files::{sha256, write_atomically};
use serde::Serialize;
use serde::de::DeserializeOwned;
use strict_json::parse_json;
use trace::is_plain_name;

/// Writes the files of a trace: its table, which must have this hash, further files, and its attached sidecar.
pub(super) fn restore(
    path: &Path,
    attachment: &Attachment,
    name: &str,
    (table, csv_sha256): (&str, &str),
    further: Vec<(String, &[u8])>,
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let found = sha256(table);
    ensure!(found == csv_sha256, "{}: messages: found a table of hash {found}, expected {csv_sha256}", path.display());
    let mut files = vec![(format!("{name}.csv"), table.as_bytes())];
    files.extend(further);
    // The sidecar is written last: it marks a complete trace.
    files.push((format!("{name}.json"), &attachment.data));
    files.iter().try_for_each(|(file, bytes)| check_replaces_same(&folder.join(file), bytes))?;
    let mut written = Vec::new();
    for (file, bytes) in files {
        let file = folder.join(file);
        write_atomically(&file, bytes)?;
        written.push(file);
    }
    Ok(written)
}

/// Checks the name of a trace, which becomes that of its files.
pub(super) fn check_name(path: &Path, attachment: &Attachment, name: &str) -> anyhow::Result<()> {
    let place = place_of(path, attachment);
    ensure!(is_plain_name(name), "{}: name: found `{name}`, expected a plain file name", place.display());
    Ok(())
}

/// Checks that a converted file replaces nothing but itself.
pub(super) fn check_replaces_same(file: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    ensure!(
        fs::read(file).map_or(true, |found| found.is_empty() || found == bytes),
        "{}: found a file with other contents, which the conversion would replace; give another --out, or remove it",
        file.display()
    );
    Ok(())
}

/// Text of an attachment.
pub(super) fn parsed<T: DeserializeOwned + Serialize>(path: &Path, attachment: &Attachment) -> Result<T, files::Error> {
    parse_json(&attachment.data).map_err(files::Error::json(&place_of(path, attachment)))
}

/// Name of an attachment in errors.
pub(super) fn place_of(path: &Path, attachment: &Attachment) -> PathBuf {
    format!("{}: attachment {}", path.display(), attachment.name).into()
}
