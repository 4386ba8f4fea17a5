//! Contacts in space from recordings of real sensors.
//!
//! | module | contents |
//! | --- | --- |
//! | [`benchmark`] | sensor models, pins and objects scored |
//! | [`calibration`] | labelled contacts of a calibration, fitted sensor model |
//! | [`fixed`] | estimator of a fixed contact |
//! | [`paper`] | the published unscented filter |
//! | [`sweep`] | contacts of a sweep over an object |
//! | [`mesh`] | distance from a mesh |
//! | [`pins`] | scores on pins, mounting learnt at a known place |
//!
//! The sensor model is the Gaussian process of [`whisker::space::sensor::gaussian_process`], fitted to labelled contacts, in the
//! frame of the sensor and in counts: forces are not known for such recordings, and only the score of the whisker's
//! reach uses the shape of the wire.

pub mod benchmark;
pub mod calibration;
pub mod fixed;
pub mod mesh;
pub mod paper;
pub mod pins;
pub mod sweep;
