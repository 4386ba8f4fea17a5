//! Passes the identities of the sources to the crate, for the watermarks of its output files.

#[path = "source_identity.rs"]
mod source_identity;

use std::path::Path;

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
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=source_identity.rs");
}
