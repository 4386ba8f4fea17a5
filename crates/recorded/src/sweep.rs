//! Contacts of a sweep over an object: one contact for each row, in a batch.
//!
//! A contact on a frictionless surface moves along it: its velocity in World has no part along the normal, which is the direction
//! of the force on the wire. The force follows from the map of the readings alone. With the energy `E(p)` of the wire whose
//! contact is at `p`, the force is its gradient, and the moment about the root `M = r x F` is its derivative by a rotation about
//! the root. In polar coordinates about the root, in the whisker's plane: `dE/dtheta = M`, hence
//! `E(r, theta)` is the integral of `M` over `theta` from the undeflected wire, where `M = 0`, and
//! `dE/dr` the integral of `dM/dr`.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x2, Vector3};
use serde::{Deserialize, Serialize};

use crate::fixed::{FixedPoint, Reading, Settings};
use crate::process::Predictor;

/// Settings of the batch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SweepSettings {
    /// Standard deviation of a reading, over the largest of the calibration, and its growth with the load.
    pub reading_sd: [f64; 2],
    /// Standard deviation of the motion along the normal, relative to the motion of the sensor.
    pub normal: f64,
    /// Standard deviation of the change of the contact's motion between two rows, relative to the motion of the sensor.
    pub smooth: f64,
    /// Standard deviation of the contact's motion along the surface, relative to the motion of the sensor.
    pub slip: f64,
    /// Standard deviation of the height of a contact relative to its neighbour (m).
    pub height_m: f64,
    /// Iterations.
    pub iterations: usize,
}

impl Default for SweepSettings {
    fn default() -> Self {
        Self { reading_sd: [0.004, 0.01], normal: 0.03, smooth: 0.15, slip: 1.0, height_m: 0.05e-3, iterations: 15 }
    }
}

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
        let (reading, slopes) =
            predictor.predict(&Vector3::new(root_m.x + radius_m * cos, root_m.y + radius_m * sin, contact_m.z));
        (
            reading.y,
            slopes[(1, 0)] * cos + slopes[(1, 1)] * sin,
            slopes[(1, 1)] * cos * radius_m - slopes[(1, 0)] * sin * radius_m,
        )
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
    /// Posterior covariance (m2). The standard deviation of a reading, most of which is that of the sensor model, counts twice: as an
    /// error of each reading, and as one that all readings have in common, relative to their standard deviations.
    pub covariance_m2: Matrix3<f64>,
}

/// Contacts in World of every row of a touch, whose first reading is the last one before it. `None` for contacts outside the
/// calibrated domain.
pub fn contacts(
    predictor: &Predictor<'_>,
    root_m: &Vector3<f64>,
    touch: &[Reading],
    settings: &SweepSettings,
) -> Vec<Option<SweptContact>> {
    const FIRST: usize = 8;
    let rows = &touch[1..];
    let count = rows.len();
    let mut first = FixedPoint::new(predictor, Settings::default(), touch[0]);
    let start = rows.iter().take(FIRST).filter_map(|reading| first.step(*reading)).last();
    let Some(start) = start else { return vec![None; count] };
    let mut places: Vec<Vector3<f64>> = vec![start.contact_m; count];
    // Forward, row by row, then all rows together.
    for i in FIRST.min(count)..count {
        places[i] = places[i - 1];
        let low = i.saturating_sub(FIRST);
        solve(predictor, root_m, &rows[low..=i], &mut places[low..=i], settings, 3, low > 0);
    }
    solve(predictor, root_m, rows, &mut places, settings, settings.iterations, false);
    let Some(covariances_m2) = Linearised::about(predictor, root_m, rows, &places, settings).covariances_m2() else {
        return vec![None; count];
    };
    let reach_m = Settings::default().reach_m;
    let known = |((reading, contact_m), covariance_m2): ((&Reading, Vector3<f64>), Matrix3<f64>)| {
        let is_known = predictor.distance_m(&reading.to_sensor(&contact_m)) <= reach_m;
        is_known.then_some(SweptContact { contact_m, covariance_m2 })
    };
    rows.iter().zip(places).zip(covariances_m2).map(known).collect()
}

/// Gauss-Newton steps for the contacts of consecutive rows. `is_tied` holds the first contact.
fn solve(
    predictor: &Predictor<'_>,
    root_m: &Vector3<f64>,
    rows: &[Reading],
    places: &mut [Vector3<f64>],
    settings: &SweepSettings,
    iterations: usize,
    is_tied: bool,
) {
    for _ in 0..iterations {
        let mut linearised = Linearised::about(predictor, root_m, rows, places, settings);
        if is_tied {
            for axis in 0..3 {
                linearised.normal_matrix[(axis, axis)] += 1e12;
            }
        }
        let Some(factor) = linearised.normal_matrix.cholesky() else { return };
        let step = factor.solve(&linearised.gradient);
        let most_m = step.amax();
        let share = (2e-3 / most_m.max(2e-3)).min(1.0);
        for (i, place) in places.iter_mut().enumerate() {
            *place += step.fixed_rows::<3>(3 * i) * share;
        }
        if most_m < 1e-6 {
            break;
        }
    }
}

/// The normal equations of the contacts of consecutive rows.
struct Linearised {
    normal_matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Gradients that errors add which are one standard deviation of the reading in all rows, for both channels.
    pull: DMatrix<f64>,
}

impl Linearised {
    fn about(
        predictor: &Predictor<'_>,
        root_m: &Vector3<f64>,
        rows: &[Reading],
        places: &[Vector3<f64>],
        settings: &SweepSettings,
    ) -> Self {
        let count = rows.len();
        let largest = predictor.process.largest_counts;
        let mut normal_matrix = DMatrix::<f64>::zeros(3 * count, 3 * count);
        let mut gradient = DVector::<f64>::zeros(3 * count);
        let mut pull = DMatrix::<f64>::zeros(3 * count, 2);
        let mut normals = Vec::with_capacity(count);
        for (i, reading) in rows.iter().enumerate() {
            let contact_m = reading.to_sensor(&places[i]);
            let (expected, slopes) = predictor.predict(&contact_m);
            let to_sensor = reading.rotation.inverse();
            let jacobian = slopes * to_sensor.matrix();
            let load = reading.counts.norm() / largest;
            let variance = (settings.reading_sd[0].powi(2) + (settings.reading_sd[1] * load).powi(2)) * largest.powi(2);
            let residual = reading.counts - expected;
            // Geman-McClure, as for fixed contacts.
            let share = 16.0 / (16.0 + residual.norm_squared() / variance);
            let weight = share * share / variance;
            let mut of = gradient.fixed_rows_mut::<3>(3 * i);
            of += jacobian.transpose() * residual * weight;
            let mut block = normal_matrix.fixed_view_mut::<3, 3>(3 * i, 3 * i);
            block += jacobian.transpose() * jacobian * weight;
            let of_common: Matrix3x2<f64> = jacobian.transpose() * (weight * variance.sqrt());
            pull.fixed_view_mut::<3, 2>(3 * i, 0).copy_from(&of_common);
            normals.push(normal(predictor, root_m, &contact_m).map(|direction| reading.rotation * direction));
        }
        let mut add = |at: &[(usize, f64)], weight: Matrix3<f64>, value: Vector3<f64>| {
            for &(i, a) in at {
                let part = weight * value * a;
                let mut of = gradient.fixed_rows_mut::<3>(3 * i);
                of -= part;
                for &(j, b) in at {
                    let mut block = normal_matrix.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                    block += weight * (a * b);
                }
            }
        };
        for i in 1..count {
            let step_m = (rows[i].origin_m - rows[i - 1].origin_m).norm().max(1e-5);
            let moved = places[i] - places[i - 1];
            let up = Vector3::z() * Vector3::z().transpose();
            let mut weight =
                (Matrix3::identity() - up) / (settings.slip * step_m).powi(2) + up / settings.height_m.powi(2);
            if let (Some(one), Some(other)) = (normals[i - 1], normals[i])
                && let Some(mean) = (one + other).try_normalize(0.1)
            {
                weight += mean * mean.transpose() / (settings.normal * step_m).powi(2);
            }
            add(&[(i - 1, -1.0), (i, 1.0)], weight, moved);
            if i > 1 {
                let change = places[i] - 2.0 * places[i - 1] + places[i - 2];
                // Beyond three standard deviations the weight decreases: contacts jump between edges.
                let sd_m = settings.smooth * step_m;
                let share = 1.0 / (1.0 + change.norm_squared() / (3.0 * sd_m).powi(2));
                add(&[(i - 2, 1.0), (i - 1, -2.0), (i, 1.0)], Matrix3::identity() * share / sd_m.powi(2), change);
            }
        }
        for i in 0..3 * count {
            normal_matrix[(i, i)] += 1e4;
        }
        Self { normal_matrix, gradient, pull }
    }

    /// Covariance of each contact. `None` unless the normal matrix is positive definite.
    fn covariances_m2(self) -> Option<Vec<Matrix3<f64>>> {
        let factor = self.normal_matrix.cholesky()?;
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

    use super::*;
    use crate::kernel::{Kernel, Sample};
    use crate::process::Process;

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
                    samples.push(Sample { contact_m, counts, line: (3 * along + height) as usize });
                }
            }
        }
        Process::new(&samples, [Kernel::START; 2]).unwrap()
    }

    #[test]
    fn verif_the_force_is_the_gradient_of_the_energy() {
        let process = process();
        for (r, bend) in [(0.025, 0.3), (0.033, 0.4)] {
            let found = normal(&process.without(&[]), &Vector3::zeros(), &polar(r, bend, 0.0)).unwrap();
            // In the direction of the pin's motion: the pin is pushed back by the wire.
            let (along, across) = (polar(1.0, bend, 0.0), Vector3::new(bend.sin(), -bend.cos(), 0.0));
            let expected = (across * 2.0 * bend / r - along * 3.0 * bend * bend / r).normalize();
            assert!(found.dot(&expected).abs() > 0.999, "{found} {expected}");
        }
    }

    #[test]
    fn verif_the_covariance_includes_an_error_that_all_readings_have_in_common() {
        let process = process();
        let (predictor, settings) = (process.without(&[]), SweepSettings::default());
        let place = polar(0.03, 0.0, 0.0);
        let readings = |error: f64| -> Vec<Reading> {
            let reading = |i: i32| {
                let origin_m = Vector3::new(1e-4 * f64::from(i), 2.5e-4 * f64::from(i), 0.0);
                let free = Reading { rotation: Rotation3::identity(), origin_m, counts: Vector2::zeros() };
                let counts = predictor.predict(&free.to_sensor(&place)).0;
                let sd = settings.reading_sd[0] * process.largest_counts + settings.reading_sd[1] * counts.norm();
                Reading { counts: counts + Vector2::repeat(error * sd), ..free }
            };
            (0..40).map(reading).collect()
        };
        let found = |error: f64| contacts(&predictor, &Vector3::zeros(), &readings(error), &settings);
        let (exact, off) = (found(0.0), found(1.0));
        let errors = exact.iter().zip(&off).skip(20).map(|(exact, off)| (exact.unwrap(), off.unwrap()));
        for (exact, off) in errors {
            let moved = off.contact_m - exact.contact_m;
            let squared = moved.dot(&exact.covariance_m2.cholesky().unwrap().solve(&moved));
            assert!(moved.norm() > 1e-5 && squared < 4.0, "{moved} {squared}");
        }
    }
}
