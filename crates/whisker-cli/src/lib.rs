//! The command `whisker`, which makes the libraries of the project available on the command line.
//!
//! | module | contents |
//! | --- | --- |
//! | `commands` | one file per command: arguments, calls of the libraries, output |
//! | [`claims`] | measurement of every number that the documentation states |
//! | [`ros`] | conversion of traces and of logs of the calibration platform to ROS 2 recordings, and back |

pub mod claims;
mod commands;
pub mod ros;

pub use commands::run;
