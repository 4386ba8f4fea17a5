//! Contacts in space from recordings of real sensors.
//!
//! | module | contents |
//! | --- | --- |
//! | [`benchmark`] | sensor models, pins and objects scored |
//! | [`kernel`] | covariance of the readings of a calibration: map, error of a line, noise |
//! | [`process`] | Gaussian process from a contact to both bending channels, and predictions on held-out lines |
//! | [`calibration`] | labelled contacts of a calibration, selection of the covariance |
//! | [`fixed`] | estimator of a fixed contact |
//! | [`paper`] | the published unscented filter |
//! | [`sweep`] | contacts of a sweep over an object |
//! | [`mesh`] | distance from a mesh |
//! | [`pins`] | scores on pins, mounting learnt at a known place |
//!
//! The sensor model is fitted to labelled contacts, in the frame of the sensor and in counts: neither the shape of the wire nor
//! forces are known of such recordings.

pub mod benchmark;
pub mod calibration;
pub mod fixed;
pub mod kernel;
pub mod mesh;
pub mod paper;
pub mod pins;
pub mod process;
pub mod sweep;
