//! Digital filters that run sample by sample: Butterworth designs as cascades of second-order sections.
//!
//! ```
//! use signal::{Cascade, low_pass};
//!
//! // A step through a second-order low-pass of 5 Hz, sampled at 250 Hz, settles at its height.
//! let mut filter = Cascade::new(low_pass(2, 5.0, 250.0)?);
//! let settled = (0..250).map(|_| filter.step(3.0)).last();
//! assert!((settled.unwrap() - 3.0).abs() < 1e-6);
//! # Ok::<(), signal::NoSuchBand>(())
//! ```

mod butterworth;
mod cascade;

pub use butterworth::{NoSuchBand, band_pass, low_pass};
pub use cascade::{Cascade, Section};

/// Longest gap between samples that is bridged by linear interpolation (s); after a longer one a filter starts anew.
pub const LONGEST_GAP_S: f64 = 0.5;
