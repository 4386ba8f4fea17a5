//! Means of successive samples, which a method takes as one.
//!
//! As long as the base hardly moves, the reading is a linear function of its pose, and the mean of some readings is that at
//! their mean pose, with their noise averaged out. A step of the filters on the mean costs as much as one on a sample.

use serde::{Deserialize, Serialize};

use super::Sample;
use crate::frames::{Base, Pose, Start};
use crate::settings::{SettingsError, within};

/// Settings of the blocks of samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct BlockSettings {
    /// Largest number of samples of a block. 1: every sample is taken by itself, as hindsight methods do.
    pub samples: u32,
    /// Displacement (m) at which a block ends: that of the base since the mean of the last block, plus the whisker's length times
    /// its turn. It bounds that of the tip of the undeflected whisker.
    pub way_m: f64,
    /// Normalised innovation squared of a block after which samples are taken one by one: the contact may have jumped.
    pub alert_nis: f64,
    /// Normalised innovation squared of a single sample above which the block ends before this sample.
    pub sample_nis: f64,
    /// Time (s) for which samples are then taken one by one, also after a touch.
    pub alert_s: f64,
}

impl Default for BlockSettings {
    /// `way_m` was compared with 0.2 and 2 mm on the standard suite with 25 seeds, and with single samples on the training suite of
    /// random scenes. `alert_nis` was compared with 9 on the standard suite. `sample_nis` is exceeded by chance once in 600
    /// samples. `alert_s` is the time between two searches of a filter.
    fn default() -> Self {
        Self { samples: 8, way_m: 0.5e-3, alert_nis: 6.0, sample_nis: 10.0, alert_s: 0.1 }
    }
}

impl BlockSettings {
    /// Single samples.
    pub(super) fn single() -> Self {
        Self { samples: 1, ..Self::default() }
    }

    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("block.samples", f64::from(self.samples), 1.0..=1000.0)?;
        within("block.way_m", self.way_m, 1e-9..=1e-2)?;
        within("block.alert_nis", self.alert_nis, 1.0..=1e6)?;
        within("block.sample_nis", self.sample_nis, 1.0..=1e6)?;
        within("block.alert_s", self.alert_s, 0.0..=1e3)
    }
}

/// Mean of the samples of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BlockMean {
    /// Motion and time since the last block, both from mean to mean, and mean reading.
    pub(super) sample: Sample,
    /// Number of samples.
    pub(super) count: f64,
    /// Mean pose of the base.
    pub(super) base: Pose<Base, Start>,
}

/// Collects the samples of one touch in blocks. The first samples, from which the belief learns most, are taken one by one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blocks {
    length_m: f64,
    /// Mean pose and mean time of the last block.
    last: (Pose<Base, Start>, f64),
    has_begun: bool,
    /// Time since the touch.
    now_s: f64,
    /// Time at which samples are no longer taken one by one.
    alert_until_s: f64,
    count: f64,
    /// Sums over the samples of the present block: position (m) and yaw (rad) of the base, time (s), reading (N m).
    sums: [f64; 5],
}

impl Blocks {
    /// No samples yet, with the base at a pose before the touch, for a whisker of this length.
    pub(super) fn new(before: Pose<Base, Start>, length_m: f64) -> Self {
        Self {
            length_m,
            last: (before, 0.0),
            has_begun: false,
            now_s: 0.0,
            alert_until_s: 0.0,
            count: 0.0,
            sums: [0.0; 5],
        }
    }

    /// Samples after the first one of the touch, at which the base had this pose, none of which are taken one by one.
    pub(super) fn after(first: Pose<Base, Start>, length_m: f64) -> Self {
        Self { has_begun: true, ..Self::new(first, length_m) }
    }

    /// Takes a sample, with the base's pose at it. The mean of the block that it ends.
    pub(super) fn take(
        &mut self,
        settings: &BlockSettings,
        base: &Pose<Base, Start>,
        sample: &Sample,
    ) -> Option<BlockMean> {
        self.now_s += sample.dt_s;
        if !self.has_begun {
            self.alert(settings);
        }
        self.count += 1.0;
        let values = [base.origin().x(), base.origin().y(), base.yaw_rad(), self.now_s, sample.reading_n_m];
        self.sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        let last = self.last.0;
        let turned_m = self.length_m * (base.yaw_rad() - last.yaw_rad()).abs();
        let goes_on = self.has_begun
            && self.count < f64::from(settings.samples)
            && last.origin().distance(&base.origin()) + turned_m < settings.way_m
            && self.now_s >= self.alert_until_s;
        if goes_on { None } else { self.end() }
    }

    /// Time since the mean of the last block. Without blocks it is zero.
    pub(super) fn pending_s(&self) -> f64 {
        self.now_s - self.last.1
    }

    /// Ends the present block. `None` if it has no samples.
    pub(super) fn end(&mut self) -> Option<BlockMean> {
        if self.count == 0.0 {
            return None;
        }
        let (last, last_s) = self.last;
        let count = std::mem::take(&mut self.count);
        let [x_m, y_m, yaw_rad, time_s, reading_n_m] = std::mem::take(&mut self.sums).map(|sum| sum / count);
        let mean = Pose::new(x_m, y_m, yaw_rad);
        (self.has_begun, self.last) = (true, (mean, time_s));
        let sample = Sample { motion: last.then(&mean.inverse()), dt_s: time_s - last_s, reading_n_m };
        Some(BlockMean { sample, count, base: mean })
    }

    /// From now on, takes samples one by one for `alert_s`.
    pub(super) fn alert(&mut self, settings: &BlockSettings) {
        self.alert_until_s = self.now_s + settings.alert_s;
    }

    /// Whether a sample may be combined with others, before it is taken.
    pub(super) fn is_calm(&self, sample: &Sample) -> bool {
        self.has_begun && self.now_s + sample.dt_s >= self.alert_until_s
    }

    /// Reading of a sample not yet taken, with the motion and the time from the last block's mean. `base` is its base pose.
    pub(super) fn since_mean(&self, base: &Pose<Base, Start>, sample: &Sample) -> Sample {
        let (last, last_s) = self.last;
        let dt_s = self.now_s + sample.dt_s - last_s;
        Sample { motion: last.then(&base.inverse()), dt_s, reading_n_m: sample.reading_n_m }
    }
}

/// Samples of the candidates that are improbable at a touch. At its onset, in which the others take samples one by one, these take
/// blocks of any number of samples, and their evidence does not count.
#[derive(Debug)]
pub(super) struct Latecomers {
    is_late: Vec<bool>,
    settings: BlockSettings,
    blocks: Blocks,
    /// Time until the end of the onset.
    left_s: f64,
}

impl Latecomers {
    /// Those among candidates that have taken the first sample of a touch, with the base at a pose, of a whisker of this length.
    pub(super) fn new(is_late: Vec<bool>, settings: &BlockSettings, first: Pose<Base, Start>, length_m: f64) -> Self {
        let settings = BlockSettings { samples: u32::MAX, ..*settings };
        Self { is_late, settings, blocks: Blocks::after(first, length_m), left_s: settings.alert_s }
    }

    /// Whether a candidate is one of them.
    pub(super) fn contain(&self, candidate: usize) -> bool {
        self.is_late[candidate]
    }

    /// Whether the onset goes on at a sample that is the mean of `count`.
    pub(super) fn wait(&self, count: f64) -> bool {
        self.left_s > 0.0 && count == 1.0
    }

    /// Takes a sample of the onset, with the base's pose at it. The mean of the block that it ends.
    pub(super) fn take(&mut self, base: &Pose<Base, Start>, sample: &Sample) -> Option<BlockMean> {
        self.left_s -= sample.dt_s;
        self.blocks.take(&self.settings, base, sample)
    }

    /// At the first sample after the onset, with the base's pose at it: the mean of the samples of the onset that remain, and this
    /// sample with the motion and the time since.
    pub(super) fn end(&mut self, base: &Pose<Base, Start>, sample: &Sample) -> (Option<BlockMean>, Sample) {
        let rest = self.blocks.end();
        (rest, self.blocks.since_mean(base, sample))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: BlockSettings =
        BlockSettings { samples: 4, way_m: 1e-3, alert_nis: 6.0, sample_nis: 10.0, alert_s: 0.015 };

    /// Counts of the blocks that end at the samples of a base that moves by `way_m` a sample; 0 if none ends.
    fn counts(way_m: f64, samples: u32, alerts: impl Fn(u32) -> f64) -> Vec<f64> {
        let mut blocks = Blocks::new(Pose::new(0.0, 0.0, 0.0), 0.08);
        let step = |i: u32| {
            let base = Pose::new(way_m * f64::from(i + 1), 0.0, 0.0);
            let motion = Pose::new(-way_m, 0.0, 0.0);
            let sample = Sample { motion, dt_s: 0.004, reading_n_m: 1e-5 };
            let is_calm = blocks.is_calm(&sample);
            let found = blocks.take(&SETTINGS, &base, &sample);
            assert!(is_calm || found.is_some(), "{i}");
            if alerts(i) > SETTINGS.alert_nis {
                blocks.alert(&SETTINGS);
            }
            found.map_or(0.0, |block| block.count)
        };
        (0..samples).map(step).collect()
    }

    #[test]
    fn verif_a_block_ends_by_number_by_way_and_after_an_outlier() {
        // The first 15 ms are four samples.
        assert_eq!(counts(1e-6, 12, |_| 1.0), [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 4.0]);
        // The way of a block counts from the mean of the one before.
        assert_eq!(counts(0.4e-3, 9, |_| 1.0), [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 3.0, 0.0, 2.0]);
        let alert = |i| if i == 7 { 9.0 } else { 1.0 };
        assert_eq!(counts(1e-6, 12, alert), [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 4.0, 1.0, 1.0, 1.0, 0.0]);
    }

    #[test]
    fn verif_the_motions_from_mean_to_mean_lead_to_the_present_pose() {
        let base = |i: f64| Pose::<Base, Start>::new(1e-5 * i, -2e-5 * i * i, 1e-4 * i);
        let mut blocks = Blocks::new(base(0.0), 0.08);
        let (mut reached, mut time_s) = (base(0.0), 0.0);
        for i in 1..=30 {
            let (before, now) = (base(f64::from(i - 1)), base(f64::from(i)));
            let motion = before.then(&now.inverse());
            let sample = Sample { motion, dt_s: 0.004, reading_n_m: 1e-6 * f64::from(i) };
            let since = blocks.since_mean(&now, &sample);
            let here = since.motion.inverse().then(&reached);
            assert!(here.origin().distance(&now.origin()) < 1e-15 && (here.yaw_rad() - now.yaw_rad()).abs() < 1e-15);
            assert!((time_s + since.dt_s - 0.004 * f64::from(i)).abs() < 1e-15);
            if let Some(block) = blocks.take(&SETTINGS, &now, &sample) {
                reached = block.sample.motion.inverse().then(&reached);
                time_s += block.sample.dt_s;
                assert!(reached.origin().distance(&block.base.origin()) < 1e-15);
                // The reading is linear in time here, as the mean is.
                assert!((block.sample.reading_n_m - 2.5e-4 * time_s).abs() < 1e-15, "{block:?}");
            }
        }
    }

    #[test]
    fn verif_latecomers_take_blocks_from_the_second_sample_to_the_end_of_the_onset() {
        let settings = BlockSettings { alert_s: 0.018, ..SETTINGS };
        let base = |i: u32| Pose::<Base, Start>::new(0.4e-3 * f64::from(i), 0.0, 0.0);
        let sample = |i: u32| Sample { motion: base(i - 1).then(&base(i).inverse()), dt_s: 0.004, reading_n_m: 1e-6 };
        let mut late = Latecomers::new(vec![true, false], &settings, base(0), 0.08);
        assert!(late.contain(0) && !late.contain(1));
        let mut counts = Vec::new();
        let mut reached = base(0);
        for i in 1..=5 {
            assert!(late.wait(1.0) && !late.wait(2.0));
            let found = late.take(&base(i), &sample(i));
            counts.push(found.map_or(0.0, |block| block.count));
            reached = found.map_or(reached, |block| block.sample.motion.inverse().then(&reached));
        }
        // Three samples from the first one on are 1.2 mm.
        assert_eq!(counts, [0.0, 0.0, 3.0, 0.0, 2.0]);
        assert!(!late.wait(1.0) && late.take(&base(6), &sample(6)).is_none());
        let (rest, after) = late.end(&base(7), &sample(7));
        let rest = rest.unwrap();
        assert_eq!(rest.count, 1.0);
        let reached = after.motion.inverse().then(&rest.sample.motion.inverse().then(&reached));
        assert!(reached.origin().distance(&base(7).origin()) < 1e-15 && (after.dt_s - 0.004).abs() < 1e-15);
    }
}
