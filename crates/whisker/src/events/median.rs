//! Removal of outliers by a running median.

const WINDOW: usize = 5;

/// Standard deviation of the median of many normal values relative to that of their mean, sqrt(pi / 2).
const MEDIAN_OVER_MEAN: f64 = 1.2533;

/// The lower and the higher of two values, neither of them NaN.
fn in_order(a: f64, b: f64) -> (f64, f64) {
    if a < b { (a, b) } else { (b, a) }
}

/// The median of five values: it is neither the smallest nor the largest of any four, hence the median of the other two
/// and the fifth. A sort would mispredict half of its branches on noise.
fn middle([a, b, c, d, e]: [f64; WINDOW]) -> f64 {
    let ((a, b), (c, d)) = (in_order(a, b), in_order(c, d));
    let ((_, low), (high, _)) = (in_order(a, c), in_order(b, d));
    let (low, high) = in_order(low, high);
    in_order(in_order(low, e).1, high).0
}

/// Running median of five samples, robust to two outliers among them. Its delay is two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MedianOfFive {
    recent: [f64; WINDOW],
    next: usize,
}

impl MedianOfFive {
    /// Resets the memory to a constant reading.
    pub(super) fn settle(&mut self, reading: f64) {
        self.recent = [reading; WINDOW];
    }

    /// Takes the next sample and returns the median of the last five.
    pub(super) fn step(&mut self, sample: f64) -> f64 {
        self.recent[self.next] = sample;
        self.next = (self.next + 1) % WINDOW;
        middle(self.recent)
    }

    /// Standard deviation of white noise of unit standard deviation after the median and a slower filter, whose noise
    /// gain over means of a number of samples is `gain`.
    pub(super) fn noise_gain(gain: impl Fn(usize) -> f64) -> f64 {
        MEDIAN_OVER_MEAN * gain(WINDOW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_median_is_that_of_the_sorted_values() {
        // Every order, and every combination of equal values.
        for code in 0..5_u32.pow(5) {
            let values = [0, 1, 2, 3, 4].map(|place| f64::from(code / 5_u32.pow(place) % 5));
            let mut sorted = values;
            sorted.sort_by(f64::total_cmp);
            assert_eq!(middle(values), sorted[2], "{values:?}");
        }
    }
}
