//! Spikes taken out.

const WINDOW: usize = 5;

/// Standard deviation of the median of many normal values over that of their mean, sqrt(pi / 2).
const MEDIAN_OVER_MEAN: f64 = 1.2533;

/// The lower and the higher of two values, neither of them NaN.
fn in_order(a: f64, b: f64) -> (f64, f64) {
    if a < b { (a, b) } else { (b, a) }
}

/// The middle one of five values: the lowest and the highest of any four are not, and it is the middle one of the other two and
/// the fifth. On noise a sort would
/// guess half of its branches wrong.
fn middle([a, b, c, d, e]: [f64; WINDOW]) -> f64 {
    let ((a, b), (c, d)) = (in_order(a, b), in_order(c, d));
    let ((_, low), (high, _)) = (in_order(a, c), in_order(b, d));
    let (low, high) = in_order(low, high);
    in_order(in_order(low, e).1, high).0
}

/// Running median of five samples, which two bad ones among them cannot move far. It delays by two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MedianOfFive {
    recent: [f64; WINDOW],
    next: usize,
}

impl MedianOfFive {
    /// Forgets all but a reading that has stood for ever.
    pub(super) fn settle(&mut self, reading: f64) {
        self.recent = [reading; WINDOW];
    }

    /// Takes the next sample and gives the median of the last five.
    pub(super) fn step(&mut self, sample: f64) -> f64 {
        self.recent[self.next] = sample;
        self.next = (self.next + 1) % WINDOW;
        middle(self.recent)
    }

    /// Standard deviation of white noise of standard deviation one after the median and a slower filter, whose noise gain over means of so
    /// many samples `gain` tells.
    pub(super) fn noise_gain(gain: impl Fn(usize) -> f64) -> f64 {
        MEDIAN_OVER_MEAN * gain(WINDOW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_middle_one_is_that_of_the_sorted_values() {
        // Every order, and every way in which some are equal.
        for code in 0..5_u32.pow(5) {
            let values = [0, 1, 2, 3, 4].map(|place| f64::from(code / 5_u32.pow(place) % 5));
            let mut sorted = values;
            sorted.sort_by(f64::total_cmp);
            assert_eq!(middle(values), sorted[2], "{values:?}");
        }
    }
}
