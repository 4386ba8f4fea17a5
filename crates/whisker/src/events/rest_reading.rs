//! Rest reading: mean reading of the free whisker at the start of a recording, an estimate of the sensor's offset.
//!
//! The whisker is assumed to be free for the first 0.1 s, unless a reading is larger than an offset can be. The estimate is
//! accepted only if the readings are steady and their mean differs significantly from zero and lies between [`LEAST_SHARE`] and
//! [`MOST_SHARE`] of the largest calibrated reading. A smaller offset is covered by the covariances that estimators state.

use signal::LONGEST_GAP_S;

use super::Sensing;

/// Time from the start of the recording over which the rest reading is estimated.
const ESTIMATION_S: f64 = 0.1;

/// Smallest number of samples for the estimate.
const LEAST_SAMPLES: usize = 8;

/// Number of samples after which the estimate ends, whatever their times.
const MOST_SAMPLES: usize = 10_000;

/// Smallest rest reading, relative to the largest calibrated reading.
const LEAST_SHARE: f64 = 0.005;

/// Largest rest reading, relative to the largest calibrated reading.
const MOST_SHARE: f64 = 0.03;

/// Smallest rest reading in standard errors of its mean; also the margin above [`MOST_SHARE`] for a single reading, in standard
/// deviations of the noise.
const SIGNIFICANT_SDS: f64 = 5.0;

/// Largest standard deviation of steady readings, relative to that of the noise.
const STEADY_SDS: f64 = 2.0;

/// Largest difference between the means of the two halves of steady readings, in its standard deviations.
const STEADY_HALVES_SDS: f64 = 3.0;

/// Smallest standard deviation of steady readings, relative to the largest calibrated reading: readings are rounded.
const LEAST_STEADY_SHARE: f64 = 1e-6;

/// Progress of the estimate.
#[derive(Clone, Debug)]
enum State {
    Estimating { time_s: f64, readings_n_m: Vec<f64> },
    Done { rest_reading_n_m: f64 },
}

impl State {
    fn start() -> Self {
        Self::Estimating { time_s: 0.0, readings_n_m: Vec::new() }
    }
}

/// Estimate of the rest reading.
#[derive(Clone, Debug)]
pub(super) struct RestReading {
    noise_sd_n_m: f64,
    largest_n_m: f64,
    state: State,
}

impl RestReading {
    /// Starts the estimate.
    pub(super) fn new(sensing: &Sensing) -> Self {
        let Sensing { noise_sd_n_m, largest_reading_n_m: largest_n_m, .. } = *sensing;
        Self { noise_sd_n_m, largest_n_m, state: State::start() }
    }

    /// Rest reading; 0 until it is determined, and if none was accepted.
    pub(super) fn rest_reading_n_m(&self) -> f64 {
        match self.state {
            State::Estimating { .. } => 0.0,
            State::Done { rest_reading_n_m } => rest_reading_n_m,
        }
    }

    /// Whether a reading is larger than that of any free whisker.
    pub(super) fn is_exceeded_by(&self, reading_n_m: f64) -> bool {
        reading_n_m.abs() > MOST_SHARE * self.largest_n_m + SIGNIFICANT_SDS * self.noise_sd_n_m
    }

    /// Ends the estimate without a rest reading, unless it is determined.
    pub(super) fn give_up(&mut self) {
        if matches!(self.state, State::Estimating { .. }) {
            self.state = State::Done { rest_reading_n_m: 0.0 };
        }
    }

    /// Takes over the rest reading of `earlier` if it has been determined or given up.
    pub(super) fn keep(&mut self, earlier: &Self) {
        if matches!(earlier.state, State::Done { .. }) {
            self.state = earlier.state.clone();
        }
    }

    /// Takes the next reading, `dt_s` after the last. Returns whether it may be a rest reading; such a reading must not be detected
    /// as a touch. The estimate starts again after a gap.
    pub(super) fn update(&mut self, reading_n_m: f64, dt_s: f64) -> bool {
        if self.is_exceeded_by(reading_n_m) {
            self.give_up();
        }
        if matches!(self.state, State::Estimating { .. }) && dt_s > LONGEST_GAP_S {
            self.state = State::start();
        }
        let State::Estimating { time_s, readings_n_m } = &mut self.state else { return false };
        *time_s += if readings_n_m.is_empty() { 0.0 } else { dt_s.max(0.0) };
        readings_n_m.push(reading_n_m);
        let count = readings_n_m.len();
        if *time_s >= ESTIMATION_S && count >= LEAST_SAMPLES || count == MOST_SAMPLES {
            let accepted = accepted(readings_n_m, self.noise_sd_n_m, self.largest_n_m);
            self.state = State::Done { rest_reading_n_m: accepted.unwrap_or_default() };
        }
        true
    }
}

/// Mean of the readings, if it is accepted as the rest reading.
fn accepted(readings_n_m: &[f64], noise_sd_n_m: f64, largest_n_m: f64) -> Option<f64> {
    let mean = |readings_n_m: &[f64]| readings_n_m.iter().sum::<f64>() / readings_n_m.len() as f64;
    let (count, mean_n_m) = (readings_n_m.len() as f64, mean(readings_n_m));
    let variance_n2_m2 = readings_n_m.iter().map(|reading| (reading - mean_n_m).powi(2)).sum::<f64>() / count;
    let (first, second) = readings_n_m.split_at(readings_n_m.len() / 2);
    let sd_n_m = noise_sd_n_m.max(LEAST_STEADY_SHARE * largest_n_m);
    let is_steady = variance_n2_m2 <= (STEADY_SDS * sd_n_m).powi(2)
        && (mean(second) - mean(first)).abs() <= STEADY_HALVES_SDS * sd_n_m * 2.0 / count.sqrt();
    let is_significant = mean_n_m.abs() * count.sqrt() > SIGNIFICANT_SDS * noise_sd_n_m;
    let is_plausible = (LEAST_SHARE..MOST_SHARE).contains(&(mean_n_m.abs() / largest_n_m));
    (is_steady && is_significant && is_plausible).then_some(mean_n_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::FirstMode;

    const NOISE_SD_N_M: f64 = 1e-7;

    fn rest_reading(noise_sd_n_m: f64) -> RestReading {
        let first_mode = FirstMode { frequency_hz: 20.0, damping_ratio: 0.05 };
        RestReading::new(&Sensing { rate_hz: 250.0, noise_sd_n_m, largest_reading_n_m: 5e-5, first_mode })
    }

    /// The rest reading after 100 samples at 250 Hz and, for each sample, whether it may be a rest reading.
    fn rest_reading_of(reading_n_m: impl Fn(usize) -> f64) -> (f64, Vec<bool>) {
        let mut rest_reading = rest_reading(NOISE_SD_N_M);
        let may_be_rest = (0..100).map(|i| rest_reading.update(reading_n_m(i), 0.004)).collect();
        (rest_reading.rest_reading_n_m(), may_be_rest)
    }

    fn noise_n_m(i: usize) -> f64 {
        NOISE_SD_N_M * [0.6, -1.2, 0.1, 1.5, -0.4, -0.9, 1.0, -0.7][i % 8]
    }

    #[test]
    fn verif_a_steady_offset_at_the_start_is_the_rest_reading() {
        let (rest_n_m, may_be_rest) = rest_reading_of(|i| 8e-7 + noise_n_m(i));
        assert!((rest_n_m - 8e-7).abs() < 0.5e-7, "{rest_n_m}");
        assert_eq!(may_be_rest.iter().filter(|may| **may).count(), 26);
        // Not significant, below the smallest, above the largest.
        for refused_n_m in [0.2e-7, 2e-7, 2e-6] {
            assert_eq!(rest_reading_of(|i| refused_n_m + noise_n_m(i)).0, 0.0, "{refused_n_m}");
        }
        // Without noise.
        let mut exact = rest_reading(0.0);
        (0..100).for_each(|_| _ = exact.update(8e-7, 0.004));
        assert!((exact.rest_reading_n_m() - 8e-7).abs() < 1e-15);
    }

    #[test]
    fn verif_a_contact_at_the_start_is_not_taken_as_a_rest_reading() {
        let (rest_n_m, may_be_rest) = rest_reading_of(|i| 4e-6 + noise_n_m(i));
        assert!(rest_n_m == 0.0 && !may_be_rest[0]);
        // Contacts whose readings rise by 0.6 to 3 % of the largest calibrated reading.
        for slope_n_m in [1.2e-8, 2.4e-8, 5e-8, 6e-8] {
            assert_eq!(rest_reading_of(|i| slope_n_m * i as f64 + noise_n_m(i)).0, 0.0, "{slope_n_m}");
        }
    }

    #[test]
    fn robust_a_gap_starts_the_estimate_again() {
        let mut rest_reading = rest_reading(NOISE_SD_N_M);
        for i in 0..8 {
            assert!(rest_reading.update(8e-7 + noise_n_m(i), if i == 4 { 2.0 * LONGEST_GAP_S } else { 0.004 }));
        }
        assert!(matches!(&rest_reading.state, State::Estimating { readings_n_m, .. } if readings_n_m.len() == 4));
    }
}
