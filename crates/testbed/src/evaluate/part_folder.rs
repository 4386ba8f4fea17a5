//! Folders that appear when they are whole.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use files::is_temporary;

use super::shards::Shards;

/// The folder in which a run is built, named after the hash of its inputs. It takes the place of the run's folder when it is whole; until then that stays as it
/// was. What is finished in it is gone on with, whether an interrupted evaluation left it or another process is just doing it.
pub(super) struct PartFolder<'a> {
    part: PathBuf,
    folder: &'a Path,
}

/// How the names of such folders end, after so many digits of the hash.
const PART: &str = ".part";
const DIGITS: usize = 16;
/// What a run is called while another takes its place.
const OLD: &str = "old";

/// A hidden folder beside another.
fn beside(folder: &Path, what: &str) -> PathBuf {
    folder.with_file_name(format!(".{}.{what}", folder.file_name().unwrap_or_default().display()))
}

impl<'a> PartFolder<'a> {
    /// The folder beside `folder` for a run from inputs with this hash. Several processes may open it at once: nothing is cleared away.
    ///
    /// # Errors
    /// If it cannot be made.
    pub(super) fn open(folder: &'a Path, inputs_sha256: &str) -> anyhow::Result<Self> {
        let part = beside(folder, &format!("{}{PART}", &inputs_sha256[..DIGITS]));
        fs::create_dir_all(&part).with_context(|| part.display().to_string())?;
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
        if self.folder.exists() {
            let old = beside(self.folder, OLD);
            remove(&old)?;
            fs::rename(self.folder, &old).with_context(context)?;
        }
        fs::rename(&self.part, self.folder).with_context(context)?;
        tidy(self.folder)
    }

    /// Clears away a run that is not worth keeping.
    ///
    /// # Errors
    /// If that cannot be done.
    pub(super) fn discard(self) -> anyhow::Result<()> {
        remove(&self.part)
    }
}

/// Puts the old run back where a program was killed between the two renames of [`PartFolder::finish`]: it is the one that counts.
///
/// # Errors
/// If it cannot be moved.
pub(super) fn restore(folder: &Path) -> anyhow::Result<()> {
    let old = beside(folder, OLD);
    if old.exists() && !folder.exists() {
        fs::rename(&old, folder).with_context(|| old.display().to_string())?;
    }
    Ok(())
}

/// Removes what was kept for going on from a whole run, and what others left beside it: the old run, and what was begun from other inputs or by processes that
/// nobody waited for. That comes last, so that a program killed before loses nothing; the next one tidies up.
///
/// # Errors
/// If it cannot be removed.
pub(super) fn tidy(folder: &Path) -> anyhow::Result<()> {
    Shards::remove(folder)?;
    remove(&beside(folder, OLD))?;
    let begins = format!("{}", beside(folder, "").file_name().unwrap_or_default().display());
    let results = folder.parent().filter(|results| !results.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let context = || results.display().to_string();
    for entry in fs::read_dir(results).with_context(context)? {
        let entry = entry.with_context(context)?;
        let name = entry.file_name().into_string().unwrap_or_default();
        let hash = name.strip_prefix(&begins).and_then(|rest| rest.strip_suffix(PART));
        if hash.is_some_and(|hash| hash.len() == DIGITS && hash.bytes().all(|digit| digit.is_ascii_hexdigit())) {
            remove(&entry.path())?;
        }
    }
    Ok(())
}

/// Removes a folder: its shards first, so that what somebody leaves who is killed here does not pass for finished.
fn remove(folder: &Path) -> anyhow::Result<()> {
    Shards::remove(folder)?;
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
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

#[cfg(test)]
mod tests {
    use super::*;

    const HASHES: [&str; 2] = ["0123456789abcdef01", "fedcba9876543210fe"];

    #[test]
    fn robust_a_folder_that_another_process_opens_too_keeps_what_is_finished() {
        let results = tempfile::tempdir().unwrap();
        let folder = results.path().join("run");
        let part = PartFolder::open(&folder, HASHES[0]).unwrap();
        fs::write(part.path().join("1"), "finished").unwrap();
        let same = PartFolder::open(&folder, HASHES[0]).unwrap();
        PartFolder::open(&folder, HASHES[1]).unwrap();
        assert!(same.path().join("1").is_file());
        same.finish().unwrap();
        assert!(folder.join("1").is_file());
        assert_eq!(fs::read_dir(results.path()).unwrap().count(), 1, "only the run stays");
    }

    #[test]
    fn robust_what_belongs_to_another_run_is_not_tidied_away() {
        let results = tempfile::tempdir().unwrap();
        let others = [
            ".run.b.0123456789abcdef.part",
            ".run.0123.part",
            ".run.0123456789abcdef.old",
            "run.0123456789abcdef.part",
        ];
        others.iter().for_each(|other| fs::create_dir(results.path().join(other)).unwrap());
        let folder = results.path().join("run");
        PartFolder::open(&folder, HASHES[0]).unwrap().finish().unwrap();
        assert!(others.iter().all(|other| results.path().join(other).is_dir()));
    }

    #[test]
    fn robust_killed_while_a_run_takes_the_place_of_another() {
        let results = tempfile::tempdir().unwrap();
        let folder = results.path().join("run");
        PartFolder::open(&folder, HASHES[0]).unwrap().finish().unwrap();
        fs::rename(&folder, beside(&folder, OLD)).unwrap();
        restore(&folder).unwrap();
        assert!(folder.is_dir() && !beside(&folder, OLD).exists());
    }
}
