//! A contact with Coulomb friction on a round object at rest.

use std::f64::consts::PI;

use filters::{Gaussian, Process, product};
use nalgebra::{RowVector4, SMatrix, SVector, Vector2, vector};
use serde::{Deserialize, Serialize};

use super::Motion;
use super::round::{Round, Tangency, Wandering};
use crate::estimators::side::{Side, StateIndices};
use crate::estimators::{Estimate, FrictionCoefficient, Sample};
use crate::frames::Point;
use crate::sensor::{AlongAway, CalibratedFace};
use crate::settings::{SettingsError, within};

/// Indices in the state.
const RADIUS: usize = 2;
const RATIO: usize = 4;
const COEFFICIENT: usize = 5;

/// Lower bound of the slip (m) by which a contact yields elastically per unit of the ratio of friction to normal force.
/// Below it a contact sticks for no longer than that.
const LEAST_YIELD_M: f64 = 1e-9;

/// Lower bound of the variance that a step adds to the ratio. Without it the covariance would be singular while the contact
/// slips, because the ratio then is the coefficient.
const LEAST_RATIO_VARIANCE: f64 = 1e-8;

/// Lower bound of the random walks over those of `full_wander_radius_m`.
const LEAST_WANDER: f64 = 0.02;

/// A contact on a round object at rest, with Coulomb friction.
///
/// The state is that of [`Round`], then the ratio `q` of friction to normal force, positive if the friction on the whisker is
/// towards its tip, and the coefficient of friction `mu`. The force leans from the normal by `atan q`, which changes reading,
/// tangent and arc length at a given place ([`crate::sensor::Lean`]).
///
/// Whisker and object slip on one another by `ds = e (rho - r) dpsi - dS` towards the whisker's tip: the contact moves by
/// `dS` along the whisker and, as the tangent turns by `dpsi` on the object, by `e (rho - r) dpsi` along its surface (`r` the
/// radius of the wire, `e` = +1 if the object is on the left). While the contact sticks, `q` changes such that there is no
/// slip: by `-ds / c`, with the slip `ds` at the old ratio and the compliance `c = d(ds)/dq` of the whisker at the object.
/// The ratio is bounded by `mu` on either side; there the contact slips. Both together are the exact quasi-static play between
/// stick and slip.
///
/// The slip has an error in proportion to the way of the contact, because object and whisker are not exactly as assumed. The
/// ratio of a step is the mean of the bounded one over this error, and its variance is the noise of the process: where the
/// slip is too small for its direction to be known, the ratio is uncertain by `mu` on either side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::estimators) struct Rubbing {
    /// The object. Its random walks are those of one with the radius `full_wander_radius_m`.
    pub object: Round,
    /// Radius of object and wire from which on the random walks of the object are the full ones; those of a smaller one are in
    /// proportion to the radius.
    pub full_wander_radius_m: f64,
    /// Prior mean of the coefficient of friction.
    pub coefficient: f64,
    /// Prior standard deviation of the coefficient of friction.
    pub coefficient_sd: f64,
    /// Random walk of the coefficient, as the standard deviation after one second.
    pub coefficient_wander_sqrt_s: f64,
    /// Standard deviation of the slip's error over the way of the contact.
    pub slip_error: f64,
    /// Largest standard deviation with which the coefficient is stated.
    pub stated_sd: f64,
}

impl Default for Rubbing {
    fn default() -> Self {
        Self {
            object: Round::of_changing_scale(),
            full_wander_radius_m: 2e-3,
            coefficient: 0.3,
            coefficient_sd: 0.3,
            coefficient_wander_sqrt_s: 0.01,
            slip_error: 0.01,
            stated_sd: 0.06,
        }
    }
}

impl Rubbing {
    /// The settings relative to the radius of the calibration's pin and wire.
    pub(in crate::estimators) fn beyond_pin(self, face: &CalibratedFace) -> Self {
        Self { object: self.object.beyond_pin(face), ..self }
    }

    pub(in crate::estimators) fn validate(&self) -> Result<(), SettingsError> {
        self.object.validate()?;
        within("full_wander_radius_m", self.full_wander_radius_m, 1e-6..=1.0)?;
        within("coefficient", self.coefficient, 0.0..=1.0)?;
        within("coefficient_sd", self.coefficient_sd, 1e-3..=1.0)?;
        within("coefficient_wander_sqrt_s", self.coefficient_wander_sqrt_s, 1e-6..=1.0)?;
        within("slip_error", self.slip_error, 1e-6..=1.0)?;
        within("stated_sd", self.stated_sd, 1e-3..=1.0)
    }

    /// The belief with the prior of the friction.
    fn extended(&self, belief: &Gaussian<4>) -> Gaussian<6> {
        let (mean, variance) = (self.coefficient, self.coefficient_sd.powi(2));
        let variances = SVector::<f64, 6>::from([0.0, 0.0, 0.0, 0.0, mean.powi(2) + variance, variance]);
        let mut covariance = SMatrix::<f64, 6, 6>::from_diagonal(&variances);
        covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&belief.covariance);
        let object = belief.mean;
        Gaussian::new(SVector::from([object[0], object[1], object[2], object[3], 0.0, mean]), covariance)
    }
}

impl Motion<6> for Rubbing {
    const INDICES: StateIndices = StateIndices { model_error: Some(3), gain: None, friction: Some(RATIO) };

    type Step<'a> = Sticking<'a>;

    fn belief(&self, place: &Gaussian<2>) -> Gaussian<6> {
        self.extended(&self.object.belief(place))
    }

    fn parts(&self, place: &Gaussian<2>) -> Vec<(Gaussian<6>, f64)> {
        self.object.parts(place).iter().map(|(part, log_weight)| (self.extended(part), *log_weight)).collect()
    }

    fn radius(&self) -> Option<usize> {
        Motion::radius(&self.object)
    }

    fn step<'a>(&self, side: &'a Side, sample: &Sample) -> Sticking<'a> {
        Sticking {
            object: self.object.step(side, sample),
            full_wander_radius_m: self.full_wander_radius_m,
            slip_error: self.slip_error,
            coefficient_variance: self.coefficient_wander_sqrt_s.powi(2) * sample.dt_s,
            is_back: sample.dt_s == 0.0,
        }
    }

    /// Adds the coefficient of friction, if the readings determine it.
    fn place(&self, _: &Side, belief: &Gaussian<6>, estimate: Estimate) -> Estimate {
        let sd = belief.covariance[(COEFFICIENT, COEFFICIENT)].max(0.0).sqrt();
        let friction = FrictionCoefficient { coefficient: belief.mean[COEFFICIENT].abs(), sd };
        Estimate { friction: (sd <= self.stated_sd).then_some(friction), ..estimate }
    }
}

/// Process of one step.
pub(in crate::estimators) struct Sticking<'a> {
    object: Wandering<'a>,
    full_wander_radius_m: f64,
    slip_error: f64,
    /// Variance that the step adds to the coefficient of friction.
    coefficient_variance: f64,
    /// Whether the step leads back to an earlier instant, for which the ratio is taken to be that of the present one.
    is_back: bool,
}

/// A contact with a ratio of friction to normal force.
struct Rest {
    place: Vector2<f64>,
    tangency: Tangency,
    /// Derivatives of the tangent's angle by the coordinates and by the ratio.
    tangent_by: (Vector2<f64>, f64),
    /// Arc length, and its derivatives by the coordinates and by the ratio.
    arc_m: f64,
    arc_by: (Vector2<f64>, f64),
}

/// Derivatives by coordinates along and away, radius and ratio.
type Row = RowVector4<f64>;

fn row(by_place: &Vector2<f64>, by_radius: f64, by_ratio: f64) -> Row {
    Row::new(by_place[0], by_place[1], by_radius, by_ratio)
}

impl Rest {
    /// Derivative of the object's centre by the ratio, at a fixed contact.
    fn middle_by_ratio(&self, radius_m: f64) -> Vector2<f64> {
        let inward = self.tangency.inward;
        vector![-inward.y, inward.x] * (radius_m * self.tangent_by.1)
    }

    /// Derivative of the coordinates by the ratio, with the object's centre at rest.
    fn place_by_ratio(&self, radius_m: f64) -> Vector2<f64> {
        -product(&self.tangency.inverse, &self.middle_by_ratio(radius_m))
    }
}

/// Result of one step.
struct Moved {
    place: Vector2<f64>,
    ratio: Bounded,
    before: Rest,
    /// At the old ratio, and at the new one.
    kept: Rest,
    after: Rest,
    /// Angle by which the tangent turns on the object at the old ratio.
    turn_rad: f64,
    /// Compliance of the contact: slip per ratio.
    yield_m: f64,
}

impl Sticking<'_> {
    fn tangency(&self, place: &Vector2<f64>, radius_m: f64, ratio: f64) -> Tangency {
        let (at, side) = (AlongAway::of_state(place), self.object.side);
        Tangency::new(side, place, radius_m, side.turn_with_friction_rad(at, ratio).0)
    }

    fn rest(&self, place: Vector2<f64>, radius_m: f64, ratio: f64) -> Rest {
        let (at, side) = (AlongAway::of_state(&place), self.object.side);
        let (turn, turn_by_ratio) = side.turn_with_friction_rad(at, ratio);
        let arc = side.arc_with_friction_m(at, ratio);
        Rest {
            place,
            tangency: Tangency::new(side, &place, radius_m, turn),
            tangent_by: (turn.1 + vector![side.face.rest.curvature_per_m(at.along_m), 0.0], turn_by_ratio),
            arc_m: arc.value,
            arc_by: (arc.by_place, arc.by_ratio),
        }
    }

    /// +1 if the object is on the left of the whisker, -1 if it is on the right.
    fn side_sign(&self) -> f64 {
        -self.object.side.face.face.away_sign()
    }

    /// Radius of the object's surface, from that of the object and the wire together.
    fn surface_radius_m(&self, place: &Vector2<f64>, radius_m: f64) -> f64 {
        self.side_sign() * (radius_m - self.object.side.wire_radius_m(place[0]))
    }

    fn moved(&self, x: &SVector<f64, 6>) -> Moved {
        let (place, radius_m, ratio, most): (Vector2<f64>, _, _, _) =
            (x.fixed_rows::<2>(0).into(), x[RADIUS], x[RATIO], x[COEFFICIENT].abs());
        let (face, motion) = (&self.object.side.face, &self.object.motion);
        let before = self.rest(place, radius_m, ratio);
        let middle_m = motion.apply(Point::from_vector(before.tangency.middle_m)).vector();
        let start = face.along_and_away(motion.apply(before.tangency.contact)).vector();
        let found = |start, ratio| {
            Tangency::place_with_middle(&middle_m, start, |place| self.tangency(place, radius_m, ratio)).0
        };
        let kept = self.rest(found(start, ratio), radius_m, ratio);
        let turn_rad = self.object.turn_rad(&before.tangency, &kept.tangency);
        let surface_m = self.surface_radius_m(&place, radius_m);
        let slip_m = surface_m * turn_rad - (kept.arc_m - before.arc_m);
        let by_ratio = kept.place_by_ratio(radius_m);
        let turned = kept.tangent_by.0.dot(&by_ratio) + kept.tangent_by.1;
        let yield_m = (surface_m * turned - kept.arc_by.0.dot(&by_ratio) - kept.arc_by.1).max(LEAST_YIELD_M);
        let bounded = if self.is_back {
            Bounded::free(ratio)
        } else if kept.place[1] <= 0.0 {
            Bounded::unknown(most)
        } else {
            let error_m = self.slip_error * self.object.way_m(before.tangency.contact);
            Bounded::new(ratio - slip_m / yield_m, error_m / yield_m, most)
        };
        let guess = kept.place + by_ratio * (bounded.mean - ratio);
        let after = self.rest(found(guess, bounded.mean), radius_m, bounded.mean);
        Moved { place: after.place, ratio: bounded, before, kept, after, turn_rad, yield_m }
    }
}

impl Process<6> for Sticking<'_> {
    fn predict(&self, x: &SVector<f64, 6>) -> SVector<f64, 6> {
        let moved = self.moved(x);
        let kept = self.object.kept(moved.before.tangency.contact);
        SVector::from([moved.place[0], moved.place[1], x[2], x[3] * kept, moved.ratio.mean, x[5]])
    }

    fn jacobian(&self, x: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        self.linearised(x).1
    }

    fn noise(&self, x: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
        self.linearised(x).2
    }

    /// Neglects the change of the compliance with the state.
    fn linearised(&self, x: &SVector<f64, 6>) -> (SVector<f64, 6>, SMatrix<f64, 6, 6>, SMatrix<f64, 6, 6>) {
        let radius_m = x[RADIUS];
        let Moved { place, ratio, before, kept, after, turn_rad, yield_m } = self.moved(x);
        let correlation = self.object.kept(before.tangency.contact);
        let rotation = self.object.motion.rotation();
        // Of the object's centre, in the order of a `Row`.
        let mut middle_by = SMatrix::<f64, 2, 4>::zeros();
        middle_by.fixed_view_mut::<2, 2>(0, 0).copy_from(&before.tangency.by_place);
        middle_by.set_column(2, &before.tangency.inward);
        middle_by.set_column(3, &before.middle_by_ratio(radius_m));
        let middle_by = product(&rotation, &middle_by);
        // Of the coordinates at a ratio, of which the given multiple is added.
        let place_by = |rest: &Rest, by_ratio: f64| {
            let mut by = middle_by;
            let radius = by.column(2) - rest.tangency.inward;
            by.set_column(2, &radius);
            let ratio = by.column(3) - rest.middle_by_ratio(radius_m) * by_ratio;
            by.set_column(3, &ratio);
            product(&rest.tangency.inverse, &by)
        };
        let kept_by = place_by(&kept, 1.0);
        let change = |(by_place, by_ratio): &(Vector2<f64>, f64),
                      (before_place, before_ratio): &(Vector2<f64>, f64)| {
            product(&by_place.transpose(), &kept_by) + row(&-before_place, 0.0, by_ratio - before_ratio)
        };
        let surface_m = self.surface_radius_m(&x.fixed_rows::<2>(0).into(), radius_m);
        let slip_by = change(&kept.tangent_by, &before.tangent_by) * surface_m - change(&kept.arc_by, &before.arc_by)
            + row(&Vector2::zeros(), self.side_sign() * turn_rad, 0.0);
        let ratio_by = (row(&Vector2::zeros(), 0.0, 1.0) - slip_by / yield_m) * ratio.by_free;
        let by_ratio = after.place_by_ratio(radius_m);
        let after_by = place_by(&after, 0.0) + product(&by_ratio, &ratio_by);

        let mut jacobian = SMatrix::<f64, 6, 6>::from_diagonal(&vector![0.0, 0.0, 1.0, correlation, 0.0, 1.0]);
        let columns = [0, 1, RADIUS, RATIO];
        for (column, from) in columns.into_iter().enumerate() {
            jacobian.fixed_view_mut::<2, 1>(0, from).copy_from(&after_by.column(column));
            jacobian[(RATIO, from)] = ratio_by[column];
        }
        let by_most = ratio.by_most * x[COEFFICIENT].signum();
        jacobian[(RATIO, COEFFICIENT)] = by_most;
        jacobian.fixed_view_mut::<2, 1>(0, COEFFICIENT).copy_from(&(by_ratio * by_most));

        let mut noise = SMatrix::<f64, 6, 6>::zeros();
        let turn_rad = self.object.turn_rad(&before.tangency, &after.tangency);
        noise.fixed_view_mut::<4, 4>(0, 0).copy_from(&self.object.noise_over(correlation, turn_rad, radius_m));
        let wander = (radius_m / self.full_wander_radius_m).clamp(LEAST_WANDER, 1.0).powi(2);
        (0..=RADIUS).for_each(|i| noise[(i, i)] *= wander);
        let mut by_error = SVector::<f64, 6>::zeros();
        by_error.fixed_rows_mut::<2>(0).copy_from(&by_ratio);
        by_error[RATIO] = 1.0;
        noise += by_error * by_error.transpose() * (ratio.variance + LEAST_RATIO_VARIANCE);
        noise[(COEFFICIENT, COEFFICIENT)] = self.coefficient_variance;
        (SVector::from([place[0], place[1], x[2], x[3] * correlation, ratio.mean, x[5]]), jacobian, noise)
    }
}

/// Mean and variance of a normally distributed ratio that is bounded on either side, and derivatives of the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bounded {
    mean: f64,
    variance: f64,
    /// By the mean of the distribution without bounds.
    by_free: f64,
    /// By the bound.
    by_most: f64,
}

impl Bounded {
    /// The distribution `N(z, sd^2)` bounded by `-most` and `most`. With the distances `a`, `b` of the bounds in standard
    /// deviations, the normal distribution `F` and its density `f`:
    ///
    /// ```text
    /// E[q] = m (1 - F(b) - F(a)) + z (F(b) - F(a)) + sd (f(a) - f(b))
    /// E[q^2] = m^2 (1 - F(b) + F(a)) + (z^2 + sd^2) (F(b) - F(a)) + 2 z sd (f(a) - f(b)) + sd^2 (a f(a) - b f(b))
    /// ```
    fn new(z: f64, sd: f64, most: f64) -> Self {
        let sd = sd.max(LEAST_SD);
        let (a, b) = ((-most - z) / sd, (most - z) / sd);
        let (below, above) = (normal(a), normal(-b));
        let inside = (1.0 - below - above).max(0.0);
        let (at_a, at_b) = (density(a), density(b));
        let mean = most * (above - below) + z * inside + sd * (at_a - at_b);
        // A density vanishes faster than its argument grows.
        let edge = |at: f64, density: f64| if density > 0.0 { at * density } else { 0.0 };
        let square = most * most * (above + below)
            + (z * z + sd * sd) * inside
            + 2.0 * z * sd * (at_a - at_b)
            + sd * sd * (edge(a, at_a) - edge(b, at_b));
        let mean = mean.clamp(-most, most);
        Self { mean, variance: (square - mean * mean).clamp(0.0, most * most), by_free: inside, by_most: above - below }
    }

    /// A ratio without bounds.
    fn free(ratio: f64) -> Self {
        Self { mean: ratio, variance: 0.0, by_free: 1.0, by_most: 0.0 }
    }

    /// A ratio of either sign.
    fn unknown(most: f64) -> Self {
        Self { mean: 0.0, variance: most * most, by_free: 0.0, by_most: 0.0 }
    }
}

/// Lower bound of the standard deviation of a bounded ratio.
const LEAST_SD: f64 = 1e-6;

/// Density of the normal distribution.
fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
}

/// Normal distribution function to 1e-7 (Abramowitz and Stegun 1964, 26.2.17).
fn normal(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let series =
        t * (0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let beyond = density(x) * series;
    if x > 0.0 { 1.0 - beyond } else { beyond }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastica::{Circle, Elastica, Touch};
    use crate::estimators::testing::{knowledge, swept};
    use crate::frames::{Base, Pose, World};

    const STEP_S: f64 = 0.004;

    /// The base slides along the object, turns and returns, with pauses of stick at every reversal.
    fn base(step: u32) -> Pose<Base, World> {
        let t = f64::from(step) * STEP_S;
        Pose::new(3e-3 * (4.0 * t).sin(), 1e-3 * (3.0 * t).sin(), 0.05 * (5.0 * t).sin())
    }

    fn sample(from: u32, to: u32) -> Sample {
        let motion = base(from).then(&base(to).inverse());
        Sample { motion, dt_s: STEP_S * f64::from(to - from), reading_n_m: 0.0 }
    }

    #[test]
    fn val_contact_sticks_and_slips_as_on_the_exact_whisker() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        for radius_m in [0.5e-3, 15e-3] {
            let middle = knowledge.rest.beside(0.055, radius_m - 6e-3);
            let circle = Circle { center: Point::from_vector(middle.vector()), radius_m };
            let rubbing = Rubbing { slip_error: 1e-5, ..Rubbing::default() };
            let exact = swept(&elastica, &circle, 0.4, (0..500).map(base));
            let state = |(touch, ratio): &(Touch, f64)| {
                let AlongAway { along_m, away_m } = side.face.along_and_away(touch.deflection.point);
                SVector::<f64, 6>::from([along_m, away_m, radius_m + 0.125e-3, 0.0, *ratio, 0.4])
            };
            let mut followed = state(&exact[0]);
            let (mut worst_m, mut worst_ratio, mut stuck) = (0.0_f64, 0.0_f64, 0);
            for step in 1..500 {
                followed = rubbing.step(&side, &sample(step - 1, step)).predict(&followed);
                let expected = state(&exact[step as usize]);
                worst_m = worst_m.max((followed - expected).fixed_rows::<2>(0).norm());
                worst_ratio = worst_ratio.max((followed[RATIO] - expected[RATIO]).abs());
                stuck += u32::from(expected[RATIO].abs() < 0.399);
            }
            assert!(worst_m < 2e-5 && worst_ratio < 0.1 && stuck > 5, "{radius_m}: {worst_m} {worst_ratio} {stuck}");
        }
    }

    #[test]
    fn verif_jacobian_is_that_of_the_prediction() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        for (radius_m, ratio, steps) in [(2e-3, 0.1, 1), (20e-3, -0.2, 1), (2e-3, 0.3, 20), (20e-3, -0.3, 25)] {
            let step = Rubbing::default().step(&side, &sample(20, 20 + steps));
            let x = SVector::<f64, 6>::from([0.055, 3e-3, radius_m, 0.7, ratio, 0.35]);
            let jacobian = step.jacobian(&x);
            for i in 0..6 {
                let h = if i >= 3 { 1e-4 } else { 1e-8 };
                let change = step.predict(&(x + SVector::ith(i, h))) - step.predict(&(x - SVector::ith(i, h)));
                let (expected, found) = (change / (2.0 * h), jacobian.column(i));
                for j in [0, 1, 2, 4, 5] {
                    let tolerance = 2e-3 + 2e-2 * expected[j].abs();
                    assert!(
                        (found[j] - expected[j]).abs() < tolerance,
                        "{radius_m} {steps} {j} {i}: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn verif_random_walks_of_a_small_object_are_in_proportion_to_its_radius() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let radius_sd_m = |radius_m: f64| {
            let x = SVector::<f64, 6>::from([0.055, 3e-3, radius_m, 0.0, 0.3, 0.3]);
            Rubbing::default().step(&side, &sample(20, 21)).noise(&x)[(RADIUS, RADIUS)].sqrt()
        };
        assert!((radius_sd_m(1e-3) / radius_sd_m(0.5e-3) - 2.0).abs() < 1e-9);
        assert_eq!(radius_sd_m(0.1), radius_sd_m(0.02));
    }

    #[test]
    fn verif_a_bounded_ratio_has_the_moments_of_its_distribution() {
        for (z, sd, most) in [(0.1, 0.05, 0.3), (0.35, 0.1, 0.3), (-2.0, 0.1, 0.3), (1.0, 5.0, 0.3), (0.0, 0.2, 0.1)] {
            let found = Bounded::new(z, sd, most);
            let (mut weight, mut mean, mut square, mut inside) = (0.0, 0.0, 0.0, 0.0);
            for i in -6000..=6000 {
                let at = f64::from(i) * 1e-3;
                let (q, density): (f64, f64) = (z + sd * at, density(at));
                weight += density;
                mean += density * q.clamp(-most, most);
                square += density * q.clamp(-most, most).powi(2);
                inside += density * f64::from(q.abs() < most);
            }
            let (mean, square, inside) = (mean / weight, square / weight, inside / weight);
            assert!((found.mean - mean).abs() < 1e-5, "{found:?} {mean}");
            assert!((found.variance - (square - mean * mean)).abs() < 1e-5, "{found:?} {square}");
            assert!((found.by_free - inside).abs() < 1e-3, "{found:?} {inside}");
            let h = 1e-4;
            let by_most = (Bounded::new(z, sd, most + h).mean - Bounded::new(z, sd, most - h).mean) / (2.0 * h);
            assert!((found.by_most - by_most).abs() < 1e-3, "{found:?} {by_most}");
        }
    }
}
