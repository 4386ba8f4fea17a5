//! The command `whisker` as tests call it.

use std::path::Path;
use std::process::{Command, Output};

pub(crate) fn whisker(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_whisker")).args(arguments).output().unwrap()
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Asserts that a command failed with a single error that contains every one of `words`.
pub(crate) fn assert_fails(output: Output, words: &[&str]) {
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(matches!(output.status.code(), Some(1 | 3)), "ended with {:?}: {errors}", output.status);
    let failures: Vec<&str> = errors.lines().filter(|line| line.starts_with("error: ")).collect();
    let [failure] = failures[..] else { panic!("printed:\n{errors}") };
    for word in words {
        assert!(failure.contains(word), "does not contain `{word}`: {errors}");
    }
}
