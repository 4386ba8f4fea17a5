//! Outputs of commands: never an input nor a file of another kind, and one writer at a time.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use files::{OutputLock, resolved};
use trace::Sidecar;

/// Exclusive access to an output that is none of the inputs and lies in none of them. Waits, with a note on stderr,
/// while another process writes it.
///
/// # Errors
/// If the output is an input or lies in one, is a device, or the system refuses access.
pub(super) fn reserve(out: &Path, inputs: &[PathBuf]) -> anyhow::Result<OutputLock> {
    check_apart(out, inputs)?;
    if let Ok(found) = fs::metadata(out) {
        // A rename would replace a device, such as /dev/null.
        ensure!(
            found.is_file() || found.is_dir(),
            "{}: found neither a file nor a folder, expected a place for the output",
            out.display()
        );
    }
    Ok(OutputLock::take(out, |holder| eprintln!("{}: waiting for {holder}, which writes it", out.display()))?)
}

/// Exclusive access to an output folder, as [`reserve`].
///
/// # Errors
/// Those of [`reserve`], and if the output is a file.
pub(super) fn reserve_folder(out: &Path, inputs: &[PathBuf]) -> anyhow::Result<OutputLock> {
    check_is_folder(out)?;
    reserve(out, inputs)
}

/// Checks that neither an output folder nor a folder above it is a file.
///
/// # Errors
/// If one is, with its path.
pub(super) fn check_is_folder(out: &Path) -> anyhow::Result<()> {
    if let Some(file) = out.ancestors().find(|folder| folder.is_file()) {
        bail!("{}: is a file, expected a folder for the output", file.display());
    }
    Ok(())
}

/// Checks that an output is none of the inputs and lies in none of them, also through links and `..`.
///
/// # Errors
/// If it is or does, with both paths, or if it lies in a file.
pub(super) fn check_apart(out: &Path, inputs: &[PathBuf]) -> anyhow::Result<()> {
    out.parent().map_or(Ok(()), check_is_folder)?;
    for input in inputs {
        if lies_in(out, input)? {
            let place = if lies_in(input, out)? { "is" } else { "lies in" };
            bail!("{}: {place} the input {}, expected another place for the output", out.display(), input.display());
        }
    }
    Ok(())
}

/// Whether a file begins with these bytes.
pub(super) fn begins_with(path: &Path, bytes: &[u8]) -> bool {
    let mut found = Vec::new();
    let read = File::open(path).and_then(|file| file.take(bytes.len() as u64).read_to_end(&mut found));
    read.is_ok() && found == bytes
}

/// Whether a path is another or lies in it.
pub(super) fn lies_in(path: &Path, other: &Path) -> anyhow::Result<bool> {
    let resolved = |path: &Path| resolved(path).with_context(|| path.display().to_string());
    Ok(resolved(path)?.starts_with(resolved(other)?))
}

/// Files of a trace: table, sidecar and outline.
pub(super) fn files_of_trace(path: &Path, sidecar: &Sidecar) -> Vec<PathBuf> {
    let outline = sidecar.contour.iter().map(|contour| path.with_file_name(&contour.file));
    ["csv", "json"].map(|extension| path.with_extension(extension)).into_iter().chain(outline).collect()
}
