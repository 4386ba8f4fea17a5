//! Kinds of results, of which a folder holds one.

use std::fs;
use std::path::Path;

use anyhow::{Context, bail};

/// Kind of the results in a folder, recognised by a file that every folder of this kind has and no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultsKind {
    /// Run in the plane, by `whisker evaluate`.
    Run,
    /// Run in space, by `whisker evaluate`.
    SpatialRun,
    /// Tables of `whisker recordings`.
    Recordings,
    /// Physics study, by `python -m whisker_sim.physics`.
    Physics,
}

impl ResultsKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Run, Self::SpatialRun, Self::Recordings, Self::Physics];

    /// Name of the file by which the kind is recognised.
    pub const fn file(self) -> &'static str {
        match self {
            Self::Run => "run.json",
            Self::SpatialRun => "space_run.json",
            Self::Recordings => "space_settings.json",
            Self::Physics => "watermark.json",
        }
    }

    /// Description for messages.
    pub const fn about(self) -> &'static str {
        match self {
            Self::Run => "a run in the plane",
            Self::SpatialRun => "a run in space",
            Self::Recordings => "tables of `whisker recordings`",
            Self::Physics => "the physics study",
        }
    }

    /// Kind of the results in a folder. `None` if it holds none.
    pub fn of(folder: &Path) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.is_in(folder))
    }

    /// Whether a folder holds results of this kind.
    pub fn is_in(self, folder: &Path) -> bool {
        folder.join(self.file()).is_file()
    }

    /// Checks that results of this kind may be written into a folder: it holds results of this kind alone, or is empty or
    /// missing.
    ///
    /// # Errors
    /// If it holds results of another kind or other files, or cannot be read.
    pub fn check_may_replace(self, folder: &Path) -> anyhow::Result<()> {
        let (at, own) = (folder.display(), self.about());
        if let Some(other) = Self::ALL.into_iter().find(|other| *other != self && other.is_in(folder)) {
            let (file, found) = (other.file(), other.about());
            bail!("{at}: found {found} ({file}), expected {own}; move these files, or choose another name");
        }
        if self.is_in(folder) || !folder.exists() {
            return Ok(());
        }
        let mut entries = fs::read_dir(folder).with_context(|| at.to_string())?;
        if entries.next().is_some() {
            bail!("{at}: found other files, expected {own}, or an empty or new folder; choose another name");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_a_folder_takes_results_of_one_kind() {
        let home = tempfile::tempdir().unwrap();
        for kind in ResultsKind::ALL {
            let folder = home.path().join(kind.file());
            kind.check_may_replace(&folder).unwrap();
            fs::create_dir(&folder).unwrap();
            kind.check_may_replace(&folder).unwrap();
            assert_eq!(ResultsKind::of(&folder), None);
            fs::write(folder.join("notes.txt"), "mine").unwrap();
            let message = kind.check_may_replace(&folder).unwrap_err().to_string();
            assert!(message.contains("found other files, expected"), "{message}");
            fs::write(folder.join(kind.file()), "{}").unwrap();
            kind.check_may_replace(&folder).unwrap();
            assert_eq!(ResultsKind::of(&folder), Some(kind));
            for other in ResultsKind::ALL.into_iter().filter(|other| *other != kind) {
                let message = other.check_may_replace(&folder).unwrap_err().to_string();
                assert!(message.contains(kind.about()) && message.contains("expected"), "{message}");
            }
        }
    }
}
