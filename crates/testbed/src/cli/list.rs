//! `whisker list`: the registries.

use std::process::ExitCode;

use whisker::estimators::ESTIMATORS;
use whisker::sensor::MODELS;

use super::python;
use crate::claims::claims;
use crate::report::FIGURES;

/// Print the registries: estimators, sensor models, figures, claims, and the generator's
#[derive(clap::Args)]
pub(super) struct Arguments {}

pub(super) fn run(_: &Arguments) -> anyhow::Result<ExitCode> {
    println!("estimators");
    for row in ESTIMATORS {
        println!("  {:<28} {}\n  {:<28} {}", row.name, row.about, "", (row.defaults)());
    }
    println!("\nsensor models");
    for row in MODELS {
        println!("  {:<28} {}\n  {:<28} {}", row.kind, row.about, "", (row.defaults)());
    }
    println!("\nfigures");
    for row in FIGURES {
        println!("  {:<28} {}", row.name, row.title);
    }
    println!("\nclaims");
    for row in claims() {
        println!("  {:<28} {}", row.id, row.claim);
    }
    println!();
    match python::generator(["list"]) {
        Ok(command) => python::run(command),
        Err(error) => {
            eprintln!("whisker presets, shapes and motions are the generator's: {error:#}");
            Ok(ExitCode::SUCCESS)
        }
    }
}
