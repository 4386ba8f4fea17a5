//! Errors of fitting and using a calibration.

/// Error of a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A setting is out of range.
    #[error("{key}: found {found}, expected {expected}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its value.
        found: f64,
        /// Expected range.
        expected: String,
    },
    /// Recordings of one calibration have different rates.
    #[error("{log}: found {found_hz:.1} samples a second, expected {expected_hz:.1} as in the others, to 5 %")]
    Rate {
        /// The recording.
        log: String,
        /// Its sampling rate (Hz).
        found_hz: f64,
        /// Median rate of all recordings (Hz).
        expected_hz: f64,
    },
    /// The times of a recording have no rate.
    #[error("{log}: found {found}, expected increasing times")]
    Times {
        /// The recording.
        log: String,
        /// Property of the times.
        found: String,
    },
    /// A recording is too short to estimate its rate and its noise.
    #[error("{log}: samples: found {found}, expected at least {expected}")]
    Short {
        /// The recording.
        log: String,
        /// Number of samples.
        found: usize,
        /// Smallest number.
        expected: usize,
    },
    /// Too few labelled presses for the regression.
    #[error("regression `{regression}`: found {found} labelled presses to fit, expected at least {expected}")]
    Few {
        /// Name of the regression.
        regression: &'static str,
        /// Number of labelled presses.
        found: usize,
        /// Smallest number.
        expected: usize,
    },
    /// All labelled presses are at one place.
    #[error("regression `{regression}`: found all labelled presses at {:.1} mm, expected several places", 1e3 * distance_m)]
    OnePlace {
        /// Name of the regression.
        regression: &'static str,
        /// The place (m).
        distance_m: f64,
    },
    /// Samples are too far apart for the low-pass.
    #[error("{log}: found a sample every {interval_s} s, expected one every {expected_s:.3} s at least{hint}")]
    Slow {
        /// The recording.
        log: String,
        /// Mean interval between samples (s).
        interval_s: f64,
        /// Half a period of the low-pass's edge (s).
        expected_s: f64,
        /// Probable cause.
        hint: &'static str,
    },
    /// Samples are closer together than those of any magnetometer.
    #[error("{log}: found {found_hz:.0} samples a second, expected at most {most_hz}; compare the unit of the times")]
    Fast {
        /// The recording.
        log: String,
        /// Its sampling rate (Hz).
        found_hz: f64,
        /// Highest sampling rate (Hz).
        most_hz: f64,
    },
    /// The regression uses a feature that a press does not have.
    #[error("regression `{regression}`: press {press} has no {feature}")]
    Feature {
        /// Name of the regression.
        regression: &'static str,
        /// The feature.
        feature: &'static str,
        /// Number of the press, from 1.
        press: usize,
    },
    /// The regression uses the true distance, which is unknown at run time.
    #[error(
        "regression `{0}` uses the true distance, which is unknown at run time: it can be cross-validated, not used"
    )]
    Leaks(&'static str),
    /// The presses do not determine the regression.
    #[error("regression `{0}`: the presses do not determine it; their slopes or distances must differ")]
    Undetermined(&'static str),
}
