//! Animations of trials: one per set, drawn by the generator as `<group>.<whisker>.webp` with a still picture `.png`.
//!
//! The page contains the still picture and a link to the animation.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use files::write_atomically;
use testbed::results::{Run, RunSet};

use super::figure::remove;

/// The folder of a run that holds its animations.
const FOLDER: &str = "animations";

/// The animation of one set of a run.
pub(crate) struct Animation {
    /// Group of the trials.
    pub(crate) group: String,
    /// Their whisker.
    pub(crate) whisker: String,
    /// Path of the animation, relative to the page.
    pub(crate) address: String,
    /// Size of its file.
    pub(crate) bytes: u64,
    /// The still picture, a PNG.
    pub(crate) still: Vec<u8>,
}

/// The files of a set's animation: moving and still.
fn names(set: &RunSet) -> [String; 2] {
    ["webp", "png"].map(|kind| format!("{}.{}.{kind}", set.group, set.whisker))
}

/// Copies the animations of a run's sets from the folder `from` into the run's, and removes those that `from` lacks.
///
/// # Errors
/// When `from` is not a folder, the run cannot be read, or a file cannot be copied; the error names it.
pub(crate) fn take(run_folder: &Path, from: &Path) -> Result<()> {
    ensure!(from.is_dir(), "{}: found no folder, expected that of the animations", from.display());
    let run = Run::read(&run_folder.join("run.json"))?;
    for name in run.sets.iter().flat_map(names) {
        let target = run_folder.join(FOLDER).join(&name);
        match read_if_there(&from.join(&name))? {
            Some(bytes) => write_atomically(&target, &bytes)?,
            None => remove(&target)?,
        }
    }
    Ok(())
}

/// The animations in a run's folder, in the order of its sets.
///
/// # Errors
/// When a file exists but cannot be read; the error names it.
pub(crate) fn read(run_folder: &Path, sets: &[RunSet]) -> Result<Vec<Animation>> {
    let mut animations = Vec::new();
    for set in sets {
        let [moving, still] = names(set);
        let folder = run_folder.join(FOLDER);
        let Ok(metadata) = fs::metadata(folder.join(&moving)) else { continue };
        if let Some(still) = read_if_there(&folder.join(still))? {
            animations.push(Animation {
                group: set.group.clone(),
                whisker: set.whisker.clone(),
                address: format!("{FOLDER}/{moving}"),
                bytes: metadata.len(),
                still,
            });
        }
    }
    Ok(animations)
}

/// The bytes of a file. `None` if there is none.
fn read_if_there(path: &Path) -> Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| format!("{}: cannot be read", path.display())),
    }
}
