//! Noise processes of a Hall sensor: white noise, 1/f noise and temperature drift. Discretised exactly for any sampling
//! interval.

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

/// Highest corner frequency and number of octaves of the 1/f noise: from above any sampling rate of such sensors down
/// to one period per hour.
const FASTEST_HZ: f64 = 128.0;
const OCTAVES: usize = 20;

/// Ornstein-Uhlenbeck process `dx = -x dt / time_s + noise` in its stationary distribution. Its exact discretisation
/// over an interval `dt` is `x <- a x + sqrt(1 - a^2) sd w` with `a = exp(-dt / time_s)` and `w` standard normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct OrnsteinUhlenbeck {
    sd: f64,
    time_s: f64,
    value: f64,
}

impl OrnsteinUhlenbeck {
    pub(super) fn new(sd: f64, time_s: f64, rng: &mut Pcg64) -> Self {
        Self { sd, time_s, value: sd * rng.sample::<f64, _>(StandardNormal) }
    }

    /// Value after an interval.
    pub(super) fn step(&mut self, dt_s: f64, rng: &mut Pcg64) -> f64 {
        let kept = (-dt_s / self.time_s).exp();
        self.value = kept * self.value + (1.0 - kept * kept).sqrt() * self.sd * rng.sample::<f64, _>(StandardNormal);
        self.value
    }
}

/// White and 1/f noise of one axis. The latter is a sum of Ornstein-Uhlenbeck processes of equal variance, one per
/// octave; its one-sided spectrum is `sd^2 / (f ln 2)` between the outermost corner frequencies (van der Ziel 1950).
#[derive(Debug)]
pub(super) struct Noise {
    white_sd: f64,
    octaves: Vec<OrnsteinUhlenbeck>,
    rng: Pcg64,
}

impl Noise {
    /// Noise with these standard deviations of the white noise per sample and of each octave of the 1/f noise.
    pub(super) fn new(white_sd: f64, octave_sd: f64, seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let time_s = |octave: i32| 2_f64.powi(octave) / (std::f64::consts::TAU * FASTEST_HZ);
        let octaves =
            (0..OCTAVES as i32).map(|octave| OrnsteinUhlenbeck::new(octave_sd, time_s(octave), &mut rng)).collect();
        Self { white_sd, octaves, rng }
    }

    /// Noise of the next sample, after an interval `dt_s`.
    pub(super) fn step(&mut self, dt_s: f64) -> f64 {
        let slow: f64 = self.octaves.iter_mut().map(|octave| octave.step(dt_s, &mut self.rng)).sum();
        slow + self.white_sd * self.rng.sample::<f64, _>(StandardNormal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const RATE_HZ: f64 = 250.0;

    /// One-sided spectral density at a frequency, averaged over Hann windows of `window` samples.
    fn density(series: &[f64], window: usize, frequency_hz: f64) -> f64 {
        let hann = |i: usize| 0.5 - 0.5 * (TAU * i as f64 / window as f64).cos();
        let power: f64 = (0..window).map(|i| hann(i).powi(2)).sum();
        let of_window = |samples: &[f64]| {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, value) in samples.iter().enumerate() {
                let (sin, cos) = (TAU * frequency_hz * i as f64 / RATE_HZ).sin_cos();
                re += hann(i) * value * cos;
                im += hann(i) * value * sin;
            }
            2.0 * (re * re + im * im) / (RATE_HZ * power)
        };
        let windows: Vec<f64> = series.chunks_exact(window).map(of_window).collect();
        windows.iter().sum::<f64>() / windows.len() as f64
    }

    #[test]
    fn val_spectrum_falls_as_one_over_f() {
        let mut noise = Noise::new(0.0, 0.1, 7);
        let series: Vec<f64> = (0..1_000_000).map(|_| noise.step(1.0 / RATE_HZ)).collect();
        let mut points = Vec::new();
        for frequency_hz in [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
            let window = (32.0 / frequency_hz * RATE_HZ) as usize;
            let found = density(&series, window, frequency_hz);
            let expected = 0.01 / (frequency_hz * std::f64::consts::LN_2);
            assert!((found / expected - 1.0).abs() < 0.4, "{frequency_hz} Hz: {found} for {expected}");
            points.push((frequency_hz.ln(), found.ln()));
        }
        let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
            / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        assert!((slope + 1.0).abs() < 0.1, "slope {slope}");
    }

    #[test]
    fn verif_the_variance_is_independent_of_the_interval() {
        let variance = |dt_s: f64| {
            let mut noise = Noise::new(0.0, 1.0, 3);
            let series: Vec<f64> = (0..200_000).map(|_| noise.octaves[5].step(dt_s, &mut noise.rng)).collect();
            series.iter().map(|value| value * value).sum::<f64>() / series.len() as f64
        };
        for dt_s in [0.001, 0.02, 1.0] {
            assert!((variance(dt_s) - 1.0).abs() < 0.1, "{dt_s} s: {}", variance(dt_s));
        }
    }
}
