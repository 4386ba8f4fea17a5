//! One program for all targets: `WHISKER_FUZZ` names the one that is run.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use fuzz_targets::{TARGETS, Target};

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("WHISKER_FUZZ").unwrap_or_default();
    TARGETS
        .iter()
        .find(|target| target.name == name)
        .unwrap_or_else(|| panic!("WHISKER_FUZZ: found `{name}`, expected a target"))
});

fuzz_target!(|bytes: &[u8]| (TARGET.run)(bytes));
