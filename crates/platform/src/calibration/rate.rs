//! Sampling rate of a stream by the times of its samples.

use signal::LONGEST_GAP_S;

/// Largest relative difference of two equal rates. Slopes are proportional to the rate, and the relative error of a
/// distance is about that of its slope.
const SHARE: f64 = 0.05;

/// Estimator of the sampling rate, without gaps.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate {
    last_s: Option<f64>,
    steps: u64,
    time_s: f64,
}

impl Rate {
    /// Adds the time of the next sample (s).
    pub fn step(&mut self, t_s: f64) {
        let step_s = t_s - self.last_s.replace(t_s).unwrap_or(f64::NAN);
        if (0.0..=LONGEST_GAP_S).contains(&step_s) {
            self.steps += 1;
            self.time_s += step_s;
        }
    }

    /// Sampling rate (Hz); not a number, or infinite, if no time has passed.
    pub fn hz(&self) -> f64 {
        self.steps as f64 / self.time_s
    }
}

/// Number of samples by which the unit of times is judged.
const JUDGED: u32 = 100;

/// Smallest ratio of two rates that is due to another unit of the times rather than to another sensor.
const OTHER_UNIT: f64 = 30.0;

/// Mean interval between the first samples of a stream, by which times in milliseconds are recognised: with an interval
/// longer than the longest gap no sample follows another, and no press is ever detected.
#[derive(Clone, Copy, Debug, Default)]
pub struct Intervals {
    last_s: Option<f64>,
    count: u32,
    sum_s: f64,
    longest_s: f64,
}

impl Intervals {
    /// Adds the time of the next sample (s). `true` if it completes the samples by which the unit is judged.
    pub fn step(&mut self, t_s: f64) -> bool {
        if self.count >= JUDGED {
            return false;
        }
        if let Some(last_s) = self.last_s.replace(t_s) {
            self.count += 1;
            self.sum_s += t_s - last_s;
            self.longest_s = self.longest_s.max(t_s - last_s);
        }
        self.count == JUDGED
    }

    /// Mean interval without the longest one, which may be a gap (s). `None` for fewer than three samples.
    pub fn mean_s(&self) -> Option<f64> {
        (self.count > 1).then(|| (self.sum_s - self.longest_s) / f64::from(self.count - 1))
    }

    /// Interval (s) and probable cause, if samples are so far apart that their times have another unit than at this rate (Hz).
    pub fn misread(&self, expected_hz: f64) -> Option<(f64, &'static str)> {
        let interval_s = self.mean_s().filter(|interval_s| interval_s * expected_hz > OTHER_UNIT)?;
        Some((interval_s, hint(interval_s * expected_hz)))
    }
}

/// Probable cause of intervals that are this many times as long as expected.
pub(super) fn hint(ratio: f64) -> &'static str {
    match ratio {
        300.0..3e3 => "; the times look like milliseconds: convert them to seconds",
        3e5..3e6 => "; the times look like microseconds: convert them to seconds",
        3e8..3e9 => "; the times look like nanoseconds: convert them to seconds",
        _ => "; check the unit of the times",
    }
}

/// Whether a calibration at one rate is valid at another.
pub fn is_same_rate(found_hz: f64, expected_hz: f64) -> bool {
    (1.0 - SHARE..=1.0 + SHARE).contains(&(found_hz / expected_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_times_in_another_unit_are_recognised() {
        for (unit, words) in
            [(1.0, None), (1e3, Some("milliseconds")), (1e6, Some("microseconds")), (60.0, Some("unit"))]
        {
            let mut intervals = Intervals::default();
            assert_eq!(intervals.mean_s(), None);
            // Two samples at a time, and a gap of an hour.
            let t_s = |k: u32| unit * (f64::from(k / 2) / 400.0 + if k < 50 { 0.0 } else { 3600.0 });
            let judged = (0..200).filter(|&k| intervals.step(t_s(k))).count();
            assert_eq!(judged, 1);
            let found = intervals.misread(800.0).map(|(_, hint)| hint);
            assert_eq!(found.is_some(), words.is_some(), "{unit}: {found:?}");
            assert!(words.is_none_or(|words| found.is_some_and(|hint| hint.contains(words))), "{unit}: {found:?}");
        }
    }

    #[test]
    fn verif_gaps_and_repeated_times_do_not_change_the_rate() {
        let mut rate = Rate::default();
        assert!(!is_same_rate(rate.hz(), 800.0));
        for k in 0..1000 {
            // Two samples at a time, and an hour between the halves.
            rate.step(f64::from(k / 2) / 400.0 + if k < 500 { 0.0 } else { 3600.0 });
        }
        assert!(is_same_rate(rate.hz(), 800.0) && (rate.hz() - 800.0).abs() < 4.0, "{}", rate.hz());
        assert!(!is_same_rate(rate.hz(), 888.0));
    }
}
