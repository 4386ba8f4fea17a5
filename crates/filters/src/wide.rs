//! Arithmetic on many numbers at once, as wide as the processor's registers are.
//!
//! The loops are plain Rust over slices, which the compiler turns into vector instructions; [`vectorised!`](crate::vectorised) has them compiled once for each
//! width and takes the widest that the processor has. The results do not depend on that: each element is computed by the same operations, sums
//! are taken in eight parts whatever the width, and Rust never fuses a product and a sum.

use std::f64::consts::{FRAC_PI_2, LOG2_E, SQRT_2};

use rand::Rng;

/// Parts in which a sum is taken.
const LANES: usize = 8;

/// Two to the 52nd and half of it: a number of modest size added to this and taken away again is rounded to the nearest integer, which meanwhile
/// stands in the lowest bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts, the first so short that its product with an exponent is exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// Calls a function as compiled for the widest vectors that the processor has: `vectorised!(scale(&mut values, 2.0))`. It and whatever it calls
/// must be `#[inline(always)]`: what is not inlined stays as narrow as the rest of the program.
#[macro_export]
macro_rules! vectorised {
    ($call:expr) => {
        $crate::fearless_simd::dispatch!($crate::fearless_simd::Level::new(), _ => $call)
    };
}

/// Sum of `term` over three columns of one length.
#[inline(always)]
pub(crate) fn sum([a, b, c]: [&[f64]; 3], term: impl Fn(f64, f64, f64) -> f64) -> f64 {
    let ((a, a_rest), (b, b_rest), (c, c_rest)) =
        (a.as_chunks::<LANES>(), b.as_chunks::<LANES>(), c.as_chunks::<LANES>());
    let mut parts = [0.0; LANES];
    for ((a, b), c) in a.iter().zip(b).zip(c) {
        for lane in 0..LANES {
            parts[lane] += term(a[lane], b[lane], c[lane]);
        }
    }
    for (lane, ((&a, &b), &c)) in a_rest.iter().zip(b_rest).zip(c_rest).enumerate() {
        parts[lane] += term(a, b, c);
    }
    let [a, b, c, d, e, f, g, h] = parts;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// The largest of some numbers, minus infinity where there are none.
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

/// `e^x` of a number not above zero, to within two units in the last place; zero below `e^-300`, so that of such numbers even the squares, times small
/// numbers, are normal: others take the processor a hundred times as long.
#[inline(always)]
pub(crate) fn exp(x: f64) -> f64 {
    const LEAST: f64 = -300.0;
    /// `1 / k!`, the highest first.
    const TAYLOR: [f64; 12] = [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
    ];
    let held = if x < LEAST { LEAST } else { x };
    let rounded = held * LOG2_E + ROUNDER;
    let exponent = rounded - ROUNDER;
    let rest = (held - exponent * LN_2[0]) - exponent * LN_2[1];
    let value = 1.0 + rest * polynomial(&TAYLOR, rest);
    let power = f64::from_bits(rounded.to_bits().wrapping_add(1023) << 52);
    if x < LEAST { 0.0 } else { value * power }
}

/// The natural logarithm of a positive normal number, to within a unit in the last place (the series of Sun's fdlibm).
#[inline(always)]
pub(crate) fn ln(x: f64) -> f64 {
    const SERIES: [f64; 7] = [
        1.479_819_860_511_658_6e-1,
        1.531_383_769_920_937_3e-1,
        1.818_357_216_161_805e-1,
        2.222_219_843_214_978_4e-1,
        2.857_142_874_366_239e-1,
        3.999_999_999_940_942e-1,
        6.666_666_666_666_735e-1,
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

/// Sine and cosine of an angle within an eighth of a turn (the series of Sun's fdlibm).
#[inline(always)]
fn sin_cos(angle_rad: f64) -> (f64, f64) {
    const SINE: [f64; 6] = [
        1.589_690_995_211_55e-10,
        -2.505_076_025_340_686_3e-8,
        2.755_731_370_707_006_8e-6,
        -1.984_126_982_985_795e-4,
        8.333_333_333_322_49e-3,
        -1.666_666_666_666_663_2e-1,
    ];
    const COSINE: [f64; 6] = [
        -1.135_964_755_778_819_5e-11,
        2.087_572_321_298_175e-9,
        -2.755_731_435_139_066_3e-7,
        2.480_158_728_947_673e-5,
        -1.388_888_888_887_411e-3,
        4.166_666_666_666_66e-2,
    ];
    let squared = angle_rad * angle_rad;
    let sine = angle_rad + angle_rad * squared * polynomial(&SINE, squared);
    let cosine = 1.0 - 0.5 * squared + squared * squared * polynomial(&COSINE, squared);
    (sine, cosine)
}

/// A polynomial by Horner's rule, its highest coefficient first.
#[inline(always)]
fn polynomial<const K: usize>(coefficients: &[f64; K], x: f64) -> f64 {
    let mut value = coefficients[0];
    for coefficient in &coefficients[1..] {
        value = value * x + coefficient;
    }
    value
}

/// Fills with independent draws from the standard normal distribution: pairs by the method of Box and Muller (1958) from the numbers of a SplitMix64
/// generator (Steele, Lea and Flood 2014), which `rng` starts.
///
/// The pairs are exact but for the 52 bits of the two numbers they are made of, so none lies more than 8.5 from zero. The ziggurat needs
/// fewer operations, but each number waits for a branch and the generator for the number before; in wide registers this is more than twice as fast.
pub(crate) fn fill_normal(values: &mut [f64], rng: &mut impl Rng) {
    let start = rng.next_u64();
    vectorised!(fill_normal_from(values, start));
}

#[inline(always)]
fn fill_normal_from(values: &mut [f64], start: u64) {
    const GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;
    let draw = |pair: u64| {
        let state = start.wrapping_add((2 * pair).wrapping_mul(GAMMA));
        normal_pair(mixed(state), mixed(state.wrapping_add(GAMMA)))
    };
    let (firsts, seconds) = values.split_at_mut(values.len() / 2);
    let pairs = firsts.len() as u64;
    let (seconds, odd) = seconds.split_at_mut(firsts.len());
    for ((first, second), pair) in firsts.iter_mut().zip(seconds).zip(0..pairs) {
        (*first, *second) = draw(pair);
    }
    if let [odd] = odd {
        *odd = draw(pairs).0;
    }
}

/// The finaliser of SplitMix64.
#[inline(always)]
fn mixed(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Two independent normal numbers out of random bits.
#[inline(always)]
fn normal_pair(radius_bits: u64, angle_bits: u64) -> (f64, f64) {
    // The highest 52 bits as the fraction of a number from 1 to 2.
    let fraction = |bits: u64| f64::from_bits((bits >> 12) | 1.0_f64.to_bits());
    let radius = (-2.0 * ln(2.0 - fraction(radius_bits))).sqrt();
    let (sine, cosine) = sin_cos((fraction(angle_bits) - 1.5) * FRAC_PI_2);
    let (a, b) = ((radius * sine).to_bits(), (radius * cosine).to_bits());
    // Of the bits that the fraction leaves, one says in which half of the turn the pair lies, one whether it is mirrored at the diagonal.
    let swapped = (a ^ b) & 0_u64.wrapping_sub(angle_bits & 1);
    let negative = (angle_bits & 2) << 62;
    (f64::from_bits(a ^ swapped ^ negative), f64::from_bits(b ^ swapped ^ negative))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn val_exp_and_ln_are_those_of_the_standard_library() {
        let apart = |found: f64, expected: f64| ((found - expected) / expected).abs();
        let worst = (0..300_000).map(|i| -1e-3 * f64::from(i)).map(|x| apart(exp(x), x.exp())).fold(0.0, f64::max);
        assert!(worst < 2.0 * f64::EPSILON, "{worst}");
        assert!(exp(0.0) == 1.0 && exp(-300.1) == 0.0 && exp(f64::NEG_INFINITY) == 0.0);

        let numbers = (-300..300).flat_map(|i| (0..100).map(move |j| 10_f64.powi(i) * (1.0 + 0.0897 * f64::from(j))));
        let worst = numbers.filter(|x| *x != 1.0).map(|x| apart(ln(x), x.ln())).fold(0.0, f64::max);
        assert!(worst < 1.5 * f64::EPSILON && ln(1.0) == 0.0, "{worst}");
    }

    #[test]
    fn val_normal_numbers_are_normal() {
        // With a million numbers the standard error of the k-th moment is the root of the variance of x^k over 1000; bounds of four of them.
        let mut numbers = vec![0.0; 1_000_001];
        fill_normal(&mut numbers, &mut Pcg64::seed_from_u64(1));
        let moment = |power: i32| numbers.iter().map(|x| x.powi(power)).sum::<f64>() / numbers.len() as f64;
        for (power, expected, variance) in
            [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0), (6, 15.0, 10_170.0)]
        {
            let (found, bound) = (moment(power), 4e-3 * f64::sqrt(variance));
            assert!((found - expected).abs() < bound, "{power}: {found}");
        }
        // The largest distance between the distributions, within the bound of Kolmogorov at one in a thousand.
        numbers.sort_by(f64::total_cmp);
        let distance = |(i, &x): (usize, &f64)| (i as f64 / 1e6 - below(x)).abs();
        let worst = numbers.iter().enumerate().step_by(97).map(distance).fold(0.0, f64::max);
        assert!(worst < 1.95e-3, "{worst}");
    }

    #[test]
    fn val_the_two_of_a_pair_are_independent() {
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
    fn verif_results_are_those_of_the_narrow_code() {
        for count in [1, 2, 7, 8, 9, 1000, 1003] {
            let mut narrow = vec![0.0; count];
            fill_normal_from(&mut narrow, 77);
            let mut wide = vec![0.0; count];
            vectorised!(fill_normal_from(&mut wide, 77));
            assert_eq!(narrow, wide);

            #[inline(always)]
            fn total(values: &[f64]) -> (f64, f64) {
                (sum([values; 3], |a, b, _| a * exp(-b * b)), largest(values))
            }
            assert_eq!(total(&narrow), vectorised!(total(&wide)));
        }
    }

    /// Share of the standard normal distribution below `x`: Simpson's rule from the middle.
    fn below(x: f64) -> f64 {
        let steps = 200;
        let h = x / f64::from(steps);
        let density = |i: i32| (-0.5 * (f64::from(i) * h).powi(2)).exp();
        let inner: f64 = (1..steps).map(|i| if i % 2 == 0 { 2.0 } else { 4.0 } * density(i)).sum();
        0.5 + (density(0) + inner + density(steps)) * h / 3.0 / std::f64::consts::TAU.sqrt()
    }
}
