//! Expected readings of a Gaussian process.

use nalgebra::{Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::MOST_SAMPLES;
use super::kernel::Kernel;
use super::trend::Trend;

/// Parameters of the expected readings of a process, which are relative to the largest reading of its samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mean {
    /// Covariance of each channel.
    pub(super) kernels: [Kernel; 2],
    pub(super) trend: Trend,
    /// Contacts of the samples.
    pub(super) contacts_m: Vec<Vector3<f64>>,
    /// Weights of the covariances with the samples, by channel.
    pub(super) weights: [Vec<f64>; 2],
}

impl Mean {
    /// Checks stored numbers.
    ///
    /// # Errors
    /// The key that is wrong, with what was found and expected.
    pub(super) fn check(&self) -> Result<(), String> {
        let expected = self.contacts_m.len();
        if expected > MOST_SAMPLES {
            return Err(format!("`contacts_m`: found {expected} contacts, expected at most {MOST_SAMPLES}"));
        }
        for weights in &self.weights {
            if weights.len() != expected || !weights.iter().all(|weight| weight.is_finite()) {
                let found = weights.len();
                return Err(format!(
                    "`weights`: found {found} numbers, expected {expected} finite ones for each moment"
                ));
            }
        }
        if !self.contacts_m.iter().flatten().all(|coordinate| coordinate.is_finite()) {
            return Err("`contacts_m`: found a number that is not finite, expected finite ones".into());
        }
        if let Some(kernel) = self.kernels.iter().find(|kernel| !kernel.is_valid()) {
            return Err(format!("`kernels`: found {kernel:?}, expected finite numbers, the lengths positive"));
        }
        self.trend.check()
    }

    /// Expected reading at a contact, 2x1, and its derivatives by the contact (1/m), 2x3, relative to the largest reading.
    pub(super) fn at(&self, contact_m: &Vector3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
        let [(first, first_slopes), (second, second_slopes)] = [0, 1].map(|channel| {
            let weighted = self.contacts_m.iter().copied().zip(self.weights[channel].iter().copied());
            expected(&self.trend, &self.kernels[channel], channel, weighted, contact_m)
        });
        (Vector2::new(first, second), Matrix2x3::from_rows(&[first_slopes.transpose(), second_slopes.transpose()]))
    }
}

/// Expected reading of a channel at a contact, from the contacts of the samples with their weights, and its derivatives by the
/// contact (1/m), 3x1. Both are relative to the largest reading.
pub(super) fn expected(
    trend: &Trend,
    kernel: &Kernel,
    channel: usize,
    weighted: impl Iterator<Item = (Vector3<f64>, f64)>,
    contact_m: &Vector3<f64>,
) -> (f64, Vector3<f64>) {
    let (readings, all_slopes) = trend.at(contact_m);
    let (mut reading, mut slopes) = (readings[channel], all_slopes.row(channel).transpose());
    for (sample_m, weight) in weighted {
        let part = weight * kernel.map(contact_m, &sample_m);
        reading += part;
        for axis in 0..3 {
            slopes[axis] += part * (sample_m[axis] - contact_m[axis]) / kernel.length_m[axis].powi(2);
        }
    }
    (reading, slopes)
}
