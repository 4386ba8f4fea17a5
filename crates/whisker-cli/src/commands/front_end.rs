//! Options that select a front end, shared by the commands that replay traces.

use anyhow::Context;
use testbed::front_end::{FRONT_ENDS, FrontEnd, FrontEndConfig, SPATIAL_FRONT_ENDS, SpatialFrontEnd};

use super::JsonOrFile;

/// A front end and its settings.
// Without its own group: the command that flattens these has a group of the same name.
#[derive(clap::Args)]
#[group(skip)]
pub(super) struct Arguments {
    /// Front end: sensor between moment and reading of simulated traces (`whisker list front-ends`; for traces in space
    /// `space-front-ends`)
    #[arg(long, default_value = FRONT_ENDS[0].name)]
    front_end: String,
    /// Settings of the front end as JSON or as a JSON file, for example '{"white_counts": 2}'
    #[arg(long, default_value = "{}", value_name = "JSON or FILE", value_parser = JsonOrFile::parsed)]
    front_end_config: JsonOrFile,
}

impl Arguments {
    /// Whether this is the front end that is selected without options.
    pub(super) fn is_default(&self) -> bool {
        self.choice() == FrontEndConfig::default()
    }

    /// The selected front end.
    pub(super) fn choice(&self) -> FrontEndConfig {
        FrontEndConfig { name: self.front_end.clone(), config: self.front_end_config.value.clone() }
    }

    /// The selected front end of planar traces.
    ///
    /// # Errors
    /// If it is unknown, or its settings are invalid.
    pub(super) fn in_plane(&self) -> anyhow::Result<FrontEnd> {
        let is_known = FRONT_ENDS.iter().any(|row| row.name == self.front_end);
        self.naming_file(is_known, FrontEnd::new(&self.choice()))
    }

    /// The selected front end of traces in space.
    ///
    /// # Errors
    /// As [`Self::in_plane`].
    pub(super) fn in_space(&self) -> anyhow::Result<SpatialFrontEnd> {
        let is_known = SPATIAL_FRONT_ENDS.iter().any(|row| row.name == self.front_end);
        self.naming_file(is_known, SpatialFrontEnd::new(&self.choice()))
    }

    /// Adds the path of the settings file, if there is one, to an error of a known front end.
    fn naming_file<T>(&self, is_known: bool, front_end: anyhow::Result<T>) -> anyhow::Result<T> {
        match &self.front_end_config.file {
            Some(path) if is_known => front_end.with_context(|| path.display().to_string()),
            _ => front_end,
        }
    }
}
