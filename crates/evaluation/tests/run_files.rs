//! The list of a run's files in FORMAT.md is that of the registry.
//! `UPDATE_DOCS=1 cargo test -p testbed --test run_files` writes it.

use std::path::Path;
use std::{env, fs};

use testbed::results::files::markdown;

const BEGIN: &str = "<!-- run files: begin -->\n";
const END: &str = "<!-- run files: end -->";

#[test]
fn verif_the_format_lists_the_files_of_the_registry() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/FORMAT.md");
    let text = fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(BEGIN).expect("FORMAT.md has the marker at which the list begins");
    let (found, after) = rest.split_once(END).expect("FORMAT.md has the marker at which the list ends");
    let expected = markdown();
    if env::var_os("UPDATE_DOCS").is_some() {
        fs::write(&path, format!("{before}{BEGIN}{expected}{END}{after}")).unwrap();
    } else {
        assert!(found == expected, "FORMAT.md differs from RUN_FILES; UPDATE_DOCS=1 with this test writes the list");
    }
}
