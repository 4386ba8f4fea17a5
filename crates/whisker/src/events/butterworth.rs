//! Butterworth band-pass filters of any order, as second-order sections.
//!
//! The design goes from the analogue low-pass prototype, whose poles lie evenly on the left half of the unit circle, over the band-pass with
//! pre-warped edges to the digital filter by the bilinear transform (Oppenheim and Schafer, *Discrete-Time Signal Processing*, 2010,
//! chapter 7). Poles and zeros are put into sections as SciPy's `zpk2sos` puts them: the poles nearest to the unit circle get the zeros nearest to
//! them and come last, which keeps the values between the sections small; so the sections can be compared one by one with
//! `scipy.signal.butter(order, [low, high], "bandpass", output="sos")`.

use std::f64::consts::PI;

use nalgebra::Complex;

use super::cascade::Section;

/// A pole whose imaginary part is smaller than this share of it is real.
const REAL: f64 = 100.0 * f64::EPSILON;

/// The band does not fit the sampling rate.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("band of {low_hz} to {high_hz} Hz: expected 0 < low < high < {}, half the sampling rate", 0.5 * .rate_hz)]
pub struct NoSuchBand {
    low_hz: f64,
    high_hz: f64,
    rate_hz: f64,
}

/// The band-pass between two frequencies that a low-pass prototype of `order` turns into: `order` sections, hence a filter of twice that order.
///
/// # Errors
/// [`NoSuchBand`] where the edges are not in order between zero and half the sampling rate.
pub fn band_pass(order: usize, low_hz: f64, high_hz: f64, rate_hz: f64) -> Result<Vec<Section>, NoSuchBand> {
    if !(0.0 < low_hz && low_hz < high_hz && 2.0 * high_hz < rate_hz) {
        return Err(NoSuchBand { low_hz, high_hz, rate_hz });
    }
    // Time is counted in half samples, for which the bilinear transform is z = (4 + s) / (4 - s).
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
    // Half the analogue zeros lie at zero, and so at one in z; the others at infinity, and so at minus one.
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
        // One of a pair of complex poles stands for both; real ones come in pairs too.
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

/// Takes out the first of the values for which `measure` is smallest.
fn take_smallest<T: Copy>(values: &mut Vec<T>, measure: impl Fn(&T) -> f64) -> Option<T> {
    let place = (0..values.len()).min_by(|&a, &b| measure(&values[a]).total_cmp(&measure(&values[b])))?;
    Some(values.remove(place))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::cascade::Cascade;

    #[test]
    fn val_the_edges_of_the_band_pass_half_the_power() {
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
    fn robust_a_band_beyond_half_the_rate_is_an_error() {
        for (low_hz, high_hz) in [(4.0, 125.0), (16.0, 4.0), (0.0, 4.0), (f64::NAN, 4.0)] {
            assert!(band_pass(3, low_hz, high_hz, 250.0).is_err());
        }
    }
}
