//! Readings that stay the same while a touched whisker moves, as of a sensor, a bus or a driver that has stopped.
//!
//! The noise of a fine sensor makes consecutive readings differ; equal ones are improbable. A coarse sensor, or a driver that
//! repeats its values, has equal readings at all times. Which of the two applies follows from the stream: from the smallest change
//! between consecutive readings, which is the resolution or less, and from the share of equal ones.

use nalgebra::{Vector2, Vector3};

/// Smallest number of equal readings that are frozen, and smallest share of the largest calibrated reading.
const LEAST_COUNT: u32 = 5;
const LOADED: f64 = 0.05;

/// Way of the middle of the whisker (m) within which readings may stay the same: those of a simulation without noise do at rest.
const WAY_M: f64 = 2e-6;

/// Largest resolution of a fine sensor, in standard deviations of the noise, and at least this share of the largest calibrated
/// reading.
const FINE_SDS: f64 = 0.5;
const LEAST_FINE_SHARE: f64 = 1e-5;

/// Probability of a run of equal readings below which it is frozen.
const IMPROBABLE: f64 = 1e-6;

/// Number of pairs of consecutive readings after which the count of equal ones has decayed to 1/e.
const MEMORY: f64 = 1e4;

/// Largest number of equal pairs that a run counts for: a sensor that stops while the whisker is free remains a fine one.
const MOST_EQUAL: u32 = 8;

/// Consecutive equal readings.
#[derive(Clone, Copy, Debug)]
struct Run {
    moments_n_m: Vector2<f64>,
    count: u32,
    /// Time of the first one (s), and middle of the whisker in World (m).
    first_s: f64,
    middle_m: Vector3<f64>,
    /// Largest distance of the middle from that place (m).
    way_m: f64,
    is_frozen: bool,
}

/// Run of frozen readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FrozenRun {
    /// Time of its first reading (s).
    pub(crate) first_s: f64,
    /// Number of its readings.
    pub(crate) count: u32,
    /// Largest distance of the whisker's middle from its place at the first reading (m).
    pub(crate) way_m: f64,
}

/// Detector of frozen readings.
#[derive(Clone, Debug)]
pub(crate) struct Freezing {
    least_n_m: f64,
    fine_n_m: f64,
    run: Option<Run>,
    /// Smallest change between consecutive readings.
    change_n_m: f64,
    /// Decaying numbers of pairs of consecutive readings, and of equal ones.
    pairs: f64,
    equal: f64,
}

impl Freezing {
    /// A detector for a sensor with this largest calibrated reading and standard deviation of the noise.
    pub(crate) fn new(largest_n_m: f64, noise_sd_n_m: f64) -> Self {
        let fine_n_m = (FINE_SDS * noise_sd_n_m).max(LEAST_FINE_SHARE * largest_n_m);
        let (least_n_m, change_n_m) = (LOADED * largest_n_m, f64::INFINITY);
        Self { least_n_m, fine_n_m, run: None, change_n_m, pairs: 0.0, equal: 0.0 }
    }

    /// Takes the next reading, with the middle of the whisker in World (m). Returns the run of frozen readings to which it belongs.
    pub(crate) fn step(&mut self, t_s: f64, moments_n_m: Vector2<f64>, middle_m: Vector3<f64>) -> Option<FrozenRun> {
        let Some(run) = self.run.as_mut().filter(|run| run.moments_n_m == moments_n_m) else {
            if let Some(ended) = self.run {
                self.change_n_m = self.change_n_m.min((moments_n_m - ended.moments_n_m).norm());
                self.learn(&ended);
            }
            self.run = Some(Run { moments_n_m, count: 1, first_s: t_s, middle_m, way_m: 0.0, is_frozen: false });
            return None;
        };
        run.count += 1;
        run.way_m = run.way_m.max((middle_m - run.middle_m).norm());
        let may_be_frozen = run.count >= LEAST_COUNT && run.way_m > WAY_M && moments_n_m.norm() > self.least_n_m;
        if may_be_frozen && !run.is_frozen && self.change_n_m <= self.fine_n_m {
            let share = (self.equal + 1.0) / (self.pairs + 2.0);
            run.is_frozen = share.powi(run.count.min(1 << 16) as i32 - 1) <= IMPROBABLE;
        }
        run.is_frozen.then_some(FrozenRun { first_s: run.first_s, count: run.count, way_m: run.way_m })
    }

    /// Begins anew with the next reading of the same sensor.
    pub(crate) fn restart(&mut self) {
        self.run = None;
    }

    /// Counts the pairs of a run, and that of its last reading with the next one. Frozen readings are no property of the sensor.
    fn learn(&mut self, run: &Run) {
        if run.is_frozen {
            return;
        }
        let equal = f64::from((run.count - 1).min(MOST_EQUAL));
        let kept = (-(equal + 1.0) / MEMORY).exp();
        self.pairs = kept * self.pairs + equal + 1.0;
        self.equal = kept * self.equal + equal;
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    use super::*;

    const LARGEST_N_M: f64 = 5e-5;
    const NOISE_N_M: f64 = 2e-7;

    /// Rows that are frozen among 2000 at 250 Hz of a whisker that is free for 200 and touches then, while its middle moves at
    /// `speed_m_s`. `sensed` gives the reading of a row from that of an ideal sensor with noise.
    fn frozen(speed_m_s: f64, slope_n_m_m: f64, mut sensed: impl FnMut(usize, f64) -> f64) -> Vec<usize> {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut freezing = Freezing::new(LARGEST_N_M, NOISE_N_M);
        let is_frozen = |row: &usize| {
            let way_m = speed_m_s * 0.004 * *row as f64;
            let moment_n_m = if *row < 200 { 0.0 } else { 8e-6 + slope_n_m_m * (way_m % 0.01) };
            let noise: f64 = rng.sample(StandardNormal);
            let reading_n_m = sensed(*row, moment_n_m + NOISE_N_M * noise);
            freezing.step(0.004 * *row as f64, Vector2::new(reading_n_m, 0.0), Vector3::new(way_m, 0.0, 0.0)).is_some()
        };
        (0..2000).filter(is_frozen).collect()
    }

    /// A sensor that holds its reading in these rows.
    fn holding(rows: std::ops::Range<usize>) -> impl FnMut(usize, f64) -> f64 {
        let mut last_n_m = 0.0;
        move |row, reading_n_m| {
            if !rows.contains(&row) {
                last_n_m = reading_n_m;
            }
            last_n_m
        }
    }

    #[test]
    fn verif_a_frozen_sensor_is_found_with_the_fifth_equal_reading() {
        for speed_m_s in [0.01, 0.05] {
            // The row before the hold is the first of the equal ones.
            let expected: Vec<usize> = (1003..1100).collect();
            assert_eq!(frozen(speed_m_s, 2e-3, holding(1000..1100)), expected, "{speed_m_s} m/s");
        }
        // Slowly: only after the way.
        let slow = frozen(9e-5, 2e-3, holding(1000..1100));
        assert_eq!(slow, (1005..1100).collect::<Vec<_>>());
        // A base at rest, and a free whisker.
        assert!(frozen(0.0, 2e-3, holding(1000..1100)).is_empty());
        assert!(frozen(0.05, 2e-3, holding(50..150)).is_empty());
        // A sensor that had stopped while the whisker was free.
        let mut first = holding(10..190);
        let mut second = holding(1000..1100);
        let again = frozen(0.05, 2e-3, |row, reading_n_m| second(row, first(row, reading_n_m)));
        assert_eq!(again, (1003..1100).collect::<Vec<_>>());
    }

    #[test]
    fn robust_repeated_values_of_a_sound_sensor_are_not_frozen() {
        // Resolutions from far below the noise to a tenth of the largest reading, and contacts that move with and along the
        // whisker.
        for speed_m_s in [0.002, 0.02, 0.1] {
            for slope_n_m_m in [0.0, 1e-4, 2e-3] {
                for resolution_n_m in [1e-9, 2e-8, 1e-7, 3e-7, 1e-6, 5e-6] {
                    let coarse = |_, reading_n_m: f64| (reading_n_m / resolution_n_m).round() * resolution_n_m;
                    let rows = frozen(speed_m_s, slope_n_m_m, coarse);
                    assert!(rows.is_empty(), "{speed_m_s} {slope_n_m_m} {resolution_n_m}: {rows:?}");
                }
                // A driver that sends each value several times.
                for repeats in [2, 5, 12] {
                    let mut last_n_m = 0.0;
                    let rows = frozen(speed_m_s, slope_n_m_m, |row, reading_n_m| {
                        if row % repeats == 0 {
                            last_n_m = reading_n_m;
                        }
                        last_n_m
                    });
                    assert!(rows.is_empty(), "{speed_m_s} {slope_n_m_m}, {repeats}-fold: {rows:?}");
                }
            }
        }
    }
}
