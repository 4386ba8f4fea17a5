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
//! | [`fitted_traces`] | check that the traces of a calibration have not changed since the fit |
//! | [`front_end`], [`encoders`] | simulated sensor chain and joint encoders, applied at replay with seeded noise |
//! | [`noise`], [`miscalibration`] | noise levels; deviations of sensor, whisker and mounting from the calibration |
//! | [`replay`], [`participant`] | causal replay of a trace through a registered estimator or an external program |
//! | [`evaluate`] | every participant on every trial: parallel, resumable, divisible among processes |
//! | [`metrics`], [`consistency`], [`contact_events`] | scores of the estimates against the truth |
//! | [`bound`] | posterior Cramér–Rao bound along a trace |
//! | [`contour`], [`map`] | outlines of objects, and maps from several whiskers |
//! | [`plausibility`] | tests of a trace that a wrong unit, sign or rate would break |
//! | [`results`] | files of a run, the only input of the crate `report` |
//!
//! [`fit`], [`evaluate`], [`participant`], [`plausibility`], [`baseline`] and most of [`space`] belong to the feature `evaluation`, which
//! is on by default. Without it the crate replays and scores single traces, as the Python package does, and builds in less time.
//!
//! # Example
//! A sweep over a pin is replayed through the filter `ekf` and scored. The data are two short golden traces of the simulator; for
//! brevity they serve as calibration too, where a suite has calibration traces of its own.
//!
//! ```
//! use std::path::Path;
//!
//! use files::sha256;
//! use indicatif::ProgressBar;
//! use testbed::dataset::Dataset;
//! use testbed::evaluate::{EvaluateSettings, evaluate};
//! use testbed::fit::{FitSettings, Models, fit};
//! use testbed::front_end::FrontEndConfig;
//! use testbed::metrics::error;
//! use trace::{Role, Trace};
//!
//! # fn main() -> anyhow::Result<()> {
//! // Data: traces with their ground truth, by role.
//! let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
//! let folder = tempfile::tempdir()?;
//! let uses = [
//!     ("golden_pin", "pin", Role::Trial),
//!     ("golden_pin", "grid_0", Role::Calibration),
//!     ("golden_circle", "grid_1", Role::Calibration),
//! ];
//! for (of, name, role) in uses {
//!     let mut trace = Trace::read(&golden.join(of).with_extension("csv"))?;
//!     (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), role, None);
//!     trace.sidecar.csv_sha256 = sha256(trace.to_csv());
//!     trace.write(folder.path())?;
//! }
//! let dataset = Dataset::open(folder.path(), None)?;
//!
//! // Calibration: the elastica with fitted parameters.
//! let models = Models::One { kind: "elastica".into(), config: serde_json::json!({}) };
//! let front_end = FrontEndConfig::default();
//! let settings = FitSettings { models, noise: 0.01, seed: 1, front_end, sensors: Vec::new() };
//! fit(&dataset, &settings, &dataset.calibrations("white"), &ProgressBar::hidden())?;
//!
//! // Replay with 1 % measurement noise, and scores.
//! let settings = EvaluateSettings {
//!     name: "golden".into(),
//!     estimators: Some(vec!["ekf".into()]),
//!     noise: vec![0.01],
//!     seeds: vec![1],
//!     results: folder.path().join("results"),
//!     ..Default::default()
//! };
//! let evaluated = evaluate(&[dataset], &settings, &ProgressBar::hidden())?;
//!
//! // Answer: the error of the contact since its start.
//! let rmse_m = evaluated.summary[0].get(&error::START_RMSE).expect("the filter estimates the contact");
//! println!("RMSE {:.2} mm", 1e3 * rmse_m);
//! assert!(rmse_m < 1e-3);
//! # Ok(())
//! # }
//! ```

#[cfg(feature = "evaluation")]
pub mod baseline;
pub mod bound;
pub mod consistency;
pub mod contact_events;
pub mod contour;
pub mod dataset;
#[cfg(feature = "evaluation")]
mod distinct;
pub mod encoders;
#[cfg(feature = "evaluation")]
pub mod evaluate;
#[cfg(feature = "evaluation")]
pub mod fit;
pub mod fitted_traces;
pub mod front_end;
#[cfg(feature = "evaluation")]
mod glitches;
pub mod map;
pub mod metrics;
pub mod miscalibration;
pub mod noise;
#[cfg(feature = "evaluation")]
pub mod participant;
#[cfg(feature = "evaluation")]
pub mod plausibility;
pub mod provenance;
pub mod replay;
pub mod results;
pub mod seeds;
pub mod settings;
pub mod space;
pub mod statistics;
