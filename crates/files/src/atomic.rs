//! Atomic writing of files.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

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
            builder.prefix(TEMPORARY.0).suffix(TEMPORARY.1);
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

/// Prefix and suffix of temporary names.
const TEMPORARY: (&str, &str) = (".", ".part");

/// Whether a path has a temporary name. Unless a writer is active, such a file was left by a process that was killed.
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with(TEMPORARY.0) && name.ends_with(TEMPORARY.1)
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
