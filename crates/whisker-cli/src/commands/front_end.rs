//! Options that select a front end, shared by the commands that replay traces.

use serde_json::Value;
use testbed::front_end::{FRONT_ENDS, FrontEndConfig};

use super::json_or_file;

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
    #[arg(long, default_value = "{}", value_parser = json_or_file)]
    front_end_config: Value,
}

impl Arguments {
    /// Whether this is the front end that is selected without options.
    pub(super) fn is_default(&self) -> bool {
        self.choice() == FrontEndConfig::default()
    }

    /// The selected front end.
    pub(super) fn choice(&self) -> FrontEndConfig {
        FrontEndConfig { name: self.front_end.clone(), config: self.front_end_config.clone() }
    }
}
