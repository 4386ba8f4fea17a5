//! The repository: its root folder, its Python environment, and command lines as typed in the root folder.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Root folder of the repository, absolute.
pub(crate) fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).unwrap_or(here).to_path_buf()
}

/// Folder of the Python environment, absolute.
pub(crate) fn environment() -> PathBuf {
    root().join(".venv")
}

/// Interpreter of the Python environment.
pub(crate) fn interpreter() -> PathBuf {
    environment().join("bin/python")
}

/// Command line as typed in the root folder.
pub(crate) fn words(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let program = program.strip_prefix(root()).unwrap_or(program);
    // cargo passes its own full path, which a message does not need.
    let program = if program.is_absolute() { program.file_name().map_or(program, Path::new) } else { program };
    std::iter::once(program.as_os_str())
        .chain(command.get_args())
        .map(|word| word.to_string_lossy())
        .collect::<Vec<_>>()
        .join(" ")
}
