//! Results that the repository keeps in `results/reference/`, because the documentation shows them.

use std::fs;
use std::path::Path;

use crate::failure::{Failure, Outcome};
use crate::repository::root;

const FOLDER: &str = "results/reference";

/// Copies files of `results/<name>/` to `results/reference/<name>/`, without their subfolders.
pub(crate) fn keep(name: &str, files: &[&str]) -> Outcome {
    let (results, kept) = (root().join("results").join(name), root().join(FOLDER).join(name));
    files.iter().try_for_each(|file| copy(&results.join(file), &kept))
}

fn copy(file: &Path, folder: &Path) -> Outcome {
    let kept = folder.join(file.file_name().unwrap_or_default());
    let unfinished = kept.with_extension("partial");
    fs::create_dir_all(folder)
        .and_then(|()| fs::copy(file, &unfinished))
        .and_then(|_| fs::rename(&unfinished, &kept))
        .map_err(|error| Failure::new(format!("{}: cannot be copied to {}: {error}", file.display(), kept.display())))
}
