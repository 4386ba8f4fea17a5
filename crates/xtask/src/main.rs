//! `cargo xtask <command>`: set-up, demo, tests, checks and measurements of the project.
//!
//! Exit codes: 0 success, 1 failure, 2 usage error.

mod commands;
mod failure;
mod kept;
mod parts;
mod pipeline;
mod python;
mod repository;
mod tools;

use std::env;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> =
        env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned()).collect();
    if arguments.iter().any(|argument| matches!(argument.as_str(), "help" | "--help" | "-h")) {
        print!("{}", commands::help());
        return ExitCode::SUCCESS;
    }
    let command = match commands::find(&arguments) {
        Ok(command) => command,
        Err(usage) => {
            eprintln!("error: {usage}\n\n{}", commands::help());
            return ExitCode::from(2);
        }
    };
    match command.run(&arguments[1..]) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::FAILURE
        }
    }
}
