//! A folder for the files that a target writes, one a thread.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = folder().expect("a temporary folder");
}

/// In memory where the system has such a place: a target is run a thousand times a second.
fn folder() -> io::Result<TempDir> {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir())
}

/// Writes a file into the folder; it may lie in folders within, which are made where missing.
pub(crate) fn file(name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = FOLDER.with(|folder| folder.path().join(name));
    if fs::write(&path, &bytes).is_err() {
        fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).expect("a folder");
        fs::write(&path, &bytes).expect("a file");
    }
    path
}

/// A file that stays as it is once it is there.
pub(crate) fn kept(name: &str, text: &str) {
    if !FOLDER.with(|folder| folder.path().join(name).is_file()) {
        file(name, text);
    }
}

/// Cuts bytes that stand for several files at the lines `%%%`; what is missing is empty.
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
