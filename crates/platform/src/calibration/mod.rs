//! From a magnetometer's samples to the radial distance at which a whisker is touched.
//!
//! Samples are unwrapped and low-passed ([`Chain`]), the stream comes apart into [`Press`]es, each with its [`Features`], and a
//! [`regression`] says the distance. The fit runs the same code over a recording, sample by sample, that runs live: the filter
//! is causal in both, so that its delay and damping are in the calibration and nothing is left to compensate but the time of a contact, from which the
//! filter's delay is taken. A filter of zero phase, which the published pipeline uses for its fit alone, stands in [`published`].
//!
//! What a fit takes in are [`logs`]; what comes of it, and is used live, is a [`Calibration`]. `docs/PLATFORM.md` has figures.

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
mod rate;
pub mod regression;
mod unwrap;

pub use cross_validation::{CrossValidation, HeldOut, HoldOut, LARGEST_SCORE, cross_validate};
pub use error::Error;
pub use features::{Features, LabelledPress};
pub use file::{Calibration, Estimate, KIND, Scores};
pub use front::Chain;
pub use learn::{Settings, learn};
pub use live::{Detection, Live};
pub use press::{Event, Press, Presses};
pub use rate::{Rate, is_same_rate};
pub use unwrap::Unwrapped;
