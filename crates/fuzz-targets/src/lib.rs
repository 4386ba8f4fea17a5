//! Files from strangers: what every parser must do with any bytes.
//!
//! A [`Target`] gives bytes to one parser and holds it to three things: it does not panic; what it refuses it refuses with one clear line; and what it lets through
//! means what stands there, value for value, and reads back equal when it is written. The same targets are run on the kept corpus by the ordinary tests and on
//! bytes without end by `cargo xtask fuzz`.
//!
//! To add a parser: one file beside `targets/outline.rs`, one row in [`TARGETS`], and a file or two in `fuzz/corpus/<name>/`.

mod claims;
mod golden;
mod scratch;
mod targets;

pub use claims::{is_decimal, one_error, same_json};
pub use targets::{TARGETS, Target};
