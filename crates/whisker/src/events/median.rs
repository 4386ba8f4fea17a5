//! Spikes taken out.

const WINDOW: usize = 5;

/// Standard deviation of the median of many normal values over that of their mean, sqrt(pi / 2).
const MEDIAN_OVER_MEAN: f64 = 1.2533;

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
        let mut sorted = self.recent;
        sorted.sort_by(f64::total_cmp);
        sorted[WINDOW / 2]
    }

    /// Standard deviation of white noise of standard deviation one after the median and a slower filter, whose noise gain over means of so
    /// many samples `gain` tells.
    pub(super) fn noise_gain(gain: impl Fn(usize) -> f64) -> f64 {
        MEDIAN_OVER_MEAN * gain(WINDOW)
    }
}
