//! Bound for a sensor that deviates from its calibration, and an object of unknown size and velocity.
//!
//! The deviations are constant states with a prior, beside the contact. An estimator that knew the shape of the object, the
//! kinds of the deviations and the distribution of their values, but not the values, could not have a smaller mean square
//! error. The prior is Gaussian with the mean square of the values that the random suites draw. The derivatives of the reading
//! by the deviations are those at zero deviation, with the physics of [`crate::miscalibration`]:
//!
//! | deviation | derivative of the reading `h(p)` of a contact seen at `p`, with the gradient `g` |
//! | --- | --- |
//! | gain, stiffness | `h`, and `h (r - 1) / s` with the deviation `s` of the stiffness and the ratio `r` of the readings with and without it |
//! | offset, drift | `R`, and `R t`, with the largest calibrated reading `R` |
//! | mount | `g . (-p_y, p_x)`, `g_x` and `g_y` |
//! | latency | `g . dp/dt` of the resting contact |
//!
//! If the size of the object is unknown too, the logarithm of its scale `c` is a further state. The whisker touches the outline
//! where both have the same direction, which scaling does not change: a contact displaced by `m` relative to the object since the
//! touch has the derivative `m` by `ln c`. If the object moves with an unknown constant velocity `v`, this is a further state with
//! its own prior; at the time `t` after the touch it adds `v t` to the displacement.
//!
//! If the object gives way to the whisker, its displacement since the touch is a random walk that is part of the contact. The
//! standard deviation of a step is that of the actual displacement since the last instant, in an unknown direction. An estimator
//! that knew when and by how much the object is displaced, but not in which direction, and assumed independent directions, could
//! not have a smaller mean square error. One that does not know the amounts has a larger error; one that knew the friction of the
//! object, and that it is pushed along the contact force, could have a smaller one.

use filters::product;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use trace::Miscalibration;
use whisker::frames::{Base, Point};
use whisker::sensor::Prediction;

/// Number of deviations, and of states with contact and size before them and the velocity after them.
const COUNT: usize = 8;
const SIZE: usize = 2;
const VELOCITY: usize = SIZE + 1 + COUNT;
const STATES: usize = VELOCITY + 2;

/// Prior standard deviation of the velocity of an object that moves, in each direction. It is the same for all whiskers and
/// motions, of the order of the speeds of the suite `hollow` (0.2 to 2 mm/s); that of `drifting` is in proportion to the speed of
/// the whisker before the touch.
const VELOCITY_SD_M_S: f64 = 1e-3;

/// Smallest and largest absolute value of each deviation in the random suites, between which it is log-uniform.
const VALUES: [(&str, f64, f64); COUNT] = [
    ("gain", 0.003, 0.05),
    ("offset", 0.001, 0.02),
    ("drift_per_s", 0.0003, 0.005),
    ("stiffness", 0.005, 0.05),
    ("mount_rad", 0.0008, 0.0087),
    ("mount_x_m", 3e-5, 3e-4),
    ("mount_y_m", 3e-5, 3e-4),
    ("latency_s", 5e-4, 5e-3),
];

/// Names of the deviations that a method with unknown gain and mounting estimates.
const INSTALLATION: [&str; 4] = ["gain", "mount_rad", "mount_x_m", "mount_y_m"];

/// Bounds of what an estimator may state beside the contact after the last reading of a trace, as standard deviations, with an
/// object of unknown size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QuantityBounds {
    /// Gain, and yaw (rad) and position (m) of the mounting. All of them are unknown, as are the other deviations that are not
    /// zero.
    pub installation: [f64; 4],
    /// Velocity of the object in World (m/s), x and y, with a prior standard deviation of 1 mm/s in each direction; the deviations
    /// that are not zero are unknown. `None` if the object is at rest.
    pub velocity_m_s: Option<[f64; 2]>,
}

/// Ratio of the largest to the smallest size of each kind of object in the random suites, between which it is log-uniform.
const SIZES: [(&str, f64); 9] = [
    ("pin", 10.0 / 3.0),
    ("circle", 100.0),
    ("ellipse", 15.0),
    ("stadium", 15.0),
    ("rectangle", 10.0),
    ("plate", 4.0),
    ("regular_polygon", 50.0 / 6.0),
    ("convex_polygon", 6.25),
    ("rounded_polygon", 20.0 / 3.0),
];

/// Prior variance of the logarithm of an object's size by its kind; that of a log-uniform size is the squared logarithm of
/// the ratio divided by 12. Zero for other kinds.
pub(super) fn size_variance(kind: &str) -> f64 {
    let ratio = SIZES.iter().find(|(known, _)| *known == kind).map_or(1.0, |(_, ratio)| *ratio);
    ratio.ln().powi(2) / 12.0
}

/// Deviations of a trial.
#[derive(Clone, Copy, Debug)]
pub struct Deviations<'a> {
    /// The deviations; those that are not zero are unknown to the estimator.
    pub of: &'a Miscalibration,
    /// Ratios of the readings at the actual stiffness, see [`crate::miscalibration::stiffness_ratios`].
    pub stiffness_ratios: Option<&'a [f64]>,
    /// Largest calibrated reading of the face.
    pub largest_n_m: f64,
}

impl Deviations<'_> {
    /// Prior variances; zero for a quantity that does not deviate. The mean square of a log-uniform value between `a` and
    /// `b` is `(b^2 - a^2) / (2 ln(b / a))`.
    fn variances(&self) -> [f64; COUNT] {
        let Miscalibration { gain, offset, drift_per_s, stiffness, mount_rad, mount_x_m, mount_y_m, latency_s } =
            *self.of;
        let values = [gain, offset, drift_per_s, stiffness, mount_rad, mount_x_m, mount_y_m, latency_s];
        std::array::from_fn(|i| if values[i] == 0.0 { 0.0 } else { mean_square(VALUES[i]) })
    }

    /// Derivatives of a reading by the deviations at a row of a trace, for a contact seen at `seen` that moves with
    /// `velocity_m_s` in Base.
    pub(super) fn slopes(
        &self,
        row: usize,
        since_start_s: f64,
        seen: Point<Base>,
        velocity_m_s: Vector2<f64>,
        expected: &Prediction,
    ) -> [f64; COUNT] {
        let (reading_n_m, gradient_n) = (expected.reading_n_m, expected.gradient_n);
        let by_stiffness = self.stiffness_ratios.map_or(0.0, |ratios| (ratios[row] - 1.0) / self.of.stiffness);
        [
            reading_n_m,
            self.largest_n_m,
            self.largest_n_m * since_start_s,
            reading_n_m * by_stiffness,
            gradient_n.y * seen.x() - gradient_n.x * seen.y(),
            gradient_n.x,
            gradient_n.y,
            gradient_n.dot(&velocity_m_s),
        ]
    }
}

fn mean_square((_, low, high): (&str, f64, f64)) -> f64 {
    (high.powi(2) - low.powi(2)) / (2.0 * (high / low).ln())
}

/// Index in the state of a deviation.
fn index(name: &str) -> usize {
    SIZE + 1 + VALUES.iter().position(|(known, ..)| *known == name).expect("a deviation's name")
}

/// Covariance of the contact at the touch, the size, the deviations and the velocity.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    covariance: SMatrix<f64, STATES, STATES>,
}

/// A reading of a contact.
pub(super) struct JointReading {
    /// Derivative by the contact in World.
    pub(super) by_contact: Vector2<f64>,
    /// Displacement of the contact relative to the object since the touch, in World.
    pub(super) moved_m: Vector2<f64>,
    /// Time since the touch.
    pub(super) since_touch_s: f64,
    /// Derivatives by the deviations.
    pub(super) by_deviations: [f64; COUNT],
    /// Variance of its noise.
    pub(super) variance_n2_m2: f64,
}

impl Joint {
    /// Before the first touch.
    pub(super) fn new(deviations: &Deviations<'_>, size_variance: f64) -> Self {
        let mut covariance = SMatrix::zeros();
        covariance[(SIZE, SIZE)] = size_variance;
        for (i, variance) in deviations.variances().into_iter().enumerate() {
            covariance[(SIZE + 1 + i, SIZE + 1 + i)] = variance;
        }
        Self { covariance }
    }

    /// The same for an object that moves.
    pub(super) fn moving(mut self) -> Self {
        for i in [VELOCITY, VELOCITY + 1] {
            self.covariance[(i, i)] = VELOCITY_SD_M_S.powi(2);
        }
        self
    }

    /// The same for a sensor of which gain and mounting are unknown.
    pub(super) fn installed(mut self) -> Self {
        for name in INSTALLATION {
            let i = index(name);
            self.covariance[(i, i)] = mean_square(VALUES[i - SIZE - 1]);
        }
        self
    }

    /// Begins a touch, whose contact has this prior; the other states are those of the touches before.
    pub(super) fn touch(&mut self, prior_m2: &Matrix2<f64>) {
        self.covariance.fixed_rows_mut::<2>(0).fill(0.0);
        self.covariance.fixed_columns_mut::<2>(0).fill(0.0);
        self.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(prior_m2);
    }

    /// Adds a step of the random walk of an object that gives way: its displacement since the last instant.
    pub(super) fn walk(&mut self, step_m: &Vector2<f64>) {
        // The mean square of a step in an unknown direction, along each of two axes.
        let variance_m2 = 0.5 * step_m.norm_squared();
        for i in 0..2 {
            self.covariance[(i, i)] += variance_m2;
        }
    }

    /// Conditions on a reading. Constant states have no process, so that this and [`Self::walk`] are the bound's whole recursion.
    pub(super) fn update(&mut self, reading: &JointReading) {
        let mut slope = SVector::<f64, STATES>::zeros();
        slope.fixed_rows_mut::<2>(0).copy_from(&reading.by_contact);
        slope[SIZE] = reading.by_contact.dot(&reading.moved_m);
        slope.fixed_rows_mut::<2>(VELOCITY).copy_from(&(reading.by_contact * reading.since_touch_s));
        slope.fixed_rows_mut::<COUNT>(SIZE + 1).copy_from(&SVector::from(reading.by_deviations));
        let cross = product(&self.covariance, &slope);
        let variance = slope.dot(&cross) + reading.variance_n2_m2;
        self.covariance -= product(&cross, &cross.transpose()) / variance;
    }

    /// Square root of the trace of the covariance of a contact that has moved by `moved_m` relative to the object in the time since
    /// the touch.
    pub(super) fn sd_m(&self, moved_m: Vector2<f64>, since_touch_s: f64) -> f64 {
        let slope = |axis: usize| {
            let mut slope = SVector::<f64, STATES>::zeros();
            slope[axis] = 1.0;
            slope[SIZE] = moved_m[axis];
            slope[VELOCITY + axis] = since_touch_s;
            slope
        };
        let variance_m2 = |axis: usize| slope(axis).dot(&product(&self.covariance, &slope(axis)));
        (variance_m2(0) + variance_m2(1)).max(0.0).sqrt()
    }

    /// Standard deviations of gain and mounting.
    pub(super) fn installation_sds(&self) -> [f64; 4] {
        INSTALLATION.map(|name| self.sd(index(name)))
    }

    /// Standard deviations of the velocity (m/s).
    pub(super) fn velocity_sds_m_s(&self) -> [f64; 2] {
        [VELOCITY, VELOCITY + 1].map(|i| self.sd(i))
    }

    fn sd(&self, i: usize) -> f64 {
        self.covariance[(i, i)].max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use filters::bound::Bound;

    use super::*;

    fn suite_file(name: &str) -> String {
        let path = format!("{}/../../sim/whisker_sim/random_suite/{name}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn verif_priors_are_those_of_the_random_suites() {
        let effects = suite_file("effects.py");
        for (name, low, high) in VALUES {
            let after = effects.rsplit(&format!("\"{name}\": ")).next().unwrap();
            let arguments: Vec<&str> = after.split('(').nth(1).unwrap().split([',', ')']).map(str::trim).collect();
            let found: Vec<f64> = arguments[1..3].iter().map(|text| text.parse().unwrap()).collect();
            assert_eq!(found, [low, high], "{name}");
        }
    }

    /// Information of the readings of a contact, without unknown size and deviations.
    #[test]
    fn verif_without_further_unknowns_the_bound_is_that_of_the_contact() {
        let prior_m2 = Matrix2::new(1e-4, 2e-6, 2e-6, 1e-6);
        let exact = Miscalibration::default();
        let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m: 5e-5 };
        let mut bound = Bound::new(&prior_m2).unwrap();
        let mut joint = Joint::new(&deviations, 0.0);
        joint.touch(&prior_m2);
        for i in 0..50 {
            let by_contact = Vector2::new(1e-4 * f64::from(i).sin(), -3e-3);
            bound.update(by_contact * by_contact.transpose() / 1e-14);
            let moved_m = Vector2::new(1e-3, 2e-3);
            joint.update(&JointReading {
                by_contact,
                moved_m,
                since_touch_s: 0.0,
                by_deviations: [1.0; COUNT],
                variance_n2_m2: 1e-14,
            });
        }
        let expected_m = bound.covariance().unwrap().trace().sqrt();
        assert!(
            (joint.sd_m(Vector2::zeros(), 0.0) / expected_m - 1.0).abs() < 1e-4,
            "{} {expected_m}",
            joint.sd_m(Vector2::zeros(), 0.0)
        );
    }

    /// A contact that moves by 10 mm on an object whose size is unknown, read along one direction only.
    #[test]
    fn verif_an_unknown_size_and_an_unknown_gain_raise_the_bound() {
        let prior_m2 = Matrix2::identity() * 1e-6;
        let sd_m = |gain: f64, size_variance: f64| {
            let of = Miscalibration { gain, ..Miscalibration::default() };
            let deviations = Deviations { of: &of, stiffness_ratios: None, largest_n_m: 5e-5 };
            let mut joint = Joint::new(&deviations, size_variance);
            joint.touch(&prior_m2);
            for i in 0..100 {
                let moved_m = Vector2::new(0.0, 1e-4 * f64::from(i));
                let by_deviations = std::array::from_fn(|i| if i == 0 { 2e-5 } else { 0.0 });
                let by_contact = Vector2::new(-3e-4, 3e-3);
                joint.update(&JointReading {
                    by_contact,
                    moved_m,
                    since_touch_s: 0.0,
                    by_deviations,
                    variance_n2_m2: 1e-13,
                });
            }
            joint.sd_m(Vector2::new(0.0, 1e-2), 0.0)
        };
        let known_m = sd_m(0.0, 0.0);
        assert!(sd_m(0.02, 0.0) > known_m && sd_m(0.0, size_variance("circle")) > known_m);
        assert_eq!(size_variance("unknown"), 0.0);
    }

    /// Readings of a contact at a known place with the same derivative by the gain determine the gain as a mean does; what they do
    /// not depend on keeps its prior.
    #[test]
    fn verif_the_bound_of_the_gain_is_that_of_a_mean() {
        let exact = Miscalibration::default();
        let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m: 5e-5 };
        let mut joint = Joint::new(&deviations, 0.0).installed();
        let prior = joint.installation_sds();
        joint.touch(&Matrix2::zeros());
        for _ in 0..400 {
            let by_deviations = std::array::from_fn(|i| if i == 0 { 2e-5 } else { 0.0 });
            let (by_contact, moved_m) = (Vector2::zeros(), Vector2::zeros());
            joint.update(&JointReading {
                by_contact,
                moved_m,
                since_touch_s: 0.0,
                by_deviations,
                variance_n2_m2: 1e-14,
            });
        }
        let [gain, yaw, ..] = joint.installation_sds();
        let of_mean = 1e-7 / 2e-5 / 20.0;
        assert!((gain / of_mean - 1.0).abs() < 1e-3, "{gain} {of_mean}");
        assert_eq!(yaw, prior[1]);
        assert!((prior[1] - 3.965e-3).abs() < 1e-6, "{prior:?}");
        assert_eq!(joint.velocity_sds_m_s(), [0.0; 2]);
    }

    /// A contact read in both directions at rest and in uniform motion, as in the straight line through readings at equal
    /// intervals: the variance of its end is four times that of the mean.
    #[test]
    fn verif_an_unknown_velocity_is_the_slope_of_a_line() {
        let exact = Miscalibration::default();
        let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m: 5e-5 };
        let end_m = |joint: Joint| {
            let mut joint = joint;
            joint.touch(&(Matrix2::identity() * 1e-4));
            for i in 0..1000 {
                let since_touch_s = f64::from(i) / 100.0;
                for by_contact in [Vector2::x(), Vector2::y()] {
                    let moved_m = Vector2::zeros();
                    let by_deviations = [0.0; COUNT];
                    joint.update(&JointReading {
                        by_contact,
                        moved_m,
                        since_touch_s,
                        by_deviations,
                        variance_n2_m2: 1e-8,
                    });
                }
            }
            joint.sd_m(Vector2::zeros(), 9.99)
        };
        let (rests_m, moves_m) = (end_m(Joint::new(&deviations, 0.0)), end_m(Joint::new(&deviations, 0.0).moving()));
        assert!((moves_m / rests_m - 2.0).abs() < 0.01, "{moves_m} {rests_m}");
    }

    /// Read in both directions with the variance `r` of the noise, a contact with steps of the variance `q` along each axis has the
    /// steady-state variance `p` of the Riccati equation `p^2 = q (r - p)` (one axis; after a reading).
    #[test]
    fn verif_a_random_walk_has_the_steady_variance_of_the_riccati_equation() {
        let exact = Miscalibration::default();
        let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m: 5e-5 };
        let mut joint = Joint::new(&deviations, 0.0);
        joint.touch(&(Matrix2::identity() * 1e-4));
        for _ in 0..2000 {
            joint.walk(&Vector2::new(6e-6, -8e-6));
            for by_contact in [Vector2::x(), Vector2::y()] {
                joint.update(&JointReading {
                    by_contact,
                    moved_m: Vector2::zeros(),
                    since_touch_s: 0.0,
                    by_deviations: [0.0; COUNT],
                    variance_n2_m2: 1e-8,
                });
            }
        }
        let q: f64 = 0.5e-10;
        let p = 0.5 * ((q * q + 4.0 * q * 1e-8).sqrt() - q);
        let sd_m = joint.sd_m(Vector2::zeros(), 0.0);
        assert!((sd_m / (2.0 * p).sqrt() - 1.0).abs() < 1e-6, "{sd_m}");
    }

    /// A contact that slides to and fro over an object of unknown size, read in both directions. The effects of size and velocity
    /// on the readings are correlated, but not proportional, so that the bound is larger with both unknown than with either.
    #[test]
    fn verif_an_unknown_size_raises_the_bound_of_a_moving_object() {
        let exact = Miscalibration::default();
        let deviations = Deviations { of: &exact, stiffness_ratios: None, largest_n_m: 5e-5 };
        let moved_m = |since_touch_s: f64| Vector2::new(3e-3 * (2.0 * since_touch_s).sin(), 0.0);
        let end_m = |mut joint: Joint| {
            joint.touch(&(Matrix2::identity() * 1e-4));
            for i in 0..100 {
                let since_touch_s = f64::from(i) / 100.0;
                for by_contact in [Vector2::x(), Vector2::y()] {
                    joint.update(&JointReading {
                        by_contact,
                        moved_m: moved_m(since_touch_s),
                        since_touch_s,
                        by_deviations: [0.0; COUNT],
                        variance_n2_m2: 1e-8,
                    });
                }
            }
            joint.sd_m(moved_m(0.99), 0.99)
        };
        let of_size = size_variance("circle");
        let [moving_m, unsized_m, both_m] = [
            Joint::new(&deviations, 0.0).moving(),
            Joint::new(&deviations, of_size),
            Joint::new(&deviations, of_size).moving(),
        ]
        .map(end_m);
        assert!(both_m > 1.01 * moving_m.max(unsized_m), "{moving_m} {unsized_m} {both_m}");
    }
}
