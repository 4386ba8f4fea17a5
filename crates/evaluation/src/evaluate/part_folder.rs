//! Folders that are written under a temporary name and renamed when they are complete.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use files::remove_temporary;
use testbed::results::files::RUN_FILES;
use testbed::space::files::SPATIAL_RUN_FILES;

use super::shards::Shards;

/// Folder in which a run is built, named after the hash of its inputs. It replaces the run's folder when it is
/// complete; until then that folder is unchanged. Files of the user in that folder, such as notes, are kept. Items that
/// are finished in it are reused, whether an interrupted evaluation or a concurrent process wrote them.
pub(crate) struct PartFolder<'a> {
    part: PathBuf,
    folder: &'a Path,
}

/// Suffix of the names of such folders.
const PART: &str = ".part";
/// Number of digits of the hash before the suffix.
const DIGITS: usize = 16;
/// Suffix of a run while another replaces it.
const OLD: &str = "old";

/// Hidden folder beside another.
fn beside(folder: &Path, what: &str) -> PathBuf {
    folder.with_file_name(format!(".{}.{what}", folder.file_name().unwrap_or_default().display()))
}

impl<'a> PartFolder<'a> {
    /// Opens the folder beside `folder` for a run from inputs with this hash. Several processes may open it at once;
    /// nothing is removed.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub(crate) fn open(folder: &'a Path, inputs_sha256: &str) -> anyhow::Result<Self> {
        let part = Self::place(folder, inputs_sha256);
        fs::create_dir_all(&part).with_context(|| part.display().to_string())?;
        Ok(Self { part, folder })
    }

    /// Path of the folder beside `folder` for a run from inputs with this hash, whether or not it exists.
    pub(crate) fn place(folder: &Path, inputs_sha256: &str) -> PathBuf {
        beside(folder, &format!("{}{PART}", &inputs_sha256[..DIGITS]))
    }

    /// Path of the folder.
    pub(crate) fn path(&self) -> &Path {
        &self.part
    }

    /// Replaces the run's folder by the complete run.
    ///
    /// # Errors
    /// If a folder cannot be moved.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        let context = || self.folder.display().to_string();
        clear_temporary(&self.part).with_context(context)?;
        if self.folder.exists() {
            restore(self.folder)?;
            fs::rename(self.folder, beside(self.folder, OLD)).with_context(context)?;
        }
        fs::rename(&self.part, self.folder).with_context(context)?;
        tidy(self.folder)
    }

    /// Removes the folder.
    ///
    /// # Errors
    /// If it cannot be removed.
    pub(crate) fn discard(self) -> anyhow::Result<()> {
        remove(&self.part)
    }
}

/// Completes the replacement of a run if a process was killed in [`PartFolder::finish`]: without the new run, the old one is
/// restored; otherwise its files of the user are moved into the new one, and it is removed.
///
/// # Errors
/// If a file or folder cannot be moved or removed.
pub(crate) fn restore(folder: &Path) -> anyhow::Result<()> {
    let old = beside(folder, OLD);
    if !old.is_dir() {
        return Ok(());
    }
    let context = || old.display().to_string();
    if !folder.exists() {
        return fs::rename(&old, folder).with_context(context);
    }
    Shards::remove(&old)?;
    clear_temporary(&old).with_context(context)?;
    keep_other_files(&old, folder, "")?;
    remove(&old)
}

/// Removes the shards of a complete run, the run that it replaced except for files of the user, which become files of
/// the complete run, and unfinished runs of the same name beside it. It is called last: if the process is killed
/// before, no result is lost, and the next evaluation removes them.
///
/// # Errors
/// If a file or folder cannot be moved or removed.
pub(crate) fn tidy(folder: &Path) -> anyhow::Result<()> {
    Shards::remove(folder)?;
    restore(folder)?;
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

/// Moves files that no command wrote from a folder of a replaced run to the same place in the run that replaces it. `below`
/// is the path of the folder in the run: empty, or with a slash at its end.
fn keep_other_files(old: &Path, run: &Path, below: &str) -> anyhow::Result<()> {
    let (from, to) = (old.join(below), run.join(below));
    for entry in fs::read_dir(&from).with_context(|| from.display().to_string())? {
        let entry = entry.with_context(|| from.display().to_string())?;
        let (name, path) = (entry.file_name(), entry.path());
        // Names of a run's files are text.
        let in_run = name.to_str().map(|name| format!("{below}{name}"));
        let inside = in_run.as_ref().map(|path| format!("{path}/"));
        let files = || RUN_FILES.iter().chain(SPATIAL_RUN_FILES);
        if in_run.is_some_and(|path| files().any(|file| file.is_at(&path))) {
            continue;
        }
        match inside.filter(|inside| files().any(|file| file.may_be_in(inside))) {
            // What a link stands for is not in the run, and stays.
            Some(_) if path.is_symlink() => {}
            Some(inside) if path.is_dir() => keep_other_files(old, run, &inside)?,
            _ => {
                let kept = to.join(name);
                ensure!(
                    !kept.exists(),
                    "{}: found a file, expected none, so that {} can be moved there; move one of them elsewhere",
                    kept.display(),
                    path.display()
                );
                fs::create_dir_all(&to)
                    .and_then(|()| fs::rename(&path, &kept))
                    .with_context(|| path.display().to_string())?;
            }
        }
    }
    Ok(())
}

/// Removes a folder, its shards first, so that a partly removed folder does not count as finished work.
fn remove(folder: &Path) -> anyhow::Result<()> {
    Shards::remove(folder)?;
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    Ok(())
}

/// Removes temporary files of killed processes from a folder and its subfolders.
fn clear_temporary(folder: &Path) -> std::io::Result<()> {
    remove_temporary(folder)?;
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            clear_temporary(&path)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HASHES: [&str; 2] = ["0123456789abcdef01", "fedcba9876543210fe"];

    #[test]
    fn robust_a_folder_opened_by_two_processes_keeps_finished_items() {
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
    fn robust_tidying_keeps_the_folders_of_other_runs() {
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
    fn robust_files_of_the_user_stay_when_a_run_is_replaced() {
        let results = tempfile::tempdir().unwrap();
        let folder = results.path().join("run");
        let (kept, replaced) = (
            ["notes.txt", "estimates/notes.txt", "mine/trials.csv"],
            ["trials.csv", "figures/a.svg", "figures/all/a_1.svg"],
        );
        for path in kept.iter().chain(&replaced).map(|name| folder.join(name)) {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "old").unwrap();
        }
        let part = PartFolder::open(&folder, HASHES[0]).unwrap();
        fs::create_dir(part.path().join("estimates")).unwrap();
        part.finish().unwrap();
        assert!(kept.iter().all(|name| folder.join(name).is_file()), "a file of the user is lost");
        assert!(replaced.iter().all(|name| !folder.join(name).exists()), "a file of the former run stays");
        assert_eq!(fs::read_dir(results.path()).unwrap().count(), 1);
    }

    #[test]
    fn robust_files_of_the_user_survive_a_kill_before_they_are_moved() {
        let results = tempfile::tempdir().unwrap();
        let folder = results.path().join("run");
        let old = beside(&folder, OLD);
        for path in [folder.join("trials.csv"), old.join("trials.csv"), old.join("notes.txt")] {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        PartFolder::open(&folder, HASHES[0]).unwrap().finish().unwrap();
        assert!(folder.join("notes.txt").is_file() && !folder.join("trials.csv").exists());
        assert_eq!(fs::read_dir(results.path()).unwrap().count(), 1);
    }

    #[test]
    fn robust_a_run_survives_a_kill_between_the_renames() {
        let results = tempfile::tempdir().unwrap();
        let folder = results.path().join("run");
        PartFolder::open(&folder, HASHES[0]).unwrap().finish().unwrap();
        fs::rename(&folder, beside(&folder, OLD)).unwrap();
        restore(&folder).unwrap();
        assert!(folder.is_dir() && !beside(&folder, OLD).exists());
    }
}
