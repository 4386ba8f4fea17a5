//! Readings that an object is fitted to, averaged where the pose of the base is nearly the same.

use nalgebra::{Rotation3, Vector2, Vector3};

use crate::frames::{Base, Start};
use crate::space::estimators::motion::SwingTilt;
use crate::space::estimators::ringing::Response;
use crate::space::frames::{Pose, rotation_vector};

/// Largest displacement and rotation of the base among readings that are averaged, as long as they are few.
const WAY_M: f64 = 0.2e-3;
const TURN_RAD: f64 = 4e-3;

/// Number of means above which more readings are averaged.
const MOST: usize = 96;

/// Factor of the displacement and rotation by which more readings are averaged.
const COARSER: f64 = std::f64::consts::SQRT_2;

/// The mean of readings between whose poses the base hardly differs, at their mean pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean {
    /// Pose of the base at the first reading.
    first: Pose<Base, Start>,
    /// Mean of the displacement (m) and of the rotation vector (rad) from the first pose, the latter in the base's frame, and the
    /// mean pose that they give.
    shift_m: Vector3<f64>,
    turn_rad: Vector3<f64>,
    base: Pose<Base, Start>,
    /// Mean of both moments.
    pub(super) reading_n_m: Vector2<f64>,
    /// Number of readings, time that they cover, and number of stays of the base at the pose in which they were taken.
    pub(super) count: f64,
    duration_s: f64,
    stays: f64,
    /// Mean square of the base's recent acceleration (m2/s4), mean response of the wire, and mean swing along the likeliest object.
    pub(super) acceleration2: f64,
    pub(super) response: Response,
    pub(super) swing: SwingTilt,
}

impl Mean {
    /// A single reading.
    pub(super) fn new(
        base: Pose<Base, Start>,
        reading_n_m: Vector2<f64>,
        duration_s: f64,
        acceleration2: f64,
        response: Response,
    ) -> Self {
        let (shift_m, turn_rad) = (Vector3::zeros(), Vector3::zeros());
        Self {
            first: base,
            shift_m,
            turn_rad,
            base,
            reading_n_m,
            count: 1.0,
            duration_s,
            stays: 1.0,
            acceleration2,
            response,
            swing: SwingTilt::default(),
        }
    }

    /// The reading with the swing at its time.
    pub(super) fn with(self, swing: SwingTilt) -> Self {
        Self { swing, ..self }
    }

    /// Mean pose of the base.
    pub(super) fn base(&self) -> &Pose<Base, Start> {
        &self.base
    }

    /// Mean duration of a stay. Each begins with the same oscillation of the wire if the base arrives in the same way, so that the
    /// oscillation averages out within a stay and not over them.
    pub(super) fn stay_s(&self) -> f64 {
        self.duration_s / self.stays
    }

    /// Displacement (m) and rotation vector (rad) from the first pose to another.
    fn way_to(&self, base: &Pose<Base, Start>) -> (Vector3<f64>, Vector3<f64>) {
        let turn_rad = rotation_vector(&self.first.rotation().tr_mul(&base.rotation()));
        (base.origin().vector() - self.first.origin().vector(), turn_rad)
    }

    /// The same with another Start.
    fn seen_from(&self, start: &Pose<Start, Start>) -> Self {
        let [first, base] = [self.first, self.base].map(|base| base.then(start));
        Self { first, base, shift_m: start.turn_vector(self.shift_m), ..*self }
    }

    /// Includes the readings of another mean. Neighbouring poses are mostly passed in the same stays, so that the larger number
    /// counts.
    fn join(&mut self, other: &Self) {
        let count = self.count + other.count;
        let share = other.count / count;
        let (shift_m, turn_rad) = self.way_to(&other.base);
        self.shift_m += (shift_m - self.shift_m) * share;
        self.turn_rad += (turn_rad - self.turn_rad) * share;
        let turned = Rotation3::from_matrix_unchecked(self.first.rotation()) * Rotation3::new(self.turn_rad);
        self.base = Pose::new(self.first.origin().vector() + self.shift_m, turned);
        self.reading_n_m += (other.reading_n_m - self.reading_n_m) * share;
        self.acceleration2 += (other.acceleration2 - self.acceleration2) * share;
        self.response.include(&other.response, share);
        self.swing.include(&other.swing, share);
        self.duration_s += other.duration_s;
        self.stays = self.stays.max(other.stays);
        self.count = count;
    }
}

/// Readings of one object, averaged where the base returns to a pose: without friction and with the object at rest they are
/// repetitions of one reading. Their number, and so the time of a fit, is bounded.
#[derive(Clone, Debug)]
pub(super) struct Readings {
    means: Vec<Mean>,
    /// Index of the mean that includes the last reading. `None` at the beginning of a touch.
    last: Option<usize>,
    /// Factor of the displacement and rotation within which readings are averaged.
    scale: f64,
}

impl Default for Readings {
    fn default() -> Self {
        Self { means: Vec::new(), last: None, scale: 1.0 }
    }
}

impl Readings {
    /// Includes a reading in the mean of the nearest pose, or appends it if there is none within reach.
    pub(super) fn keep(&mut self, reading: Mean) {
        let known = self.means.len();
        let found = self.include(reading);
        if self.last != Some(found) && found < known {
            self.means[found].stays += 1.0;
        }
        self.last = Some(found);
        self.bound();
    }

    /// These readings with another Start.
    pub(super) fn seen_from(&self, start: &Pose<Start, Start>) -> Self {
        let means = self.means.iter().map(|mean| mean.seen_from(start)).collect();
        Self { means, last: None, ..*self }
    }

    /// These readings and later ones.
    pub(super) fn followed_by(&self, later: &Self) -> Self {
        let mut both = Self { scale: self.scale.max(later.scale), ..self.clone() };
        let join = |mean: &Mean| {
            let place = both.include(*mean);
            if let Some(earlier) = self.means.get(place) {
                // The later readings were taken in other stays.
                let stays = &mut both.means[place].stays;
                *stays = stays.max(earlier.stays + mean.stays);
            }
            place
        };
        let moved: Vec<usize> = later.means.iter().map(join).collect();
        both.last = later.last.map(|last| moved[last]);
        both.bound();
        both
    }

    /// Averages more readings if there are too many means.
    fn bound(&mut self) {
        while self.means.len() > MOST && self.scale.is_finite() {
            self.scale *= COARSER;
            let moved: Vec<usize> =
                std::mem::take(&mut self.means).into_iter().map(|mean| self.include(mean)).collect();
            self.last = self.last.map(|last| moved[last]);
        }
    }

    /// Ends the stay at the present pose.
    pub(super) fn leave(&mut self) {
        self.last = None;
    }

    /// The index of the mean that includes a reading, or the readings of a mean.
    fn include(&mut self, reading: Mean) -> usize {
        let (way_m, turn_rad) = (self.scale * WAY_M, self.scale * TURN_RAD);
        let base = reading.base;
        let distances = self.means.iter().enumerate().filter_map(|(i, mean)| {
            let far = mean.first.origin().distance(&base.origin()) / way_m;
            if far > 1.0 {
                return None;
            }
            let turned = mean.way_to(&base).1.norm() / turn_rad;
            Some((i, far.max(turned)))
        });
        match distances.filter(|(_, distance)| *distance <= 1.0).min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((i, _)) => {
                self.means[i].join(&reading);
                i
            }
            None => {
                self.means.push(reading);
                self.means.len() - 1
            }
        }
    }

    /// The means, in the order of the first of their readings unless they were averaged further.
    pub(super) fn means(&self) -> &[Mean] {
        &self.means
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    fn reading(x_m: f64, turn_rad: f64, reading_n_m: f64) -> Mean {
        let base = Pose::new(Vector3::x() * x_m, Rotation3::new(Vector3::z() * turn_rad));
        Mean::new(base, Vector2::new(reading_n_m, 0.0), 4e-3, 0.0, Response::default())
    }

    #[test]
    fn verif_readings_at_a_pose_are_averaged_whenever_the_base_returns() {
        let mut readings = Readings::default();
        for (x_m, turn_rad) in [(0.0, 0.0), (1e-3, 0.0), (1e-3, 0.01), (1e-3, 2e-3), (0.1e-3, 0.0)] {
            readings.keep(reading(x_m, turn_rad, 1e-3 * x_m));
        }
        let [first, second, third] = readings.means() else { panic!("three poses") };
        assert_eq!((first.count, second.count, third.count), (2.0, 2.0, 1.0));
        assert!((first.base().origin().vector().x - 0.05e-3).abs() < 1e-15);
        assert!((first.reading_n_m.x - 0.05e-6).abs() < 1e-15);
        let turn = Rotation3::from_matrix_unchecked(second.base().rotation()).scaled_axis();
        assert!((turn - Vector3::z() * 1e-3).norm() < 1e-12, "{turn}");
    }

    #[test]
    fn verif_a_stay_ends_when_the_base_leaves_the_pose() {
        let mut readings = Readings::default();
        for x_m in [0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0] {
            readings.keep(reading(x_m, 0.0, 1e-3));
        }
        let [there, elsewhere] = readings.means() else { panic!("two poses") };
        assert_eq!((there.count, elsewhere.count), (6.0, 1.0));
        assert!((there.stay_s() - 12e-3).abs() < 1e-12 && (elsewhere.stay_s() - 4e-3).abs() < 1e-12);
    }

    #[test]
    fn regress_rounded_rotations_have_a_mean_pose() {
        let rounded = Rotation3::from_matrix_unchecked(Matrix3::identity() * (1.0 + 1e-15));
        let base = Pose::new(Vector3::zeros(), rounded);
        let mut readings = Readings::default();
        for _ in 0..3 {
            readings.keep(Mean::new(base, Vector2::zeros(), 4e-3, 0.0, Response::default()));
        }
        assert!(readings.means()[0].base().rotation().iter().all(|entry| entry.is_finite()));
    }

    #[test]
    fn verif_readings_with_another_start_are_those_of_the_moved_poses() {
        let start =
            Pose::<Start, Start>::new(Vector3::new(0.02, -0.01, 0.03), Rotation3::new(Vector3::new(0.3, -0.2, 0.5)));
        let taken = [(0.0, 0.0), (0.1e-3, 1e-3), (1e-3, 0.0), (0.15e-3, 2e-3)];
        let (mut before, mut moved) = (Readings::default(), Readings::default());
        for (x_m, turn_rad) in taken {
            let one = reading(x_m, turn_rad, x_m);
            before.keep(one);
            let base = one.base().then(&start);
            moved.keep(Mean::new(base, one.reading_n_m, one.duration_s, 0.0, Response::default()));
        }
        let found = before.seen_from(&start);
        assert_eq!(found.means().len(), 2);
        for (one, other) in found.means().iter().zip(moved.means()) {
            assert!(one.base().origin().distance(&other.base().origin()) < 1e-12);
            assert!((one.base().rotation() - other.base().rotation()).norm() < 1e-9);
            assert!((one.shift_m - other.shift_m).norm() < 1e-12 && one.count == other.count);
        }
    }

    #[test]
    fn verif_later_readings_join_the_means_of_the_earlier_ones() {
        let [mut earlier, mut later, mut all] = [(); 3].map(|()| Readings::default());
        let first = [(0.0, 1e-6), (1e-3, 2e-6)];
        let second = [(1e-3, 4e-6), (2e-3, 3e-6)];
        for (x_m, reading_n_m) in first {
            earlier.keep(reading(x_m, 0.0, reading_n_m));
        }
        second.iter().for_each(|(x_m, reading_n_m)| later.keep(reading(*x_m, 0.0, *reading_n_m)));
        first.iter().chain(&second).for_each(|(x_m, reading_n_m)| all.keep(reading(*x_m, 0.0, *reading_n_m)));
        let both = earlier.followed_by(&later);
        let summary = |readings: &Readings| {
            readings.means().iter().map(|mean| (mean.count, mean.reading_n_m.x)).collect::<Vec<_>>()
        };
        assert_eq!(summary(&both), summary(&all));
        assert_eq!((both.means().len(), both.last), (3, Some(2)));
        let mut many = Readings::default();
        (0..MOST).for_each(|i| many.keep(reading(0.1 + 1e-3 * i as f64, 0.0, 1e-6)));
        assert!(both.followed_by(&many).means().len() <= MOST);
    }

    #[test]
    fn robust_the_number_of_means_is_bounded() {
        let mut readings = Readings::default();
        for i in 0..20 * MOST {
            readings.keep(reading(1e-3 * i as f64, 0.0, 1e-3));
            assert!(readings.means().len() <= MOST);
        }
        let count: f64 = readings.means().iter().map(|mean| mean.count).sum();
        assert!((count - 20.0 * MOST as f64).abs() < 1e-6);
    }
}
