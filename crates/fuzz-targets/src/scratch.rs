//! Temporary folder for the files of a target, one per thread.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = folder().expect("a temporary folder");
}

/// In shared memory if available, since a target runs thousands of times per second.
fn folder() -> io::Result<TempDir> {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir())
}

/// Writes a file into the folder and creates missing subfolders.
pub(crate) fn file(name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = FOLDER.with(|folder| folder.path().join(name));
    if fs::write(&path, &bytes).is_err() {
        fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).expect("a folder");
        fs::write(&path, &bytes).expect("a file");
    }
    path
}

/// Writes a file unless it exists.
pub(crate) fn kept(name: &str, text: &str) {
    if !FOLDER.with(|folder| folder.path().join(name).is_file()) {
        file(name, text);
    }
}

/// Splits the bytes of several files at lines `%%%`; missing files are empty.
pub(crate) fn parts<const N: usize>(bytes: &[u8]) -> [&[u8]; N] {
    const CUT: &[u8] = b"\n%%%\n";
    let mut rest = bytes;
    std::array::from_fn(|part| {
        let cut = (part + 1 < N).then(|| rest.windows(CUT.len()).position(|window| window == CUT)).flatten();
        let (own, after) = cut.map_or((rest, &[][..]), |at| (&rest[..at], &rest[at + CUT.len()..]));
        rest = after;
        own
    })
}
