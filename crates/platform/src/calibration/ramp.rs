//! Speed of a push that is short for the low-pass.
//!
//! An edge that moves at a constant speed changes the reading along a ramp of the duration `T`. The step response `h`
//! of the low-pass turns a ramp of unit height into one whose slope is `(h(t) - h(t - T)) / T`: a ramp that is shorter
//! than the rise time of the low-pass becomes less steep, the shorter the less. The ratio of the peak to the steepest
//! slope increases with `T`, so it determines `T`, and with it the slope of the ramp itself. Long ramps keep their
//! slope, apart from the overshoot of the step response.

use signal::Cascade;

/// Longest ramp of the table, in delays of the low-pass: longer ones have its gain.
const LONGEST_DELAYS: f64 = 4.0;
/// Duration after a ramp in which its peak occurs, in delays of the low-pass.
const SETTLED_DELAYS: f64 = 8.0;
/// Largest gain: a ramp that lost more of its slope is too short to be resolved.
const MOST_GAIN: f64 = 2.0;

/// Slopes of ramps before a low-pass by those after it.
#[derive(Clone, Debug)]
pub(super) struct Ramps {
    /// Ratio of the peak to the steepest slope (s), rising, and the gain from the steepest slope to that of the ramp.
    gains: Vec<[f64; 2]>,
}

impl Ramps {
    /// Table of a low-pass with this delay (s).
    pub(super) fn new(filter: &Cascade, delay_s: f64, rate_hz: f64) -> Self {
        let samples = |delays: f64| (delays * delay_s * rate_hz).ceil().max(1.0) as usize;
        let (longest, settled) = (samples(LONGEST_DELAYS), samples(LONGEST_DELAYS + SETTLED_DELAYS));
        let mut filter = filter.clone();
        filter.settle(0.0);
        let steps: Vec<f64> = (0..settled).map(|_| filter.step(1.0)).collect();
        let mut gains: Vec<[f64; 2]> = Vec::new();
        for duration in 1..=longest {
            let duration_s = duration as f64 / rate_hz;
            let (mut level, mut peak, mut steepest) = (0.0, 0.0_f64, 0.0_f64);
            for (i, step) in steps.iter().enumerate() {
                let slope = (step - if i < duration { 0.0 } else { steps[i - duration] }) / duration_s;
                level += slope / rate_hz;
                (peak, steepest) = (peak.max(level), steepest.max(slope));
            }
            let (ratio_s, gain) = (peak / steepest, 1.0 / (duration_s * steepest));
            if gain <= MOST_GAIN && gains.last().is_none_or(|[last_s, _]| ratio_s > *last_s) {
                gains.push([ratio_s, gain]);
            }
        }
        Self { gains }
    }

    /// Slope of the ramp with this peak and steepest slope after the low-pass (counts, counts/s). `None` if the ramp was too short.
    pub(super) fn slope_counts_per_s(&self, peak_counts: f64, steepest_counts_per_s: f64) -> Option<f64> {
        let ratio_s = peak_counts / steepest_counts_per_s;
        let above = self.gains.partition_point(|[of_row_s, _]| *of_row_s <= ratio_s);
        let [low_s, low] = *self.gains.get(above.checked_sub(1)?)?;
        let gain = self
            .gains
            .get(above)
            .map_or(low, |[high_s, high]| low + (high - low) * (ratio_s - low_s) / (high_s - low_s));
        Some(gain * steepest_counts_per_s)
    }
}

#[cfg(test)]
mod tests {
    use signal::low_pass;

    use super::*;

    /// Peak and steepest slope of a filtered ramp (counts, counts/s), by direct filtering.
    fn filtered(order: usize, edge_hz: f64, rate_hz: f64, duration_s: f64, speed: f64) -> (f64, f64) {
        let mut filter = Cascade::new(low_pass(order, edge_hz, rate_hz).expect("a band"));
        filter.settle(0.0);
        let (mut last, mut peak, mut steepest) = (0.0, 0.0_f64, 0.0_f64);
        for i in 0..(2.0 * rate_hz) as usize {
            let level = filter.step(speed * (i as f64 / rate_hz).min(duration_s));
            (peak, steepest) = (peak.max(level), steepest.max((level - last) * rate_hz));
            last = level;
        }
        (peak, steepest)
    }

    #[test]
    fn val_the_speed_of_a_ramp_is_recovered_whatever_its_duration() {
        for (order, edge_hz, rate_hz, delay_s) in
            [(2, 10.0, 800.0, 0.0225), (2, 5.0, 888.0, 0.045), (4, 20.0, 800.0, 0.0208)]
        {
            let filter = Cascade::new(low_pass(order, edge_hz, rate_hz).expect("a band"));
            let ramps = Ramps::new(&filter, delay_s, rate_hz);
            for periods in [0.35, 0.5, 0.7, 1.0, 2.0, 5.0] {
                let (peak, steepest) = filtered(order, edge_hz, rate_hz, periods / edge_hz, 3e4);
                let found = ramps.slope_counts_per_s(peak, steepest).expect("resolved");
                assert!((found / 3e4 - 1.0).abs() < 0.01, "{order} {edge_hz} {periods}: {found} from {steepest}");
            }
            let (peak, steepest) = filtered(order, edge_hz, rate_hz, 0.05 / edge_hz, 3e4);
            assert_eq!(ramps.slope_counts_per_s(peak, steepest), None, "too short to be resolved");
            assert_eq!(ramps.slope_counts_per_s(f64::NAN, 1.0), None);
        }
    }
}
