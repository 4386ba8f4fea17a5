//! Files as this project reads and writes them: bounded and strict on the way in, atomic and watermarked on the way out.
//!
//! Every error names file, line and column, the value found and the value expected ([`Error`]). A file that is written appears whole or not at all ([`AtomicFile`],
//! [`write_json`]); a [`Watermark`] states the program and the hash of the inputs that it was made from.
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
pub mod table;
mod watermark;

pub use atomic::{AtomicFile, is_temporary, write_atomically};
pub use bounded::read_table;
pub use digest::{Digest, hexadecimal, sha256};
pub use error::Error;
pub use json::{read_json, write_json};
pub use watermark::Watermark;

/// Version of every JSON and CSV format of the project.
pub const FORMAT: u32 = 1;
