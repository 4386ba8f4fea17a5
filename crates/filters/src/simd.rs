//! Vectorised arithmetic on arrays.
//!
//! The loops are plain Rust over slices, which the compiler vectorises; [`vectorised!`](crate::vectorised) compiles
//! them once per instruction set and selects the widest that the processor supports. Results do not depend on the
//! instruction set: each element is computed by the same operations, sums have sixteen partial sums at every width, and
//! Rust never contracts a product and a sum to a fused multiply-add.

use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_4};
use std::f64::consts::{LOG2_E, SQRT_2};

use aligned_vec::{AVec, ConstAlign};
use rand::Rng;

/// Number of `f64` in a cache line and in the widest vector register.
pub(crate) const LINE: usize = 8;

/// Array aligned to a cache line, so that no vector access crosses two lines.
pub(crate) type Column = AVec<f64, ConstAlign<64>>;

/// Array of `count` elements of one value.
pub(crate) fn column(count: usize, value: f64) -> Column {
    AVec::from_iter(64, std::iter::repeat_n(value, count))
}

/// Number of partial sums.
const LANES: usize = 16;

/// `1.5 * 2^52`: adding it to a number of modest size and subtracting it again rounds to the nearest integer, which is
/// in the lowest bits of the sum.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// `ln 2` as a sum of two parts, of which the first has so few bits that its product with an exponent is exact (Cody and Waite).
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// Calls a function compiled for the widest instruction set that the processor supports:
/// `vectorised!(scale(&mut values, 2.0))`. The function and its callees must be `#[inline(always)]`; a function that is
/// not inlined is compiled for the baseline instruction set.
#[macro_export]
macro_rules! vectorised {
    ($call:expr) => {
        $crate::fearless_simd::dispatch!(*$crate::LEVEL, _ => $call)
    };
}

/// Sum of `term` over the rows of columns of equal length.
#[allow(clippy::needless_range_loop, reason = "the compiler does not vectorise an iterator over several columns")]
#[inline(always)]
pub(crate) fn sum<const C: usize>(columns: [&[f64]; C], term: impl Fn([f64; C]) -> f64) -> f64 {
    let count = columns[0].len() / LANES;
    let (mut chunks, mut rests) = ([&[][..]; C], [&[][..]; C]);
    for c in 0..C {
        let (of_column, rest) = columns[c].as_chunks::<LANES>();
        (chunks[c], rests[c]) = (&of_column[..count], rest);
    }
    let mut parts = [0.0; LANES];
    for row in 0..count {
        // Slices taken here spare a bounds check per lane.
        let mut chunk = [&[0.0; LANES]; C];
        for c in 0..C {
            chunk[c] = &chunks[c][row];
        }
        for lane in 0..LANES {
            let mut values = [0.0; C];
            for c in 0..C {
                values[c] = chunk[c][lane];
            }
            parts[lane] += term(values);
        }
    }
    for lane in 0..rests[0].len() {
        let mut values = [0.0; C];
        for c in 0..C {
            values[c] = rests[c][lane];
        }
        parts[lane] += term(values);
    }
    let mut count = LANES;
    while count > 1 {
        count /= 2;
        for lane in 0..count {
            parts[lane] += parts[lane + count];
        }
    }
    parts[0]
}

/// Largest value; minus infinity if there are none.
#[inline(always)]
pub(crate) fn largest(values: &[f64]) -> f64 {
    let mut parts = [f64::NEG_INFINITY; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            parts[lane] = larger(parts[lane], chunk[lane]);
        }
    }
    let mut found = f64::NEG_INFINITY;
    for &value in parts.iter().chain(rest) {
        found = larger(found, value);
    }
    found
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// `e^x` for `x <= 0` with a relative error below 3e-12. Zero for `x < -300`, which keeps squares of weights out of the
/// subnormal range, where arithmetic is about a hundred times slower.
#[inline(always)]
pub(crate) fn exp(x: f64) -> f64 {
    const LEAST: f64 = -300.0;
    /// Coefficients of the polynomial that interpolates `(e^x - 1) / x` at the Chebyshev nodes for `|x| <= ln 2 / 2`.
    const SERIES: [f64; 8] = [
        0.999_999_999_995_505_5,
        0.499_999_999_999_550_7,
        0.166_666_667_863_804_4,
        0.041_666_666_786_337_556,
        0.008_333_283_518_768_105,
        0.001_388_883_909_064_138,
        0.000_199_075_825_913_251_34,
        0.000_024_867_883_453_521_802,
    ];
    let held = if x < LEAST { LEAST } else { x };
    let rounded = held * LOG2_E + ROUNDER;
    let exponent = rounded - ROUNDER;
    let rest = (held - exponent * LN_2[0]) - exponent * LN_2[1];
    let value = 1.0 + rest * polynomial(&SERIES, rest);
    let power = f64::from_bits(rounded.to_bits().wrapping_add(1023) << 52);
    if x < LEAST { 0.0 } else { value * power }
}

/// Natural logarithm of a positive normal number with an error below one unit in the last place (series of Sun's fdlibm).
#[inline(always)]
pub(crate) fn ln(x: f64) -> f64 {
    const SERIES: [f64; 8] = [
        6.666_666_666_666_735e-1,
        3.999_999_999_940_942e-1,
        2.857_142_874_366_239e-1,
        2.222_219_843_214_978_4e-1,
        1.818_357_216_161_805e-1,
        1.531_383_769_920_937_3e-1,
        1.479_819_860_511_658_6e-1,
        0.0,
    ];
    // x = 2^exponent m, with m from sqrt(1/2) to sqrt(2).
    let steps = (x.to_bits().wrapping_sub((0.5 * SQRT_2).to_bits()) as i64) >> 52;
    let m = f64::from_bits(x.to_bits().wrapping_sub((steps as u64) << 52));
    let exponent = f64::from_bits(ROUNDER.to_bits().wrapping_add(steps as u64)) - ROUNDER;
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let squared = s * s;
    let half = 0.5 * f * f;
    let correction = s * (half + squared * polynomial(&SERIES, squared)) + exponent * LN_2[1];
    exponent * LN_2[0] - ((half - correction) - f)
}

/// Polynomial of degree 7, lowest coefficient first, by Estrin's scheme, whose products are mostly independent.
#[inline(always)]
fn polynomial([a, b, c, d, e, f, g, h]: &[f64; 8], x: f64) -> f64 {
    let squared = x * x;
    ((a + b * x) + (c + d * x) * squared) + ((e + f * x) + (g + h * x) * squared) * (squared * squared)
}

/// Fills an array with independent standard normal draws: pairs by the Box-Muller transform (1958) of the output of a
/// SplitMix64 generator (Steele, Lea and Flood 2014) seeded by `rng`.
///
/// The computation is in `f32`, of which a register holds twice as many as of `f64`: probabilities are accurate to
/// 4e-7, and no draw exceeds 6.7 in magnitude. The ziggurat method needs fewer operations, but its branches and the
/// sequential generator prevent vectorisation.
pub(crate) fn fill_normal(values: &mut [f64], rng: &mut impl Rng) {
    let start = rng.next_u64();
    vectorised!(fill_normal_from(values, start));
}

/// Pairs per block.
const PAIRS: usize = 64;

#[inline(always)]
fn fill_normal_from(values: &mut [f64], start: u64) {
    let (blocks, rest) = values.as_chunks_mut::<{ 2 * PAIRS }>();
    let mut first = start;
    for block in blocks {
        *block = normal_block(first);
        first = first.wrapping_add(GAMMA.wrapping_mul(PAIRS as u64));
    }
    if !rest.is_empty() {
        rest.copy_from_slice(&normal_block(first)[..rest.len()]);
    }
}

/// Increment of SplitMix64.
const GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// Block of standard normal pairs from the next outputs of the generator: first all first elements, then all second ones.
#[inline(always)]
fn normal_block(first: u64) -> [f64; 2 * PAIRS] {
    let (mut radius_bits, mut angle_bits) = ([0; PAIRS], [0; PAIRS]);
    for pair in 0..PAIRS {
        let bits = mixed(first.wrapping_add(GAMMA.wrapping_mul(pair as u64)));
        (radius_bits[pair], angle_bits[pair]) = ((bits >> 32) as u32, bits as u32);
    }
    let (mut ones, mut others) = ([0.0; PAIRS], [0.0; PAIRS]);
    for pair in 0..PAIRS {
        (ones[pair], others[pair]) = normal_pair(radius_bits[pair], angle_bits[pair]);
    }
    let mut block = [0.0; 2 * PAIRS];
    for pair in 0..PAIRS {
        block[pair] = f64::from(ones[pair]);
        block[PAIRS + pair] = f64::from(others[pair]);
    }
    block
}

/// Finaliser of SplitMix64.
#[inline(always)]
fn mixed(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Two independent standard normal numbers from random bits.
#[inline(always)]
fn normal_pair(radius_bits: u32, angle_bits: u32) -> (f32, f32) {
    let radius = radius(radius_bits);
    // Two bits of the angle select the half-plane and whether the pair is mirrored at the diagonal; the others give the
    // angle within a quarter turn.
    let place = ((angle_bits & !3) | 2) as i32;
    let (sine, cosine) = sin_cos(place as f32 * (FRAC_PI_4 / TWO_TO_31));
    let (a, b) = ((radius * sine).to_bits(), (radius * cosine).to_bits());
    let swapped = (a ^ b) & 0_u32.wrapping_sub(angle_bits & 1);
    let negative = (angle_bits & 2) << 30;
    (f32::from_bits(a ^ swapped ^ negative), f32::from_bits(b ^ swapped ^ negative))
}

const TWO_TO_31: f32 = 2_147_483_648.0;

/// Radius `sqrt(-2 ln u)` of a standard normal pair, for uniform `u`; the logarithm is that of fdlibm for `f32`.
#[inline(always)]
fn radius(bits: u32) -> f32 {
    const LN_2: [f32; 2] = [6.931_381e-1, 9.058_001e-6];
    const SERIES: [f32; 4] = [0.666_666_6, 0.400_009_72, 0.284_987_87, 0.242_790_79];
    // u is the centre of one of 2^31 equal intervals of (0, 1).
    let u = ((bits >> 1) as i32 as f32 + 0.5) * (1.0 / TWO_TO_31);
    // u = 2^exponent m, with m from sqrt(1/2) to sqrt(2).
    let steps = (u.to_bits().wrapping_sub(FRAC_1_SQRT_2.to_bits()) as i32) >> 23;
    let m = f32::from_bits(u.to_bits().wrapping_sub((steps as u32) << 23));
    let exponent = steps as f32;
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let squared = s * s;
    let half = 0.5 * f * f;
    let [a, b, c, d] = SERIES;
    let series = (a + b * squared) + (c + d * squared) * (squared * squared);
    let correction = s * (half + squared * series) + exponent * LN_2[1];
    let ln = exponent * LN_2[0] - ((half - correction) - f);
    (-2.0 * ln).sqrt()
}

/// Sine and cosine of an angle within `pi / 4` of zero (series of Cephes for `f32`).
#[inline(always)]
fn sin_cos(angle_rad: f32) -> (f32, f32) {
    let squared = angle_rad * angle_rad;
    let sine = (-1.951_529_6e-4 * squared + 8.332_161e-3) * squared - 1.666_665_5e-1;
    let cosine = (2.443_315_7e-5 * squared - 1.388_731_6e-3) * squared + 4.166_664_6e-2;
    (angle_rad + angle_rad * squared * sine, 1.0 - 0.5 * squared + squared * squared * cosine)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn val_exp_and_ln_agree_with_the_standard_library() {
        let apart = |found: f64, expected: f64| ((found - expected) / expected).abs();
        let worst = (0..300_000).map(|i| -1e-3 * f64::from(i)).map(|x| apart(exp(x), x.exp())).fold(0.0, f64::max);
        assert!(worst < 3e-12, "{worst}");
        assert!((exp(0.0) - 1.0).abs() < 1e-15 && exp(-300.1) == 0.0 && exp(f64::NEG_INFINITY) == 0.0);

        let numbers = (-300..300).flat_map(|i| (0..100).map(move |j| 10_f64.powi(i) * (1.0 + 0.0897 * f64::from(j))));
        let worst = numbers.filter(|x| *x != 1.0).map(|x| apart(ln(x), x.ln())).fold(0.0, f64::max);
        assert!(worst < 1.5 * f64::EPSILON && ln(1.0) == 0.0, "{worst}");
    }

    #[test]
    fn val_normal_draws_are_standard_normal() {
        // For a million draws the standard error of the k-th moment is the standard deviation of x^k over 1000; the
        // bounds are four standard errors.
        let mut numbers = vec![0.0; 1_000_001];
        fill_normal(&mut numbers, &mut Pcg64::seed_from_u64(1));
        let moment = |power: i32| numbers.iter().map(|x| x.powi(power)).sum::<f64>() / numbers.len() as f64;
        for (power, expected, variance) in
            [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0), (6, 15.0, 10_170.0)]
        {
            let (found, bound) = (moment(power), 4e-3 * f64::sqrt(variance));
            assert!((found - expected).abs() < bound, "{power}: {found}");
        }
        // Kolmogorov-Smirnov statistic at the significance level 0.001.
        numbers.sort_by(f64::total_cmp);
        let distance = |(i, &x): (usize, &f64)| (i as f64 / 1e6 - below(x)).abs();
        let worst = numbers.iter().enumerate().step_by(97).map(distance).fold(0.0, f64::max);
        assert!(worst < 1.95e-3, "{worst}");
    }

    #[test]
    fn val_single_precision_draws_have_accurate_probabilities() {
        // A pair lies within r with probability 1 - exp(-r^2 / 2), whose derivative by r^2 is at most 1/2; its
        // direction is uniform.
        for bits in (0..1 << 22).map(|i: u32| i << 10).chain(0..1 << 12).chain((0..1 << 12).map(|i| u32::MAX - i)) {
            let u = (f64::from(bits >> 1) + 0.5) / 2_f64.powi(31);
            let (found, expected) = (f64::from(radius(bits)).powi(2), -2.0 * u.ln());
            let apart = (-0.5 * found).exp() - (-0.5 * expected).exp();
            assert!(apart.abs() < 4e-7, "{bits}: {found} {expected}");
            assert!(
                (found - expected).abs() < 4e-7 * (1.0 + expected) && found < 6.7 * 6.7,
                "{bits}: {found} {expected}"
            );
            let angle_rad = (f64::from(bits) / 2_f64.powi(32) - 0.5) * std::f64::consts::FRAC_PI_2;
            let (sine, cosine) = sin_cos(angle_rad as f32);
            let apart = (f64::from(sine).atan2(f64::from(cosine)) - angle_rad).abs();
            assert!(apart < 2e-7 && (sine.hypot(cosine) - 1.0).abs() < 2e-7, "{angle_rad}: {apart}");
        }
    }

    #[test]
    fn val_the_two_draws_of_a_pair_are_independent() {
        let mut numbers = vec![0.0; 1_000_000];
        fill_normal(&mut numbers, &mut Pcg64::seed_from_u64(2));
        let (firsts, seconds) = numbers.split_at(500_000);
        let mean = |term: fn(f64, f64) -> f64| {
            firsts.iter().zip(seconds).map(|(&a, &b)| term(a, b)).sum::<f64>() / firsts.len() as f64
        };
        assert!(mean(|a, b| a * b).abs() < 4.0 / 500_000_f64.sqrt());
        assert!((mean(|a, b| a * a * b * b) - 1.0).abs() < 4.0 * 8_f64.sqrt() / 500_000_f64.sqrt());
        let next = firsts.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / firsts.len() as f64;
        assert!(next.abs() < 4.0 / 500_000_f64.sqrt());
    }

    #[test]
    fn verif_vectorised_results_equal_scalar_results() {
        for count in [1, 2, 7, 8, 9, 1000, 1003] {
            let mut narrow = vec![0.0; count];
            fill_normal_from(&mut narrow, 77);
            let mut wide = vec![0.0; count];
            vectorised!(fill_normal_from(&mut wide, 77));
            assert_eq!(narrow, wide);

            #[inline(always)]
            fn total(values: &[f64]) -> (f64, f64) {
                (sum([values], |[a]| a * exp(-a * a)), largest(values))
            }
            assert_eq!(total(&narrow), vectorised!(total(&wide)));
        }
    }

    /// Standard normal distribution function at `x`, by Simpson's rule from zero.
    fn below(x: f64) -> f64 {
        let steps = 200;
        let h = x / f64::from(steps);
        let density = |i: i32| (-0.5 * (f64::from(i) * h).powi(2)).exp();
        let inner: f64 = (1..steps).map(|i| if i % 2 == 0 { 2.0 } else { 4.0 } * density(i)).sum();
        0.5 + (density(0) + inner + density(steps)) * h / 3.0 / std::f64::consts::TAU.sqrt()
    }
}
