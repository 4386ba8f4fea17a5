//! Folders that appear when they are whole.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

/// The folder in which a run is built. It takes the place of the run's folder when it is whole; until then that stays as it was. What an
/// interrupted evaluation left behind is cleared away by the next.
pub(super) struct PartFolder<'a> {
    part: tempfile::TempDir,
    folder: &'a Path,
}

/// A hidden folder beside another.
fn beside(folder: &Path, what: &str) -> PathBuf {
    folder.with_file_name(format!(".{}.{what}", folder.file_name().unwrap_or_default().display()))
}

impl<'a> PartFolder<'a> {
    /// An empty folder beside `folder`.
    ///
    /// # Errors
    /// If it cannot be made.
    pub(super) fn new(folder: &'a Path) -> anyhow::Result<Self> {
        let part = beside(folder, "part");
        let context = || part.display().to_string();
        let old = beside(folder, "old");
        if old.exists() && !folder.exists() {
            // Killed between the two renames of `finish`: the old run is the one that counts.
            fs::rename(&old, folder).with_context(|| old.display().to_string())?;
        }
        for left in [&part, &old] {
            if left.exists() {
                fs::remove_dir_all(left).with_context(|| left.display().to_string())?;
            }
        }
        let results = folder.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(results).with_context(context)?;
        let name = part.file_name().unwrap_or_default();
        let part = tempfile::Builder::new().prefix(name).rand_bytes(0).tempdir_in(results).with_context(context)?;
        Ok(Self { part, folder })
    }

    /// Where to write.
    pub(super) fn path(&self) -> &Path {
        self.part.path()
    }

    /// Puts the whole run in its place.
    ///
    /// # Errors
    /// If a folder cannot be moved.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        let context = || self.folder.display().to_string();
        // Temporary folders are private; results are to be read by others.
        #[cfg(unix)]
        fs::set_permissions(self.path(), std::os::unix::fs::PermissionsExt::from_mode(0o755)).with_context(context)?;
        let old = beside(self.folder, "old");
        if self.folder.exists() {
            fs::rename(self.folder, &old).with_context(context)?;
        }
        fs::rename(self.part.keep(), self.folder).with_context(context)?;
        if old.exists() {
            fs::remove_dir_all(&old).with_context(context)?;
        }
        Ok(())
    }
}
