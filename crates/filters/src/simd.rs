//! Vectorised arithmetic on arrays.
//!
//! Loops are plain Rust over slices, which the compiler vectorises, or are written with the vectors of `fearless_simd`
//! where it does not. [`vectorised!`](crate::vectorised) compiles them once per instruction set and selects the widest
//! that the processor supports.
//!
//! Results do not depend on the instruction set. Each element is computed by the same operations, and sums have sixteen
//! partial sums at every width. A product and a sum are rounded once where the code calls `mul_add` or
//! `mul_add_precise`, and only there: Rust never contracts them, and a processor without fused multiply-adds computes
//! the same, correctly rounded number in software, which takes many times as long.
//!
//! Vectors are not passed through `array::map` or iterators: these are not always inlined, and code that is not inlined
//! is compiled for the baseline instruction set.

use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use std::f64::consts::{LN_2, LOG2_E, SQRT_2};
use std::ops::Range;

use aligned_vec::{AVec, ConstAlign};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, f64x8, i32x16, u32x16, u64x8};

/// Number of partial sums, and of rows that [`pass`] processes per step: two of the widest registers.
pub(crate) const LANES: usize = 16;

/// Array aligned to a cache line, so that no vector access crosses two lines.
pub(crate) type Column = AVec<f64, ConstAlign<64>>;

/// Array of `count` elements of one value, padded to whole steps.
pub(crate) fn column(count: usize, value: f64) -> Column {
    AVec::from_iter(64, std::iter::repeat_n(value, padded(count)))
}

/// `count` rounded up to a multiple of [`LANES`].
pub(crate) fn padded(count: usize) -> usize {
    count.next_multiple_of(LANES)
}

/// `1.5 * 2^52`: adding it to a number of modest size and subtracting it again rounds to the nearest integer, which is
/// in the lowest bits of the sum.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// `ln 2` as a sum of two parts, of which the first has so few bits that its product with an exponent is exact (Cody and Waite).
const LN_2_PARTS: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// Calls a function compiled for the widest instruction set that the processor supports:
/// `vectorised!(scale(&mut values, 2.0))`. The function and its callees must be `#[inline(always)]`; a function that is
/// not inlined is compiled for the baseline instruction set.
#[macro_export]
macro_rules! vectorised {
    ($call:expr) => {
        $crate::fearless_simd::dispatch!(*$crate::LEVEL, _ => $call)
    };
    ($simd:ident => $call:expr) => {
        $crate::fearless_simd::dispatch!(*$crate::LEVEL, $simd => $call)
    };
}

/// Runs a statement for every pair of indices below two constants.
macro_rules! for_each_index {
    ($first:expr, $second:expr, |$j:ident, $k:ident| $statement:expr) => {
        for $j in 0..$first {
            for $k in 0..$second {
                $statement;
            }
        }
    };
}

/// Rows that are computed together.
pub(crate) type Rows<S> = f64x8<S>;

/// Number of rows in [`Rows`].
pub(crate) const WIDTH: usize = 8;

/// Number of [`Rows`] in a step of [`pass`].
pub(crate) const GROUPS: usize = LANES / WIDTH;

/// Partial results of a sum or of a maximum.
pub(crate) type Parts<S> = [Rows<S>; GROUPS];

/// Rows of one group in a step.
#[inline(always)]
pub(crate) fn of_group(group: usize) -> Range<usize> {
    WIDTH * group..WIDTH * (group + 1)
}

/// Passes once over the first `count` rows of [`padded`] columns. `step` receives rows of the first column and of
/// the others, and `J` times `K` accumulators, which begin at `start`; it returns rows of the outputs. What is written
/// beyond the last row has no meaning.
#[inline(always)]
pub(crate) fn pass<S: Simd, const C: usize, const D: usize, const J: usize, const K: usize>(
    simd: S,
    count: usize,
    (first, others): (&[f64], [&[f64]; C]),
    outputs: [&mut [f64]; D],
    start: [[f64; K]; J],
    step: impl Fn(Rows<S>, [Rows<S>; C], &mut [[Rows<S>; K]; J]) -> [Rows<S>; D],
) -> [[Parts<S>; K]; J] {
    let zero = Rows::splat(simd, 0.0);
    let steps = count.div_ceil(LANES);
    // Slices of equal length make bounds checks unnecessary.
    let first = &first.as_chunks::<LANES>().0[..steps];
    let others = others.map(|column| &column.as_chunks::<LANES>().0[..steps]);
    let outputs = outputs.map(|column| &mut column.as_chunks_mut::<LANES>().0[..steps]);
    let mut parts = [[[zero; GROUPS]; K]; J];
    for_each_index!(J, K, |j, k| parts[j][k] = [Rows::splat(simd, start[j][k]); GROUPS]);
    for number in 0..steps {
        for group in 0..GROUPS {
            let of_first = Rows::from_slice(simd, &first[number][of_group(group)]);
            let mut of_others = [zero; C];
            for c in 0..C {
                of_others[c] = Rows::from_slice(simd, &others[c][number][of_group(group)]);
            }
            let mut after = [[zero; K]; J];
            for_each_index!(J, K, |j, k| after[j][k] = parts[j][k][group]);
            let found = step(of_first, of_others, &mut after);
            for d in 0..D {
                found[d].store_slice(&mut outputs[d][number][of_group(group)]);
            }
            let rest = count - LANES * number;
            if rest < LANES {
                let within = Rows::from_fn(simd, |row| (WIDTH * group + row) as f64).simd_lt(rest as f64);
                for_each_index!(J, K, |j, k| after[j][k] = within.select(after[j][k], parts[j][k][group]));
            }
            for_each_index!(J, K, |j, k| parts[j][k][group] = after[j][k]);
        }
    }
    parts
}

/// Sums over the first `count` rows of padded columns; `add` adds the terms of rows.
#[inline(always)]
pub(crate) fn sums<S: Simd, const C: usize, const J: usize, const K: usize>(
    simd: S,
    count: usize,
    columns: (&[f64], [&[f64]; C]),
    add: impl Fn(Rows<S>, [Rows<S>; C], &mut [[Rows<S>; K]; J]),
) -> [[f64; K]; J] {
    let parts = pass(simd, count, columns, [], [[0.0; K]; J], |first, others, sums| {
        add(first, others, sums);
        []
    });
    let mut found = [[0.0; K]; J];
    for_each_index!(J, K, |j, k| found[j][k] = total(parts[j][k]));
    found
}

/// Sum of all parts.
#[inline(always)]
pub(crate) fn total<S: Simd>([a, b]: Parts<S>) -> f64 {
    reduced((a + b).to_array(), |a, b| a + b)
}

/// Largest of all parts.
#[inline(always)]
pub(crate) fn largest_part<S: Simd>([a, b]: Parts<S>) -> f64 {
    reduced(a.max(b).to_array(), |a, b| if b > a { b } else { a })
}

#[inline(always)]
fn reduced([a, b, c, d, e, f, g, h]: [f64; WIDTH], both: impl Fn(f64, f64) -> f64) -> f64 {
    both(both(both(a, e), both(c, g)), both(both(b, f), both(d, h)))
}

/// Largest of the first `count` rows of a padded column; minus infinity if there are none.
#[inline(always)]
pub(crate) fn largest(simd: impl Simd, count: usize, values: &[f64]) -> f64 {
    let [[parts]] = pass(simd, count, (values, []), [], [[f64::NEG_INFINITY]], |value, [], [[largest]]| {
        *largest = largest.max(value);
        []
    });
    largest_part(parts)
}

/// `e^x` for `x <= 0` with a relative error below 3e-12. Zero for `x < -300`, which keeps squares of weights out of the
/// subnormal range, where arithmetic is about a hundred times slower.
#[inline(always)]
pub(crate) fn exp<S: Simd>(simd: S, x: Rows<S>) -> Rows<S> {
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
    let held = x.max(LEAST);
    let rounded = held.mul_add_precise(LOG2_E, ROUNDER);
    let exponent = rounded - ROUNDER;
    // The product is not rounded; the rounding error of ln 2 contributes less than 1e-14.
    let rest = exponent.mul_add_precise(-LN_2, held);
    let pair = |i: usize| Rows::splat(simd, SERIES[i + 1]).mul_add_precise(rest, SERIES[i]);
    let squared = rest * rest;
    let high = squared.mul_add_precise(pair(6), pair(4));
    let series = squared.mul_add_precise(squared.mul_add_precise(high, pair(2)), pair(0));
    let value = rest.mul_add_precise(series, 1.0);
    // The lowest bits of `rounded` are the exponent, which is added to that of the value.
    let scaled: Rows<S> = (value.bitcast::<u64x8<S>>() + (rounded.bitcast::<u64x8<S>>() << 52)).bitcast();
    x.simd_ge(LEAST).select(scaled, Rows::splat(simd, 0.0))
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
    let correction = s * (half + squared * polynomial(&SERIES, squared)) + exponent * LN_2_PARTS[1];
    exponent * LN_2_PARTS[0] - ((half - correction) - f)
}

/// Polynomial of degree 7, lowest coefficient first, by Estrin's scheme, whose products are mostly independent.
#[inline(always)]
fn polynomial([a, b, c, d, e, f, g, h]: &[f64; 8], x: f64) -> f64 {
    let squared = x * x;
    ((a + b * x) + (c + d * x) * squared) + ((e + f * x) + (g + h * x) * squared) * (squared * squared)
}

/// Generator of standard normal numbers: eight generators xoroshiro128+ (Blackman and Vigna 2021), of which each gives
/// the bits of two lanes. Their first states are outputs of SplitMix64 (Steele, Lea and Flood 2014).
pub(crate) struct Generator<S: Simd> {
    simd: S,
    state: [u64x8<S>; 2],
}

impl<S: Simd> Generator<S> {
    /// Generator for a seed.
    #[inline(always)]
    pub(crate) fn new(simd: S, seed: u64) -> Self {
        let output = |number: usize| mixed(seed.wrapping_add(GAMMA.wrapping_mul(number as u64 + 1)));
        Self { simd, state: [u64x8::from_fn(simd, output), u64x8::from_fn(simd, |place| output(8 + place))] }
    }

    /// Next random bits of every lane. The lowest bits are the least random ones.
    #[inline(always)]
    fn next(&mut self) -> u32x16<S> {
        let [a, b] = self.state;
        let both = a ^ b;
        self.state = [((a << 24) | (a >> 40)) ^ both ^ (both << 16), (both << 37) | (both >> 27)];
        (a + b).bitcast()
    }

    /// Independent standard normal numbers for [`LANES`] states, by component: pairs by the Box-Muller transform (1958).
    ///
    /// The computation is in `f32`, of which a register holds twice as many as of `f64`: probabilities are accurate to
    /// 4e-7, and no draw exceeds 6.7 in magnitude. The ziggurat method needs fewer operations, but its branches prevent
    /// vectorisation.
    #[inline(always)]
    pub(crate) fn normals<const N: usize>(&mut self) -> [Parts<S>; N] {
        let mut normals = [[Rows::splat(self.simd, 0.0); GROUPS]; N];
        // For an odd number of components, half of the last pair is unused.
        for pair in 0..N.div_ceil(2) {
            let (radius_bits, angle_bits) = (self.next(), self.next());
            let (ones, others) = normal_pairs(self.simd, radius_bits, angle_bits);
            for (number, draws) in [(2 * pair, ones), (2 * pair + 1, others)] {
                if number < N {
                    let (low, high) = draws.widen();
                    normals[number] = [low, high];
                }
            }
        }
        normals
    }
}

/// Increment of SplitMix64.
const GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// Finaliser of SplitMix64.
#[inline(always)]
fn mixed(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Pairs of independent standard normal numbers from random bits.
#[inline(always)]
fn normal_pairs<S: Simd>(simd: S, radius_bits: u32x16<S>, angle_bits: u32x16<S>) -> (f32x16<S>, f32x16<S>) {
    const SIGN: u32 = 1 << 31;
    // Odd numbers, uniform from -2^31 to 2^31. Their magnitudes give the radii, their signs the half-planes.
    let numbers: u32x16<S> = signed(radius_bits | 1).bitcast();
    let radii: u32x16<S> = radii(simd, (numbers & !SIGN).bitcast()).bitcast();
    let signed_radii: f32x16<S> = (radii ^ (numbers & SIGN)).bitcast();
    let (sines, cosines) = sines_and_cosines(simd, signed(angle_bits) * (1.0 / TWO_TO_31));
    (signed_radii * sines, signed_radii * cosines)
}

/// Bits read as signed integers in two's complement, converted to `f32`.
#[inline(always)]
fn signed<S: Simd>(bits: u32x16<S>) -> f32x16<S> {
    f32x16::float_from(bits.bitcast::<i32x16<S>>())
}

const TWO_TO_31: f32 = 2_147_483_648.0;

/// Radii `sqrt(-2 ln u)` of standard normal pairs, for `u = magnitude / 2^31`, which is uniform from 0 to 1.
#[inline(always)]
fn radii<S: Simd>(simd: S, magnitudes: f32x16<S>) -> f32x16<S> {
    /// Minimax polynomial of `-2 ln(1 + f) / f` for `1 + f` from `sqrt(1/2)` to `sqrt(2)`. A division would need fewer
    /// operations, but would compete with the square root.
    const SERIES: [f32; 8] =
        [-1.999_999_6, 1.000_013_4, -0.666_723_6, 0.499_186_8, -0.397_460_6, 0.346_669_9, -0.328_402_37, 0.202_046_06];
    const ROOT: u32 = FRAC_1_SQRT_2.to_bits();
    // u = 2^exponent (1 + f), with 1 + f from sqrt(1/2) to sqrt(2).
    let above = magnitudes.bitcast::<u32x16<S>>() - (ROOT + (31 << 23));
    let exponents = f32x16::float_from(above.bitcast::<i32x16<S>>() >> 23);
    let f = ((above & ((1 << 23) - 1)) + ROOT).bitcast::<f32x16<S>>() - 1.0;
    let pair = |i: usize| f32x16::splat(simd, SERIES[i + 1]).mul_add_precise(f, SERIES[i]);
    let squared = f * f;
    let high = squared.mul_add_precise(pair(6), pair(4));
    let series = squared.mul_add_precise(squared.mul_add_precise(high, pair(2)), pair(0));
    exponents.mul_add_precise(-2.0 * std::f32::consts::LN_2, f * series).sqrt()
}

/// Sines and cosines of `t` times `pi / 2`, for `t` from -1 to 1, by minimax polynomials.
#[inline(always)]
fn sines_and_cosines<S: Simd>(simd: S, t: f32x16<S>) -> (f32x16<S>, f32x16<S>) {
    const SINE: [f32; 5] = [FRAC_PI_2, -0.645_964_26, 0.079_691_41, -4.675_879_6e-3, 1.523_677_6e-4];
    const COSINE: [f32; 5] = [1.0, -1.233_698_8, 0.253_653_2, -0.020_813_966, 8.596_899_6e-4];
    let squared = t * t;
    let (mut sine, mut cosine) = (f32x16::splat(simd, SINE[4]), f32x16::splat(simd, COSINE[4]));
    for i in (0..4).rev() {
        sine = sine.mul_add_precise(squared, SINE[i]);
        cosine = cosine.mul_add_precise(squared, COSINE[i]);
    }
    (t * sine, cosine)
}

#[cfg(test)]
pub(crate) mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::LEVEL;

    /// All instruction sets that the processor supports.
    pub(crate) fn levels() -> Vec<Level> {
        let widest = Level::new();
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let narrower = [
            widest.as_sse2().map(Level::Sse2),
            widest.as_sse4_2().map(Level::Sse4_2),
            widest.as_avx2().map(Level::Avx2),
        ];
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        let narrower = [Some(Level::baseline())];
        narrower.into_iter().flatten().chain([widest]).collect()
    }

    #[inline(always)]
    fn exponentials(simd: impl Simd, values: &mut [f64]) {
        for values in values.as_chunks_mut::<WIDTH>().0 {
            *values = exp(simd, Rows::load_array(simd, *values)).to_array();
        }
    }

    /// Standard normal draws by component.
    #[inline(always)]
    fn draws<const N: usize>(simd: impl Simd, seed: u64, steps: usize) -> [Vec<f64>; N] {
        let (mut generator, mut found) = (Generator::new(simd, seed), std::array::from_fn(|_| Vec::new()));
        for _ in 0..steps {
            for (draws, parts) in found.iter_mut().zip(generator.normals::<N>()) {
                parts.iter().for_each(|rows| draws.extend(rows.to_array()));
            }
        }
        found
    }

    #[test]
    fn val_exp_and_ln_agree_with_the_standard_library() {
        let apart = |found: f64, expected: f64| ((found - expected) / expected).abs();
        let numbers: Vec<f64> = (0..300_000).map(|i| -1e-3 * f64::from(i)).collect();
        let mut found = numbers.clone();
        vectorised!(simd => exponentials(simd, &mut found));
        let worst = numbers.iter().zip(found).map(|(x, found)| apart(found, x.exp())).fold(0.0, f64::max);
        assert!(worst < 3e-12, "{worst}");
        let mut found = [0.0, -0.0, -300.0, -300.1, f64::MIN, f64::NEG_INFINITY, 0.0, 0.0];
        vectorised!(simd => exponentials(simd, &mut found));
        assert!((found[0] - 1.0).abs() < 1e-15 && found[1] == found[0] && found[2] > 0.0);
        assert_eq!(found[3..6], [0.0; 3]);

        let numbers = (-300..300).flat_map(|i| (0..100).map(move |j| 10_f64.powi(i) * (1.0 + 0.0897 * f64::from(j))));
        let worst = numbers.filter(|x| *x != 1.0).map(|x| apart(ln(x), x.ln())).fold(0.0, f64::max);
        assert!(worst < 1.5 * f64::EPSILON && ln(1.0) == 0.0, "{worst}");
    }

    /// Draws with the widest instruction set, compiled once for both tests.
    fn drawn(seed: u64, steps: usize) -> [Vec<f64>; 3] {
        vectorised!(simd => draws::<3>(simd, seed, steps))
    }

    #[test]
    fn val_normal_draws_are_standard_normal() {
        // For a million draws the standard error of the k-th moment is the standard deviation of x^k over 1000; the
        // bounds are four standard errors.
        for mut numbers in drawn(1, 62_500) {
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
    }

    #[test]
    fn val_single_precision_draws_have_accurate_probabilities() {
        #[inline(always)]
        fn parts<S: Simd>(simd: S, numbers: [i32; LANES]) -> [[f32; LANES]; 3] {
            let t = f32x16::float_from(i32x16::load_array(simd, numbers)) * (1.0 / TWO_TO_31);
            let (sines, cosines) = sines_and_cosines(simd, t);
            [radii(simd, t.abs() * TWO_TO_31).to_array(), sines.to_array(), cosines.to_array()]
        }
        // A pair lies within r with probability 1 - exp(-r^2 / 2), whose derivative by r^2 is at most 1/2; its
        // direction is uniform.
        let ends = (0..1 << 8).flat_map(|i| [i << 4, i32::MAX - (i << 4)]);
        for first in (0..1 << 17).map(|i| i << 14).chain(ends) {
            let numbers = std::array::from_fn(|lane| (first | 1).saturating_add(2 * lane as i32));
            let [radii, sines, cosines] = vectorised!(simd => parts(simd, numbers));
            for lane in 0..LANES {
                let u = f64::from(numbers[lane]) / 2_f64.powi(31);
                let (found, expected) = (f64::from(radii[lane]).powi(2), -2.0 * u.ln());
                let apart = (-0.5 * found).exp() - (-0.5 * expected).exp();
                assert!(apart.abs() < 4e-7, "{u}: {found} {expected}");
                assert!(
                    (found - expected).abs() < 4e-7 * (1.0 + expected) && found < 6.7 * 6.7,
                    "{u}: {found} {expected}"
                );
                let (sine, cosine, angle_rad) = (sines[lane], cosines[lane], u * std::f64::consts::FRAC_PI_2);
                let apart = (f64::from(sine).atan2(f64::from(cosine)) - angle_rad).abs();
                assert!(apart < 2e-7 && (sine.hypot(cosine) - 1.0).abs() < 2e-7, "{angle_rad}: {apart}");
            }
        }
    }

    #[test]
    fn val_draws_are_independent() {
        let [firsts, seconds, thirds] = drawn(2, 31_250);
        let count = firsts.len() as f64;
        let mean = |a: &[f64], b: &[f64], term: fn(f64, f64) -> f64| {
            a.iter().zip(b).map(|(&a, &b)| term(a, b)).sum::<f64>() / count
        };
        for (a, b) in [(&firsts, &seconds), (&firsts, &thirds), (&seconds, &thirds)] {
            assert!(mean(a, b, |a, b| a * b).abs() < 4.0 / count.sqrt());
            assert!((mean(a, b, |a, b| a * a * b * b) - 1.0).abs() < 4.0 * 8_f64.sqrt() / count.sqrt());
        }
        // Neighbouring lanes share a generator, LANES draws lie between two draws of a lane.
        for lag in [1, 2, WIDTH, LANES] {
            assert!(mean(&firsts, &firsts[lag..], |a, b| a * b).abs() < 4.0 / count.sqrt(), "{lag}");
        }
    }

    #[test]
    fn verif_draws_exponentials_and_sums_do_not_depend_on_the_instruction_set() {
        type Found = (Vec<f64>, Vec<f64>, [f64; 2], f64);

        #[inline(always)]
        fn found(simd: impl Simd, count: usize) -> Found {
            let [numbers] = draws::<1>(simd, 77, count.div_ceil(LANES));
            let mut powers: Vec<f64> = numbers.iter().map(|x| -30.0 * x * x).collect();
            exponentials(simd, &mut powers);
            let [sums] = sums(simd, count, (&numbers, [&powers]), |x, [y], [[a, b]]| {
                *a += x;
                *b = x.mul_add_precise(y, *b);
            });
            let largest = largest(simd, count, &numbers);
            (numbers, powers, sums, largest)
        }

        // The only dispatch of `found`, which is therefore compiled once per instruction set.
        fn found_at(level: Level, count: usize) -> Found {
            dispatch!(level, simd => found(simd, count))
        }

        for count in [1, 2, 7, 8, 9, 15, 16, 17, 1000, 1003] {
            let widest = found_at(*LEVEL, count);
            let plain = widest.0[..count].iter().sum::<f64>();
            assert!((widest.2[0] - plain).abs() < 1e-12);
            assert_eq!(widest.3, widest.0[..count].iter().copied().fold(f64::NEG_INFINITY, f64::max));
            for level in levels() {
                assert_eq!(found_at(level, count), widest, "{level:?}, {count}");
            }
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
