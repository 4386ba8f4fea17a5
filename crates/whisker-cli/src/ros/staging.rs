//! Recordings that appear under their names when they are complete.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use files::sha256_of_file;

/// Result of an export.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Export {
    /// The recording was written.
    Written,
    /// The recording existed with the same bytes.
    UpToDate,
}

/// SHA-256 of each file of a folder, by name.
fn digests(folder: &Path) -> anyhow::Result<BTreeMap<OsString, String>> {
    let context = || folder.display().to_string();
    let entries = fs::read_dir(folder).with_context(context)?;
    entries
        .map(|entry| {
            let entry = entry.with_context(context)?;
            Ok((entry.file_name(), sha256_of_file(&entry.path())?))
        })
        .collect()
}

/// Hidden folder beside a recording, in which it is written. An export that is repeated after a kill removes the
/// incomplete recording.
pub(super) struct Staging<'a> {
    folder: PathBuf,
    /// The recording in the hidden folder, under its own name.
    pub(super) recording: PathBuf,
    target: &'a Path,
}

impl<'a> Staging<'a> {
    pub(super) fn new(target: &'a Path) -> anyhow::Result<Self> {
        let name = target
            .file_name()
            .with_context(|| format!("{}: path: expected the name of a new folder", target.display()))?;
        let folder = target.with_file_name(format!(".{}.export", name.display()));
        let staging = Self { recording: folder.join(name), folder, target };
        staging.remove()?;
        Ok(staging)
    }

    /// Gives the complete recording its name, unless one with the same bytes has it already.
    pub(super) fn finish(self) -> anyhow::Result<Export> {
        let target = self.target;
        if !target.exists() {
            fs::rename(&self.recording, target).with_context(|| target.display().to_string())?;
            self.remove()?;
            return Ok(Export::Written);
        }
        let same = target.is_dir() && digests(target)? == digests(&self.recording)?;
        self.remove()?;
        ensure!(same, "{}: path: found another file or folder of that name: rename or remove it", target.display());
        Ok(Export::UpToDate)
    }

    fn remove(&self) -> anyhow::Result<()> {
        match fs::remove_dir_all(&self.folder) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(error).with_context(|| self.folder.display().to_string())
            }
            _ => Ok(()),
        }
    }
}
