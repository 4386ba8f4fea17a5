//! The command `whisker`.

use std::process::ExitCode;

fn main() -> ExitCode {
    match testbed::cli::run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
