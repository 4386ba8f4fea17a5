//! Outputs of commands: never an input, and one writer at a time.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::{OutputLock, resolved};
use trace::Sidecar;

/// Exclusive access to an output that is none of the inputs and lies in none of them. Waits, with a note on stderr, while another process writes it.
///
/// # Errors
/// If the output is an input or lies in one, or the system refuses access.
pub(super) fn reserve(out: &Path, inputs: &[PathBuf]) -> anyhow::Result<OutputLock> {
    check_apart(out, inputs)?;
    Ok(OutputLock::take(out, |holder| eprintln!("{}: waiting for {holder}, which writes it", out.display()))?)
}

/// Checks that an output is none of the inputs and lies in none of them, also through links and `..`.
///
/// # Errors
/// If it is or does, with both paths.
pub(super) fn check_apart(out: &Path, inputs: &[PathBuf]) -> anyhow::Result<()> {
    for input in inputs {
        if lies_in(out, input)? {
            let place = if lies_in(input, out)? { "is" } else { "lies in" };
            bail!("{}: {place} the input {}, expected another place for the output", out.display(), input.display());
        }
    }
    Ok(())
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
