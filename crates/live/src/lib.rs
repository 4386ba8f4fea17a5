//! Contact estimation on streams: readings and poses that arrive independently, late, twice, in another order, or not at all.
//!
//! ```text
//! readings, poses -> order and jumps of their clocks -> matching by time -> estimator -> one answer to each reading
//! ```
//!
//! The crate accesses no files, threads, clocks or devices: each message is passed with the time of its arrival. Samples, contact
//! detection and estimators are those of [`testbed::replay`]; a stream without delays has the estimates of a replay.
//!
//! | item | contents |
//! | --- | --- |
//! | [`LiveEstimator`] | estimator of one whisker on its streams |
//! | [`Kind`], [`Planar`], [`Spatial`] | estimators of the plane and of space |
//! | [`Motion`], [`Poses`], [`SpatialPoses`] | motion of the base between its measurements |
//! | [`Samples`] | values over time and their interpolation |
//! | [`counts`] | conversion of the counts of a sensor to readings |
//! | [`Timing`] | longest waits and gaps, smallest jump of a clock |
//! | [`Counters`], [`Event`], [`Status`] | what happened to the messages |
//! | [`play()`], [`Disturbance`] | recordings as streams, with lost, delayed and swapped messages |
//! | [`wire`] | messages as JSON lines |
//!
//! # Example
//! A golden trace arrives as two streams, of which 5 % are lost. The contacts are estimated by the filter `ekf` and compared
//! with the truth. For brevity the trace serves as calibration too.
//!
//! ```
//! use std::path::Path;
//!
//! use indicatif::ProgressBar;
//! use live::{Disturbance, LiveEstimator, Timing, messages, play};
//! use testbed::dataset::Dataset;
//! use evaluation::fit::{FitSettings, Models, fit};
//! use testbed::front_end::FrontEndConfig;
//! use testbed::replay::{estimator, knowledge};
//! use trace::{CalibrationFile, Role, Trace};
//! use whisker::events::TouchConfig;
//!
//! # fn main() -> anyhow::Result<()> {
//! let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
//! let folder = tempfile::tempdir()?;
//! for name in ["golden_pin", "golden_circle"] {
//!     let mut trace = Trace::read(&golden.join(name).with_extension("csv"))?;
//!     (trace.sidecar.role, trace.sidecar.contour) = (Role::Calibration, None);
//!     trace.write(folder.path())?;
//! }
//! let dataset = Dataset::open(folder.path(), None)?;
//! let models = Models::One { kind: "elastica".into(), config: serde_json::json!({}) };
//! let front_end = FrontEndConfig::default();
//! let settings = FitSettings { models, noise: 0.01, seed: 1, front_end, sensors: Vec::new() };
//! let calibrations = dataset.calibrations("white");
//! fit(&dataset, &settings, &calibrations, &ProgressBar::hidden())?;
//!
//! // Prior information, and a builder of the estimator.
//! let trace = Trace::read(&golden.join("golden_pin.csv"))?;
//! let path = calibrations.join(format!("{}.json", trace.sidecar.whisker.name));
//! let faces = CalibrationFile::read(&path)?.calibrated(&path, None)?;
//! let knowledge = knowledge(&trace.sidecar, &faces, 1e-7);
//! let row = whisker::estimators::estimator("ekf").expect("a registered estimator");
//! let prior = knowledge.clone();
//! let build = move || estimator(row, &(row.defaults)(), TouchConfig::default(), &prior, "golden_pin", 1);
//!
//! // Streams of readings and poses.
//! let readings: Vec<f64> = trace.recording.instants.iter().map(|instant| instant.moment_z_n_m).collect();
//! let disturbance = Disturbance { lost: 0.05, ..Disturbance::default() };
//! let messages = messages(&[(&trace.recording, &readings)], &disturbance, 1);
//!
//! let mut live = [LiveEstimator::new(Box::new(build), &knowledge, false, Timing::default())?];
//! let mut contacts = Vec::new();
//! play(&mut live, &messages, |_| true, |_, out| {
//!     let estimates = out.answers.drain(..);
//!     contacts.extend(estimates.filter_map(|answer| Some((answer.t_s, answer.base?.apply(answer.estimate?.contact)))));
//!     Ok(())
//! })?;
//!
//! let (t_s, last) = contacts.last().expect("the whisker touches");
//! let row = trace.recording.instants.iter().position(|instant| instant.t_s == *t_s).expect("a time of the trace");
//! let error_m = trace.truth.instants[row].contact.expect("it touches until the end").distance(last);
//! assert!(error_m < 1e-3 && live[0].counters().missing > 0, "{error_m} m");
//! # Ok(())
//! # }
//! ```

mod clock;
mod counters;
pub mod counts;
mod disturbance;
mod estimator;
mod event;
mod frozen;
mod kind;
mod matching;
mod motion;
mod play;
mod poses;
mod samples;
mod timing;
pub mod wire;

use strict_json::shown_number;

pub use clock::{Clock, Jump, Order};
pub use counters::Counters;
pub use disturbance::Disturbance;
pub use estimator::{
    Answer, AnswerOf, Build, LiveEstimator, Output, OutputOf, SpatialAnswer, SpatialBuild, SpatialOutput, Status,
};
pub use event::{Event, Stream};
pub use kind::{Kind, Planar, Spatial, Way};
pub use motion::{Deviation, Motion, Place};
pub use play::{Content, Message, SpatialMessage, messages, messages_in_space, play};
pub use poses::{Posed, Poses, SpatialPoses};
pub use samples::{Lack, Sampled, Samples};
pub use timing::Timing;

/// Standard deviation of the noise (N m) of a stream: the stated one, but at least that of the sensor in the calibration. With
/// less, a filter becomes certain of a wrong contact. `None` if neither is known.
pub fn noise_n_m(stated: Option<f64>, of_sensor: Option<f64>) -> Option<f64> {
    match (stated, of_sensor) {
        (Some(stated), Some(of_sensor)) => Some(stated.max(of_sensor)),
        (stated, of_sensor) => stated.or(of_sensor),
    }
}

/// Checks the standard deviation of the noise (N m) that is stated for a stream, if there is one. It must not exceed the largest
/// calibrated reading: otherwise no reading would be informative. It must be above zero unless that of the sensor, `of_sensor`,
/// is: a filter without noise becomes certain of a wrong contact.
///
/// # Errors
/// The text found and the text expected.
pub fn check_noise(stated: Option<f64>, of_sensor: Option<f64>, largest_n_m: f64) -> Result<(), (String, String)> {
    let is_known = of_sensor.is_some_and(|sd_n_m| sd_n_m > 0.0);
    let is_valid = |sd_n_m: f64| (sd_n_m > 0.0 || sd_n_m == 0.0 && is_known) && sd_n_m <= largest_n_m;
    match stated.filter(|sd_n_m| !is_valid(*sd_n_m)) {
        None => Ok(()),
        Some(sd_n_m) => {
            let expected =
                format!("more than 0, at most {largest_n_m:.3e} N m, the largest reading of the calibration");
            Err((shown_number(sd_n_m), expected))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_stated_noise_is_above_zero_and_at_most_the_largest_calibrated_reading() {
        for (stated_n_m, of_sensor) in [(None, None), (Some(1e-9), None), (Some(0.02), None), (Some(0.0), Some(1e-9))] {
            assert_eq!(check_noise(stated_n_m, of_sensor, 0.02), Ok(()));
        }
        for (stated_n_m, found) in [(-1.0, "-1"), (0.0, "0"), (0.5, "0.5"), (f64::NAN, "NaN")] {
            let expected = "more than 0, at most 2.000e-2 N m, the largest reading of the calibration";
            assert_eq!(check_noise(Some(stated_n_m), Some(0.0), 0.02), Err((found.into(), expected.into())));
        }
    }

    #[test]
    fn verif_the_noise_of_a_stream_is_at_least_that_of_its_sensor() {
        for (stated, of_sensor, noise) in [
            (None, None, None),
            (Some(2.0), None, Some(2.0)),
            (None, Some(1.0), Some(1.0)),
            (Some(0.0), Some(1.0), Some(1.0)),
            (Some(2.0), Some(1.0), Some(2.0)),
        ] {
            assert_eq!(noise_n_m(stated, of_sensor), noise);
        }
    }
}
