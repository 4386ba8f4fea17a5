//! Readings at one pose of the base.
//!
//! They say no more about the contact than their mean. If a filter took them one by one, it would linearise each at another
//! contact, and become certain of a place along the whisker, which two moments leave open. Filters therefore condition the
//! hypotheses from before the first of the readings on the mean of all of them.

use filters::Bank;
use nalgebra::Vector2;

use super::Sample;
use super::side::Side;
use crate::frames::Base;
use crate::space::frames::{Pose, rotation_vector};

/// Largest displacement of the base within a stay, with its turn times the whisker's length: less than the errors of the contact.
const STAY_M: f64 = 20e-6;

/// Longest duration of a stay (s): an object may move while the base is at rest.
const LONGEST_S: f64 = 1.0;

/// Deviation of a reading from the mean at which the stay ends, in standard deviations of the noise: the contact may have slipped.
const SLIPPED_SDS: f64 = 5.0;

/// Motion of the base over some time.
#[derive(Clone, Copy)]
struct Way {
    motion: Pose<Base, Base>,
    duration_s: f64,
}

impl Way {
    fn none() -> Self {
        Self { motion: Pose::identity(), duration_s: 0.0 }
    }

    fn then(&self, sample: &Sample) -> Self {
        Self { motion: self.motion.then(&sample.motion), duration_s: self.duration_s + sample.dt_s }
    }
}

/// Successive readings at nearly the same pose of the base.
pub(super) struct Stay<const N: usize> {
    /// The hypotheses before the first of the readings.
    before: Bank<N>,
    /// Way since then, since the first reading, and since the last update.
    through: Way,
    within: Way,
    later: Way,
    /// Mean and number of the readings.
    mean_n_m: Vector2<f64>,
    count: u32,
}

impl<const N: usize> Stay<N> {
    /// The stay that begins with a reading. `bank` has the hypotheses after the last update of the earlier stay.
    pub(super) fn new(bank: &Bank<N>, earlier: Option<Self>, sample: &Sample) -> Self {
        let (later, before) = match earlier {
            Some(Self { later, mut before, .. }) => {
                before.copy_from(bank);
                (later, before)
            }
            None => (Way::none(), bank.clone()),
        };
        let (within, mean_n_m) = (Way::none(), sample.reading_n_m);
        Self { before, through: later.then(sample), within, later: Way::none(), mean_n_m, count: 1 }
    }

    /// Includes a reading and returns true, unless the stay has ended.
    pub(super) fn includes(&mut self, side: &Side, sample: &Sample) -> bool {
        let within = self.within.then(sample);
        let turned_m = side.length_m() * rotation_vector(&within.motion.rotation()).norm();
        let off_n_m = sample.reading_n_m - self.mean_n_m;
        let noise_n2_m2 = side.noise_of_mean_n2_m2(1.0)[(0, 0)];
        if within.motion.origin().vector().norm() + turned_m > STAY_M
            || within.duration_s > LONGEST_S
            || off_n_m.norm_squared() > SLIPPED_SDS.powi(2) * noise_n2_m2
        {
            return false;
        }
        (self.within, self.through, self.later) = (within, self.through.then(sample), self.later.then(sample));
        self.count += 1;
        self.mean_n_m += off_n_m / self.count();
        true
    }

    /// Whether an update is due, which begins with the hypotheses before the first reading; these replace those of `bank`. With one
    /// at every reading, a step would take long: the number of readings doubles from one to the next, and less than half of the
    /// readings are not used.
    pub(super) fn begin_update(&mut self, bank: &mut Bank<N>) -> bool {
        let is_due = self.count.is_power_of_two();
        if is_due {
            self.later = Way::none();
        }
        // At the first reading they are those of the bank.
        if is_due && self.count > 1 {
            bank.copy_from(&self.before);
        }
        is_due
    }

    /// The mean reading, with the motion and the time since the hypotheses before the first one.
    pub(super) fn mean(&self) -> Sample {
        let Way { motion, duration_s } = self.through;
        Sample { motion, dt_s: duration_s, reading_n_m: self.mean_n_m }
    }

    /// Number of readings.
    pub(super) fn count(&self) -> f64 {
        f64::from(self.count)
    }
}
