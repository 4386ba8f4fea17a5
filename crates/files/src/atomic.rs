//! Files that appear whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::Error;

/// A file that is written under a temporary name in its folder, which is made where missing, and renamed when it is finished: the file is there
/// whole or not at all.
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<NamedTempFile>,
    path: PathBuf,
}

impl AtomicFile {
    /// Begins the file.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let create = || {
            fs::create_dir_all(folder)?;
            let mut builder = tempfile::Builder::new();
            builder.prefix(TEMPORARY.0).suffix(TEMPORARY.1);
            // Temporary files are private; results are to be read by others, as far as the file mode mask allows.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            builder.tempfile_in(folder)
        };
        let file = create().map_err(Error::io(path))?;
        Ok(Self { file: BufWriter::new(file), path: path.into() })
    }

    /// Puts the whole file in its place, once all of it has reached the disk.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn finish(self) -> Result<(), Error> {
        self.put(true)
    }

    /// Puts the whole file in its place without waiting for the disk: for what can be made again, and is known to be whole by something else.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
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

/// How temporary names begin and end.
const TEMPORARY: (&str, &str) = (".", ".part");

/// Whether a file bears a temporary name: where nobody is writing, it was left behind by a program that was killed.
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with(TEMPORARY.0) && name.ends_with(TEMPORARY.1)
}

/// Writes a whole file, see [`AtomicFile`].
///
/// # Errors
/// [`Error::Io`] names the file.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(Error::io(path))?;
    file.finish()
}
