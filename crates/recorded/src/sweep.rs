//! Contacts of a sweep over an object: one contact for each row, in a batch.
//!
//! A contact on a frictionless surface moves along it: its velocity in World has no part along the normal, which is the direction
//! of the force on the wire. The force follows from the map of the readings alone. With the energy `E(p)` of the wire whose
//! contact is at `p`, the force is its gradient, and the moment about the root `M = r x F` is its derivative by a rotation about
//! the root. In polar coordinates about the root, in the whisker's plane: `dE/dtheta = M`, hence
//! `E(r, theta)` is the integral of `M` over `theta` from the undeflected wire, where `M = 0`, and
//! `dE/dr` the integral of `dM/dr`.

use std::ops::Range;

use filters::least_squares::{self, Damping, Method, Moves, Problem, Quadratic, minimise};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x2, SVector, Vector3};
use serde::{Deserialize, Serialize};
use whisker::space::sensor::gaussian_process::Predictor;

use crate::fixed::{FixedPoint, Reading, Settings};

/// Settings of the batch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SweepSettings {
    /// Standard deviation of a reading, over the largest of the calibration, and its growth with the load.
    pub reading_sd: [f64; 2],
    /// Standard deviation of the motion along the normal, relative to the motion of the sensor.
    pub normal: f64,
    /// Standard deviation of the change of the contact's motion between two rows, relative to the motion of the sensor.
    pub smooth: f64,
    /// Standard deviation of the contact's motion along the surface while it is followed row by row, and in the first iterations
    /// for all rows together, relative to the motion of the sensor.
    pub slip: f64,
    /// Scale of the Laplace distribution of this motion in the last iterations, relative to the motion of the sensor.
    pub slide: f64,
    /// Standard deviation of the height of a contact relative to its neighbour (m).
    pub height_m: f64,
    /// Iterations for all rows together, of each of two kinds.
    pub iterations: usize,
}

impl Default for SweepSettings {
    fn default() -> Self {
        Self {
            reading_sd: [0.004, 0.01],
            normal: 0.03,
            smooth: 0.15,
            slip: 1.0,
            slide: 0.4,
            height_m: 0.05e-3,
            iterations: 20,
        }
    }
}

/// Channel of the bending in the whisker's plane.
const IN_PLANE: usize = 1;

/// Step of the integral over the angle (rad), and its largest number of steps.
const STEP_RAD: f64 = 0.03;
const STEPS: usize = 60;

/// Direction of the force on the wire at a contact, out of the object, in the frame of the sensor and in the whisker's plane.
/// `None` if the whisker is not deflected there.
pub fn normal(predictor: &Predictor<'_>, root_m: &Vector3<f64>, contact_m: &Vector3<f64>) -> Option<Vector3<f64>> {
    let arm = contact_m - root_m;
    let (radius_m, angle) = (arm.x.hypot(arm.y), arm.y.atan2(arm.x));
    let at = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        let at_m = Vector3::new(root_m.x + radius_m * cos, root_m.y + radius_m * sin, contact_m.z);
        let (reading, slope) = predictor.predict_channel(IN_PLANE, &at_m);
        (reading, slope.x * cos + slope.y * sin, slope.y * cos * radius_m - slope.x * sin * radius_m)
    };
    let (moment, mut by_radius, turning) = at(angle);
    // Towards the undeflected wire the size of the moment decreases.
    let back = if moment * turning > 0.0 { -STEP_RAD } else { STEP_RAD };
    let mut radial = 0.0;
    let mut turned = angle;
    let mut last = moment;
    for _ in 0..STEPS {
        turned += back;
        let (now, next, _) = at(turned);
        if now * moment <= 0.0 || now.abs() > last.abs() {
            break;
        }
        radial -= 0.5 * (by_radius + next) * back;
        (by_radius, last) = (next, now);
    }
    let (sin, cos) = angle.sin_cos();
    let around = moment / radius_m;
    Vector3::new(radial * cos - around * sin, radial * sin + around * cos, 0.0).try_normalize(f64::EPSILON)
}

/// Contact of a row of a sweep, in World.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweptContact {
    /// Contact on the centre line (m).
    pub contact_m: Vector3<f64>,
    /// Posterior covariance (m2). The standard deviation of a reading, most of which is that of the sensor model, counts twice: as
    /// an error of each reading, and as one that all readings have in common, relative to their standard deviations.
    pub covariance_m2: Matrix3<f64>,
}

/// Number of rows from which a contact is first found, and over which it is followed.
const FIRST: usize = 8;

/// A contact is lost after this many consecutive rows whose squared normalised residual exceeds [`UNEXPLAINED`].
const LOST: usize = 3;
const UNEXPLAINED: f64 = 9.0;

/// Iterations for each row while a contact is followed.
const FOLLOWING: usize = 3;

/// Contacts in World of every row of a touch, whose first reading is the last one before it. `None` for contacts outside the
/// calibrated domain.
///
/// A contact that jumps, as from point to point of a star, is lost and found again: the rows between two jumps have their own
/// batch. The covariance along the surface is a lower bound, since the Laplace distribution of the motion has a sharp peak.
pub fn contacts(
    predictor: &Predictor<'_>,
    root_m: &Vector3<f64>,
    touch: &[Reading],
    settings: &SweepSettings,
) -> Vec<Option<SweptContact>> {
    let Some((_, rows)) = touch.split_first() else { return Vec::new() };
    let following = Sweep { predictor, root_m, settings, stage: Stage::Following };
    let batch = Sweep { stage: Stage::Batch, ..following };
    // Forward, row by row, then all rows between two jumps together.
    let mut places = vec![None; rows.len()];
    let mut parts: Vec<Range<usize>> = Vec::new();
    let mut from = 0;
    while from < rows.len() {
        let mut first = FixedPoint::new(predictor, Settings::default(), touch[from]);
        let start = rows[from..].iter().take(FIRST).filter_map(|reading| first.step(*reading)).last();
        let Some(start) = start else {
            from += 1;
            continue;
        };
        let mut found = vec![start.contact_m; FIRST.min(rows.len() - from)];
        following.follow(&rows[from..], &mut found);
        let before = parts.last().map_or(0, |part| part.start + FIRST);
        let to = from + found.len();
        from = following.reach_back(rows, &places, &mut found, before.min(from)..from);
        if let Some(part) = parts.last_mut() {
            part.end = part.end.min(from);
        }
        places[from..to].iter_mut().zip(found).for_each(|(place, found)| *place = Some(found));
        parts.push(from..to);
        from = to;
    }
    let reach_m = Settings::default().reach_m;
    let mut contacts = vec![None; rows.len()];
    for part in parts {
        let rows = &rows[part.clone()];
        let mut places: Vec<Vector3<f64>> = places[part.clone()].iter().flatten().copied().collect();
        for stage in [&following, &batch] {
            stage.solve(rows, &mut places, settings.iterations, false);
        }
        let Some(covariances_m2) = batch.approximated(rows, places.clone()).covariances_m2() else { continue };
        for (i, ((reading, contact_m), covariance_m2)) in part.zip(rows.iter().zip(places).zip(covariances_m2)) {
            let is_known = predictor.distance_m(&reading.to_sensor(&contact_m)) <= reach_m;
            contacts[i] = is_known.then_some(SweptContact { contact_m, covariance_m2 });
        }
    }
    contacts
}

/// Which model of the motion is solved.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    /// Row by row, and at first all rows together: each step holds the normals and is taken, so that it leaves local minima, and
    /// the motion along the surface has a Gaussian distribution.
    Following,
    /// All rows together, with a Laplace distribution, because a contact stays on an edge and slides on a face. Small motions are
    /// not spread over many rows, and a motion in one direction costs the same however it is distributed.
    Batch,
}

/// A sweep of a sensor.
#[derive(Clone, Copy)]
struct Sweep<'a> {
    predictor: &'a Predictor<'a>,
    root_m: &'a Vector3<f64>,
    settings: &'a SweepSettings,
    stage: Stage,
}

impl Sweep<'_> {
    /// Follows a contact from the rows for which it is given until it is lost, or to the last row.
    fn follow(&self, rows: &[Reading], places: &mut Vec<Vector3<f64>>) {
        self.solve(&rows[..places.len()], places, FOLLOWING, false);
        let mut unexplained = 0;
        while places.len() < rows.len() {
            let i = places.len();
            places.push(places[i - 1]);
            let low = i.saturating_sub(FIRST);
            self.solve(&rows[low..=i], &mut places[low..], FOLLOWING, low > 0);
            // A misfit that is not a number is none that is explained.
            let is_explained = self.misfit(&rows[i], &places[i]) <= UNEXPLAINED;
            unexplained = if is_explained { 0 } else { unexplained + 1 };
            // With fewer rows left, a new search would be less certain than the followed contact.
            if unexplained >= LOST && rows.len() >= i + 1 - LOST + FIRST {
                places.truncate(i + 1 - LOST);
                return;
            }
        }
    }

    /// Extends new contacts that begin at the end of `earlier` backwards over its last rows, as long as they explain a row better
    /// than the previous contact, which is lost only some rows after a jump. Returns the first row.
    fn reach_back(
        &self,
        rows: &[Reading],
        followed: &[Option<Vector3<f64>>],
        places: &mut Vec<Vector3<f64>>,
        earlier: Range<usize>,
    ) -> usize {
        let mut from = earlier.end;
        while from > earlier.start {
            let Some(other) = followed[from - 1] else { break };
            let other = self.misfit(&rows[from - 1], &other);
            // Backward in time, the last of the rows held.
            let count = places.len().min(FIRST);
            let back: Vec<Reading> = rows[from - 1..from + count].iter().rev().copied().collect();
            let mut moved: Vec<Vector3<f64>> = places[..count].iter().rev().copied().collect();
            moved.push(places[0]);
            self.solve(&back, &mut moved, FOLLOWING, true);
            if self.misfit(&back[count], &moved[count]) >= other {
                break;
            }
            places.insert(0, moved[count]);
            from -= 1;
        }
        from
    }

    /// Squared residual of a reading, relative to its variance.
    fn misfit(&self, reading: &Reading, place: &Vector3<f64>) -> f64 {
        let residual = reading.counts - self.predictor.predict(&reading.to_sensor(place)).0;
        residual.norm_squared() / self.variance(reading)
    }

    /// Variance of a reading (counts2).
    fn variance(&self, reading: &Reading) -> f64 {
        let largest = self.predictor.process.largest_reading;
        let [of_all, of_load] = self.settings.reading_sd;
        (of_all * largest).powi(2) + (of_load * reading.counts.norm()).powi(2)
    }

    /// Twice the negative logarithm of the density of a motion along the surface, without its constant, and the weight of its
    /// square (1/m2).
    fn slip(&self, moved_m: f64, step_m: f64) -> (f64, f64) {
        /// Motion below which the Laplace distribution is rounded off, relative to the motion of the sensor.
        const ROUNDED: f64 = 0.05;
        match self.stage {
            Stage::Following => {
                let weight = (self.settings.slip * step_m).powi(-2);
                (weight * moved_m * moved_m, weight)
            }
            Stage::Batch => {
                let (rounded_m, scale_m) = (ROUNDED * step_m, self.settings.slide * step_m);
                let length_m = moved_m.hypot(rounded_m);
                (2.0 * (length_m - rounded_m) / scale_m, 1.0 / (scale_m * length_m))
            }
        }
    }

    /// Direction of the force on the wire at a contact in World.
    fn normal(&self, reading: &Reading, place: &Vector3<f64>) -> Option<Vector3<f64>> {
        Some(reading.rotation * normal(self.predictor, self.root_m, &reading.to_sensor(place))?)
    }

    /// Refines the contacts of consecutive rows. While a contact is followed, the method is that of Gauss and Newton with the
    /// normals held in each step; in the batch, that of Levenberg and Marquardt. If `is_tied`, the first contact is held.
    fn solve(&self, rows: &[Reading], places: &mut [Vector3<f64>], iterations: usize, is_tied: bool) {
        /// Decrease of the cost, and norm of a step (m), below which a search has converged.
        const LEAST_GAIN: f64 = 0.5e-3;
        const LEAST_STEP_M: f64 = 1e-6;
        let method = match self.stage {
            Stage::Following => Method::GaussNewton,
            Stage::Batch => Method::LevenbergMarquardt(Damping::MARQUARDT),
        };
        let settings =
            least_squares::Settings { method, iterations, absolute: LEAST_GAIN, relative: 0.0, step: LEAST_STEP_M };
        let start = self.approximated(rows, places.to_vec());
        if let Some(found) = minimise(&Part { sweep: self, rows, is_tied }, start, &settings) {
            places.copy_from_slice(&found.state.places_m);
        }
    }

    /// Contacts with their cost, half the sum of squared and robust errors, and its quadratic approximation.
    fn approximated(&self, rows: &[Reading], places_m: Vec<Vector3<f64>>) -> Approximated {
        /// Squared normalised residual at which a reading counts as outlier, and change of the motion, in standard deviations,
        /// beyond which its weight decreases.
        const OUTLIER: f64 = 16.0;
        const JUMP: f64 = 3.0;
        /// Weak prior of each coordinate (1/m2).
        const PRIOR_PER_M2: f64 = 1e4;
        /// Step of the derivatives of the normals (m).
        const STEP_M: f64 = 2e-5;
        let count = rows.len();
        let (gradient, curvature) = (DVector::zeros(3 * count), DMatrix::identity(3 * count, 3 * count) * PRIOR_PER_M2);
        let mut found = Approximated {
            quadratic: Quadratic { cost: 0.0, gradient, curvature },
            pull: DMatrix::zeros(3 * count, 2),
            places_m,
        };
        // Normals, and their derivatives in the plane: where on the wire a contact lies shows mainly in how they turn.
        let mut normals: Vec<Option<(Vector3<f64>, Matrix3<f64>)>> = Vec::with_capacity(count);
        for (i, (reading, place)) in rows.iter().zip(&found.places_m).enumerate() {
            let (expected, slopes) = self.predictor.predict(&reading.to_sensor(place));
            let jacobian = slopes * reading.rotation.inverse().matrix();
            let variance = self.variance(reading);
            let residual = reading.counts - expected;
            // Geman-McClure, as for fixed contacts.
            let square = residual.norm_squared() / variance;
            let share = OUTLIER / (OUTLIER + square);
            found.quadratic.cost += 0.5 * square * share;
            let weight = share * share / variance;
            let mut of = found.quadratic.gradient.fixed_rows_mut::<3>(3 * i);
            of -= jacobian.transpose() * residual * weight;
            let mut block = found.quadratic.curvature.fixed_view_mut::<3, 3>(3 * i, 3 * i);
            block += jacobian.transpose() * jacobian * weight;
            let of_common: Matrix3x2<f64> = jacobian.transpose() * (weight * variance.sqrt());
            found.pull.fixed_view_mut::<3, 2>(3 * i, 0).copy_from(&of_common);
            normals.push(self.normal(reading, place).map(|direction| {
                let turned = |axis: usize| {
                    if self.stage == Stage::Following {
                        return Vector3::zeros();
                    }
                    let moved = self.normal(reading, &(place + Vector3::ith(axis, STEP_M)));
                    moved.map_or_else(Vector3::zeros, |moved| (moved - direction) / STEP_M)
                };
                (direction, Matrix3::from_columns(&[turned(0), turned(1), Vector3::zeros()]))
            }));
        }
        let settings = self.settings;
        for i in 1..count {
            let step_m = (rows[i].origin_m - rows[i - 1].origin_m).norm().max(1e-5);
            let moved = found.places_m[i] - found.places_m[i - 1];
            let (cost, weight) = self.slip(moved.xy().norm(), step_m);
            let upward = settings.height_m.powi(-2);
            found.quadratic.cost += 0.5 * (cost + upward * moved.z.powi(2));
            let weight = Matrix3::from_diagonal(&Vector3::new(weight, weight, upward));
            found.add(&[(i - 1, -1.0), (i, 1.0)], weight, moved);
            if let (Some((one, one_turns)), Some((other, other_turns))) = (normals[i - 1], normals[i])
                && let Some(mean) = (one + other).try_normalize(0.1)
            {
                let sd_m = settings.normal * step_m;
                // Only the part of the motion across the mean turns it.
                let across = (moved - mean * mean.dot(&moved)) / ((one + other).norm() * sd_m);
                let mut slopes = SVector::<f64, 6>::zeros();
                slopes.fixed_rows_mut::<3>(0).copy_from(&(one_turns.tr_mul(&across) - mean / sd_m));
                slopes.fixed_rows_mut::<3>(3).copy_from(&(other_turns.tr_mul(&across) + mean / sd_m));
                found.add_error(i, mean.dot(&moved) / sd_m, &slopes);
            }
            if i > 1 {
                let change = found.places_m[i] - 2.0 * found.places_m[i - 1] + found.places_m[i - 2];
                // Beyond three standard deviations the weight decreases: contacts jump between edges.
                let variance_m2 = (settings.smooth * step_m).powi(2);
                let square = change.norm_squared() / (JUMP.powi(2) * variance_m2);
                found.quadratic.cost += 0.5 * JUMP.powi(2) * square.ln_1p();
                let weight = Matrix3::identity() / (variance_m2 * (1.0 + square));
                found.add(&[(i - 2, 1.0), (i - 1, -2.0), (i, 1.0)], weight, change);
            }
        }
        found
    }
}

/// Rows of a sweep that are solved together.
struct Part<'a> {
    sweep: &'a Sweep<'a>,
    rows: &'a [Reading],
    /// Whether the first contact is held.
    is_tied: bool,
}

impl Moves for Part<'_> {
    type State = Approximated;

    fn moved(&self, at: &Approximated, step: &DVector<f64>) -> Option<Approximated> {
        let moved = at.places_m.iter().enumerate().map(|(i, place)| place + step.fixed_rows::<3>(3 * i));
        Some(self.sweep.approximated(self.rows, moved.collect()))
    }

    /// The damped step, shortened if a coordinate would change by more than 2 mm.
    fn step(&self, approximation: &Quadratic, damping: f64) -> Option<DVector<f64>> {
        const MOST_M: f64 = 2e-3;
        const HELD: f64 = 1e9;
        let step = if self.is_tied {
            let mut held = approximation.clone();
            (0..3).for_each(|i| held.curvature[(i, i)] *= HELD);
            held.damped_step(damping)?
        } else {
            approximation.damped_step(damping)?
        };
        let share = MOST_M / step.amax().max(MOST_M);
        Some(step * share)
    }
}

impl Problem for Part<'_> {
    fn approximate(&self, at: &Approximated) -> Option<Quadratic> {
        Some(at.quadratic.clone())
    }

    fn cost(&self, at: &Approximated, _: &Approximated) -> Option<f64> {
        Some(at.quadratic.cost)
    }
}

/// Contacts of consecutive rows with the approximation of the cost about them.
struct Approximated {
    places_m: Vec<Vector3<f64>>,
    quadratic: Quadratic,
    /// Gradients that errors add which are one standard deviation of the reading in all rows, for both channels.
    pull: DMatrix<f64>,
}

impl Approximated {
    /// Adds a squared error of the motion between rows: the sum of places, each times a factor, with its inverse covariance.
    fn add(&mut self, at: &[(usize, f64)], weight: Matrix3<f64>, value: Vector3<f64>) {
        for &(i, a) in at {
            let mut of = self.quadratic.gradient.fixed_rows_mut::<3>(3 * i);
            of += weight * value * a;
            for &(j, b) in at {
                let mut block = self.quadratic.curvature.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                block += weight * (a * b);
            }
        }
    }

    /// Adds the square of an error of the contacts of a row and of the one before it, with its derivatives by both.
    fn add_error(&mut self, i: usize, error: f64, slopes: &SVector<f64, 6>) {
        let Quadratic { cost, gradient, curvature } = &mut self.quadratic;
        *cost += 0.5 * error * error;
        let mut of = gradient.fixed_rows_mut::<6>(3 * (i - 1));
        of += slopes * error;
        let mut block = curvature.fixed_view_mut::<6, 6>(3 * (i - 1), 3 * (i - 1));
        block += slopes * slopes.transpose();
    }

    /// Covariance of each contact. `None` unless the curvature is positive definite.
    fn covariances_m2(self) -> Option<Vec<Matrix3<f64>>> {
        let factor = self.quadratic.curvature.cholesky()?;
        let common = factor.solve(&self.pull);
        let inverse = factor.inverse();
        let of = |i: usize| {
            let common: Matrix3x2<f64> = common.fixed_view::<3, 2>(3 * i, 0).into_owned();
            inverse.fixed_view::<3, 3>(3 * i, 3 * i) + common * common.transpose()
        };
        Some((0..inverse.nrows() / 3).map(of).collect())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector2};
    use whisker::space::sensor::gaussian_process::{Kernel, Process, Sample};

    use super::*;

    /// Contacts at a radius and angle about the root, and at a height.
    fn polar(r: f64, bend: f64, z: f64) -> Vector3<f64> {
        Vector3::new(-r * bend.cos(), -r * bend.sin(), z)
    }

    /// With the energy `E = r^-3 (theta - t0)^2`, the moment is `2 r^-3 (theta - t0)` and the force the gradient.
    fn process() -> Process {
        let mut samples = Vec::new();
        for along in 0..10 {
            for height in 0..3 {
                for step in 0..10 {
                    let (r, bend) = (0.015 + 0.003 * f64::from(along), 0.06 * f64::from(step));
                    let counts = Vector2::new(50.0 * f64::from(height - 1), bend * (0.03 / r).powi(3) * 1000.0);
                    let contact_m = polar(r, bend, 0.003 * f64::from(height - 1));
                    samples.push(Sample { contact_m, reading: counts, line: (3 * along + height) as usize });
                }
            }
        }
        Process::new(&samples, [Kernel::START; 2]).unwrap()
    }

    #[test]
    fn verif_the_force_is_the_gradient_of_the_energy() {
        let process = process();
        for (r, bend) in [(0.025, 0.3), (0.033, 0.4)] {
            let found = normal(&process.predictor(), &Vector3::zeros(), &polar(r, bend, 0.0)).unwrap();
            // In the direction of the pin's motion: the pin is pushed back by the wire.
            let (along, across) = (polar(1.0, bend, 0.0), Vector3::new(bend.sin(), -bend.cos(), 0.0));
            let expected = (across * 2.0 * bend / r - along * 3.0 * bend * bend / r).normalize();
            assert!(found.dot(&expected).abs() > 0.999, "{found} {expected}");
        }
    }

    /// Readings of a sensor that moves evenly with its contacts at these places.
    fn readings(predictor: &Predictor<'_>, places: &[Vector3<f64>]) -> Vec<Reading> {
        let reading = |(i, place): (usize, &Vector3<f64>)| {
            let origin_m = Vector3::new(1e-4, 2.5e-4, 0.0) * i as f64;
            let free = Reading { rotation: Rotation3::identity(), origin_m, counts: Vector2::zeros() };
            Reading { counts: predictor.predict(&free.to_sensor(place)).0, ..free }
        };
        places.iter().enumerate().map(reading).collect()
    }

    #[test]
    fn verif_the_covariance_includes_an_error_that_all_readings_have_in_common() {
        let process = process();
        let (predictor, settings) = (process.predictor(), SweepSettings::default());
        let found = |error: f64| {
            let mut readings = readings(&predictor, &[polar(0.03, 0.0, 0.0); 40]);
            for reading in &mut readings {
                let sd =
                    settings.reading_sd[0] * process.largest_reading + settings.reading_sd[1] * reading.counts.norm();
                reading.counts += Vector2::repeat(error * sd);
            }
            contacts(&predictor, &Vector3::zeros(), &readings, &settings)
        };
        let (exact, off) = (found(0.0), found(1.0));
        let errors = exact.iter().zip(&off).skip(20).map(|(exact, off)| (exact.unwrap(), off.unwrap()));
        for (exact, off) in errors {
            let moved = off.contact_m - exact.contact_m;
            let squared = moved.dot(&exact.covariance_m2.cholesky().unwrap().solve(&moved));
            assert!(moved.norm() > 1e-5 && squared < 4.0, "{moved} {squared}");
        }
    }

    #[test]
    fn regress_a_contact_that_jumps_is_found_again() {
        let process = process();
        let (predictor, settings) = (process.predictor(), SweepSettings::default());
        // From an edge far out on the wire to one near its root, that the wire touches with another deflection.
        let places = [[polar(0.036, 0.0, 0.0); 41], [polar(0.022, -0.15, 0.0); 41]].concat();
        let found = contacts(&predictor, &Vector3::zeros(), &readings(&predictor, &places), &settings);
        for (i, (place, found)) in places[1..].iter().zip(&found).enumerate().skip(10) {
            let error_m = (found.expect("a contact").contact_m - place).norm();
            assert!(error_m < 0.5e-3, "{i} {error_m}");
        }
    }

    #[test]
    fn verif_the_gradient_is_that_of_the_cost() {
        let process = process();
        let (predictor, settings) = (process.predictor(), SweepSettings::default());
        let mut places: Vec<Vector3<f64>> =
            (0..6).map(|i| polar(0.03, 0.01 * f64::from(i), 0.0) + Vector3::y() * 1e-4 * f64::from(i)).collect();
        let rows = readings(&predictor, &[polar(0.031, 0.02, 1e-4); 6]);
        let sweep =
            Sweep { predictor: &predictor, root_m: &Vector3::zeros(), settings: &settings, stage: Stage::Batch };
        let gradient = sweep.approximated(&rows, places.clone()).quadratic.gradient;
        for (i, axis) in [(0, 0), (0, 1), (2, 0), (3, 1), (5, 0), (5, 1)] {
            let mut cost = |by_m: f64| {
                places[i][axis] += by_m;
                let cost = sweep.approximated(&rows, places.clone()).quadratic.cost;
                places[i][axis] -= by_m;
                cost
            };
            let slope = (cost(1e-7) - cost(-1e-7)) / 2e-7;
            let error = (gradient[3 * i + axis] - slope).abs();
            assert!(error < 0.02 * slope.abs().max(500.0), "{i} {axis}: {} {slope}", gradient[3 * i + axis]);
        }
    }
}
