//! Fits of sensor models and evaluations of estimators over whole data sets.
//!
//! ```text
//! calibration traces -> fit -> calibrations/<whisker>.json
//! trials, calibrations -> evaluate -> results/<run>/
//! ```
//!
//! Single traces are replayed and scored by the crate `testbed`, which also defines the files of a run.
//!
//! | module | contents |
//! | --- | --- |
//! | [`fit`] | sensor models fitted to calibration traces |
//! | [`participant`] | what is evaluated: registered estimators and external programs |
//! | [`evaluate`] | every participant on every trial: parallel, resumable, divisible among processes |
//! | [`plausibility`] | tests that detect a wrong unit, sign or rate in a trace |
//! | [`space`] | fits and evaluations of traces in space |
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
//! use evaluation::evaluate::{EvaluateSettings, evaluate};
//! use evaluation::fit::{FitSettings, Models, fit};
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

mod distinct;
pub mod evaluate;
pub mod fit;
mod glitches;
pub mod participant;
pub mod plausibility;
mod provenance;
pub mod remarks;
pub mod space;
