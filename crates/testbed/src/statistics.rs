//! Order statistics.

/// Standard deviations within which a Gaussian has 95 % of its probability.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;

/// The `q`-quantile of some values, linear between order statistics; nothing of nothing. Values that are missing come in as
/// infinite and sort last.
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut values = values.to_vec();
    let position = q * values.len().checked_sub(1)? as f64;
    let (_, low, above) = values.select_nth_unstable_by(position.floor() as usize, f64::total_cmp);
    let next = || above.iter().copied().min_by(f64::total_cmp);
    let high = if position.fract() > 0.0 { next() } else { None };
    Some(between(*low, high.unwrap_or(*low), position.fract()))
}

/// The same of values that are in order.
pub fn quantile_of_sorted(sorted: &[f64], q: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let position = q * last as f64;
    let (low, high) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    Some(between(low, high, position.fract()))
}

/// The value at a share of the way between two.
fn between(low: f64, high: f64, share: f64) -> f64 {
    // Without the case apart, infinity less infinity would be no number.
    if low == high { low } else { low + (high - low) * share }
}

/// The middle value, or the mean of the two in the middle; nothing of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    quantile(&values.into_iter().collect::<Vec<_>>(), 0.5)
}

/// The median over trials of a score that some lack: lacking counts as worse than any, and where the median itself is lacking there is none.
pub fn median_of_scores(scores: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    median(scores.map(|score| score.unwrap_or(f64::INFINITY))).filter(|median| median.is_finite())
}

/// Mean, nothing of nothing.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.into_iter().fold((0, 0.0), |(count, sum), value| (count + 1, sum + value));
    (count > 0).then(|| sum / f64::from(count))
}

/// Root mean square, nothing of nothing.
pub fn rms(values: &[f64]) -> Option<f64> {
    mean(values.iter().map(|value| value * value)).map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_quantiles() {
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.25), Some(1.25));
        assert_eq!(quantile(&[], 0.5), None);
        let (values, sorted) = ([5.0, 1.0, f64::INFINITY, 2.0, 2.0, -3.0], [-3.0, 1.0, 2.0, 2.0, 5.0, f64::INFINITY]);
        for q in [0.0, 0.1, 0.5, 0.6, 0.75, 0.95, 1.0] {
            assert_eq!(quantile(&values, q), quantile_of_sorted(&sorted, q));
        }
        assert_eq!(rms(&[3.0, -4.0]), Some(12.5f64.sqrt()));
    }

    #[test]
    fn verif_lacking_scores_are_the_worst() {
        assert_eq!(median_of_scores([Some(1.0), None, Some(2.0)].into_iter()), Some(2.0));
        assert_eq!(median_of_scores([Some(1.0), None, None].into_iter()), None);
        assert_eq!(median_of_scores([Some(1.0), None].into_iter()), None);
    }
}
