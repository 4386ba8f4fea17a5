//! Model of a three-axis Hall sensor: from field to counts.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::config::Config;

/// Individual sensor. Gains, offsets and axis directions vary between sensors and are unknown to the estimators.
#[derive(Clone, Debug)]
pub(super) struct HallSensor {
    axes: [Axis; 3],
    /// Limit of the counts: they saturate at `-range` and `range - 1`.
    range: f64,
    gain_drift_per_k: f64,
}

/// Direction (in Base), gain and offset of an axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    direction: Vector3<f64>,
    gain_counts_per_t: f64,
    offset_counts: f64,
    offset_drift_counts_per_k: f64,
}

impl HallSensor {
    /// Individual sensor drawn with this seed.
    pub(super) fn new(config: &Config, seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut normal = |sd: f64| sd * rng.sample::<f64, _>(StandardNormal);
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
            let tilt = Vector3::from_fn(|_, _| normal(config.misalignment_rad));
            Axis {
                direction: (axis + tilt).normalize(),
                gain_counts_per_t: config.gain_counts_per_t * (1.0 + normal(config.gain_spread)),
                offset_counts: normal(config.offset_spread_counts),
                offset_drift_counts_per_k: normal(config.offset_drift_counts_per_k),
            }
        });
        let range = 2_f64.powi(config.bits as i32 - 1);
        Self { axes, range, gain_drift_per_k: config.gain_drift_per_k }
    }

    /// Sensor with an amplified signal.
    pub(super) fn amplified(&self, by: f64) -> Self {
        let axes = self.axes.map(|axis| Axis { gain_counts_per_t: by * axis.gain_counts_per_t, ..axis });
        Self { axes, ..self.clone() }
    }

    /// Counts of one axis, rounded and saturated, for a field, a temperature deviation from calibration and a noise.
    pub(super) fn counts(&self, axis: usize, field_t: Vector3<f64>, temperature_k: f64, noise_counts: f64) -> f64 {
        let Axis { direction, gain_counts_per_t, offset_counts, offset_drift_counts_per_k } = self.axes[axis];
        let signal = gain_counts_per_t * (1.0 + self.gain_drift_per_k * temperature_k) * direction.dot(&field_t);
        let offset = offset_counts + offset_drift_counts_per_k * temperature_k;
        (signal + offset + noise_counts).round().clamp(-self.range, self.range - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ideal(bits: u32) -> HallSensor {
        let config = Config {
            bits,
            gain_spread: 0.0,
            offset_spread_counts: 0.0,
            offset_drift_counts_per_k: 0.0,
            misalignment_rad: 0.0,
            ..Config::default()
        };
        HallSensor::new(&config, 1)
    }

    #[test]
    fn verif_counts_are_rounded_and_saturate() {
        let sensor = ideal(16);
        let counts = |field_t: f64| sensor.counts(1, Vector3::new(0.0, field_t, 0.0), 0.0, 0.0);
        // 2.8e5 counts per tesla.
        assert_eq!(counts(1e-3), 280.0);
        assert_eq!(counts(1.001e-3), 280.0);
        assert_eq!(counts(1.002e-3), 281.0);
        assert_eq!((counts(1.0), counts(-1.0)), (32767.0, -32768.0));
        let coarse = ideal(8);
        assert_eq!(coarse.counts(1, Vector3::new(0.0, 1e-3, 0.0), 0.0, 0.0), 127.0);
        assert_eq!(sensor.amplified(2.0).counts(1, Vector3::new(0.0, 1e-3, 0.0), 0.0, 0.0), 560.0);
    }

    #[test]
    fn verif_gain_depends_on_temperature() {
        let sensor = ideal(16);
        let counts = |temperature_k: f64| sensor.counts(0, Vector3::new(0.01, 0.0, 0.0), temperature_k, 0.0);
        assert_eq!((counts(0.0), counts(10.0)), (2800.0, 2772.0));
    }

    #[test]
    fn verif_the_seed_determines_the_sensor() {
        let field_t = Vector3::new(0.001, 0.002, 0.003);
        let read = |seed| {
            let sensor = HallSensor::new(&Config::default(), seed);
            [0, 1, 2].map(|axis| sensor.counts(axis, field_t, 0.0, 0.0))
        };
        assert_eq!(read(1), read(1));
        assert_ne!(read(1), read(2));
    }
}
