//! Replay, evaluation and report of whisker traces.
//!
//! ```text
//! traces, calibration -> replay -> estimates x truth -> metrics -> results/<run>/ -> report
//! ```
//!
//! [`fit`] learns sensor models from calibration traces, [`evaluate`] runs every estimator over every trial and writes a run, and
//! [`report`] draws it. [`claims`] checks what the documentation promises. The command `whisker` ([`cli`]) is a face to these.

pub mod baseline;
pub mod bound;
pub mod claims;
pub mod cli;
pub mod consistency;
pub mod contour;
pub mod dataset;
pub mod encoders;
pub mod entrant;
pub mod evaluate;
pub mod fit;
pub mod front_end;
pub mod map;
pub mod metrics;
pub mod provenance;
pub mod replay;
pub mod report;
pub mod results;
pub mod ros;
pub mod settings;
mod statistics;
