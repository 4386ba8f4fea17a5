//! Exclusive access of one process to an output.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::process;

use crate::Error;
use crate::atomic::remove_unfinished;

/// Exclusive access to a file or folder that is to be written, until it is dropped.
///
/// A lock of the operating system on the hidden file `.<name>.lock` beside the output. The operating system releases it
/// when the process ends, even by a kill. On a file system without locks, or in a folder that may not be written, there
/// is no exclusion.
#[derive(Debug)]
pub struct OutputLock {
    /// The locked file and its path. `None` without exclusion.
    file: Option<(File, PathBuf)>,
}

impl OutputLock {
    /// Waits for exclusive access to an output, and removes the temporary files that killed processes left of it. If
    /// another process has the access, `on_wait` is called with the description of that process before the wait.
    ///
    /// # Errors
    /// [`Error::Io`] with the path of the output.
    pub fn take(output: &Path, on_wait: impl FnOnce(&str)) -> Result<Self, Error> {
        let path = beside(output).map_err(Error::io(output))?;
        let mut on_wait = Some(on_wait);
        loop {
            let opened = open(&path).and_then(|file| locked(file, &path, &mut on_wait));
            let file = match opened {
                Err(error) if is_unavailable(&error) => return Ok(Self { file: None }),
                opened => opened.map_err(Error::io(output))?,
            };
            // The previous holder removes the file: a lock on a removed file excludes nobody.
            if is_at(&file, &path) {
                describe(&file).map_err(Error::io(output))?;
                remove_unfinished(output).map_err(Error::io(output))?;
                return Ok(Self { file: Some((file, path)) });
            }
        }
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        if let Some((_, path)) = &self.file {
            // Removed while the lock is held. If that fails, the file remains without a lock, which is harmless.
            _ = fs::remove_file(path);
        }
    }
}

/// Path of the lock file of an output, the same for every path that leads to it.
fn beside(output: &Path) -> io::Result<PathBuf> {
    let output = resolved(output)?;
    Ok(output.with_file_name(format!(".{}.lock", output.file_name().unwrap_or_default().display())))
}

/// Absolute path without symbolic links and `..`. The last components need not exist.
///
/// # Errors
/// If the working directory is unknown or a folder may not be read.
pub fn resolved(path: &Path) -> io::Result<PathBuf> {
    let mut resolved = PathBuf::new();
    for component in std::path::absolute(path)?.components() {
        match component {
            Component::ParentDir => _ = resolved.pop(),
            component => resolved.push(component),
        }
        match resolved.canonicalize() {
            Ok(path) => resolved = path,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    Ok(resolved)
}

fn open(path: &Path) -> io::Result<File> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    File::options().read(true).write(true).create(true).truncate(false).open(path)
}

/// Locks the file, after a wait if another process holds the lock.
fn locked(file: File, path: &Path, on_wait: &mut Option<impl FnOnce(&str)>) -> io::Result<File> {
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::Error(error)) => return Err(error),
        Err(TryLockError::WouldBlock) => {
            if let Some(on_wait) = on_wait.take() {
                on_wait(&holder(path));
            }
            file.lock()?;
        }
    }
    Ok(file)
}

/// Whether exclusion is impossible: the file system has no locks or the folder may not be written.
fn is_unavailable(error: &io::Error) -> bool {
    use io::ErrorKind::{PermissionDenied, ReadOnlyFilesystem, Unsupported};
    // ENOLCK: a network file system without a lock server.
    const NO_LOCKS: i32 = 37;
    matches!(error.kind(), PermissionDenied | ReadOnlyFilesystem | Unsupported)
        || (cfg!(target_os = "linux") && error.raw_os_error() == Some(NO_LOCKS))
}

/// Whether a file is still the one at its path.
fn is_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let id = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
        matches!((file.metadata().map(id), fs::metadata(path).map(id)), (Ok(a), Ok(b)) if a == b)
    }
    #[cfg(not(unix))]
    {
        _ = file;
        path.exists()
    }
}

/// Writes this process and its machine into the lock file.
fn describe(mut file: &File) -> io::Result<()> {
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let on_host = if host.trim().is_empty() { String::new() } else { format!(" on {}", host.trim()) };
    file.set_len(0)?;
    file.write_all(format!("process {}{on_host}\n", process::id()).as_bytes())
}

/// Description of the process that holds a lock, from the lock file.
fn holder(path: &Path) -> String {
    const LONGEST: u64 = 200;
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(LONGEST).read_to_string(&mut text));
    if read.is_err() || text.trim().is_empty() { "another process".into() } else { text.trim().into() }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::thread;

    use super::*;

    #[test]
    fn robust_a_second_process_waits_for_the_first_and_is_told_who_holds_the_output() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("run");
        let first = OutputLock::take(&output, |_| panic!("the output is free")).unwrap();
        let (waits, waited) = channel();
        // Locks of the operating system belong to open files, so that a thread stands for a process.
        let second = thread::spawn({
            let output = output.clone();
            move || OutputLock::take(&output, |holder| waits.send(holder.to_owned()).unwrap()).unwrap()
        });
        assert!(waited.recv().unwrap().starts_with(&format!("process {}", process::id())));
        drop(first);
        let second = second.join().unwrap();
        assert!(beside(&output).unwrap().is_file());
        drop(second);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn robust_unfinished_files_of_killed_processes_are_removed_and_other_files_kept() {
        let folder = tempfile::tempdir().unwrap();
        let kept = [".table.csv.part", ".other.csv.a1B2c3.part", ".table.csv.a1B2c3.partial", "table.csv.a1B2c3.part"];
        let left = ".table.csv.a1B2c3.part";
        kept.iter().chain([&left]).for_each(|name| fs::write(folder.path().join(name), "").unwrap());
        drop(OutputLock::take(&folder.path().join("table.csv"), |_| {}).unwrap());
        assert!(kept.iter().all(|name| folder.path().join(name).is_file()));
        assert!(!folder.path().join(left).exists());
    }
}
