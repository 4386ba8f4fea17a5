//! Whisker mechanics, sensor models and contact estimators.
//!
//! A whisker is a thin elastic wire on a compliant root ([`Whisker`]). Its only signal is the bending moment at the
//! root, which depends on the point of contact: a [`sensor`] model, fitted to a calibration, predicts the reading of a
//! contact. The map is many-to-one, so a single reading does not determine the contact; readings along a known motion
//! of the base do, and an [estimator](estimators) computes the contact and its covariance from them, sample by sample.
//!
//! | module | contents |
//! | --- | --- |
//! | [`frames`] | points, poses and twists whose types include their frame |
//! | [`elastica`] | exact quasi-static mechanics of a whisker against points and convex outlines |
//! | [`sensor`] | sensor models: fit, calibrated region, model error |
//! | [`events`] | contact detection |
//! | [`estimators`] | estimators of the contact point |
//!
//! The crate reads no files and has no access to ground truth.

pub mod elastica;
pub mod estimators;
pub mod events;
mod face;
pub mod frames;
mod presets;
mod rest;
pub mod sensor;
mod settings;
mod wire;

pub use rest::{Foot, RestShape};
pub use wire::{Curvature, Invalid, Whisker};
