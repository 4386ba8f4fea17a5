//! The reference of the Rust crates, by rustdoc, and of the Python package, by pdoc.

use crate::failure::Outcome;
use crate::parts::step;
use crate::python;
use crate::tools::{cargo, python as python_command, run as run_command};

/// Folder of the Python reference, beside that of the crates.
const PYTHON: &str = "target/doc/python";

pub(crate) fn run() -> Outcome {
    step("reference of the crates", || run_command(cargo(&["doc", "--workspace", "--no-deps"])))?;
    step("Python package", python::install_package)?;
    let pdoc = ["-m", "pdoc", "--docformat", "markdown", "--no-show-source", "--output-directory", PYTHON];
    step("reference of the Python package", || {
        run_command(python_command(&[&pdoc[..], &["whisker_contact"]].concat()))
    })?;
    println!("target/doc/whisker/index.html\n{PYTHON}/index.html");
    Ok(())
}
