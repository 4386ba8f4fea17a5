//! Whisker mechanics, sensor models and contact estimators.
//!
//! A whisker is a thin elastic wire on a compliant root ([`Whisker`]). Its one signal, the bending moment at the root,
//! depends on where an object touches it: a [`sensor`] model, fitted to a calibration, predicts the reading of a contact. The
//! map is many-to-one, so one reading does not tell the place; readings along a known motion of the root do, and an
//! [estimator](estimators) draws that conclusion sample by sample.
//!
//! Nothing here reads a file or knows the truth.

pub mod elastica;
pub mod estimators;
pub mod events;
mod face;
pub mod frames;
mod rest;
pub mod sensor;
mod settings;
mod wire;

pub use rest::{Foot, RestShape};
pub use wire::{Curvature, Invalid, Whisker};
