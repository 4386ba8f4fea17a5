//! Steps and parts of a command, each printed under a heading with its duration.

use std::time::Instant;

use crate::failure::{Failure, Outcome};

/// One part of a command whose remaining parts run even if this one fails.
#[derive(Clone, Copy)]
pub(crate) struct Part {
    pub(crate) name: &'static str,
    pub(crate) run: fn() -> Outcome,
}

/// Runs a step under a heading and prints its duration.
pub(crate) fn step(heading: &str, run: impl FnOnce() -> Outcome) -> Outcome {
    eprintln!("\n== {heading}");
    let started = Instant::now();
    run()?;
    eprintln!("== {heading}: {:.1} s", started.elapsed().as_secs_f64());
    Ok(())
}

/// Runs every part, even after a failure, and prints a table of outcomes and durations.
///
/// # Errors
/// If any part failed; the message names each of them.
pub(crate) fn run_all(parts: &[Part]) -> Outcome {
    let mut table = String::new();
    let mut failed = Vec::new();
    for part in parts {
        let started = Instant::now();
        let outcome = step(part.name, part.run);
        let verdict = if outcome.is_ok() { "passed" } else { "FAILED" };
        let seconds = started.elapsed().as_secs_f64();
        table += &format!("{:20} {verdict} {seconds:8.1} s", part.name);
        if let Err(failure) = outcome {
            eprintln!("error: {failure}");
            failed.push(part.name);
        }
        table.push('\n');
    }
    print!("\n{table}");
    if failed.is_empty() {
        Ok(())
    } else {
        Err(Failure::new(format!("{} of {} parts failed: {}", failed.len(), parts.len(), failed.join(", "))))
    }
}
