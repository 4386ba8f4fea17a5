//! Quantiles of samples, and of the normal and the chi-square distribution for 95 % intervals and regions of a Gaussian.

/// 97.5 % quantile of the standard normal distribution: half width of the 95 % interval in standard deviations.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;

/// 95 % quantile of the chi-square distribution with two degrees of freedom: squared Mahalanobis distance of the 95 % ellipse.
pub const CHI2_2_95: f64 = 5.991_464_547_107_979;

/// 95 % quantile of the chi-square distribution with three degrees of freedom: squared Mahalanobis distance of the 95 % ellipsoid.
pub const CHI2_3_95: f64 = 7.814_727_903_251_178;

/// `q`-quantile with linear interpolation between order statistics. `None` for an empty slice. Missing values are
/// passed as infinity and sort last.
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut values = values.to_vec();
    let position = q * values.len().checked_sub(1)? as f64;
    let (_, low, above) = values.select_nth_unstable_by(position.floor() as usize, f64::total_cmp);
    let next = || above.iter().copied().min_by(f64::total_cmp);
    let high = if position.fract() > 0.0 { next() } else { None };
    Some(between(*low, high.unwrap_or(*low), position.fract()))
}

/// `q`-quantile of values in ascending order, see [`quantile`].
pub fn quantile_of_sorted(sorted: &[f64], q: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let position = q * last as f64;
    let (low, high) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    Some(between(low, high, position.fract()))
}

/// Linear interpolation between two values.
fn between(low: f64, high: f64, share: f64) -> f64 {
    // The case distinction avoids infinity minus infinity.
    if low == high { low } else { low + (high - low) * share }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, SQRT_2};

    use super::*;

    /// Error function, by its Maclaurin series.
    fn erf(x: f64) -> f64 {
        let term = |n: i32, power: f64| power / f64::from(2 * n + 1);
        let (mut sum, mut power) = (0.0, x);
        for n in 0..100 {
            sum += term(n, power);
            power *= -x * x / f64::from(n + 1);
        }
        2.0 / PI.sqrt() * sum
    }

    #[test]
    fn verif_quantiles_have_their_probability() {
        let of_three = |x: f64| erf((0.5 * x).sqrt()) - (2.0 * x / PI).sqrt() * (-0.5 * x).exp();
        for probability in [erf(NORMAL_95 / SQRT_2), 1.0 - (-0.5 * CHI2_2_95).exp(), of_three(CHI2_3_95)] {
            assert!((probability - 0.95).abs() < 1e-14, "{probability}");
        }
    }

    #[test]
    fn val_quantiles() {
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[1.0, 2.0], 0.25), Some(1.25));
        assert_eq!(quantile(&[], 0.5), None);
        let (values, sorted) = ([5.0, 1.0, f64::INFINITY, 2.0, 2.0, -3.0], [-3.0, 1.0, 2.0, 2.0, 5.0, f64::INFINITY]);
        for q in [0.0, 0.1, 0.5, 0.6, 0.75, 0.95, 1.0] {
            assert_eq!(quantile(&values, q), quantile_of_sorted(&sorted, q));
        }
    }
}
