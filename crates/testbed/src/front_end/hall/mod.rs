//! A magnet at the root of the whisker over a Hall sensor with three axes, as in Lin et al. 2022, and on the same board a reference sensor that the
//! whiskers of an array share.
//!
//! ```text
//! moment -> rotation of the root -> field of the magnet + the earth's -> counts -> common mode taken out -> zeroed -> reading
//! ```
//!
//! The magnet sits behind the root and turns and swings with it (`dipole`). The sensor lies behind the magnet, at `-x` of Base, and its y axis is the
//! one that is read. The reference lies beside it, out of the plane, where of the magnet there is but a weak residue: what it reads is the
//! earth's field. It sees still less of the magnets of other whiskers, which are left out.
//!
//! Whoever uses the sensor knows what can be measured with it. Standing at a ring of headings, the whisker free, they learn how much of the reference's
//! counts appears in the sensor's (`common_mode`); from the calibration traces, by least squares, the [`Characteristic`] that turns counts into
//! moments; and from some recordings at rest the noise of the readings. Before each recording the reading is zeroed, the whisker free.

mod common_mode;
mod dipole;
mod noise;
mod sensor;
mod turn;

use anyhow::Context;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use trace::{Characteristic, Instant, SensorFile};
use whisker::estimators::{Settings, SettingsError, parse, within};

use super::{Chain, Mounting, Occasion, Played, Reader, derived_seed};
use crate::results::{TransferRow, csv_bytes};
use crate::statistics::rms;
use dipole::Magnet;
use noise::{Forgetting, Noise};
use sensor::HallSensor;

pub use turn::shift_counts;

/// Degree of the characteristic: what a dipole at this distance leaves of a lower one lies above the noise.
const DEGREE: usize = 5;

/// Recordings at rest, and their length, from which the noise is learnt: that of a trial, for slow noise grows with time.
const RESTS: usize = 20;
const REST_S: f64 = 10.0;

/// Axes of Base by their place in a field.
const X: usize = 0;
const Y: usize = 1;

/// Settings of the chain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Which copies of the sensors: another seed, other copies.
    pub seed: u64,
    /// Moment of the magnet: 6.5e-3 is that of a neodymium cylinder 2 mm wide and 1.8 mm high.
    pub magnet_moment_a_m2: f64,
    /// From the axis about which the root turns to the magnet.
    pub lever_m: f64,
    /// From the resting magnet to the sensor.
    pub gap_m: f64,
    /// From the sensor to the reference sensor, out of the plane.
    pub reference_distance_m: f64,
    /// Gain of every axis.
    pub gain_counts_per_t: f64,
    /// Standard deviation of the gain from axis to axis, relative.
    pub gain_spread: f64,
    /// Standard deviation of the counts without field, from axis to axis.
    pub offset_spread_counts: f64,
    /// Standard deviation of the tilt of an axis about each of the two others.
    pub misalignment_rad: f64,
    /// Bits of the counts, one of them the sign's; beyond, they saturate.
    pub bits: u32,
    /// Standard deviation of the white noise of an axis, in each sample.
    pub white_counts: f64,
    /// Standard deviation that each octave of the 1/f noise of an axis has: one-sided spectrum `flicker_counts^2 / (f ln 2)`.
    pub flicker_counts: f64,
    /// Standard deviation of the temperature of a board over long times.
    pub temperature_sd_k: f64,
    /// Time in which it forgets.
    pub temperature_time_s: f64,
    /// Change of the gain with temperature, relative: that of the magnet is in it.
    pub gain_drift_per_k: f64,
    /// Standard deviation, from axis to axis, of the change with temperature of the counts without field.
    pub offset_drift_counts_per_k: f64,
    /// Strength of the earth's field.
    pub earth_t: f64,
    /// How steeply it dips below the plane.
    pub earth_inclination_rad: f64,
    /// Direction of magnetic north in World.
    pub north_rad: f64,
    /// Whether the common mode is taken out.
    pub compensated: bool,
    /// How long the resting sensor is read before a recording, for the mean that counts as zero.
    pub zeroing_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            magnet_moment_a_m2: 6.5e-3,
            lever_m: 0.5e-3,
            gap_m: 4e-3,
            reference_distance_m: 20e-3,
            gain_counts_per_t: 2.8e5,
            gain_spread: 0.03,
            offset_spread_counts: 20.0,
            misalignment_rad: 0.01,
            bits: 16,
            white_counts: 1.1,
            flicker_counts: 0.05,
            temperature_sd_k: 1.0,
            temperature_time_s: 600.0,
            gain_drift_per_k: -1e-3,
            offset_drift_counts_per_k: 0.3,
            earth_t: 48e-6,
            earth_inclination_rad: 1.065,
            north_rad: std::f64::consts::FRAC_PI_2,
            compensated: true,
            zeroing_s: 1.0,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("magnet_moment_a_m2", self.magnet_moment_a_m2, 1e-6..=1.0)?;
        within("lever_m", self.lever_m, 0.0..=0.1)?;
        within("gap_m", self.gap_m, 1e-4..=0.1)?;
        within("reference_distance_m", self.reference_distance_m, 1e-3..=1.0)?;
        within("gain_counts_per_t", self.gain_counts_per_t, 1.0..=1e12)?;
        within("gain_spread", self.gain_spread, 0.0..=0.2)?;
        within("offset_spread_counts", self.offset_spread_counts, 0.0..=1e6)?;
        within("misalignment_rad", self.misalignment_rad, 0.0..=0.2)?;
        within("bits", f64::from(self.bits), 2.0..=32.0)?;
        within("white_counts", self.white_counts, 0.0..=1e6)?;
        within("flicker_counts", self.flicker_counts, 0.0..=1e6)?;
        within("temperature_sd_k", self.temperature_sd_k, 0.0..=100.0)?;
        within("temperature_time_s", self.temperature_time_s, 1.0..=1e6)?;
        within("gain_drift_per_k", self.gain_drift_per_k, -0.01..=0.01)?;
        within("offset_drift_counts_per_k", self.offset_drift_counts_per_k, 0.0..=1e6)?;
        within("earth_t", self.earth_t, 0.0..=1e-3)?;
        let quarter = std::f64::consts::FRAC_PI_2;
        within("earth_inclination_rad", self.earth_inclination_rad, -quarter..=quarter)?;
        within("north_rad", self.north_rad, -4.0 * quarter..=4.0 * quarter)?;
        within("zeroing_s", self.zeroing_s, 0.01..=60.0)
    }
}

pub(super) fn defaults() -> Value {
    json!(Config::default())
}

pub(super) fn build(config: &Value) -> anyhow::Result<Box<dyn Chain>> {
    Ok(Box::new(Hall { config: parse(config)? }))
}

/// The chain.
#[derive(Debug)]
struct Hall {
    config: Config,
}

/// A sensor and its reference on their board, as they truly are.
#[derive(Clone)]
struct Board<'a> {
    config: &'a Config,
    magnet: Magnet,
    own: HallSensor,
    reference: HallSensor,
}

/// A board while it is being read: what its noise and its temperature have come to.
struct Watch<'a> {
    board: Board<'a>,
    own: Noise,
    reference: [Noise; 2],
    warmer: Forgetting,
    weather: Pcg64,
}

/// One reading: the sensor's y axis, and x and y of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Counts {
    own: f64,
    reference: [f64; 2],
}

impl Counts {
    /// Those of the sensor, with the common mode taken out.
    fn compensated(&self, common_mode: [f64; 2]) -> f64 {
        self.own - common_mode[X] * self.reference[X] - common_mode[Y] * self.reference[Y]
    }
}

impl<'a> Board<'a> {
    fn new(config: &'a Config, mounting: &Mounting) -> Self {
        let copy = |kind: &str, name: &str| HallSensor::new(config, derived_seed(config.seed, &["hall", kind, name]));
        Self {
            config,
            magnet: Magnet { moment_a_m2: config.magnet_moment_a_m2, lever_m: config.lever_m },
            own: copy("sensor", &mounting.sensor),
            reference: copy("reference", &mounting.array),
        }
    }

    /// Field of the magnet at a distance out of the plane from the sensor, in Base.
    fn magnet_t(&self, rotation_rad: f64, distance_m: f64) -> Vector3<f64> {
        self.magnet.field_t(rotation_rad, Vector3::new(-self.config.lever_m - self.config.gap_m, 0.0, distance_m))
    }

    /// The earth's field in Base.
    fn earth_t(&self, yaw_rad: f64) -> Vector3<f64> {
        let (down, level) = self.config.earth_inclination_rad.sin_cos();
        let (sin, cos) = (self.config.north_rad - yaw_rad).sin_cos();
        self.config.earth_t * Vector3::new(level * cos, level * sin, -down)
    }

    /// Begins to read it on an occasion: the same words, the same noise.
    fn watch(&self, mounting: &Mounting, seed: u64) -> Watch<'a> {
        let Mounting { sensor, array, recording } = mounting;
        let seed = |kind: &str, name: &str| derived_seed(seed, &["hall", kind, name, recording]);
        let noise = |seed| Noise::new(self.config.white_counts, self.config.flicker_counts, seed);
        let mut weather = Pcg64::seed_from_u64(seed("temperature", array));
        Watch {
            board: self.clone(),
            own: noise(seed("sensor", sensor)),
            reference: ["reference x", "reference y"].map(|kind| noise(seed(kind, array))),
            warmer: Forgetting::new(self.config.temperature_sd_k, self.config.temperature_time_s, &mut weather),
            weather,
        }
    }
}

impl Watch<'_> {
    /// The counts so long after the last, with the root turned and the base at a heading.
    fn read(&mut self, dt_s: f64, rotation_rad: f64, yaw_rad: f64) -> Counts {
        let board = &self.board;
        let warmer_k = self.warmer.step(dt_s, &mut self.weather);
        let earth_t = board.earth_t(yaw_rad);
        let own_t = earth_t + board.magnet_t(rotation_rad, 0.0);
        let reference_t = earth_t + board.magnet_t(rotation_rad, board.config.reference_distance_m);
        Counts {
            own: board.own.counts(Y, own_t, warmer_k, self.own.step(dt_s)),
            reference: [X, Y].map(|axis| {
                let noise_counts = self.reference[axis].step(dt_s);
                board.reference.counts(axis, reference_t, warmer_k, noise_counts)
            }),
        }
    }

    /// Reads so often at rest.
    fn rest(&mut self, samples: usize, dt_s: f64, yaw_rad: f64) -> Vec<Counts> {
        (0..samples).map(|_| self.read(dt_s, 0.0, yaw_rad)).collect()
    }

    /// The compensated counts of the next while at rest, which count as zero.
    fn zero_counts(&mut self, common_mode: [f64; 2], dt_s: f64, yaw_rad: f64) -> f64 {
        let samples = samples_in(self.board.config.zeroing_s, dt_s);
        let rest = self.rest(samples, dt_s, yaw_rad);
        rest.iter().map(|counts| counts.compensated(common_mode)).sum::<f64>() / samples as f64
    }
}

/// Samples in a time, at least one.
fn samples_in(time_s: f64, dt_s: f64) -> usize {
    (time_s / dt_s).round().max(1.0) as usize
}

impl Hall {
    /// Counts of a recording, the common mode taken out, from zero.
    fn counts(&self, played: &Played, common_mode: [f64; 2]) -> Vec<f64> {
        played.recording.instants.iter().map(self.counter(&played.on, common_mode)).collect()
    }

    /// Counts the instants of a recording one by one, the common mode taken out, from the zero that is found before the first.
    fn counter<'a>(&'a self, on: &Occasion<'a>, common_mode: [f64; 2]) -> impl FnMut(&Instant) -> f64 + use<'a> {
        let mut watch = Board::new(&self.config, on.mounting).watch(on.mounting, on.seed);
        let mut noise_n_m = on.noise();
        let stiffness_n_m_rad = on.sidecar.whisker.root_stiffness_n_m_rad;
        let rest_dt_s = 1.0 / on.sidecar.rate_hz;
        let mut begun: Option<(f64, f64)> = None;
        move |instant| {
            let yaw_rad = instant.base.yaw_rad();
            let (last_s, zero) =
                begun.unwrap_or_else(|| (instant.t_s - rest_dt_s, watch.zero_counts(common_mode, rest_dt_s, yaw_rad)));
            begun = Some((instant.t_s, zero));
            let rotation_rad = instant.rotation_z_rad.unwrap_or(instant.moment_z_n_m / stiffness_n_m_rad);
            let turned_rad = rotation_rad + noise_n_m() / stiffness_n_m_rad;
            let counts = watch.read(instant.t_s - last_s, turned_rad, yaw_rad);
            counts.compensated(common_mode) - zero
        }
    }

    /// Root mean square of the readings of some recordings at rest.
    fn rest_sd_n_m(
        &self,
        mounting: &Mounting,
        seed: u64,
        dt_s: f64,
        common_mode: [f64; 2],
        characteristic: &Characteristic,
    ) -> f64 {
        let board = Board::new(&self.config, mounting);
        let mut readings_n_m = Vec::new();
        for rest in 0..RESTS {
            let mounting = Mounting { recording: format!("rest {rest}"), ..mounting.clone() };
            let mut watch = board.watch(&mounting, seed);
            let zero = watch.zero_counts(common_mode, dt_s, 0.0);
            let read = watch.rest(samples_in(REST_S, dt_s), dt_s, 0.0);
            let reading = |counts: &Counts| characteristic.moment_n_m(counts.compensated(common_mode) - zero);
            readings_n_m.extend(read.iter().map(reading));
        }
        rms(&readings_n_m).unwrap_or(0.0)
    }
}

impl Chain for Hall {
    fn has_sensor(&self) -> bool {
        true
    }

    fn calibrate(&self, mounting: &Mounting, recordings: &[Played]) -> anyhow::Result<Option<SensorFile>> {
        let first = recordings.first().context("no recording to calibrate on")?;
        let dt_s = 1.0 / first.on.sidecar.rate_hz;
        let common_mode = match self.config.compensated {
            true => common_mode::learn(&Board::new(&self.config, mounting), mounting, first.on.seed, dt_s),
            false => [0.0; 2],
        };
        let mut pairs = Vec::new();
        for played in recordings {
            let mounting = Mounting { recording: played.on.mounting.recording.clone(), ..mounting.clone() };
            let on = Occasion { mounting: &mounting, ..played.on };
            let counts = self.counts(&Played { on, ..*played }, common_mode);
            let moments = played.recording.instants.iter().map(|instant| instant.moment_z_n_m);
            pairs.extend(moments.zip(counts));
        }
        let characteristic = Characteristic::fit(DEGREE, &pairs).with_context(|| {
            format!(
                "sensor `{}`: its counts saturate or turn back within the calibration and do not tell moments",
                mounting.sensor
            )
        })?;
        let noise_sd_n_m = self.rest_sd_n_m(mounting, first.on.seed, dt_s, common_mode, &characteristic);
        Ok(Some(SensorFile {
            name: mounting.sensor.clone(),
            array: mounting.array.clone(),
            common_mode,
            characteristic,
            noise_sd_n_m,
        }))
    }

    fn reader<'a>(&'a self, on: &Occasion<'a>, sensor: Option<&'a SensorFile>) -> anyhow::Result<Reader<'a>> {
        let sensor = sensor.context("a Hall sensor reads counts: it must be calibrated")?;
        let mut counts = self.counter(on, sensor.common_mode);
        Ok(Box::new(move |instant| sensor.characteristic.moment_n_m(counts(instant))))
    }

    fn tables(&self) -> &'static [&'static str] {
        &["turn", "transfer"]
    }

    fn table_bytes(&self, sensor: &SensorFile) -> anyhow::Result<Vec<Vec<u8>>> {
        let mounting = Mounting { sensor: sensor.name.clone(), array: sensor.array.clone(), recording: "turn".into() };
        let board = Board::new(&self.config, &mounting);
        Ok(vec![csv_bytes(&turn::rows(&board, &mounting, sensor))?, csv_bytes(&transfer(&board))?])
    }
}

/// Counts over the rotation of the root, without noise and without the earth's field, as the sensor is and behind an amplifier.
fn transfer(board: &Board) -> Vec<TransferRow> {
    const AMPLIFIED: [f64; 4] = [1.0, 16.0, 32.0, 64.0];
    const MOST_DEGREES: i32 = 40;
    let mut rows = Vec::new();
    for amplified in AMPLIFIED {
        let sensor = board.own.amplified(amplified);
        for half_degrees in -2 * MOST_DEGREES..=2 * MOST_DEGREES {
            let rotation_rad = (0.5 * f64::from(half_degrees)).to_radians();
            let field_t = board.magnet_t(rotation_rad, 0.0);
            let [x_counts, y_counts, z_counts] = [0, 1, 2].map(|axis| sensor.counts(axis, field_t, 0.0, 0.0));
            rows.push(TransferRow { amplified, rotation_rad, x_counts, y_counts, z_counts });
        }
    }
    rows
}

#[cfg(test)]
mod tests;
