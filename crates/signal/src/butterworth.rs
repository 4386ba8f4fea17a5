//! Butterworth low-pass and band-pass filters of any order, as second-order sections.
//!
//! The design transforms the analogue low-pass prototype, whose poles are evenly spaced on the left half of the unit
//! circle, into the digital filter with pre-warped edges by the bilinear transform (Oppenheim and Schafer,
//! *Discrete-Time Signal Processing*, 2010, chapter 7). Poles and zeros are grouped into sections as by SciPy's
//! `zpk2sos`: the poles nearest to the unit circle are paired with the zeros nearest to them and come last, which keeps
//! the intermediate values small. So each section equals that of `scipy.signal.butter(order, [low, high], "bandpass",
//! output="sos")`, or of `"lowpass"`.

use std::f64::consts::PI;

use nalgebra::Complex;

use crate::Section;

/// A pole is real if its imaginary part is below this share of its absolute value.
const REAL: f64 = 100.0 * f64::EPSILON;

/// The band does not fit the sampling rate.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("band of {low_hz} to {high_hz} Hz: expected edges in ascending order above 0 and below {}, half the sampling \
    rate", 0.5 * .rate_hz)]
pub struct NoSuchBand {
    low_hz: f64,
    high_hz: f64,
    rate_hz: f64,
}

/// The low-pass of `order` whose power is halved at `edge_hz`, as `order / 2` sections, rounded up.
///
/// # Errors
/// [`NoSuchBand`] if the edge is not between zero and half the sampling rate.
pub fn low_pass(order: usize, edge_hz: f64, rate_hz: f64) -> Result<Vec<Section>, NoSuchBand> {
    if !(0.0 < edge_hz && 2.0 * edge_hz < rate_hz) {
        return Err(NoSuchBand { low_hz: 0.0, high_hz: edge_hz, rate_hz });
    }
    // The unit of time is that of `band_pass`. Every zero lies at infinity, hence at minus one in z.
    let edge = 4.0 * (PI * edge_hz / rate_hz).tan();
    let digital = |s: Complex<f64>| (s + 4.0) / (-s + 4.0);
    // In ascending order of the angle from the negative real axis, and so of the quality factor: the poles nearest to
    // the unit circle come last.
    let first_angle = if order.is_multiple_of(2) { 0.5 } else { 0.0 };
    let sections = (0..order.div_ceil(2)).map(|index| {
        let angle = (index as f64 + first_angle) * PI / order as f64;
        let pole = digital(-Complex::from_polar(edge, angle));
        let (mut b, a) = if angle == 0.0 {
            ([1.0, 1.0, 0.0], [-pole.re, 0.0])
        } else {
            ([1.0, 2.0, 1.0], [-2.0 * pole.re, pole.norm_sqr()])
        };
        // Each section has unit gain at zero frequency.
        let gain = (1.0 + a.iter().sum::<f64>()) / b.iter().sum::<f64>();
        b = b.map(|coefficient| gain * coefficient);
        Section { b, a }
    });
    Ok(sections.collect())
}

/// The band-pass between two frequencies with a low-pass prototype of `order`: a filter of twice that order, as `order`
/// sections.
///
/// # Errors
/// [`NoSuchBand`] if the edges are not in ascending order between zero and half the sampling rate.
pub fn band_pass(order: usize, low_hz: f64, high_hz: f64, rate_hz: f64) -> Result<Vec<Section>, NoSuchBand> {
    if !(0.0 < low_hz && low_hz < high_hz && 2.0 * high_hz < rate_hz) {
        return Err(NoSuchBand { low_hz, high_hz, rate_hz });
    }
    // The unit of time is half a sample, for which the bilinear transform is z = (4 + s) / (4 - s).
    let [low, high] = [low_hz, high_hz].map(|edge_hz| 4.0 * (PI * edge_hz / rate_hz).tan());
    let (middle, width) = ((low * high).sqrt(), high - low);
    let digital = |s: Complex<f64>| (s + 4.0) / (-s + 4.0);
    let mut analogue = Vec::with_capacity(2 * order);
    for index in 0..order {
        let angle = PI * (2.0 * index as f64 + 1.0 - order as f64) / (2.0 * order as f64);
        let scaled = -Complex::from_polar(0.5 * width, angle);
        let apart = (scaled * scaled - middle * middle).sqrt();
        analogue.extend([scaled + apart, scaled - apart]);
    }
    // Half of the analogue zeros lie at zero, hence at one in z; the others at infinity, hence at minus one.
    let gain =
        analogue.iter().fold(Complex::new((4.0 * width).powi(order as i32), 0.0), |gain, &s| gain / (-s + 4.0)).re;
    let mut poles: Vec<Complex<f64>> = analogue
        .iter()
        .map(|&s| digital(s))
        .filter_map(|pole| {
            let is_real = pole.im.abs() <= REAL * pole.norm();
            (is_real || pole.im > 0.0).then(|| if is_real { Complex::new(pole.re, 0.0) } else { pole })
        })
        .collect();
    let mut zeros: Vec<f64> = (0..2 * order).map(|index| if index < order { -1.0 } else { 1.0 }).collect();

    let mut sections = Vec::with_capacity(order);
    while let Some(pole) = take_smallest(&mut poles, |pole| (1.0 - pole.norm()).abs()) {
        // One of a pair of complex poles represents both; real ones come in pairs too.
        let partner = if pole.im == 0.0 {
            take_smallest(&mut poles, |other| if other.im == 0.0 { (1.0 - other.norm()).abs() } else { f64::INFINITY })
                .expect("a band-pass has an even number of real poles")
        } else {
            pole.conj()
        };
        let [first, second] =
            [(); 2].map(|()| take_smallest(&mut zeros, |&zero| (pole - zero).norm()).expect("as many zeros as poles"));
        sections.push(Section {
            b: [1.0, -(first + second), first * second],
            a: [-(pole + partner).re, (pole * partner).re],
        });
    }
    sections.reverse();
    for coefficient in &mut sections[0].b {
        *coefficient *= gain;
    }
    Ok(sections)
}

/// Removes the first of the values with the smallest `measure`.
fn take_smallest<T: Copy>(values: &mut Vec<T>, measure: impl Fn(&T) -> f64) -> Option<T> {
    let place = (0..values.len()).min_by(|&a, &b| measure(&values[a]).total_cmp(&measure(&values[b])))?;
    Some(values.remove(place))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cascade;

    #[test]
    fn val_the_band_edges_pass_half_the_power() {
        for (order, low_hz, high_hz) in [(1, 4.0, 16.0), (3, 4.0, 16.0), (3, 1.0, 100.0), (6, 5.0, 12.0)] {
            let mut filter = Cascade::new(band_pass(order, low_hz, high_hz, 250.0).unwrap());
            for (frequency_hz, power) in [(low_hz, 0.5), (high_hz, 0.5)] {
                let phase = |sample: usize| 2.0 * PI * frequency_hz * sample as f64 / 250.0;
                let rows = 20_000;
                let sum: f64 =
                    (0..2 * rows).map(|i| (i, filter.step(phase(i).sin()))).skip(rows).map(|(_, y)| y * y).sum();
                assert!((2.0 * sum / rows as f64 - power).abs() < 1e-3, "order {order}, {frequency_hz} Hz");
            }
        }
    }

    #[test]
    fn verif_a_low_pass_halves_the_power_at_its_edge_and_keeps_a_constant() {
        for order in 1..=5 {
            let sections = low_pass(order, 5.0, 888.0).unwrap();
            let z = Complex::from_polar(1.0, -2.0 * PI * 5.0 / 888.0);
            let response = sections.iter().fold(Complex::new(1.0, 0.0), |product, Section { b, a }| {
                product * (z * z * b[2] + z * b[1] + b[0]) / (z * z * a[1] + z * a[0] + 1.0)
            });
            assert!((response.norm_sqr() - 0.5).abs() < 1e-9, "order {order}");
            let mut filter = Cascade::new(sections);
            let last = (0..10_000).map(|_| filter.step(3.0)).last().unwrap();
            assert!((last - 3.0).abs() < 1e-9, "order {order}");
        }
        assert!([0.0, 444.0, f64::NAN].iter().all(|&edge_hz| low_pass(2, edge_hz, 888.0).is_err()));
    }

    #[test]
    fn robust_a_band_beyond_half_the_rate_is_an_error() {
        for (low_hz, high_hz) in [(4.0, 125.0), (16.0, 4.0), (0.0, 4.0), (f64::NAN, 4.0)] {
            assert!(band_pass(3, low_hz, high_hz, 250.0).is_err());
        }
    }
}
