//! The calibration platform: a printer pushes an edge against a whisker at known places, a magnetometer at its root listens, and a regression
//! learns the radial distance of the contact.

pub mod calibration;
mod sample;

pub use sample::Sample;
