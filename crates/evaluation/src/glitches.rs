//! Glitches: single readings far above all others, as of a sensor or of its bus, which no contact explains.

/// Largest plausible reading, relative to [`largest`].
const MOST: f64 = 4.0;

/// Largest magnitude of readings without single outliers: that of their running median of five, of fewer at both ends.
pub(crate) fn largest(readings: &[f64]) -> f64 {
    let median = |i: usize| {
        let mut window = readings[i.saturating_sub(2)..readings.len().min(i + 3)].to_vec();
        let middle = (window.len() - 1) / 2;
        *window.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    (0..readings.len()).map(|i| median(i).abs()).fold(0.0, f64::max)
}

/// Largest magnitude of a reading that is no glitch, from the [`largest`] one without outliers.
pub(crate) fn most(largest: f64) -> f64 {
    MOST * largest
}

/// Indices of the glitches. None if the running median is zero throughout.
pub(crate) fn rows(readings: &[f64]) -> Vec<usize> {
    let most = most(largest(readings));
    (0..readings.len()).filter(|row| most > 0.0 && readings[*row].abs() > most).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_single_readings_far_above_all_others_are_glitches() {
        let mut readings: Vec<f64> = (0..100).map(|i| (f64::from(i) / 10.0).sin()).collect();
        assert!(rows(&readings).is_empty());
        (readings[0], readings[50], readings[51]) = (-9.0, 9.0, 9.0);
        assert_eq!(rows(&readings), [0, 50, 51]);
        assert!(rows(&[0.0; 9]).is_empty() && rows(&[]).is_empty());
        // A step that lasts is no glitch.
        readings[60..].fill(9.0);
        assert!(rows(&readings).is_empty());
    }
}
