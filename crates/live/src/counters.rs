//! Counts of the messages of one whisker.

use std::fmt;

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
    /// Readings whose base moves faster than any robot.
    pub fast: u64,
    /// Readings beyond the largest plausible one.
    pub gated: u64,
    /// Readings and poses with a value that is not finite.
    pub not_finite: u64,
    /// Jumps of a clock, each with a restart of the estimator.
    pub jumps: u64,
}

impl Counters {
    /// Names and values.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64)> + use<> {
        let Self { readings, poses, matched, touching, estimates, missing, overtaken, late, repeated, stale, .. } =
            *self;
        let Self { stale_intervals, off_plane, fast, gated, not_finite, jumps, .. } = *self;
        [
            ("readings", readings),
            ("poses", poses),
            ("matched", matched),
            ("touching", touching),
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
            ("not_finite", not_finite),
            ("jumps", jumps),
        ]
        .into_iter()
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
            (self.fast, "with an implausibly fast base"),
            (self.gated, "gated"),
            (self.not_finite, "not finite"),
            (self.jumps, "jumps of a clock"),
        ];
        rest.into_iter().filter(|(count, _)| *count > 0).try_for_each(|(count, of)| write!(f, ", {count} {of}"))
    }
}
