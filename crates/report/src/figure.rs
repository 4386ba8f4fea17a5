//! What a figure of any report is.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use files::write_atomically;

use super::canvas::Picture;

/// One figure of a report that is drawn from `Data`.
pub(crate) struct Figure<Data> {
    /// Name of its files.
    pub(crate) name: &'static str,
    /// Its heading on the page.
    pub(crate) title: &'static str,
    /// What is seen, in plain text.
    pub(crate) caption: &'static str,
    /// Lays it out; absent where the data hold nothing of the kind.
    pub(crate) draw: fn(&Data) -> Result<Option<Picture>>,
}

/// A figure's heading, caption and files and, where there was something to show in it, its picture.
pub(crate) struct Drawn {
    /// Name of its files.
    pub(crate) name: &'static str,
    /// Its heading on the page.
    pub(crate) title: &'static str,
    /// What is seen, in plain text.
    pub(crate) caption: &'static str,
    /// The picture.
    pub(crate) picture: Option<Picture>,
}

/// Draws every figure and writes `<name>.svg` and `<name>.png` into `figures` in `folder`; gives them with the files' paths.
///
/// # Errors
/// When a figure cannot be drawn or a file cannot be written; the error names the one or the other.
pub(crate) fn draw_all<Data>(
    folder: &Path,
    figures: &[Figure<Data>],
    data: &Data,
) -> Result<(Vec<Drawn>, Vec<PathBuf>)> {
    let folder = folder.join("figures");
    fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be created", folder.display()))?;
    let mut drawn = Vec::new();
    let mut paths = Vec::new();
    for figure in figures {
        let &Figure { name, title, caption, draw } = figure;
        let picture = draw(data).with_context(|| format!("figure `{name}`"))?;
        let [svg, png] = ["svg", "png"].map(|kind| folder.join(format!("{name}.{kind}")));
        if let Some(picture) = &picture {
            write_atomically(&svg, picture.to_standalone_svg(title)?.as_bytes())?;
            picture.write_png(&png)?;
            paths.extend([svg, png]);
        } else {
            // A picture of an earlier run must not stand beside a page that leaves it out.
            remove(&svg)?;
            remove(&png)?;
        }
        drawn.push(Drawn { name, title, caption, picture });
    }
    Ok((drawn, paths))
}

/// Removes a file, if it is there.
///
/// # Errors
/// When it cannot be removed; the error names it.
pub(crate) fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", path.display()))
        }
        _ => Ok(()),
    }
}
