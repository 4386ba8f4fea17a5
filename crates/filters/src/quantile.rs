//! Quantiles of the normal and the chi-square distribution, for 95 % intervals and regions of a Gaussian.

/// 97.5 % quantile of the standard normal distribution: half width of the 95 % interval in standard deviations.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;

/// 95 % quantile of the chi-square distribution with two degrees of freedom: squared Mahalanobis distance of the 95 % ellipse.
pub const CHI2_2_95: f64 = 5.991_464_547_107_979;

/// 95 % quantile of the chi-square distribution with three degrees of freedom: squared Mahalanobis distance of the 95 % ellipsoid.
pub const CHI2_3_95: f64 = 7.814_727_903_251_178;

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
}
