//! Gaussian process from a contact to both readings (Rasmussen and Williams, "Gaussian Processes for Machine
//! Learning", 2006, chapter 2; predictions on held-out groups of samples by section 5.4.2).

use nalgebra::{DMatrix, DVector, Matrix2x3, Vector2, Vector3};

use super::kernel::{Kernel, Place, Sample};
use super::mean::{Mean, expected};
use super::trend::Trend;
use crate::space::sensor::neighbours::neighbours_of;

/// Residual of a sample, predicted from all others, over its standard deviation, beyond which it is left out as an outlier: the
/// pin slipped off, or the wire jumped to another equilibrium.
const OUTLIER_SDS: f64 = 6.0;

/// Largest number of rounds in which outliers are left out.
const OUTLIER_ROUNDS: usize = 10;

/// A fitted sensor model.
#[derive(Clone, Debug)]
pub struct Process {
    /// Covariance of each channel.
    pub kernels: [Kernel; 2],
    /// Samples of the fit.
    pub samples: Vec<Sample>,
    /// Largest reading of a channel, `R`.
    pub largest_reading: f64,
    places: Vec<Place>,
    /// Factor of the predicted covariance of each channel, with which it agrees with the errors on held-out lines.
    inflation: [f64; 2],
    trend: Trend,
    /// Inverse covariance of the samples, and its product with their deviations from the trend, over `R`, by channel.
    inverse: [DMatrix<f64>; 2],
    weights: [DVector<f64>; 2],
}

/// Residual of a held-out sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOut {
    /// Index of the sample.
    pub sample: usize,
    /// Reading minus prediction, 2x1.
    pub error: Vector2<f64>,
    /// Predicted standard deviation of each, 2x1.
    pub sd: Vector2<f64>,
}

impl Process {
    /// Fits a process to samples. `None` if their covariance is singular.
    pub fn new(samples: &[Sample], kernels: [Kernel; 2]) -> Option<Self> {
        let largest_reading = samples.iter().map(|sample| sample.reading.amax()).fold(0.0, f64::max);
        let trend = Trend::new(samples, largest_reading)?;
        let place = |sample: &Sample| Place::of(sample.contact_m, &sample.reading, largest_reading);
        let places: Vec<Place> = samples.iter().map(place).collect();
        let solve = |channel: usize| {
            let kernel = &kernels[channel];
            let covariance = covariance(samples, &places, kernel);
            let inverse = filters::inverse(&covariance)?;
            let deviation =
                |i: usize| samples[i].reading[channel] / largest_reading - trend.at(&samples[i].contact_m).0[channel];
            let weights = &inverse * DVector::from_fn(samples.len(), |i, _| deviation(i));
            Some((inverse, weights))
        };
        let ((first, first_weights), (second, second_weights)) = (solve(0)?, solve(1)?);
        Some(Self {
            kernels,
            samples: samples.to_vec(),
            largest_reading,
            places,
            inflation: [1.0; 2],
            trend,
            inverse: [first, second],
            weights: [first_weights, second_weights],
        })
    }

    /// Fits a process without outliers, and returns the indices of the samples that were left out. An outlier impairs the
    /// predictions of its neighbours, so that those with more than half of the largest normalised residual are left out first.
    pub fn robust(samples: &[Sample], kernels: [Kernel; 2]) -> Option<(Self, Vec<usize>)> {
        let mut process = Self::new(samples, kernels)?;
        let mut kept: Vec<usize> = (0..samples.len()).collect();
        for _ in 0..OUTLIER_ROUNDS {
            let sizes: Vec<f64> = (0..process.samples.len()).map(|i| process.left_out_sds(i)).collect();
            let most = sizes.iter().copied().fold(0.0, f64::max);
            let least = OUTLIER_SDS.max(0.5 * most);
            if most <= least {
                break;
            }
            kept = kept.into_iter().zip(&sizes).filter(|(_, size)| **size <= least).map(|(i, _)| i).collect();
            process = Self::new(&kept.iter().map(|&i| samples[i]).collect::<Vec<_>>(), kernels)?;
        }
        let outliers = (0..samples.len()).filter(|i| kept.binary_search(i).is_err()).collect();
        Some((process, outliers))
    }

    /// Residual of a sample, predicted from all others, in standard deviations; the larger of both channels.
    fn left_out_sds(&self, i: usize) -> f64 {
        let of_channel = |channel: usize| (self.weights[channel][i] / self.inverse[channel][(i, i)].sqrt()).abs();
        of_channel(0).max(of_channel(1))
    }

    /// Multiplies the predicted covariance of each channel by the mean normalised squared error on held-out lines, if it is
    /// larger than one. `None` as by [`Self::held_out`], or if a predicted variance is zero.
    pub fn inflate(&mut self, neighbours: &[Vec<usize>]) -> Option<()> {
        let held = self.held_out(neighbours)?;
        for (channel, inflation) in self.inflation.iter_mut().enumerate() {
            let squares = held.iter().map(|one| (one.error[channel] / one.sd[channel]).powi(2));
            let mean = squares.sum::<f64>() / held.len().max(1) as f64;
            *inflation = Some(mean.max(1.0)).filter(|_| mean.is_finite())?;
        }
        Some(())
    }

    /// Residuals of every sample, predicted without the lines that `neighbours` lists for its line. `None` if the covariance of the
    /// samples of such lines given the others is singular.
    pub fn held_out(&self, neighbours: &[Vec<usize>]) -> Option<Vec<HeldOut>> {
        let mut found = Vec::new();
        for (line, held) in neighbours.iter().enumerate() {
            let rows: Vec<usize> = (0..self.samples.len()).filter(|&i| held.contains(&self.samples[i].line)).collect();
            let own: Vec<usize> = (0..rows.len()).filter(|&i| self.samples[rows[i]].line == line).collect();
            if own.is_empty() {
                continue;
            }
            let mut of_channel = Vec::new();
            for channel in 0..2 {
                let block = self.inverse[channel].select_rows(&rows).select_columns(&rows);
                let covariance = filters::inverse(&block)?;
                let error = &covariance * self.weights[channel].select_rows(&rows);
                of_channel.push((error, covariance));
            }
            found.extend(own.iter().map(|&i| HeldOut {
                sample: rows[i],
                error: Vector2::new(of_channel[0].0[i], of_channel[1].0[i]) * self.largest_reading,
                sd: Vector2::from_fn(|channel, _| of_channel[channel].1[(i, i)].max(0.0).sqrt()) * self.largest_reading,
            }));
        }
        Some(found)
    }

    /// The expected readings, without what their covariances need.
    pub(super) fn mean(&self) -> Mean {
        Mean {
            kernels: self.kernels,
            trend: self.trend.clone(),
            contacts_m: self.samples.iter().map(|sample| sample.contact_m).collect(),
            weights: self.weights.each_ref().map(|weights| weights.as_slice().to_vec()),
        }
    }

    /// The predictor from all samples.
    pub fn predictor(&self) -> Predictor<'_> {
        Predictor {
            process: self,
            weights: self.weights.clone(),
            dropped: [0, 1].map(|_| DMatrix::zeros(0, 0)),
            is_kept: vec![true; self.samples.len()],
            rows: Vec::new(),
        }
    }

    /// The predictor without the samples of some lines. `None` if the covariance of these samples given the others is singular.
    pub fn without(&self, lines: &[usize]) -> Option<Predictor<'_>> {
        let rows: Vec<usize> = (0..self.samples.len()).filter(|&i| lines.contains(&self.samples[i].line)).collect();
        let mut predictor = self.predictor();
        if rows.is_empty() {
            return Some(predictor);
        }
        for channel in 0..2 {
            let columns = self.inverse[channel].select_columns(&rows);
            let block = columns.select_rows(&rows);
            let inverse = filters::inverse(&block)?;
            predictor.weights[channel] -= columns * (&inverse * self.weights[channel].select_rows(&rows));
            predictor.dropped[channel] = inverse;
        }
        for &row in &rows {
            predictor.weights.iter_mut().for_each(|weights| weights[row] = 0.0);
            predictor.is_kept[row] = false;
        }
        Some(Predictor { rows, ..predictor })
    }
}

fn covariance(samples: &[Sample], places: &[Place], kernel: &Kernel) -> DMatrix<f64> {
    let count = samples.len();
    let mut covariance = DMatrix::zeros(count, count);
    for i in 0..count {
        for j in 0..=i {
            let (a, b) = (&places[i], &places[j]);
            let mut value = kernel.map(&a.contact_m, &b.contact_m);
            if samples[i].line == samples[j].line {
                value +=
                    kernel.line_sd(a.load) * kernel.line_sd(b.load) * kernel.along((a.contact_m - b.contact_m).norm());
            }
            if i == j {
                value += kernel.noise_variance(a.load);
            }
            covariance[(i, j)] = value;
            covariance[(j, i)] = value;
        }
    }
    covariance
}

/// Lines that are left out with each line: itself and those whose centre is at most 1.5 times as far away as the nearest.
pub fn neighbours(samples: &[Sample]) -> Vec<Vec<usize>> {
    let count = samples.iter().map(|sample| sample.line + 1).max().unwrap_or(0);
    let center = |line: usize| {
        let points: Vec<_> =
            samples.iter().filter(|sample| sample.line == line).map(|sample| sample.contact_m).collect();
        points.iter().sum::<Vector3<f64>>() / points.len() as f64
    };
    neighbours_of(&(0..count).map(center).collect::<Vec<_>>())
}

/// Predicts readings from the samples of a process, or from a part of them.
#[derive(Clone, Debug)]
pub struct Predictor<'a> {
    /// The process.
    pub process: &'a Process,
    weights: [DVector<f64>; 2],
    /// Inverse of the block of the inverse covariance that belongs to the dropped samples.
    dropped: [DMatrix<f64>; 2],
    rows: Vec<usize>,
    is_kept: Vec<bool>,
}

impl Predictor<'_> {
    /// Samples from which the readings are predicted.
    pub fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.process.samples.iter().zip(&self.is_kept).filter(|(_, is_kept)| **is_kept).map(|(sample, _)| sample)
    }

    /// Distance of a contact from the nearest calibrated one (m).
    pub fn distance_m(&self, contact_m: &Vector3<f64>) -> f64 {
        self.samples().map(|sample| (sample.contact_m - contact_m).norm_squared()).fold(f64::INFINITY, f64::min).sqrt()
    }

    /// Expected reading, 2x1, in the unit of the samples, and its derivatives by the contact (that unit per m), 2x3.
    pub fn predict(&self, contact_m: &Vector3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
        let [(first, first_slopes), (second, second_slopes)] =
            [0, 1].map(|channel| self.predict_channel(channel, contact_m));
        (Vector2::new(first, second), Matrix2x3::from_rows(&[first_slopes.transpose(), second_slopes.transpose()]))
    }

    /// The same of one channel, 0 or 1, with the derivatives as 3x1.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn predict_channel(&self, channel: usize, contact_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let process = self.process;
        let weighted = process.samples.iter().zip(&self.weights[channel]).zip(&self.is_kept);
        let kept = weighted.filter(|(_, is_kept)| **is_kept).map(|((sample, weight), _)| (sample.contact_m, *weight));
        let (reading, slopes) = expected(&process.trend, &process.kernels[channel], channel, kept, contact_m);
        (reading * process.largest_reading, slopes * process.largest_reading)
    }

    /// Standard deviation of the map of a channel at a contact given the calibration, over the largest reading.
    pub fn map_sd(&self, channel: usize, contact_m: &Vector3<f64>) -> f64 {
        let kernel = &self.process.kernels[channel];
        let place = Place { contact_m: *contact_m, load: 0.0 };
        let own = kernel.line_sd(0.0).powi(2) + kernel.noise_variance(0.0);
        let inflation = self.process.inflation[channel];
        let all = self.covariance(channel, &[place])[(0, 0)] / (inflation * self.process.largest_reading.powi(2));
        (inflation * (all - own).max(0.0)).sqrt()
    }

    /// Covariance of the errors of one channel at several contacts of one touch, in the squared unit of the samples: that of the
    /// map given the calibration, of the line error of the touch itself, and of the noise.
    pub fn covariance(&self, channel: usize, at: &[Place]) -> DMatrix<f64> {
        let process = self.process;
        let kernel = &process.kernels[channel];
        let value = |row: usize, place: &Place| {
            if self.is_kept[row] { kernel.map(&place.contact_m, &process.places[row].contact_m) } else { 0.0 }
        };
        let cross = DMatrix::from_fn(process.samples.len(), at.len(), |row, i| value(row, &at[i]));
        let solved = &process.inverse[channel] * &cross;
        let mut explained = cross.tr_mul(&solved);
        if !self.rows.is_empty() {
            let of_dropped = solved.select_rows(&self.rows);
            explained -= of_dropped.tr_mul(&(&self.dropped[channel] * &of_dropped));
        }
        let prior = |i: usize, j: usize| {
            let (a, b) = (&at[i], &at[j]);
            let along = kernel.along((a.contact_m - b.contact_m).norm());
            let noise = if i == j { kernel.noise_variance(a.load) } else { 0.0 };
            kernel.map(&a.contact_m, &b.contact_m) + kernel.line_sd(a.load) * kernel.line_sd(b.load) * along + noise
        };
        (DMatrix::from_fn(at.len(), at.len(), prior) - explained)
            * (process.inflation[channel] * process.largest_reading.powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings of a smooth map.
    fn reading(contact_m: &Vector3<f64>) -> Vector2<f64> {
        let [x, y, z] = (contact_m * 100.0).into();
        Vector2::new(900.0 * z * (1.0 + 0.3 * x), 1500.0 * y * (1.0 - 0.4 * x + 0.2 * x * x) + 60.0 * z * z)
    }

    /// Contacts on lines that leave an undeflected wire along x.
    fn samples() -> Vec<Sample> {
        let mut samples = Vec::new();
        for along in 0..7 {
            for height in 0..5 {
                for step in 0..8 {
                    let [x, z] = [-0.01 - 0.005 * f64::from(along), 0.004 * f64::from(height - 2)];
                    let contact_m = Vector3::new(x, -0.002 * f64::from(step), z);
                    let line = (5 * along + height) as usize;
                    samples.push(Sample { contact_m, reading: reading(&contact_m), line });
                }
            }
        }
        samples
    }

    fn process() -> Process {
        Process::new(&samples(), [Kernel::START; 2]).expect("a regular covariance")
    }

    #[test]
    fn verif_derivatives_are_those_of_differences() {
        let process = process();
        let predictor = process.without(&[3, 4]).unwrap();
        let at = Vector3::new(-0.023, -0.0071, 0.0023);
        let slopes = predictor.predict(&at).1;
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-6);
            let difference = (predictor.predict(&(at + step)).0 - predictor.predict(&(at - step)).0) / 2e-6;
            assert!((slopes.column(axis) - difference).norm() < 1e-5 * (1.0 + difference.norm()), "{axis}");
        }
    }

    #[test]
    fn verif_predictions_without_lines_are_those_of_a_fit_without_them() {
        let (process, dropped) = (process(), [5, 6, 12]);
        let kept: Vec<Sample> = samples().into_iter().filter(|sample| !dropped.contains(&sample.line)).collect();
        let mut fitted = Process::new(&kept, [Kernel::START; 2]).unwrap();
        // The trend is that of all samples, as for the residuals on held-out lines.
        fitted.trend = process.trend.clone();
        fitted.largest_reading = process.largest_reading;
        for channel in 0..2 {
            let deviation = |i: usize| {
                kept[i].reading[channel] / process.largest_reading - process.trend.at(&kept[i].contact_m).0[channel]
            };
            fitted.weights[channel] = &fitted.inverse[channel] * DVector::from_fn(kept.len(), |i, _| deviation(i));
        }
        let (one, other) = (process.without(&dropped).unwrap(), fitted.predictor());
        let place = Place { contact_m: Vector3::new(-0.022, -0.004, 0.001), load: 0.3 };
        assert!((one.predict(&place.contact_m).0 - other.predict(&place.contact_m).0).norm() < 1e-4);
        let held = process
            .held_out(&(0..35).map(|line| if line == 5 { dropped.to_vec() } else { vec![line] }).collect::<Vec<_>>())
            .unwrap();
        for found in held.iter().filter(|found| process.samples[found.sample].line == 5) {
            let sample = &process.samples[found.sample];
            assert!((sample.reading - found.error - one.predict(&sample.contact_m).0).norm() < 1e-4);
        }
        for channel in 0..2 {
            let [a, b] = [&one, &other].map(|predictor| predictor.covariance(channel, &[place])[(0, 0)]);
            // The covariance of the samples is nearly singular; rounding is amplified.
            assert!((a - b).abs() < 1e-5 * a, "{a} {b}");
        }
    }

    #[test]
    fn robust_lines_with_a_singular_covariance_are_not_held_out() {
        let mut process = process();
        let rows: Vec<usize> = (0..process.samples.len()).filter(|&i| process.samples[i].line == 3).collect();
        for (&i, &j) in rows.iter().flat_map(|i| rows.iter().map(move |j| (i, j))) {
            process.inverse[1][(i, j)] = 0.0;
        }
        assert!(process.without(&[3]).is_none() && process.without(&[4]).is_some());
        let each: Vec<Vec<usize>> = (0..35).map(|line| vec![line]).collect();
        assert!(process.held_out(&each).is_none() && process.inflate(&each).is_none());
    }

    #[test]
    fn robust_readings_of_a_pin_that_slipped_off_are_left_out() {
        let mut damaged = samples();
        damaged[100].reading = Vector2::zeros();
        let (process, outliers) = Process::robust(&damaged, [Kernel::START; 2]).unwrap();
        assert_eq!((process.samples.len(), outliers), (damaged.len() - 1, vec![100]));
    }
}
