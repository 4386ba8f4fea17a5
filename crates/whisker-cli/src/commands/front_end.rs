//! The options that choose a front end, the same for every command that replays traces.

use std::fs;

use serde_json::Value;
use testbed::front_end::{FRONT_ENDS, FrontEndConfig};

use super::json;

/// A front end and its settings.
// No group of its own: the command that takes these already has one of this name.
#[derive(clap::Args)]
#[group(skip)]
pub(super) struct Arguments {
    /// Front end between moment and reading of simulated traces; `whisker list` names them
    #[arg(long, default_value = FRONT_ENDS[0].name)]
    front_end: String,
    /// Settings of the front end as JSON or a file with it, for example '{"white_counts": 2}'
    #[arg(long, default_value = "{}", value_parser = json_or_file)]
    front_end_config: Value,
}

impl Arguments {
    /// What they choose.
    pub(super) fn choice(&self) -> FrontEndConfig {
        FrontEndConfig { name: self.front_end.clone(), config: self.front_end_config.clone() }
    }
}

/// A JSON object, or that in a file.
fn json_or_file(text: &str) -> Result<Value, String> {
    if text.trim_start().starts_with('{') {
        return json(text);
    }
    json(&fs::read_to_string(text).map_err(|error| format!("neither a JSON object nor a file: {error}"))?)
}
