//! Digital filters evaluated sample by sample: Butterworth designs as cascades of second-order sections.
//!
//! These are filters of signals; the crate `filters` contains Bayesian filters of states.
//!
//! # Example
//!
//! The noise of a force sensor above 5 Hz is removed; the sampling rate is 250 Hz. The filter is initialised in the
//! steady state of a constant input, so that the constant itself causes no transient. The noise gain is the standard
//! deviation of the output if the input is white noise of unit standard deviation.
//!
//! ```
//! use signal::{Cascade, low_pass};
//!
//! let mut filter = Cascade::new(low_pass(2, 5.0, 250.0)?);
//! let gain = filter.noise_gain(1);
//! // Alternating disturbance of amplitude 1 on a constant force of 3.
//! let force = |sample: i32| 3.0 + if sample % 2 == 0 { 1.0 } else { -1.0 };
//! filter.settle(3.0);
//! let filtered: Vec<f64> = (0..250).map(|sample| filter.step(force(sample))).collect();
//! // After the transient of the disturbance, the force remains.
//! assert!(filtered[125..].iter().all(|value| (value - 3.0).abs() < 1e-3));
//! assert!(gain < 0.3);
//! # Ok::<(), signal::NoSuchBand>(())
//! ```

mod butterworth;
mod cascade;

pub use butterworth::{NoSuchBand, band_pass, low_pass};
pub use cascade::{Cascade, Section};

/// Longest gap between samples that is bridged by linear interpolation (s); after a longer one a filter restarts.
pub const LONGEST_GAP_S: f64 = 0.5;
