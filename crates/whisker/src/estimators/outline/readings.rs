//! Readings that an outline is fitted to.

use crate::frames::{Base, Pose, Start};

/// Largest displacement and rotation of the base among readings that are averaged, as long as they are few.
const WAY_M: f64 = 0.3e-3;
const TURN_RAD: f64 = 5e-3;

/// Number of means above which more readings are averaged.
const MOST: usize = 256;

/// Factor of the displacement and rotation by which more readings are averaged.
const COARSER: f64 = std::f64::consts::SQRT_2;

/// The mean of readings between whose poses the base hardly differs, at their mean pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Mean pose of the base.
    pub(super) base: Pose<Base, Start>,
    /// Mean reading.
    pub(super) reading_n_m: f64,
    /// Number of readings.
    pub(super) count: f64,
    /// `tau` from which the contact is sought: that at the last of the readings.
    pub(super) near_m: f64,
    /// Whether the readings contradict the prediction. They are not averaged with others, which may be those of another
    /// object or of a whisker that has not settled.
    is_outlier: bool,
    first: Pose<Base, Start>,
}

impl Reading {
    /// A single reading, whose contact lies about `near_m`.
    pub(super) fn new(base: Pose<Base, Start>, reading_n_m: f64, near_m: f64) -> Self {
        Self { base, reading_n_m, count: 1.0, near_m, is_outlier: false, first: base }
    }

    /// The same as the mean of `count` readings.
    pub(super) fn of_mean(self, count: f64) -> Self {
        Self { count, ..self }
    }

    /// The same, as an outlier if `is_outlier`.
    pub(super) fn outlier(self, is_outlier: bool) -> Self {
        Self { is_outlier, ..self }
    }

    /// Includes the readings of another mean.
    fn join(&mut self, other: &Self) {
        let count = self.count + other.count;
        let share = other.count / count;
        let origin = self.base.origin().vector().lerp(&other.base.origin().vector(), share);
        let yaw_rad = self.base.yaw_rad() + share * (other.base.yaw_rad() - self.base.yaw_rad());
        self.base = Pose::new(origin.x, origin.y, yaw_rad);
        self.reading_n_m += share * (other.reading_n_m - self.reading_n_m);
        self.near_m = other.near_m;
        self.count = count;
    }
}

/// Readings of one object, averaged where the base returns to a pose: without friction and with the object at rest they
/// are repetitions of one reading. Their number, and so the time of a fit, is bounded.
#[derive(Clone, Debug)]
pub(super) struct Readings {
    means: Vec<Reading>,
    /// Factor of the displacement and rotation within which readings are averaged.
    scale: f64,
}

impl Default for Readings {
    fn default() -> Self {
        Self { means: Vec::new(), scale: 1.0 }
    }
}

impl Readings {
    /// Includes a reading in the mean of the nearest pose, or appends it if there is none within reach.
    pub(super) fn keep(&mut self, reading: Reading) {
        if let Some(mean) = self.beside(&reading) {
            mean.join(&reading);
            return;
        }
        self.means.push(reading);
        while self.means.len() > MOST && self.scale.is_finite() {
            self.scale *= COARSER;
            for mean in std::mem::take(&mut self.means) {
                match self.beside(&mean) {
                    Some(beside) => beside.join(&mean),
                    None => self.means.push(mean),
                }
            }
        }
    }

    /// The mean of the nearest pose within reach. An outlier joins only one that immediately precedes it.
    fn beside(&mut self, reading: &Reading) -> Option<&mut Reading> {
        let (way_m, turn_rad) = (self.scale * WAY_M, self.scale * TURN_RAD);
        let distance = |mean: &Reading| {
            let way = mean.first.origin().distance(&reading.first.origin()) / way_m;
            let turn = (mean.first.yaw_rad() - reading.first.yaw_rad()).abs() / turn_rad;
            way.max(turn)
        };
        let place = if reading.is_outlier {
            self.means
                .len()
                .checked_sub(1)
                .filter(|last| self.means[*last].is_outlier && distance(&self.means[*last]) <= 1.0)
        } else {
            let means = self.means.iter().enumerate().filter(|(_, mean)| !mean.is_outlier);
            let near = means.map(|(i, mean)| (i, distance(mean))).filter(|(_, distance)| *distance <= 1.0);
            near.min_by(|one, other| one.1.total_cmp(&other.1)).map(|(i, _)| i)
        };
        self.means.get_mut(place?)
    }

    /// The means.
    pub(super) fn means(&self) -> &[Reading] {
        &self.means
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(x_m: f64, reading_n_m: f64) -> Reading {
        Reading::new(Pose::new(x_m, 0.0, 0.0), reading_n_m, 0.0)
    }

    #[test]
    fn verif_readings_at_a_pose_are_averaged_whenever_the_base_returns() {
        let mut readings = Readings::default();
        for x_m in [0.0, 1e-3, 2e-3, 1e-3, 0.1e-3] {
            readings.keep(reading(x_m, 1e-3 * x_m));
        }
        let [first, second, third] = readings.means() else { panic!("three poses") };
        assert_eq!((first.count, second.count, third.count), (2.0, 2.0, 1.0));
        assert!((first.base.origin().x() - 0.05e-3).abs() < 1e-15 && (first.reading_n_m - 0.05e-6).abs() < 1e-15);
    }

    #[test]
    fn robust_outliers_are_averaged_only_with_outliers_just_before() {
        let mut readings = Readings::default();
        readings.keep(reading(0.0, 1e-3));
        readings.keep(reading(0.0, 9e-3).outlier(true));
        readings.keep(reading(0.0, 9e-3).outlier(true));
        readings.keep(reading(0.0, 1e-3));
        let means: Vec<_> = readings.means().iter().map(|mean| (mean.reading_n_m, mean.count)).collect();
        assert_eq!(means, [(1e-3, 2.0), (9e-3, 2.0)]);
    }

    #[test]
    fn robust_the_number_of_means_is_bounded() {
        let mut readings = Readings::default();
        for i in 0..20 * MOST {
            readings.keep(reading(1e-3 * i as f64, 1e-3));
            assert!(readings.means().len() <= MOST);
        }
        let count: f64 = readings.means().iter().map(|mean| mean.count).sum();
        assert!((count - 20.0 * MOST as f64).abs() < 1e-6);
    }
}
