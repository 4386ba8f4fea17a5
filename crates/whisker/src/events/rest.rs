//! Rest reading: that of the free whisker at the start of a recording, by which a sensor with an offset is off.
//!
//! It is learnt only if it is certain: from readings that differ by no more than the noise, and whose mean is larger than the noise
//! explains. A smaller offset is left to the covariances that estimators state, and a larger reading is that of a contact.

use super::Sensing;

/// Time from the start in which the rest reading is learnt, and the smallest number of samples.
const LEARNING_S: f64 = 0.1;
const LEAST_SAMPLES: usize = 8;

/// Smallest and largest rest reading, relative to the largest calibrated one.
const LEAST_SHARE: f64 = 0.005;
const MOST_SHARE: f64 = 0.03;

/// Smallest rest reading, in standard deviations of the mean.
const CERTAIN_SDS: f64 = 5.0;

/// Largest standard deviation of the readings, relative to that of the noise.
const STEADY_SDS: f64 = 2.0;

/// State of the learning.
#[derive(Clone, Copy, Debug)]
enum State {
    Learning { count: usize, time_s: f64, sum_n_m: f64, sum_n2_m2: f64 },
    Known { rest_n_m: f64 },
}

/// The rest reading of a sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rest {
    noise_sd_n_m: f64,
    largest_n_m: f64,
    state: State,
}

impl Rest {
    /// A rest reading that is yet to be learnt.
    pub(super) fn new(sensing: &Sensing) -> Self {
        let Sensing { noise_sd_n_m, largest_reading_n_m: largest_n_m, .. } = *sensing;
        Self {
            noise_sd_n_m,
            largest_n_m,
            state: State::Learning { count: 0, time_s: 0.0, sum_n_m: 0.0, sum_n2_m2: 0.0 },
        }
    }

    /// The rest reading, 0 before it is known.
    pub(super) fn rest_n_m(&self) -> f64 {
        match self.state {
            State::Learning { .. } => 0.0,
            State::Known { rest_n_m } => rest_n_m,
        }
    }

    /// Takes the next reading. Returns whether it may be the rest reading, so that it is no evidence of a contact.
    pub(super) fn is_learning(&mut self, reading_n_m: f64, dt_s: f64) -> bool {
        let State::Learning { count, time_s, sum_n_m, sum_n2_m2 } = &mut self.state else { return false };
        if reading_n_m.abs() > MOST_SHARE * self.largest_n_m + CERTAIN_SDS * self.noise_sd_n_m {
            self.state = State::Known { rest_n_m: 0.0 };
            return false;
        }
        *count += 1;
        *time_s += dt_s;
        *sum_n_m += reading_n_m;
        *sum_n2_m2 += reading_n_m.powi(2);
        if *time_s >= LEARNING_S && *count >= LEAST_SAMPLES {
            let mean_n_m = *sum_n_m / *count as f64;
            let variance_n2_m2 = *sum_n2_m2 / *count as f64 - mean_n_m.powi(2);
            let is_steady = variance_n2_m2 <= (STEADY_SDS * self.noise_sd_n_m).powi(2);
            let is_certain = mean_n_m.abs() * (*count as f64).sqrt() > CERTAIN_SDS * self.noise_sd_n_m;
            let is_small = (LEAST_SHARE..MOST_SHARE).contains(&(mean_n_m.abs() / self.largest_n_m));
            let is_rest = is_steady && is_certain && is_small;
            self.state = State::Known { rest_n_m: if is_rest { mean_n_m } else { 0.0 } };
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::FirstMode;

    const NOISE_SD_N_M: f64 = 1e-7;

    /// The rest reading after 100 samples at 250 Hz, and whether each of them may have been it.
    fn learnt(reading_n_m: impl Fn(usize) -> f64) -> (f64, Vec<bool>) {
        let first_mode = FirstMode { frequency_hz: 20.0, damping_ratio: 0.05 };
        let sensing = Sensing { rate_hz: 250.0, noise_sd_n_m: NOISE_SD_N_M, largest_reading_n_m: 5e-5, first_mode };
        let mut rest = Rest::new(&sensing);
        let is_learning = (0..100).map(|i| rest.is_learning(reading_n_m(i), 0.004)).collect();
        (rest.rest_n_m(), is_learning)
    }

    fn noise_n_m(i: usize) -> f64 {
        NOISE_SD_N_M * [0.6, -1.2, 0.1, 1.5, -0.4, -0.9, 1.0, -0.7][i % 8]
    }

    #[test]
    fn verif_a_steady_offset_is_learnt_at_the_start() {
        let (rest_n_m, is_learning) = learnt(|i| 8e-7 + noise_n_m(i));
        assert!((rest_n_m - 8e-7).abs() < 0.5e-7, "{rest_n_m}");
        assert_eq!(is_learning.iter().filter(|is| **is).count(), 25);
        // One within the noise, one below the smallest, and one above the largest.
        for small_n_m in [0.2e-7, 2e-7, 2e-6] {
            assert_eq!(learnt(|i| small_n_m + noise_n_m(i)).0, 0.0, "{small_n_m}");
        }
    }

    #[test]
    fn verif_a_contact_at_the_start_is_no_rest_reading() {
        let (rest_n_m, is_learning) = learnt(|i| 4e-6 + noise_n_m(i));
        assert!(rest_n_m == 0.0 && !is_learning[0]);
        // A contact whose reading rises.
        assert_eq!(learnt(|i| 5e-8 * i as f64 + noise_n_m(i)).0, 0.0);
    }
}
