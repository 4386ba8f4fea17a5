//! Bounded, strict reading and atomic, watermarked writing of files.
//!
//! These are the rules of all file formats of the project. An [`Error`] states file, line and column, the value found
//! and the value expected. Files are written atomically ([`AtomicFile`], [`write_json`]), and an [`OutputLock`] excludes
//! a second writer. A [`Watermark`] records the program and the hash of the inputs from which a file was made.
//!
//! In the following example, a JSON file is written and read back; a syntax error is then reported with its place:
//!
//! ```
//! use files::{read_json, write_json};
//!
//! let home = tempfile::tempdir()?;
//! let path = home.path().join("offset.json");
//! write_json(&path, &[0.001, 0.002])?;
//! assert_eq!(read_json::<[f64; 2]>(&path)?, [0.001, 0.002]);
//!
//! std::fs::write(&path, "[0.001,\n0.002,]")?;
//! let error = read_json::<[f64; 2]>(&path).unwrap_err().to_string();
//! assert!(error.ends_with("offset.json:2:7: trailing comma"), "{error}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atomic;
mod bounded;
mod digest;
mod error;
mod json;
mod lock;
pub mod table;
mod watermark;

pub use atomic::{AtomicFile, StagedFiles, check_replaces_own, remove_temporary, write_atomically};
pub use bounded::read_table;
pub use digest::{Digest, hexadecimal, sha256, sha256_of_file};
pub use error::Error;
pub use json::{is_of_kind, read_json, write_json};
pub use lock::{OutputLock, resolved};
pub use watermark::Watermark;

/// Version of every JSON and CSV format of the project.
pub const FORMAT: u32 = 1;
