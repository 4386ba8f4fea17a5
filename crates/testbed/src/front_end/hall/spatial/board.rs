//! Simulated board of one whisker in space: magnet, sensor, reference, noise and temperature.

use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use trace::SpatialInstant;

use crate::front_end::hall::config::Config;
use crate::front_end::hall::dipole::Magnet;
use crate::front_end::hall::noise::{Noise, OrnsteinUhlenbeck};
use crate::front_end::hall::sensor::HallSensor;
use crate::seeds::derived_seed;

/// Exact model of a whisker's sensor and reference, in Base. The individual sensors are those of the planar front end
/// for the same whisker.
pub(super) struct Board<'a> {
    config: &'a Config,
    name: &'a str,
    magnet: Magnet,
    sensor: HallSensor,
    /// Position of the sensor.
    place_m: Vector3<f64>,
    reference: HallSensor,
    /// Position of the reference.
    reference_place_m: Vector3<f64>,
}

/// Simulated readout of a board: states of its noise processes and its temperature.
pub(super) struct BoardReader<'a> {
    board: &'a Board<'a>,
    own: [Noise; 3],
    reference: [Noise; 3],
    temperature: OrnsteinUhlenbeck,
    temperature_rng: Pcg64,
}

/// One readout of the three axes of sensor and reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Counts {
    pub(super) own: Vector3<f64>,
    pub(super) reference: Vector3<f64>,
}

impl Counts {
    /// Counts of the sensor after common-mode compensation.
    pub(super) fn compensated(&self, common_mode: &Matrix3<f64>) -> Vector3<f64> {
        self.own - common_mode * self.reference
    }
}

impl<'a> Board<'a> {
    pub(super) fn new(config: &'a Config, name: &'a str) -> Self {
        let copy = |words: &[&str]| HallSensor::new(config, derived_seed(config.seed, words));
        let place_m = Vector3::new(-config.lever_m - config.gap_m, 0.0, 0.0);
        Self {
            config,
            name,
            magnet: Magnet { moment_a_m2: config.magnet_moment_a_m2, lever_m: config.lever_m },
            sensor: copy(&["hall", "sensor", name, name]),
            place_m,
            reference: copy(&["hall", "reference", name]),
            reference_place_m: place_m + Vector3::new(0.0, 0.0, config.reference_distance_m),
        }
    }

    /// Earth's field in Base.
    pub(super) fn earth_t(&self, base: &Rotation3<f64>) -> Vector3<f64> {
        let (down, level) = self.config.earth_inclination_rad.sin_cos();
        let (sin, cos) = self.config.north_rad.sin_cos();
        base.inverse() * (self.config.earth_t * Vector3::new(level * cos, level * sin, -down))
    }

    /// Field at the sensor, in Base.
    pub(super) fn field_t(&self, direction: Vector3<f64>, base: &Rotation3<f64>) -> Vector3<f64> {
        self.earth_t(base) + self.magnet.field_along_t(direction, self.place_m)
    }

    /// Starts a readout. Its noise is determined by the seed, the recording and the name of the sensor.
    pub(super) fn reader(&'a self, recording: &str, seed: u64) -> BoardReader<'a> {
        let seed = |kind: &str| derived_seed(seed, &["hall in space", kind, self.name, recording]);
        let noise = |kind: &str| Noise::new(self.config.white_counts, self.config.flicker_counts, seed(kind));
        let mut temperature_rng = Pcg64::seed_from_u64(seed("temperature"));
        let (sd_k, time_s) = (self.config.temperature_sd_k, self.config.temperature_time_s);
        BoardReader {
            board: self,
            own: ["x", "y", "z"].map(noise),
            reference: ["reference x", "reference y", "reference z"].map(noise),
            temperature: OrnsteinUhlenbeck::new(sd_k, time_s, &mut temperature_rng),
            temperature_rng,
        }
    }
}

impl BoardReader<'_> {
    /// Counts after an interval `dt_s`, for a direction of the root in Base and a rotation of the base.
    pub(super) fn read(&mut self, dt_s: f64, direction: Vector3<f64>, base: &Rotation3<f64>) -> Counts {
        let board = self.board;
        let temperature_k = self.temperature.step(dt_s, &mut self.temperature_rng);
        let field_t = board.field_t(direction, base);
        let reference_t = board.earth_t(base) + board.magnet.field_along_t(direction, board.reference_place_m);
        let counts = |sensor: &HallSensor, field_t: Vector3<f64>, noise: &mut [Noise; 3]| {
            Vector3::from_fn(|axis, _| sensor.counts(axis, field_t, temperature_k, noise[axis].step(dt_s)))
        };
        Counts {
            own: counts(&board.sensor, field_t, &mut self.own),
            reference: counts(&board.reference, reference_t, &mut self.reference),
        }
    }

    /// Repeated readout with the whisker free.
    pub(super) fn rest(&mut self, samples: usize, dt_s: f64, base: &Rotation3<f64>) -> Vec<Counts> {
        (0..samples).map(|_| self.read(dt_s, Vector3::x(), base)).collect()
    }
}

/// Rotation from Base to World.
pub(super) fn rotation_of(instant: &SpatialInstant) -> Rotation3<f64> {
    instant.base.rotation.to_rotation_matrix()
}
