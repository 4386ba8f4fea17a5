//! The calibration platform: a 3D printer pushes a ruler against a whisker at known places while a magnetometer at the
//! whisker's root is recorded. A regression fitted to these presses estimates the radial distance of later contacts,
//! live.
//!
//! The crate is independent of the estimators of the crate `whisker`: its calibration maps the slope of the
//! magnetometer's counts to a distance, not a contact to a bending moment.
//!
//! [`sensor`] reads the magnetometer, [`printer`] drives the printer, [`routine`] is the sequence of pushes, and
//! [`session`] runs a routine and passes its data to the recordings ([`record`], [`streams`]). [`emulate`] offers both
//! devices on pseudo-terminals, without hardware. [`calibration`] fits and applies the regression; [`inference`]
//! applies it to a live stream and measures its latency.
//!
//! The rig is that of the OpenWhisker platform ("3D Printer Based Open Source Calibration Platform for Whisker
//! Sensors", TAROS 2024).
//!
//! # Example: from presses to a distance with its interval
//!
//! The steepest slopes of sixteen presses at known distances are those of a conical beam on a gel hinge at a constant
//! speed of the ruler, with 1 % of scatter. The regression `beam` is fitted to them. The distance of a new press, with
//! the slope of a contact at 100 mm, is then estimated, with the interval that contains the true distance with a
//! probability of about 90 %. For a press outside the calibrated domain there is no estimate.
//!
//! ```
//! use files::Watermark;
//! use platform::calibration::regression::regression;
//! use platform::calibration::{Calibration, Features, HoldOut, LabelledPress};
//!
//! // Slope (counts/s) of a press at a distance (m).
//! let slope = |distance_m: f64| {
//!     Features::of_slope(4e3 / (distance_m + 6.0 * distance_m.powi(2) / (1.0 - distance_m / 0.19)))
//! };
//! let presses = (0..16).map(|i| {
//!     let distance_m = 0.045 + 0.1 * f64::from(i) / 15.0;
//!     let mut features = slope(distance_m);
//!     features.slope_counts_per_s *= 1.0 + 0.01 * (5.0 * f64::from(i)).sin();
//!     LabelledPress { log: "session".into(), onset_s: None, features, distance_m }
//! });
//! let watermark =
//!     Watermark { tool: "example".into(), version: "1".into(), git_commit: None, inputs_sha256: String::new() };
//! let beam = regression("beam").expect("a name in the registry");
//! let calibration = Calibration::fit(beam, presses.collect(), None, HoldOut::Place, 0.9, watermark)?;
//! assert!(calibration.scores().rmse_m < 1e-3);
//!
//! let estimate = calibration.estimate(&slope(0.1)).expect("inside the calibrated domain");
//! let [low_m, high_m] = estimate.interval_m.expect("enough presses for 90 %");
//! assert!((estimate.distance_m - 0.1).abs() < 1e-3);
//! assert!(low_m < 0.1 && 0.1 < high_m && high_m - low_m < 5e-3);
//! assert_eq!(calibration.estimate(&slope(0.02)), None);
//! # Ok::<(), platform::calibration::Error>(())
//! ```

pub mod calibration;
#[cfg(unix)]
pub mod emulate;
mod error;
pub mod inference;
pub mod interrupt;
mod lines;
mod port;
pub mod printer;
mod range;
pub mod record;
pub mod rig;
pub mod routine;
mod sample;
pub mod sensor;
pub mod session;
pub mod streams;

pub use error::Error;
pub use sample::Sample;
