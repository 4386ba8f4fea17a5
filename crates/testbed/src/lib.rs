//! Replay of whisker traces through estimators, and scores against the truth.
//!
//! ```text
//! trace, calibration -> replay -> estimates x truth -> metrics
//! ```
//!
//! The estimators and sensor models are those of the crate `whisker`, the traces those of the crate `trace`. This crate
//! replays single traces through the estimators, compares the estimates with the ground truth, and defines the files of results.
//! Whole data sets are fitted and evaluated by the crate `evaluation`.
//!
//! | module | contents |
//! | --- | --- |
//! | [`dataset`], [`fitted_traces`] | traces of a folder; check that the traces of a calibration have not changed since the fit |
//! | [`front_end`], [`encoders`] | simulated sensor chain and joint encoders, applied at replay with seeded noise |
//! | [`noise`], [`miscalibration`] | noise levels; deviations of sensor, whisker and mounting from the calibration |
//! | [`protocol`] | messages of external programs and of live streams: answers with an estimate |
//! | [`replay`] | causal replay of a trace through a registered estimator |
//! | [`metrics`], [`consistency`], [`contact_events`] | scores of the estimates against the truth |
//! | [`baseline`] | ratio of the error of the baselines to that of an estimator |
//! | [`bound`] | posterior Cramér–Rao bound along a trace |
//! | [`contour`], [`map`] | outlines of objects, and maps from several whiskers |
//! | [`space`] | the same for traces in space |
//! | [`results`] | files of a run, the only input of the crate `report` |

pub mod baseline;
pub mod bound;
pub mod consistency;
pub mod contact_events;
pub mod contour;
pub mod dataset;
pub mod encoders;
pub mod fitted_traces;
pub mod front_end;
pub mod map;
pub mod metrics;
pub mod miscalibration;
pub mod noise;
pub mod protocol;
pub mod provenance;
pub mod replay;
pub mod results;
pub mod seeds;
pub mod settings;
pub mod space;
pub mod statistics;
