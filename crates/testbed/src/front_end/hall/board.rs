//! Simulated board of an array: magnets, sensors, noise and temperature.

use nalgebra::{Isometry3, Point3, Vector3};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::config::Config;
use super::dipole::Magnet;
use super::noise::{Noise, OrnsteinUhlenbeck};
use super::sensor::HallSensor;
use crate::front_end::mounting::Mounting;
use crate::seeds::derived_seed;

/// Indices of Base's axes in a field vector.
pub(super) const X: usize = 0;
pub(super) const Y: usize = 1;

/// Exact model of an array's sensors and reference on their board. The board's axes are those of the Base of its first
/// whisker.
pub(super) struct Board<'a> {
    pub(super) config: &'a Config,
    pub(super) magnet: Magnet,
    pub(super) whiskers: Vec<Placed>,
    pub(super) reference: HallSensor,
    pub(super) reference_place: Point3<f64>,
}

/// Whisker on a board.
pub(super) struct Placed {
    /// Pose of its Base in the board's frame.
    base: Isometry3<f64>,
    /// Position of its sensor in the board's frame.
    pub(super) place: Point3<f64>,
    pub(super) sensor: HallSensor,
}

/// Simulated readout of a board: states of its noise processes and its temperature.
pub(super) struct BoardReader<'a> {
    board: &'a Board<'a>,
    sensors: Vec<Noise>,
    reference: [Noise; 2],
    temperature: OrnsteinUhlenbeck,
    temperature_rng: Pcg64,
}

/// One readout: y axis of a sensor, x and y axes of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Counts {
    pub(super) own: f64,
    pub(super) reference: [f64; 2],
}

impl Counts {
    /// Counts of the sensor after common-mode compensation.
    pub(super) fn compensated(&self, common_mode: [f64; 2]) -> f64 {
        self.own - common_mode[X] * self.reference[X] - common_mode[Y] * self.reference[Y]
    }
}

impl<'a> Board<'a> {
    pub(super) fn new(config: &'a Config, mounting: &Mounting) -> Self {
        let Mounting { array, board, .. } = mounting;
        let copy = |kind: &str, names: &[&str]| {
            HallSensor::new(config, derived_seed(config.seed, &[&["hall", kind], names].concat()))
        };
        let beside_root = Point3::new(-config.lever_m - config.gap_m, 0.0, 0.0);
        let whiskers: Vec<Placed> = board
            .iter()
            .map(|slot| Placed {
                base: slot.base,
                place: slot.base * beside_root,
                sensor: copy("sensor", &[array, &slot.sensor]),
            })
            .collect();
        let middle = whiskers.iter().map(|whisker| whisker.place.coords).sum::<Vector3<f64>>() / whiskers.len() as f64;
        Self {
            config,
            magnet: Magnet { moment_a_m2: config.magnet_moment_a_m2, lever_m: config.lever_m },
            whiskers,
            reference: copy("reference", &[array]),
            reference_place: Point3::from(middle + Vector3::new(0.0, 0.0, config.reference_distance_m)),
        }
    }

    /// Field of all magnets at a position, in the board's frame, for given rotations of the roots.
    pub(super) fn magnets_t(&self, rotations_rad: &[f64], place: &Point3<f64>) -> Vector3<f64> {
        let of_one = |(whisker, rotation_rad): (&Placed, &f64)| {
            let seen_m = whisker.base.inverse_transform_point(place).coords;
            whisker.base.rotation * self.magnet.field_t(*rotation_rad, seen_m)
        };
        self.whiskers.iter().zip(rotations_rad).map(of_one).sum()
    }

    /// Earth's field in the board's frame.
    pub(super) fn earth_t(&self, yaw_rad: f64) -> Vector3<f64> {
        let (down, level) = self.config.earth_inclination_rad.sin_cos();
        let (sin, cos) = (self.config.north_rad - yaw_rad).sin_cos();
        self.config.earth_t * Vector3::new(level * cos, level * sin, -down)
    }

    /// Heading of the board for a given heading of the whisker in a slot.
    pub(super) fn yaw_rad(&self, slot: usize, whisker_yaw_rad: f64) -> f64 {
        let ahead = self.whiskers[slot].base.rotation * Vector3::x();
        whisker_yaw_rad - ahead.y.atan2(ahead.x)
    }

    /// Starts a readout. Its noise is determined by the seed, the recording and the names of array and sensors.
    pub(super) fn reader(&'a self, mounting: &Mounting, seed: u64) -> BoardReader<'a> {
        let Mounting { array, recording, board, .. } = mounting;
        let seed = |words: &[&str]| derived_seed(seed, &[&["hall"], words, &[recording.as_str()]].concat());
        let noise = |words: &[&str]| Noise::new(self.config.white_counts, self.config.flicker_counts, seed(words));
        let mut temperature_rng = Pcg64::seed_from_u64(seed(&["temperature", array]));
        BoardReader {
            board: self,
            sensors: board.iter().map(|slot| noise(&["sensor", array, &slot.sensor])).collect(),
            reference: ["reference x", "reference y"].map(|kind| noise(&[kind, array])),
            temperature: OrnsteinUhlenbeck::new(
                self.config.temperature_sd_k,
                self.config.temperature_time_s,
                &mut temperature_rng,
            ),
            temperature_rng,
        }
    }
}

impl BoardReader<'_> {
    /// Counts of every whisker after an interval `dt_s`, for given rotations of the roots and heading of the board.
    pub(super) fn read(&mut self, dt_s: f64, rotations_rad: &[f64], yaw_rad: f64) -> Vec<Counts> {
        let board = self.board;
        let temperature_k = self.temperature.step(dt_s, &mut self.temperature_rng);
        let earth_t = board.earth_t(yaw_rad);
        let reference_t = earth_t + board.magnets_t(rotations_rad, &board.reference_place);
        let reference = [X, Y].map(|axis| {
            let noise_counts = self.reference[axis].step(dt_s);
            board.reference.counts(axis, reference_t, temperature_k, noise_counts)
        });
        let of_one = |(whisker, noise): (&Placed, &mut Noise)| {
            let field_t = whisker.base.rotation.inverse() * (earth_t + board.magnets_t(rotations_rad, &whisker.place));
            Counts { own: whisker.sensor.counts(Y, field_t, temperature_k, noise.step(dt_s)), reference }
        };
        board.whiskers.iter().zip(&mut self.sensors).map(of_one).collect()
    }

    /// Repeated readout of one whisker with all roots at rest.
    pub(super) fn rest(&mut self, slot: usize, samples: usize, dt_s: f64, yaw_rad: f64) -> Vec<Counts> {
        let still = vec![0.0; self.board.whiskers.len()];
        (0..samples).map(|_| self.read(dt_s, &still, yaw_rad)[slot]).collect()
    }
}

/// Number of samples in a duration, at least one.
pub(super) fn samples_in(time_s: f64, dt_s: f64) -> usize {
    (time_s / dt_s).round().max(1.0) as usize
}
