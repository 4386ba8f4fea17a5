//! The calibration platform: a 3D printer pushes a ruler against a whisker at known places, a magnetometer at the whisker's root listens.
//!
//! [`sensor`] reads the magnetometer, [`printer`] drives the printer, [`routine`] is the way that the ruler goes, and [`session`] puts
//! them together and feeds what records. [`emulate`] offers the same two devices on pseudo-terminals, for those who have neither.
//! [`calibration`] learns the radial distance of the contact from what was recorded; [`inference`] tells it while samples stream in.
//!
//! After the OpenWhisker platform ("3D Printer Based Open Source Calibration Platform for Whisker Sensors", TAROS 2024).

pub mod calibration;
#[cfg(unix)]
pub mod emulate;
mod error;
pub mod inference;
pub mod interrupt;
mod lines;
mod port;
pub mod printer;
mod range;
pub mod record;
pub mod rig;
pub mod routine;
mod sample;
pub mod sensor;
pub mod session;
pub mod streams;

pub use error::Error;
pub use sample::Sample;
