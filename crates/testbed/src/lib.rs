//! Replay and evaluation of whisker traces against the truth.
//!
//! ```text
//! traces, calibration -> replay -> estimates x truth -> metrics -> results/<run>/
//! ```
//!
//! The estimators and sensor models are those of the crate `whisker`, the traces those of the crate `trace`. This crate
//! replays the traces through the estimators and compares the estimates with the ground truth.
//!
//! | module | contents |
//! | --- | --- |
//! | [`fit`] | sensor models fitted to calibration traces: `calibrations/<whisker>.json` |
//! | [`front_end`], [`encoders`] | simulated sensor chain and joint encoders, applied at replay with seeded noise |
//! | [`replay`], [`participant`] | causal replay of a trace through a registered estimator or an external program |
//! | [`evaluate`] | every participant on every trial: parallel, resumable, divisible among processes |
//! | [`metrics`], [`consistency`], [`contact_events`] | scores of the estimates against the truth |
//! | [`bound`] | posterior Cramer-Rao bound along a trace |
//! | [`contour`], [`map`] | outlines of objects, and maps from several whiskers |
//! | [`results`] | files of a run, the only input of the crate `report` |

pub mod baseline;
pub mod bound;
pub mod consistency;
pub mod contact_events;
pub mod contour;
pub mod dataset;
pub mod encoders;
pub mod evaluate;
pub mod fit;
pub mod front_end;
pub mod map;
pub mod metrics;
pub mod participant;
pub mod provenance;
pub mod replay;
pub mod results;
pub mod seeds;
pub mod settings;
pub mod statistics;
