//! Entry point of the command `whisker`: exit code and error message.

use std::io::{self, Write};
use std::process::ExitCode;

use strict_json::one_line;

fn main() -> ExitCode {
    match whisker_cli::run() {
        Ok(code) => code,
        // The reader of stdout has closed it.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // A terminal that was closed cannot show it.
            let _ = writeln!(io::stderr(), "error: {}", one_line(&format!("{error:#}")));
            ExitCode::FAILURE
        }
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
