//! Atomic writing of files.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempDir};

use crate::Error;

/// File written under a temporary name in its folder and renamed on completion, so that a reader sees either the whole
/// file or none. The folder is created if missing.
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<NamedTempFile>,
    path: PathBuf,
}

impl AtomicFile {
    /// Creates the temporary file.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let create = || {
            fs::create_dir_all(folder)?;
            let mut builder = tempfile::Builder::new();
            let prefix = prefix(path);
            builder.prefix(&prefix).rand_bytes(RANDOM).suffix(SUFFIX);
            // Temporary files are private by default; results are created with the permissions that the umask allows.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            builder.tempfile_in(folder)
        };
        let file = create().map_err(Error::io(path))?;
        Ok(Self { file: BufWriter::new(file), path: path.into() })
    }

    /// Flushes the file to disk and renames it to its final name.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn finish(self) -> Result<(), Error> {
        self.put(true)
    }

    /// Renames the file to its final name without a sync to disk: for reproducible files whose completeness is checked
    /// elsewhere.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn finish_fast(self) -> Result<(), Error> {
        self.put(false)
    }

    fn put(self, waits: bool) -> Result<(), Error> {
        let put = || {
            let file = self.file.into_inner()?;
            if waits {
                file.as_file().sync_all()?;
            }
            file.persist(&self.path)?;
            Ok(())
        };
        put().map_err(Error::io(&self.path))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Files of a folder that are replaced together: they are written into a temporary subfolder, and moved once all of them are
/// complete.
#[derive(Debug)]
pub struct StagedFiles {
    folder: PathBuf,
    staged: TempDir,
}

impl StagedFiles {
    /// Creates the folder, if it is not there, and the temporary subfolder.
    ///
    /// # Errors
    /// [`Error::Io`] with the path of the folder.
    pub fn create(folder: &Path) -> Result<Self, Error> {
        let create = || {
            fs::create_dir_all(folder)?;
            tempfile::Builder::new().prefix(".staged.").rand_bytes(RANDOM).suffix(SUFFIX).tempdir_in(folder)
        };
        Ok(Self { staged: create().map_err(Error::io(folder))?, folder: folder.into() })
    }

    /// The temporary subfolder, which is removed with all its files unless they are moved.
    pub fn folder(&self) -> &Path {
        self.staged.path()
    }

    /// Moves the files in the order of their names, CSV files before JSON files of the same name, which mark them as complete.
    ///
    /// # Errors
    /// [`Error::Io`] with the path of the file that cannot be moved. Those before it have been moved.
    pub fn finish(self) -> Result<(), Error> {
        let names = || {
            let entries = fs::read_dir(self.folder())?;
            entries.map(|entry| Ok(entry?.file_name())).collect::<io::Result<Vec<_>>>()
        };
        let mut names = names().map_err(Error::io(&self.folder))?;
        // `csv` is before `json`, and an outline, `<name>.contour.csv`, before both.
        names.sort();
        for name in &names {
            let path = self.folder.join(name);
            fs::rename(self.folder().join(name), &path).map_err(Error::io(&path))?;
        }
        Ok(())
    }
}

/// Suffix of temporary names.
const SUFFIX: &str = ".part";

/// Number of random letters and digits before the suffix.
const RANDOM: usize = 6;

/// Longest file name in bytes on common file systems.
const LONGEST_NAME: usize = 255;

/// First part of the temporary names of a file: `.<name>.`, shortened if the temporary name would be too long.
fn prefix(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let most = LONGEST_NAME - 2 - RANDOM - SUFFIX.len();
    let end = (0..=name.len().min(most)).rev().find(|&end| name.is_char_boundary(end)).unwrap_or_default();
    format!(".{}.", &name[..end])
}

/// Whether a path has a temporary name. Unless a writer is active, such a file was left by a process that was killed.
fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let random = name.strip_prefix('.').and_then(|rest| rest.strip_suffix(SUFFIX)?.rsplit('.').next());
    random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// Removes the temporary files of an output that killed processes left: of a file those with its name, of a folder those in it.
pub(crate) fn remove_unfinished(output: &Path) -> io::Result<()> {
    if output.is_dir() {
        return remove_temporary(output);
    }
    let prefix = prefix(output);
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    remove_if(folder, |path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.strip_prefix(&prefix).is_some_and(|rest| rest.len() == RANDOM + SUFFIX.len())
    })
}

/// Removes the temporary files and folders that killed processes left in a folder, not in its subfolders.
///
/// # Errors
/// If the folder cannot be read or a file cannot be removed.
pub fn remove_temporary(folder: &Path) -> io::Result<()> {
    remove_if(folder, |_| true)
}

/// Removes the temporary files and folders in a folder that meet a condition.
fn remove_if(folder: &Path, condition: impl Fn(&Path) -> bool) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if is_temporary(&path) && condition(&path) {
            if path.is_dir() { fs::remove_dir_all(path)? } else { fs::remove_file(path)? }
        }
    }
    Ok(())
}

/// Writes a whole file atomically, see [`AtomicFile`].
///
/// # Errors
/// [`Error::Io`] with the path.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(Error::io(path))?;
    file.finish()
}
/// Checks that an output does not replace a file of another kind: there is no file of this name, or an empty one, or `is_own`
/// holds of it.
///
/// # Errors
/// [`Error::Foreign`] if there is another file.
pub fn check_replaces_own(out: &Path, kind: &str, is_own: impl FnOnce(&Path) -> bool) -> Result<(), Error> {
    match fs::metadata(out) {
        Ok(found) if !found.is_file() || (found.len() > 0 && !is_own(out)) => {
            Err(Error::Foreign { path: out.into(), kind: kind.into() })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_staged_files_are_moved_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let entries = || fs::read_dir(folder.path()).unwrap().count();
        fs::write(at("a.csv"), "old").unwrap();
        let staged = StagedFiles::create(folder.path()).unwrap();
        fs::write(staged.folder().join("a.csv"), "new").unwrap();
        drop(staged);
        assert_eq!((fs::read_to_string(at("a.csv")).unwrap().as_str(), entries()), ("old", 1));
        let staged = StagedFiles::create(folder.path()).unwrap();
        for name in ["a.csv", "a.json"] {
            fs::write(staged.folder().join(name), "new").unwrap();
        }
        staged.finish().unwrap();
        assert!(["a.csv", "a.json"].iter().all(|name| fs::read_to_string(at(name)).unwrap() == "new"));
        assert_eq!(entries(), 2);
        // A process that was killed leaves its folder.
        let left = at(".staged.a1B2c3.part");
        fs::create_dir(&left).unwrap();
        fs::write(left.join("b.csv"), "").unwrap();
        remove_temporary(folder.path()).unwrap();
        assert_eq!(entries(), 2);
    }
}
