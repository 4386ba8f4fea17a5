//! Fuzzing entry point of all targets; the environment variable `WHISKER_FUZZ` selects the target.

#![no_main]

use std::sync::LazyLock;

use fuzz_targets::{TARGETS, Target};
use libfuzzer_sys::fuzz_target;

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("WHISKER_FUZZ").unwrap_or_default();
    TARGETS
        .iter()
        .find(|target| target.name == name)
        .unwrap_or_else(|| panic!("WHISKER_FUZZ: found `{name}`, expected the name of a target"))
});

fuzz_target!(|bytes: &[u8]| (TARGET.run)(bytes));
