//! Counts of the messages of one whisker.

use std::fmt;

use crate::event::SECONDS;

/// Number of readings in contact below which their estimates are not judged: an estimator may wait at the beginning of a touch.
const FEW: u64 = 50;

/// Time between two readings (s) from which on they are implausibly slow: sensors of whiskers are read tens to thousands of times a
/// second, and within this time a contact begins and ends unseen.
pub(crate) const SLOW_STEP_S: f64 = 0.5;

/// Number of jumps by about a thousand nominal intervals from which on times look like milliseconds.
const THOUSANDFOLD_JUMPS: u64 = 3;

/// Counts of messages and of what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Readings that arrived.
    pub readings: u64,
    /// Poses that arrived.
    pub poses: u64,
    /// Readings given to the estimator with their pose.
    pub matched: u64,
    /// Those of them at which the whisker touches.
    pub touching: u64,
    /// Those of these without an estimate.
    pub unanswered: u64,
    /// Estimates of a contact.
    pub estimates: u64,
    /// Readings that the nominal rate leads to expect and that did not arrive in time.
    pub missing: u64,
    /// Readings and poses that were overtaken by later ones and could still be used.
    pub overtaken: u64,
    /// Readings and poses that arrived too late to be used.
    pub late: u64,
    /// Readings and poses whose time had arrived before.
    pub repeated: u64,
    /// Readings without a pose in time.
    pub stale: u64,
    /// Intervals without poses in time.
    pub stale_intervals: u64,
    /// Readings whose pose lies outside the plane.
    pub off_plane: u64,
    /// Intervals of 20 ms or more in which the base moves implausibly fast.
    pub fast: u64,
    /// Readings beyond the largest plausible one.
    pub gated: u64,
    /// Readings that stay the same although the touched whisker moves.
    pub frozen: u64,
    /// Readings and poses with a value that is not finite.
    pub not_finite: u64,
    /// Jumps of a clock, each with a restart of the estimator.
    pub jumps: u64,
    /// Jumps by about a thousand nominal intervals between readings; `jumps` includes them.
    pub thousandfold: u64,
    /// Readings half a second or more after the one before, at a nominal rate that implies such steps.
    pub slow: u64,
}

impl Counters {
    /// Names and values.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64)> + use<> {
        let Self { readings, poses, matched, touching, unanswered, estimates, missing, overtaken, late, .. } = *self;
        let Self { repeated, stale, stale_intervals, off_plane, fast, gated, frozen, not_finite, jumps, slow, .. } =
            *self;
        [
            ("readings", readings),
            ("poses", poses),
            ("matched", matched),
            ("touching", touching),
            ("unanswered", unanswered),
            ("estimates", estimates),
            ("missing", missing),
            ("overtaken", overtaken),
            ("late", late),
            ("repeated", repeated),
            ("stale", stale),
            ("stale_intervals", stale_intervals),
            ("off_plane", off_plane),
            ("fast", fast),
            ("gated", gated),
            ("frozen", frozen),
            ("not_finite", not_finite),
            ("jumps", jumps),
            ("slow", slow),
        ]
        .into_iter()
    }

    /// Whether times look like milliseconds: most jumps of the clocks are by about a thousand nominal intervals, and there are several;
    /// one may be due to a clock that was set.
    pub(crate) fn shows_milliseconds(&self) -> bool {
        self.thousandfold >= THOUSANDFOLD_JUMPS && 2 * self.thousandfold > self.jumps
    }

    /// Remarks on numbers that suggest wrong readings, poses or settings.
    pub fn remarks(&self) -> Vec<String> {
        let Self {
            readings, matched, touching, unanswered, gated, missing, slow, late, repeated, stale, frozen, ..
        } = *self;
        let mut remarks = Vec::new();
        if self.shows_milliseconds() {
            remarks.push(format!(
                "the clocks have made {} jumps of about 1000 times the interval of rate_hz: the times look like milliseconds; {SECONDS}",
                self.thousandfold
            ));
        }
        // Late and repeated poses are counted too.
        let unused = readings.saturating_sub(matched);
        if 2 * unused.min(late + repeated + stale) > readings {
            remarks.push(format!(
                "{matched} of {readings} readings were given to the estimator; {stale} had no pose in time, and {late} readings and poses \
                 were late and {repeated} repeated; compare the clocks of readings and poses"
            ));
        }
        if 2 * gated > matched {
            remarks.push(format!(
                "{gated} of {matched} readings are gated, beyond the largest plausible one; compare the unit of the readings"
            ));
        } else if touching >= FEW && 2 * unanswered > touching {
            remarks.push(format!(
                "{unanswered} of {touching} readings in contact have no estimate: they contradict the calibration, or their contacts \
                 lie outside it; compare units, signs and frames of readings and poses, and the calibrated faces"
            ));
        }
        if frozen > 0 {
            remarks.push(format!(
                "{frozen} of {readings} readings stay the same although the touched whisker moves, and were left out; check the bus and \
                 the driver of the sensor, and whether it saturates"
            ));
        }
        if 2 * missing > readings {
            remarks.push(format!(
                "{missing} readings are missing, {readings} arrived; compare rate_hz with the times of the readings"
            ));
        }
        if 2 * slow > readings {
            remarks.push(format!(
                "{slow} of {readings} readings are {SLOW_STEP_S} s or more apart, in agreement with rate_hz; check that times are in \
                 seconds and rate_hz in hertz"
            ));
        }
        remarks
    }
}

impl fmt::Display for Counters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { readings, poses, matched, touching, estimates, .. } = self;
        write!(
            f,
            "{readings} readings, {poses} poses, {matched} readings with a pose, {touching} of them in contact, {estimates} estimates"
        )?;
        let rest = [
            (self.missing, "missing"),
            (self.overtaken, "overtaken"),
            (self.late, "late"),
            (self.repeated, "repeated"),
            (self.stale, "without a pose in time"),
            (self.off_plane, "with a pose off the plane"),
            (self.fast, "intervals with an implausibly fast base"),
            (self.gated, "gated"),
            (self.frozen, "frozen"),
            (self.not_finite, "not finite"),
            (self.jumps, "jumps of a clock"),
        ];
        rest.into_iter().filter(|(count, _)| *count > 0).try_for_each(|(count, of)| write!(f, ", {count} {of}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_numbers_that_suggest_wrong_inputs_are_remarked() {
        let good = Counters {
            readings: 500,
            matched: 490,
            touching: 200,
            unanswered: 90,
            missing: 20,
            gated: 3,
            slow: 2,
            ..Default::default()
        };
        assert_eq!(good.remarks(), [""; 0]);
        assert_eq!(Counters { jumps: 2, thousandfold: 2, ..good }.remarks(), [""; 0]);
        assert_eq!(Counters { jumps: 8, thousandfold: 4, ..good }.remarks(), [""; 0]);
        for (counters, words) in [
            (Counters { gated: 300, unanswered: 200, ..good }, "300 of 490 readings are gated"),
            (Counters { unanswered: 101, ..good }, "101 of 200 readings in contact have no estimate"),
            (Counters { missing: 300, ..good }, "300 readings are missing, 500 arrived"),
            (Counters { slow: 300, ..good }, "300 of 500 readings are 0.5 s or more apart"),
            (
                Counters { jumps: 300, thousandfold: 300, ..good },
                "300 jumps of about 1000 times the interval of rate_hz",
            ),
            (Counters { jumps: 3, thousandfold: 3, ..good }, "3 jumps of about 1000 times the interval of rate_hz"),
            (Counters { frozen: 20, ..good }, "20 of 500 readings stay the same"),
            (Counters { matched: 200, late: 280, ..good }, "200 of 500 readings were given to the estimator"),
            (
                Counters { matched: 0, touching: 0, unanswered: 0, stale: 500, gated: 0, ..good },
                "500 had no pose in time",
            ),
            (Counters { matched: 100, touching: 0, unanswered: 0, repeated: 900, ..good }, "and 900 repeated"),
        ] {
            let remarks = counters.remarks();
            assert!(remarks.len() == 1 && remarks[0].contains(words), "{remarks:?}");
        }
        assert_eq!(Counters { touching: 40, unanswered: 40, ..good }.remarks(), [""; 0], "a short touch");
    }
}
