//! The command `whisker`, which makes the libraries of the project available on the command line.
//!
//! | module | contents |
//! | --- | --- |
//! | `commands` | one file per command: arguments, calls of the libraries, output |
//! | [`claims`] | measurement of every number that the documentation states |
//! | [`ros`] | conversion of traces and of logs of the calibration platform to ROS 2 recordings, and back |
//!
//! # Example
//! A trace becomes a ROS 2 recording, from which it is restored byte for byte. On the command line: `whisker bag export` and
//! `whisker bag import`.
//!
//! ```
//! use std::fs;
//! use std::path::Path;
//!
//! use whisker_cli::ros;
//!
//! # fn main() -> anyhow::Result<()> {
//! // Data: a short sweep over a pin, with its ground truth.
//! let trace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/golden_pin.csv");
//!
//! // Poses, moments and contacts as ROS 2 messages.
//! let folder = tempfile::tempdir()?;
//! let recording = folder.path().join("golden_pin");
//! ros::export_trace(&trace, None, &recording)?;
//!
//! // Answer: the restored trace equals the original.
//! let restored = ros::import(&recording, false, folder.path())?;
//! assert_eq!(fs::read(&restored[0])?, fs::read(&trace)?);
//! # Ok(())
//! # }
//! ```

pub mod claims;
mod commands;
pub mod ros;

pub use commands::run;
