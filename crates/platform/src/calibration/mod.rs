//! Estimation of the radial distance of a contact from the samples of a magnetometer.
//!
//! Samples are unwrapped, low-passed and segmented into [`Press`]es ([`Chain`]), each with its [`Features`]. A
//! [`regression`] estimates the distance from the features. Fit and live inference run the same code, sample by sample.
//! The filter is causal in both, so its delay and damping are part of the calibration; only the onset of a contact is
//! corrected by the filter's delay. The published pipeline, with a zero-phase filter, is in [`published`].
//!
//! A fit reads [`logs`] and returns a [`Calibration`], which is applied live. `docs/PLATFORM.md` states its accuracy.

mod coefficients;
mod cross_validation;
mod error;
mod features;
mod file;
mod front;
mod learn;
mod least_squares;
mod live;
pub mod logs;
mod press;
pub mod published;
mod ramp;
mod rate;
pub mod regression;
mod unwrap;

pub use cross_validation::{CrossValidation, HeldOut, HoldOut, LARGEST_SCORE, Progress, cross_validate, no_progress};
pub use error::Error;
pub use features::{Features, LabelledPress};
pub use file::{Calibration, Estimate, KIND, Scores};
pub use front::Chain;
pub use learn::{Settings, learn};
pub use live::{Detection, Live};
pub use press::{Event, Press, Presses};
pub use rate::{Intervals, Rate, is_same_rate};
pub use unwrap::Unwrapped;
