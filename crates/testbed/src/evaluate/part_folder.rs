//! Folders that appear when they are whole.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use trace::{is_temporary, write_atomically};

use super::shards::Shards;

/// The folder in which a run is built. It takes the place of the run's folder when it is whole; until then that stays as it was. What an
/// interrupted evaluation left behind is gone on with where the inputs are the same, and cleared away where they are not.
pub(super) struct PartFolder<'a> {
    part: PathBuf,
    folder: &'a Path,
}

/// File with the hash of the inputs.
const INPUTS: &str = "inputs_sha256";

/// A hidden folder beside another.
fn beside(folder: &Path, what: &str) -> PathBuf {
    folder.with_file_name(format!(".{}.{what}", folder.file_name().unwrap_or_default().display()))
}

impl<'a> PartFolder<'a> {
    /// The folder beside `folder` for a run from inputs with this hash.
    ///
    /// # Errors
    /// If it cannot be made.
    pub(super) fn open(folder: &'a Path, inputs_sha256: &str) -> anyhow::Result<Self> {
        let part = beside(folder, "part");
        let old = beside(folder, "old");
        if old.exists() && !folder.exists() {
            // Killed between the two renames of `finish`: the old run is the one that counts.
            fs::rename(&old, folder).with_context(|| old.display().to_string())?;
        }
        let clear = |left: &Path| fs::remove_dir_all(left).with_context(|| left.display().to_string());
        if old.exists() {
            clear(&old)?;
        }
        let inputs = part.join(INPUTS);
        if fs::read(&inputs).ok().is_none_or(|known| known != inputs_sha256.as_bytes()) {
            if part.exists() {
                clear(&part)?;
            }
            write_atomically(&inputs, inputs_sha256.as_bytes())?;
        }
        Ok(Self { part, folder })
    }

    /// Where to write.
    pub(super) fn path(&self) -> &Path {
        &self.part
    }

    /// Puts the whole run in its place.
    ///
    /// # Errors
    /// If a folder cannot be moved.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        let context = || self.folder.display().to_string();
        clear_temporary(&self.part).with_context(context)?;
        let old = beside(self.folder, "old");
        if self.folder.exists() {
            fs::rename(self.folder, &old).with_context(context)?;
        }
        fs::rename(&self.part, self.folder).with_context(context)?;
        if old.exists() {
            fs::remove_dir_all(&old).with_context(context)?;
        }
        tidy(self.folder)
    }

    /// Clears away a run that is not worth keeping.
    ///
    /// # Errors
    /// If that cannot be done.
    pub(super) fn discard(self) -> anyhow::Result<()> {
        fs::remove_dir_all(&self.part).with_context(|| self.part.display().to_string())
    }
}

/// Removes from a whole run what was kept for going on. That comes last, so that a program killed before loses nothing; the next one tidies up.
///
/// # Errors
/// If it cannot be removed.
pub(super) fn tidy(folder: &Path) -> anyhow::Result<()> {
    Shards::remove(folder)?;
    let inputs = folder.join(INPUTS);
    if inputs.exists() {
        fs::remove_file(&inputs).with_context(|| inputs.display().to_string())?;
    }
    Ok(())
}

/// Removes what processes that were killed had begun to write.
fn clear_temporary(folder: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            clear_temporary(&path)?;
        } else if is_temporary(&path) {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}
