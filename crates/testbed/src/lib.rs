//! Replay and evaluation of whisker traces against the truth.
//!
//! ```text
//! traces, calibration -> replay -> estimates x truth -> metrics -> results/<run>/
//! ```
//!
//! [`fit`] fits sensor models to calibration traces; [`evaluate`] runs every estimator over every trial and writes a run.

pub mod baseline;
pub mod bound;
pub mod consistency;
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
