//! Fuzz targets: parsers of untrusted input and the properties that they must satisfy.
//!
//! A [`Target`] passes arbitrary bytes to one parser and asserts three properties: it does not panic; an error is a
//! single line that names the file; and the values of an accepted input are those of its text, and are equal after
//! writing and reading. The tests of this crate run the targets on the corpus and on damaged copies of it; `cargo
//! xtask fuzz` runs them under libFuzzer.
//!
//! In the following example, the target for traces rejects damaged bytes without a panic:
//!
//! ```
//! let target = fuzz_targets::TARGETS.iter().find(|target| target.name == "trace").expect("a registered target");
//! (target.run)(b"t_s,base_x_m\n0,nan\n");
//! ```
//!
//! To add a parser: one file beside `targets/outline.rs`, one row in [`TARGETS`], and seed files in
//! `fuzz/corpus/<name>/`.

mod golden;
mod properties;
mod scratch;
mod targets;

pub use properties::{is_decimal, one_error, same_json};
pub use targets::{TARGETS, Target};
