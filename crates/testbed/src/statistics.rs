//! Order statistics, means, quantiles and tails.

use std::f64::consts::SQRT_2;

use statrs::function::erf::erfc;

pub use filters::quantile::{CHI2_2_95, CHI2_3_95, NORMAL_95, quantile, quantile_of_sorted};

/// Median, or the mean of the two middle values. `None` without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    quantile(&values.into_iter().collect::<Vec<_>>(), 0.5)
}

/// Median of scores, of which some are missing. A missing score counts as worse than any other; `None` if the median
/// itself is missing.
pub fn median_of_scores(scores: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    median(scores.map(|score| score.unwrap_or(f64::INFINITY))).filter(|median| median.is_finite())
}

/// Arithmetic mean. `None` without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.into_iter().fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    (count > 0.0).then(|| sum / count)
}

/// Root mean square. `None` for an empty slice.
pub fn rms(values: &[f64]) -> Option<f64> {
    mean(values.iter().map(|value| value * value)).map(f64::sqrt)
}

/// Largest number of averages over blocks from which an autocorrelation is computed.
const MOST_BLOCKS: usize = 1000;

/// Number of independent samples that have the same variance of their mean as correlated values with the given
/// expectation: `n c0 / (c0 + 2 sum c_k)`, with the autocovariances `c_k` about the expectation, summed up to the first
/// pair of lags whose sum is not positive (Geyer, "Practical Markov Chain Monte Carlo", 1992). Between 1 and `n`; `None`
/// without values. Of long series, averages over blocks are used.
pub fn effective_samples(values: &[f64], expectation: f64) -> Option<f64> {
    let count = values.len() as f64;
    let deviations: Vec<f64> = values.iter().map(|value| value - expectation).collect();
    let variance = mean(deviations.iter().map(|deviation| deviation * deviation))?;
    let blocks: Vec<f64> = deviations
        .chunks(values.len().div_ceil(MOST_BLOCKS))
        .map(|block| block.iter().sum::<f64>() / block.len() as f64)
        .collect();
    let covariance = |lag: usize| {
        let products = blocks.iter().zip(&blocks[lag..]).map(|(one, other)| one * other);
        products.sum::<f64>() / blocks.len() as f64
    };
    let pairs = (1..blocks.len().saturating_sub(1)).step_by(2).map(|lag| covariance(lag) + covariance(lag + 1));
    let correlated: f64 = pairs.take_while(|pair| *pair > 0.0).sum();
    let of_mean = (covariance(0) + 2.0 * correlated) / blocks.len() as f64;
    Some(if of_mean > 0.0 { (variance / of_mean).clamp(1.0, count) } else { count })
}

/// Probability that the size of a normally distributed quantity with zero mean and standard deviation `sd` exceeds `limit`.
pub fn beyond(limit: f64, sd: f64) -> f64 {
    erfc(limit / (sd * SQRT_2))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn val_five_percent_of_a_normal_distribution_lie_beyond_its_95_percent_quantile() {
        assert!((beyond(2.0 * NORMAL_95, 2.0) - 0.05).abs() < 1e-9 && beyond(1.0, 0.0) == 0.0);
    }

    #[test]
    fn val_root_mean_square() {
        assert_eq!(rms(&[3.0, -4.0]), Some(12.5f64.sqrt()));
    }

    #[test]
    fn verif_missing_scores_count_as_the_worst() {
        assert_eq!(median_of_scores([Some(1.0), None, Some(2.0)].into_iter()), Some(2.0));
        assert_eq!(median_of_scores([Some(1.0), None, None].into_iter()), None);
        assert_eq!(median_of_scores([Some(1.0), None].into_iter()), None);
    }

    /// Autoregressive values of order one with the correlation `r` have `n (1 - r) / (1 + r)` effective samples.
    #[test]
    fn val_effective_samples_of_autoregressive_values() {
        for (correlation, count) in [(0.0, 4000_usize), (0.8, 4000), (0.95, 900)] {
            let (mut value, mut total) = (0.0, 0.0);
            let mut rng = Pcg64::seed_from_u64(2);
            for _ in 0..20 {
                let mut next = || {
                    let step: f64 = rng.sample(StandardNormal);
                    value = correlation * value + (1.0_f64 - correlation * correlation).sqrt() * step;
                    3.0 + value
                };
                let values: Vec<f64> = (0..count).map(|_| next()).collect();
                total += effective_samples(&values, 3.0).unwrap() / 20.0;
            }
            let exact = count as f64 * (1.0 - correlation) / (1.0 + correlation);
            assert!((total / exact - 1.0).abs() < 0.25, "{correlation}: {total}, expected {exact}");
        }
        let constant = effective_samples(&[9.0; 500], 2.0).unwrap();
        assert!(constant < 1.1, "a constant deviation is one sample, not {constant}");
        assert_eq!(effective_samples(&[], 2.0), None);
    }
}
