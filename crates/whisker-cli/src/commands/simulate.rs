//! `whisker simulate`: passes its arguments to the generator.

use std::ffi::OsString;
use std::process::ExitCode;

use super::python;

/// Simulate scenes or suites in MuJoCo and write traces (`whisker-sim simulate`)
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(super) struct Arguments {
    /// Scenes, suites and options of the generator; --help lists them
    #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let all = std::iter::once(OsString::from("simulate")).chain(arguments.arguments.iter().cloned());
    python::run(python::generator(all)?)
}
