//! Presses: an edge moves against the whisker, stays, and lets go.
//!
//! A press begins where the main axis's slope exceeds the [`Chain`]'s threshold, which also tells its direction. It is known when the slope has
//! fallen back, and it may be known better when the edge moves on. It ends when the level has sunk to half its peak, and a quiet while after that, in which a released whisker
//! has stopped ringing. A recording must begin with the whisker free; so must what follows a gap.

use super::front::{Front, Motion, Moved};
use super::{Chain, Error, Features};
use crate::Sample;

/// The edge has stopped moving where the slope is below this share of the threshold; between the two nothing changes.
const STILL_SHARE: f64 = 0.5;

/// The edge has let go where the level has sunk to this share of its peak.
const RETURNED_SHARE: f64 = 0.5;

/// What is known of a press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Press {
    /// When the contact began, less the low-pass's delay.
    pub onset_s: f64,
    /// Time of the sample with which the press became known as it is.
    pub t_s: f64,
    /// `1.0` where the main axis's counts rise, `-1.0` where they fall.
    pub direction: f64,
    /// Its features.
    pub features: Features,
}

/// What a sample brought about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The edge pressed and stopped; again, with better features, if it went on pressing.
    Pressed(Press),
    /// The edge let go, at the time of this sample.
    Released(f64),
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Free,
    Touched { press: Press, moving: bool },
    Released { quiet_samples: u32 },
}

/// Finds presses, sample by sample.
#[derive(Clone, Debug)]
pub struct Presses {
    chain: Chain,
    front: Front,
    delay_s: f64,
    quiet_samples: u32,
    rest_counts: f64,
    phase: Phase,
}

impl Presses {
    /// A stream that has not begun.
    ///
    /// # Errors
    /// [`Error::Setting`] where the low-pass does not fit the rate.
    pub fn new(chain: &Chain) -> Result<Self, Error> {
        let front = Front::new(chain.order, chain.cutoff_hz, chain.rate_hz)?;
        Ok(Self {
            delay_s: front.delay_s(),
            quiet_samples: (chain.quiet_s * chain.rate_hz).round().max(1.0) as u32,
            rest_counts: 0.0,
            phase: Phase::Free,
            chain: chain.clone(),
            front,
        })
    }

    /// Takes the next sample.
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
                let features = Features { slope_counts_per_s: 0.0, peak_counts: None, slope_ratio: None };
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
            return Some(Event::Pressed(*press));
        }
        // Not by the slope alone: a low-pass swings back a little when the edge stops.
        if slope < 0.0 && press.features.peak_counts.is_some_and(|peak| level < RETURNED_SHARE * peak) {
            self.phase = Phase::Released { quiet_samples: 0 };
            return Some(Event::Released(t_s));
        }
        *moving |= slope > threshold;
        None
    }

    /// The presses of a whole recording, each as it was known last.
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
