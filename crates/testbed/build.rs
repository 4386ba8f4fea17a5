//! Passes the identities of the sources and the commit to the crate, for the watermarks of its output files.

#[path = "source_identity.rs"]
mod source_identity;

use std::path::Path;
use std::process::Command;

use source_identity::{CALIBRATION, EVALUATION};

const WORKSPACE: &str = "../..";

fn main() {
    for (variable, code) in [("WHISKER_CALIBRATION_SHA256", CALIBRATION), ("WHISKER_EVALUATION_SHA256", EVALUATION)] {
        println!("cargo::rustc-env={variable}={}", code.sha256(Path::new(WORKSPACE)));
        for source in code.sources {
            println!("cargo::rerun-if-changed={WORKSPACE}/{source}");
        }
    }
    println!("cargo::rerun-if-changed={WORKSPACE}/Cargo.lock");
    println!("cargo::rerun-if-changed=Cargo.toml");
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
    };
    if let Some(commit) = git(&["describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]) {
        println!("cargo::rustc-env=WHISKER_GIT_COMMIT={commit}");
    }
    // The log of HEAD changes with every commit and checkout.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={log}");
    }
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=source_identity.rs");
}
