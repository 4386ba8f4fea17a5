//! The command `whisker`.
//!
//! One file a command in [`commands`]; [`claims`] measures the figures that the documentation states; [`ros`] converts traces and sessions to ROS 2 recordings and back.

pub mod claims;
mod commands;
pub mod ros;

pub use commands::run;
