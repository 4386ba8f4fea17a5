//! Events of a stream that a user has to know of.

use std::fmt;

use crate::clock::Jump;
use crate::motion::Deviation;
use crate::samples::Lack;

/// Largest plausible speed of a base (m/s).
pub(crate) const MOST_SPEED_M_S: f64 = 5.0;

/// Largest plausible rate of rotation of a base (rad/s).
pub(crate) const MOST_RATE_RAD_S: f64 = 100.0;

/// Advice if times are in milliseconds.
pub(crate) const SECONDS: &str = "state them in seconds";

/// Kind of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Readings of the sensor.
    Readings,
    /// Poses of the base.
    Poses,
}

impl fmt::Display for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Readings => "readings",
            Self::Poses => "poses",
        })
    }
}

/// Event of a stream. It is displayed as what was found and what was expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// There is no pose of the base at the time of a reading; there are no estimates until [`Self::Recovered`].
    Stale {
        /// Time of the first reading without a pose.
        t_s: f64,
        /// Time of the newest pose.
        newest_pose_s: Option<f64>,
        /// Why the poses do not determine it. `None`: none of its time or later arrived in time.
        lack: Option<Lack>,
    },
    /// The poses of the base lie outside the plane of the estimator; there are no estimates until [`Self::Recovered`].
    OffPlane {
        /// Time of the first such reading.
        t_s: f64,
        /// Its deviation.
        deviation: Deviation,
    },
    /// Poses arrive in time again, in the plane.
    Recovered {
        /// Time of the first reading with a pose.
        t_s: f64,
    },
    /// The readings stay the same although the touched whisker moves; there are no estimates until [`Self::Thawed`].
    Frozen {
        /// Time of the reading at which this is found.
        t_s: f64,
        /// Time of the first equal reading.
        first_s: f64,
        /// Number of equal readings.
        count: u32,
        /// Way of the middle of the whisker since the first one (m).
        way_m: f64,
    },
    /// The readings change again.
    Thawed {
        /// Time of the first other reading.
        t_s: f64,
    },
    /// The base moves implausibly fast, for the third time since the start of the estimator: single poses may be wrong.
    Fast {
        /// Time of the reading.
        t_s: f64,
        /// Mean speed of the base in the last 20 ms or more.
        speed_m_s: f64,
        /// Mean rate of its rotation.
        rate_rad_s: f64,
    },
    /// The clock of a stream jumped; the estimator restarted.
    Jumped {
        /// The stream.
        stream: Stream,
        /// Its jump.
        jump: Jump,
        /// Whether this jump and most others were by about a thousand nominal intervals, as if times were in milliseconds.
        in_milliseconds: bool,
    },
    /// A message has a value that is not finite.
    NotFinite {
        /// The stream.
        stream: Stream,
        /// Time of the message, which may be the value.
        t_s: f64,
    },
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stale { t_s, newest_pose_s, lack: None } => {
                write!(
                    f,
                    "stale poses: found none at or after the reading of {t_s} s within --wait (wait_s of a mapping)"
                )?;
                if let Some(newest_s) = newest_pose_s {
                    write!(f, ", the newest of {newest_s} s")?;
                }
                f.write_str("; there are no estimates until poses arrive again")
            }
            Self::Stale { t_s, lack: Some(Lack::Gap { before_s, after_s }), .. } => write!(
                f,
                "stale poses: found those before and after the reading of {t_s} s {:.3} s apart, more than --gap (gap_s of a mapping); \
                 there are no estimates until poses arrive at shorter intervals",
                after_s - before_s
            ),
            Self::Stale { t_s, lack: Some(Lack::BeforeAll { first_s }), .. } => write!(
                f,
                "stale poses: found none before the reading of {t_s} s, the first of {first_s} s; there are no estimates until readings \
                 have later times. If they never do, compare the clocks of readings and poses"
            ),
            Self::OffPlane { t_s, deviation: Deviation { tilt_rad, height_m } } => write!(
                f,
                "pose off the plane: found a tilt of {tilt_rad:.4} rad and a distance of {height_m:.4} m at {t_s} s, beyond \
                 the tolerance; there are no estimates until it returns"
            ),
            Self::Fast { t_s, speed_m_s, rate_rad_s } => write!(
                f,
                "poses: found a base that moves at {speed_m_s:.3} m/s and turns at {rate_rad_s:.3} rad/s at {t_s} s, expected at most \
                 {MOST_SPEED_M_S} m/s and {MOST_RATE_RAD_S} rad/s; compare the units, metres, radians and seconds"
            ),
            Self::Frozen { t_s, first_s, count, way_m } => write!(
                f,
                "frozen readings: found {count} equal ones from {first_s} s to {t_s} s, while the touched whisker moves by {:.3} mm, \
                 expected readings that change; the sensor or its driver has stopped, or it is saturated; there are no estimates until \
                 they change again",
                1e3 * way_m
            ),
            Self::Thawed { t_s } => write!(f, "readings change again, from {t_s} s on"),
            Self::Recovered { t_s } => write!(f, "poses arrive again, from {t_s} s on"),
            Self::Jumped { stream, jump, in_milliseconds } => {
                write!(f, "clock of the {stream}: {jump}, expected an equal step; the estimator restarts")?;
                if *in_milliseconds {
                    write!(
                        f,
                        ". The jump is about 1000 times the interval of rate_hz: the times look like milliseconds; {SECONDS}"
                    )?;
                }
                Ok(())
            }
            Self::NotFinite { stream, t_s } => write!(
                f,
                "{stream}: found a value that is not finite at {t_s} s, expected finite numbers; the message is left out"
            ),
        }
    }
}
