//! Importers: recordings of others, turned into the project's traces.
//!
//! To add a format: one file with a function that reads it, and one row in [`IMPORTERS`].

mod mesh;
mod registration;
mod stanford_whisker;

use std::path::Path;

use files::Error;
use trace::{Outline, Trace};

/// A row of the registry of importers.
pub struct ImporterRow {
    /// Name of the format.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Reads a folder.
    pub import: fn(&Path) -> Result<Imported, Error>,
}

/// What an importer found.
#[derive(Debug, Default)]
pub struct Imported {
    /// The traces.
    pub traces: Vec<Trace>,
    /// Outlines of the traces' objects, each with the name of the file that a trace's sidecar gives it.
    pub outlines: Vec<(String, Outline)>,
    /// Files of the layout that are no such recordings, each with its reason. The rest does not depend on them.
    pub failures: Vec<Error>,
}

/// The registry of importers.
pub const IMPORTERS: &[ImporterRow] = &[ImporterRow {
    name: stanford_whisker::NAME,
    about: "a clone of HaoLiRobo/WhiskerSensing (Li et al. 2024): calibrations, pin trials and object sweeps, planar part",
    import: stanford_whisker::import,
}];

/// The registry's row of this name.
pub fn importer(name: &str) -> Option<&'static ImporterRow> {
    IMPORTERS.iter().find(|row| row.name == name)
}
