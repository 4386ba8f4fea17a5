//! Detection of presses: an edge moves against the whisker, rests, and releases it.
//!
//! A press begins when the main axis's slope exceeds the [`Chain`]'s threshold; the sign of the slope is its direction.
//! It is reported when the slope has decreased again, and once more, with updated features, if the edge moves on. It
//! ends when the level has decreased to half its peak and the whisker has then been quiet, without ringing, for a
//! while. The whisker must be free at the beginning of a recording and after a gap.

use super::front::{Front, Motion, Moved};
use super::ramp::Ramps;
use super::{Chain, Error, Features};
use crate::Sample;

/// Hysteresis: the edge has stopped when the slope is below this share of the threshold.
const STILL_SHARE: f64 = 0.5;

/// The whisker is released when the level is below this share of its peak.
const RETURNED_SHARE: f64 = 0.5;

/// A detected press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Press {
    /// Onset of the contact (s), corrected by the delay of the low-pass.
    pub onset_s: f64,
    /// Time of the sample that completed it (s).
    pub t_s: f64,
    /// `1.0` if the counts of the main axis increase, `-1.0` if they decrease.
    pub direction: f64,
    /// Its features.
    pub features: Features,
}

/// Event that a sample completes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The edge pressed and stopped; repeated, with updated features, if it pressed on.
    Pressed(Press),
    /// The edge released the whisker, at this time (s).
    Released(f64),
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Free,
    Touched { press: Press, moving: bool },
    Released { quiet_samples: u32 },
}

/// Detector of presses, sample by sample.
#[derive(Clone, Debug)]
pub struct Presses {
    chain: Chain,
    front: Front,
    ramps: Ramps,
    delay_s: f64,
    quiet_samples: u32,
    rest_counts: f64,
    phase: Phase,
}

impl Presses {
    /// Detector at the start of a stream.
    ///
    /// # Errors
    /// [`Error::Setting`] if the edge of the low-pass is not below half the rate.
    pub fn new(chain: &Chain) -> Result<Self, Error> {
        let front = Front::new(chain.order, chain.cutoff_hz, chain.rate_hz)?;
        Ok(Self {
            ramps: front.ramps(),
            delay_s: front.delay_s(),
            quiet_samples: (chain.quiet_s * chain.rate_hz).round().max(1.0) as u32,
            rest_counts: 0.0,
            phase: Phase::Free,
            chain: chain.clone(),
            front,
        })
    }

    /// Processes the next sample.
    pub fn step(&mut self, sample: &Sample) -> Option<Event> {
        let Moved { anew, axes } = self.front.step(sample);
        let Motion { level_counts, slope_counts_per_s: slope } = axes[self.chain.main_axis];
        let threshold = self.chain.threshold_counts_per_s;
        if anew {
            self.phase = Phase::Free;
            self.rest_counts = level_counts;
        }
        match &mut self.phase {
            Phase::Free if slope.abs() > threshold => {
                let features = Features::of_slope(0.0);
                let direction = slope.signum();
                let press = Press { onset_s: sample.t_s - self.delay_s, t_s: sample.t_s, direction, features };
                self.phase = Phase::Touched { press, moving: true };
                self.step_touched(sample.t_s, &axes)
            }
            Phase::Free => {
                self.rest_counts += (level_counts - self.rest_counts) / f64::from(self.quiet_samples);
                None
            }
            Phase::Touched { .. } => self.step_touched(sample.t_s, &axes),
            Phase::Released { quiet_samples } => {
                *quiet_samples = if slope.abs() > threshold { 0 } else { *quiet_samples + 1 };
                if *quiet_samples >= self.quiet_samples {
                    self.phase = Phase::Free;
                    self.rest_counts = level_counts;
                }
                None
            }
        }
    }

    fn step_touched(&mut self, t_s: f64, axes: &[Motion; 3]) -> Option<Event> {
        let Phase::Touched { press, moving } = &mut self.phase else { return None };
        let Chain { main_axis, second_axis, threshold_counts_per_s: threshold, .. } = self.chain;
        let slope = press.direction * axes[main_axis].slope_counts_per_s;
        if slope > press.features.slope_counts_per_s {
            press.features.slope_counts_per_s = slope;
            press.features.slope_ratio = Some(press.direction * axes[second_axis].slope_counts_per_s / slope);
        }
        let level = press.direction * (axes[main_axis].level_counts - self.rest_counts);
        press.features.peak_counts = Some(press.features.peak_counts.unwrap_or(level).max(level));
        if *moving && slope < STILL_SHARE * threshold {
            *moving = false;
            press.t_s = t_s;
            let Features { slope_counts_per_s, peak_counts, .. } = press.features;
            press.features.ramp_counts_per_s =
                peak_counts.and_then(|peak| self.ramps.slope_counts_per_s(peak, slope_counts_per_s));
            return Some(Event::Pressed(*press));
        }
        // The slope alone does not show a release: the low-pass overshoots when the edge stops.
        if slope < 0.0 && press.features.peak_counts.is_some_and(|peak| level < RETURNED_SHARE * peak) {
            self.phase = Phase::Released { quiet_samples: 0 };
            return Some(Event::Released(t_s));
        }
        *moving |= slope > threshold;
        None
    }

    /// Presses of a whole recording, each with its last features.
    pub fn of(mut self, samples: &[Sample]) -> Vec<Press> {
        let mut presses: Vec<Press> = Vec::new();
        for event in samples.iter().filter_map(|sample| self.step(sample)) {
            if let Event::Pressed(press) = event {
                match presses.last_mut().filter(|last| last.onset_s == press.onset_s) {
                    Some(last) => *last = press,
                    None => presses.push(press),
                }
            }
        }
        presses
    }
}
