//! Figures of a report and their files.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use files::write_atomically;
use indicatif::ProgressBar;

use super::canvas::Picture;

/// The folder of the figures' files, in that of the results.
const FOLDER: &str = "figures";
/// The folder of the pictures of all methods, in that of the results.
pub(crate) const ALL_METHODS: &str = "figures/all";

/// One figure of a report that is drawn from `Data`.
pub(crate) struct Figure<Data> {
    /// Name of its files.
    pub(crate) name: &'static str,
    /// Heading on the page.
    pub(crate) title: &'static str,
    /// Quantities, panels and signs, in plain text. The picture's own note names the methods and trials drawn.
    pub(crate) caption: &'static str,
    /// Lays the figure out. `None` if the results hold no data for it.
    pub(crate) draw: fn(&Data) -> Result<Option<Picture>>,
}

/// A figure with the picture that was drawn of it.
pub(crate) struct Drawn {
    /// Name of its files.
    pub(crate) name: &'static str,
    /// Heading on the page.
    pub(crate) title: &'static str,
    /// Caption of the figure and note of the picture.
    pub(crate) caption: String,
    /// The picture.
    pub(crate) picture: Picture,
}

/// The figures of some results.
pub(crate) struct Figures {
    /// Those for which there is data, in the order of the page.
    pub(crate) drawn: Vec<Drawn>,
    /// Titles of the others.
    pub(crate) left_out: Vec<&'static str>,
    /// Files written: SVG and PNG of each picture in turn.
    pub(crate) files: Vec<PathBuf>,
}

/// Draws every figure and writes `figures/<name>.svg` and `.png` in `folder`, and the pictures of all methods as
/// `figures/all/<name>_<number>.svg` and `.png`. Removes those of an earlier report. The unit of progress is one figure.
///
/// # Errors
/// When a figure cannot be drawn or a file cannot be written; the error names the figure or the file.
pub(crate) fn draw_all<Data>(
    folder: &Path,
    figures: &[Figure<Data>],
    data: &Data,
    progress: &ProgressBar,
) -> Result<Figures> {
    progress.set_length(figures.len() as u64);
    let all_methods = folder.join(ALL_METHODS);
    if all_methods.exists() {
        fs::remove_dir_all(&all_methods).with_context(|| format!("{}: cannot be removed", all_methods.display()))?;
    }
    let mut all = Figures { drawn: Vec::new(), left_out: Vec::new(), files: Vec::new() };
    for &Figure { name, title, caption, draw } in progress.wrap_iter(figures.iter()) {
        let files = files_of(folder, FOLDER, name);
        let Some(picture) = draw(data).with_context(|| format!("figure `{name}`"))? else {
            // A picture of an earlier run must not stand beside a page that leaves it out.
            files.iter().try_for_each(|file| remove(file))?;
            all.left_out.push(title);
            continue;
        };
        write(&picture, title, files, &mut all.files)?;
        for (index, picture) in picture.all_methods.iter().enumerate() {
            write(picture, title, files_of(folder, ALL_METHODS, &numbered(name, index)), &mut all.files)?;
        }
        let caption = if picture.note.is_empty() { caption.to_owned() } else { format!("{caption} {}", picture.note) };
        all.drawn.push(Drawn { name, title, caption, picture });
    }
    Ok(all)
}

/// Name of one of the pictures of all methods.
pub(crate) fn numbered(name: &str, index: usize) -> String {
    format!("{name}_{}", index + 1)
}

fn files_of(folder: &Path, below: &str, name: &str) -> [PathBuf; 2] {
    ["svg", "png"].map(|kind| folder.join(below).join(format!("{name}.{kind}")))
}

fn write(picture: &Picture, title: &str, files: [PathBuf; 2], written: &mut Vec<PathBuf>) -> Result<()> {
    let [svg, png] = &files;
    let folder = svg.parent().context("a file without a folder")?;
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot be created", folder.display()))?;
    write_atomically(svg, picture.to_standalone_svg(title)?.as_bytes())?;
    picture.write_png(png)?;
    written.extend(files);
    Ok(())
}

/// Removes a file, if there is one.
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
