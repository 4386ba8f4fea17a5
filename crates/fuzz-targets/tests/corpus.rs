//! Every target on its corpus and on damaged copies: truncated at many positions, with single bytes changed.

use std::fs;
use std::path::{Path, PathBuf};

use fuzz_targets::{TARGETS, Target};

/// Maximum number of positions at which a file is damaged.
const PLACES: usize = 30;

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus")
}

fn files(target: &Target) -> Vec<PathBuf> {
    let folder = corpus().join(target.name);
    let listed = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<PathBuf> = listed.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files
}

/// Prints the file and the damage when a panic unwinds.
struct PrintOnPanic(String);

impl Drop for PrintOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}", self.0);
        }
    }
}

fn run(target: &Target, bytes: &[u8], description: impl FnOnce() -> String) {
    let _print = PrintOnPanic(description());
    (target.run)(bytes);
}

#[test]
fn regress_corpus_files() {
    for target in TARGETS {
        let files = files(target);
        assert!(!files.is_empty(), "{}: no files", target.name);
        for file in files {
            run(target, &fs::read(&file).expect("a file"), || file.display().to_string());
        }
    }
}

#[test]
fn verif_every_folder_belongs_to_a_target() {
    for entry in fs::read_dir(corpus()).expect("the corpus") {
        let name = entry.expect("an entry").file_name();
        assert!(TARGETS.iter().any(|target| name == target.name), "{}", name.display());
    }
}

#[test]
fn robust_damaged_files() {
    for target in TARGETS {
        for file in files(target) {
            let bytes = fs::read(&file).expect("a file");
            for place in (0..bytes.len()).step_by(bytes.len() / PLACES + 1) {
                run(target, &bytes[..place], || format!("{} cut at {place}", file.display()));
                // Flipping bit 0 gives another digit, bit 7 invalid UTF-8.
                for flip in [1, 0x80] {
                    let mut bytes = bytes.clone();
                    bytes[place] ^= flip;
                    run(target, &bytes, || format!("{} with byte {place} flipped by {flip}", file.display()));
                }
            }
        }
    }
}
