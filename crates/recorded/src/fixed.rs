//! Estimator of a fixed contact: nonlinear generalised least squares over all readings since the touch.
//!
//! The errors of the readings are strongly correlated along the way of the contact: map, friction, hysteresis, drift of the rest
//! reading. Their joint covariance follows from the [`Predictor`], so that the covariance of the contact is that of correlated
//! errors. Errors that no reading shows (pose of the sensor, position of the pin) are added to it.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use whisker::space::sensor::gaussian_process::{Place, Predictor};

/// Settings of the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Standard deviation of the drift of the rest reading, over the largest reading of the calibration.
    pub rest_sd: f64,
    /// Standard deviation of the sensor's position relative to its calibration, along each axis (m).
    pub place_sd_m: f64,
    /// Largest number of readings that are used; more are thinned evenly.
    pub readings: usize,
    /// Distance from the nearest calibrated contact beyond which a contact is not calibrated (m).
    pub reach_m: f64,
    /// Standard deviation of the sensor model, over the largest reading of the calibration, beyond which a contact is not
    /// calibrated.
    pub known: f64,
    /// Squared normalised residual at which a reading counts as outlier.
    pub outlier: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { rest_sd: 0.002, place_sd_m: 0.1e-3, readings: 24, reach_m: 4e-3, known: 0.03, outlier: 16.0 }
    }
}

/// A reading with the pose of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Rotation from the sensor's frame to World.
    pub rotation: Rotation3<f64>,
    /// Origin of the sensor in World (m).
    pub origin_m: Vector3<f64>,
    /// Both bending channels above rest (counts).
    pub counts: Vector2<f64>,
}

impl Reading {
    /// A point of World in the frame of the sensor.
    pub fn to_sensor(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * (point_m - self.origin_m)
    }
}

/// Estimate of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Contact in World (m).
    pub contact_m: Vector3<f64>,
    /// Its covariance (m2), 3x3.
    pub covariance_m2: Matrix3<f64>,
    /// Whether the contact lies within the calibrated domain.
    pub is_calibrated: bool,
}

/// Estimates one fixed contact from touch to release.
pub struct FixedPoint<'a> {
    predictor: &'a Predictor<'a>,
    settings: Settings,
    /// Readings since the touch, after the last one before it.
    readings: Vec<Reading>,
    /// Contacts of the best hypotheses in World.
    places_m: Vec<Vector3<f64>>,
}

/// Largest number of hypotheses from which a search starts, and that are kept.
const STARTS: usize = 24;
const KEPT: usize = 3;

/// Distance between two starts, and between two hypotheses that are one (m).
const APART_M: f64 = 4e-3;
const SAME_M: f64 = 0.5e-3;

/// Iterations of a search, and of the refinement with the joint covariance.
const ITERATIONS: usize = 15;
const REFINEMENTS: usize = 4;

/// Standard deviation of the prior of the contact about the sensor (m).
const PRIOR_SD_M: f64 = 0.05;

impl<'a> FixedPoint<'a> {
    /// An estimator at a touch. `before` is the last reading before it.
    pub fn new(predictor: &'a Predictor<'a>, settings: Settings, before: Reading) -> Self {
        Self { predictor, settings, readings: vec![before], places_m: Vec::new() }
    }

    /// Takes the next reading. `None` if it gives no estimate.
    pub fn step(&mut self, reading: Reading) -> Option<Estimate> {
        self.readings.push(reading);
        let count = self.readings.len() - 1;
        let mut places_m = std::mem::take(&mut self.places_m);
        if count.is_power_of_two() {
            places_m.extend(self.starts());
        }
        let thinned = self.thinned();
        let mut found: Vec<(f64, Vector3<f64>)> = places_m
            .iter()
            .map(|place_m| self.search(*place_m, &thinned))
            .filter(|(cost, _)| cost.is_finite())
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, place_m) in found {
            if self.places_m.len() < KEPT && self.places_m.iter().all(|known| (known - place_m).norm() > SAME_M) {
                self.places_m.push(place_m);
            }
        }
        let refined: Vec<Refined> =
            self.places_m.iter().filter_map(|place_m| self.refine(*place_m, &thinned)).collect();
        let most = refined.iter().map(|one| one.log_weight).fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = refined.iter().map(|one| (one.log_weight - most).exp()).collect();
        let total: f64 = weights.iter().sum();
        let contact_m =
            refined.iter().zip(&weights).map(|(one, weight)| one.place_m * (weight / total)).sum::<Vector3<f64>>();
        let mut covariance_m2 = Matrix3::identity() * self.settings.place_sd_m.powi(2);
        for (one, weight) in refined.iter().zip(&weights) {
            let off = one.place_m - contact_m;
            covariance_m2 += (one.covariance_m2 + off * off.transpose()) * (weight / total);
        }
        let contact = reading.to_sensor(&contact_m);
        let is_known = |channel: usize| self.predictor.map_sd(channel, &contact) <= self.settings.known;
        let is_calibrated = self.predictor.distance_m(&contact) <= self.settings.reach_m && is_known(0) && is_known(1);
        (!refined.is_empty()).then_some(Estimate { contact_m, covariance_m2, is_calibrated })
    }

    /// Indices of the used readings, evenly spaced, the last included.
    fn thinned(&self) -> Vec<usize> {
        let count = self.readings.len() - 1;
        let used = count.min(self.settings.readings);
        (1..=used).map(|i| (i * count).div_ceil(used)).collect()
    }

    /// Calibrated contacts whose readings are nearest to the largest one so far, one of each line.
    fn starts(&self) -> Vec<Vector3<f64>> {
        let Some(largest) = self.readings[1..].iter().max_by(|a, b| a.counts.norm().total_cmp(&b.counts.norm())) else {
            return Vec::new();
        };
        let mut nearest: Vec<(f64, usize, Vector3<f64>)> = Vec::new();
        for sample in self.predictor.samples() {
            let misfit = (sample.reading - largest.counts).norm();
            match nearest.last_mut().filter(|last| last.1 == sample.line) {
                Some(last) if last.0 <= misfit => {}
                Some(last) => *last = (misfit, sample.line, sample.contact_m),
                None => nearest.push((misfit, sample.line, sample.contact_m)),
            }
        }
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut starts: Vec<Vector3<f64>> = Vec::new();
        for (_, _, contact_m) in nearest {
            if starts.len() < STARTS && starts.iter().all(|known| (known - contact_m).norm() > APART_M) {
                starts.push(contact_m);
            }
        }
        starts.iter().map(|contact_m| largest.rotation * contact_m + largest.origin_m).collect()
    }

    /// Contact and load of a reading, for a contact in World.
    fn place(&self, i: usize, place_m: &Vector3<f64>) -> Place {
        let contact_m = self.readings[i].to_sensor(place_m);
        let load = self.readings[i].counts.norm() / self.predictor.process.largest_reading;
        Place { contact_m, load }
    }

    /// Variance of a reading on its own.
    fn variance(&self, load: f64) -> Vector2<f64> {
        let process = self.predictor.process;
        Vector2::from_fn(|channel, _| {
            let kernel = &process.kernels[channel];
            let share = kernel.line_sd(load).powi(2) + kernel.noise_variance(load) + self.settings.rest_sd.powi(2);
            share * process.largest_reading.powi(2)
        })
    }

    /// Gauss-Newton search with independent errors from a start. Returns cost and contact in World.
    fn search(&self, start_m: Vector3<f64>, used: &[usize]) -> (f64, Vector3<f64>) {
        let linearised = |place_m: &Vector3<f64>| {
            let (mut cost, mut normal, mut gradient) = (0.0, Matrix3::zeros(), Vector3::zeros());
            for &i in used {
                let place = self.place(i, place_m);
                if self.predictor.distance_m(&place.contact_m) > self.settings.reach_m {
                    cost += self.settings.outlier;
                    continue;
                }
                let (expected, slopes) = self.predictor.predict(&place.contact_m);
                let residual = self.readings[i].counts - expected;
                let variance = self.variance(place.load);
                let square = residual.component_div(&variance).dot(&residual);
                // Geman-McClure: bounded by the cost of an outlier.
                let share = self.settings.outlier / (self.settings.outlier + square);
                cost += square * share;
                let jacobian = slopes * self.readings[i].rotation.inverse().matrix();
                let scaled =
                    jacobian.transpose() * nalgebra::Matrix2::from_diagonal(&variance.map(|v| share * share / v));
                normal += scaled * jacobian;
                gradient += scaled * residual;
            }
            (cost, normal, gradient)
        };
        let mut place_m = start_m;
        let (mut cost, mut normal, mut gradient) = linearised(&place_m);
        let mut damping = 1e-2;
        for _ in 0..ITERATIONS {
            let damped = normal
                + Matrix3::from_diagonal(&(normal.diagonal() * damping))
                + Matrix3::identity() / PRIOR_SD_M.powi(2);
            let Some(factor) = damped.cholesky() else { break };
            let step = factor.solve(&gradient);
            let next_m = place_m + step * (APART_M / step.norm().max(APART_M));
            let next = linearised(&next_m);
            if next.0 < cost {
                let gained = cost - next.0;
                (cost, normal, gradient) = next;
                place_m = next_m;
                damping *= 0.3;
                if gained < 1e-3 {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        (cost, place_m)
    }

    /// Generalised least squares with the joint covariance of the errors.
    fn refine(&self, start_m: Vector3<f64>, used: &[usize]) -> Option<Refined> {
        let process = self.predictor.process;
        let is_kept = |&&i: &&usize| {
            let place = self.place(i, &start_m);
            if self.predictor.distance_m(&place.contact_m) > self.settings.reach_m {
                return false;
            }
            let residual = self.readings[i].counts - self.predictor.predict(&place.contact_m).0;
            residual.component_div(&self.variance(place.load)).dot(&residual) < 2.0 * self.settings.outlier
        };
        let kept: Vec<usize> = used.iter().filter(is_kept).copied().collect();
        if kept.is_empty() {
            return None;
        }
        let at: Vec<Place> = kept.iter().map(|&i| self.place(i, &start_m)).collect();
        let rest = (self.settings.rest_sd * process.largest_reading).powi(2);
        let factor = |channel: usize| {
            let covariance = self.predictor.covariance(channel, &at) + DMatrix::from_element(at.len(), at.len(), rest);
            covariance.cholesky()
        };
        let factors = [factor(0)?, factor(1)?];
        let prior = Matrix3::identity() / PRIOR_SD_M.powi(2);
        let linearised = |place_m: &Vector3<f64>| {
            let (mut cost, mut normal, mut gradient) = (0.0, prior, Vector3::zeros());
            let rows: Vec<_> = kept
                .iter()
                .map(|&i| {
                    let place = self.place(i, place_m);
                    let (expected, slopes) = self.predictor.predict(&place.contact_m);
                    (self.readings[i].counts - expected, slopes * self.readings[i].rotation.inverse().matrix())
                })
                .collect();
            for (channel, factor) in factors.iter().enumerate() {
                let residual = DVector::from_fn(rows.len(), |i, _| rows[i].0[channel]);
                let jacobian = DMatrix::from_fn(rows.len(), 3, |i, axis| rows[i].1[(channel, axis)]);
                let solved = factor.solve(&jacobian);
                cost += residual.dot(&factor.solve(&residual));
                normal += (jacobian.transpose() * &solved).fixed_view::<3, 3>(0, 0);
                gradient += (solved.transpose() * &residual).fixed_rows::<3>(0);
            }
            (cost, normal, gradient)
        };
        let mut place_m = start_m;
        let (mut cost, mut normal, mut gradient) = linearised(&place_m);
        for _ in 0..REFINEMENTS {
            let step = normal.cholesky()?.solve(&gradient);
            let lengths = [1.0, 0.5, 0.25, 0.125];
            let shorter = lengths.map(|share| (linearised(&(place_m + step * share)), place_m + step * share));
            let Some((next, next_m)) = shorter.into_iter().find(|(next, _)| next.0 < cost) else { break };
            let gained = cost - next.0;
            (cost, normal, gradient) = next;
            place_m = next_m;
            if gained < 1e-3 {
                break;
            }
        }
        let freedom = (2 * kept.len()) as f64 - 3.0;
        let inflation = if freedom > 0.0 { (cost / freedom).max(1.0) } else { 1.0 };
        let factor = normal.cholesky()?;
        let log_determinant = |factor: &nalgebra::Cholesky<f64, nalgebra::Dyn>| {
            2.0 * factor.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>()
        };
        let outliers = (used.len() - kept.len()) as f64 * self.settings.outlier;
        let of_readings: f64 = factors.iter().map(log_determinant).sum();
        let log_weight = -0.5 * (cost + of_readings + outliers + factor.determinant().ln())
            - outliers_evidence(used.len() - kept.len(), process.largest_reading);
        Some(Refined { place_m, covariance_m2: factor.inverse() * inflation, log_weight })
    }
}

/// Negative logarithm of the density of outliers, spread evenly over the range of both channels.
fn outliers_evidence(count: usize, largest_counts: f64) -> f64 {
    2.0 * count as f64 * (2.0 * largest_counts).ln()
}

struct Refined {
    place_m: Vector3<f64>,
    covariance_m2: Matrix3<f64>,
    log_weight: f64,
}

#[cfg(test)]
mod tests {
    use whisker::space::sensor::gaussian_process::{Kernel, Process, Sample};

    use super::*;

    /// Readings of a smooth map (counts).
    fn counts(contact_m: &Vector3<f64>) -> Vector2<f64> {
        let [x, y, z] = (contact_m * 100.0).into();
        Vector2::new(900.0 * z * (1.0 + 0.3 * x), 1500.0 * y * (1.0 - 0.4 * x + 0.2 * x * x) + 60.0 * z * z)
    }

    /// Contacts on lines that leave an undeflected wire along x.
    fn samples() -> Vec<Sample> {
        let mut samples = Vec::new();
        for line in 0..35 {
            let [x, z] = [-0.01 - 0.005 * f64::from(line / 5), 0.004 * f64::from(line % 5 - 2)];
            samples.extend((0..8).map(|step| {
                let contact_m = Vector3::new(x, -0.002 * f64::from(step), z);
                Sample { contact_m, reading: counts(&contact_m), line: line as usize }
            }));
        }
        samples
    }

    #[test]
    fn verif_a_fixed_contact_is_found_without_a_start() {
        let process = Process::new(&samples(), [Kernel::START; 2]).unwrap();
        let predictor = process.predictor();
        let place_m = Vector3::new(0.1, -0.2, 0.05);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.4);
        let at = |step: usize| {
            let contact_m = Vector3::new(-0.02 - 2e-4 * step as f64, -0.001 - 4e-4 * step as f64, 0.002);
            Reading { rotation: turn, origin_m: place_m - turn * contact_m, counts: counts(&contact_m) }
        };
        let mut estimator = FixedPoint::new(&predictor, Settings::default(), at(0));
        let last = (1..30).filter_map(|step| estimator.step(at(step))).last().expect("an estimate");
        assert!(last.is_calibrated);
        let error_m = (last.contact_m - place_m).norm();
        assert!(error_m < 0.2e-3 && error_m < 3.0 * last.covariance_m2.trace().sqrt(), "{error_m}");
    }
}
