//! A magnet at the root of the whisker over a Hall sensor with three axes, as in Lin et al. 2022, and on the same board a reference sensor that the
//! whiskers of an array share.
//!
//! ```text
//! moment -> rotation of the root -> field of the magnet + the earth's -> counts -> common mode taken out -> zeroed -> reading
//! ```
//!
//! The magnet sits behind the root and turns and swings with it (`dipole`). The sensor lies behind the magnet, at `-x` of Base, and its y axis is the
//! one that is read. The reference lies beside the middle of the board's sensors, out of the plane, where of the magnets there is but a weak residue: what it reads is the
//! earth's field. Every sensor sees the magnets of all whiskers of its board; those of other boards are left out.
//!
//! Whoever uses the sensor knows what can be measured with it. Standing at a ring of headings, the whiskers free, they learn how much of the reference's
//! counts appears in the sensor's (`common_mode`); while each whisker of the board in turn is swept as in the calibration traces and the others are free, by least squares, the
//! [`Characteristic`] that turns counts into moments and the [`CrossTalk`] of the others; and from some recordings at rest the noise of the counts, and by how much they are off throughout one. Before each recording the reading is
//! zeroed, the whiskers free.

mod common_mode;
mod dipole;
mod noise;
mod sensor;
mod turn;

use anyhow::Context;
use nalgebra::{Isometry3, Point3, Vector3};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use trace::{Characteristic, CrossTalk, Instant, SensorFile, through_zero};
use whisker::estimators::{Settings, SettingsError, parse, within};

use super::{Chain, Mounting, Played};
use crate::results::{TransferRow, csv_bytes};
use crate::seeds::derived_seed;
use crate::statistics::{mean, rms};
use dipole::Magnet;
use noise::{Forgetting, Noise};
use sensor::HallSensor;

pub use turn::shift_counts;

/// Degree of the characteristic: what a dipole at this distance leaves of a lower one lies above the noise.
const DEGREE: usize = 5;

/// Degree of the cross-talk: of a distant dipole that turns, the sine and, by its square, the cosine.
const CROSS_TALK_DEGREE: usize = 2;

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
    /// From the middle of the board's sensors to the reference sensor, out of the plane.
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

/// The sensors of an array and their reference on their board, as they truly are. Its axes are those of the Base of its first whisker.
struct Board<'a> {
    config: &'a Config,
    magnet: Magnet,
    whiskers: Vec<Placed>,
    reference: HallSensor,
    reference_place: Point3<f64>,
}

/// A whisker on a board.
struct Placed {
    /// Pose of its Base on the board.
    base: Isometry3<f64>,
    /// Place of its sensor on the board.
    place: Point3<f64>,
    sensor: HallSensor,
}

/// A board while it is being read: what its noise and its temperature have come to.
struct Watch<'a> {
    board: &'a Board<'a>,
    sensors: Vec<Noise>,
    reference: [Noise; 2],
    temperature: Forgetting,
    temperature_rng: Pcg64,
}

/// One reading: a sensor's y axis, and x and y of the reference.
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
        let Mounting { array, board, .. } = mounting;
        let copy = |kind: &str, names: &[&str]| {
            HallSensor::new(config, derived_seed(config.seed, &[&["hall", kind], names].concat()))
        };
        let beside_root = Point3::new(-config.lever_m - config.gap_m, 0.0, 0.0);
        let whiskers: Vec<Placed> = board
            .iter()
            .map(|seat| Placed {
                base: seat.base,
                place: seat.base * beside_root,
                sensor: copy("sensor", &[array, &seat.sensor]),
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

    /// Field of all magnets at a place, on the board, with their roots turned.
    fn magnets_t(&self, rotations_rad: &[f64], place: &Point3<f64>) -> Vector3<f64> {
        let of_one = |(whisker, rotation_rad): (&Placed, &f64)| {
            let seen_m = whisker.base.inverse_transform_point(place).coords;
            whisker.base.rotation * self.magnet.field_t(*rotation_rad, seen_m)
        };
        self.whiskers.iter().zip(rotations_rad).map(of_one).sum()
    }

    /// The earth's field, on the board.
    fn earth_t(&self, yaw_rad: f64) -> Vector3<f64> {
        let (down, level) = self.config.earth_inclination_rad.sin_cos();
        let (sin, cos) = (self.config.north_rad - yaw_rad).sin_cos();
        self.config.earth_t * Vector3::new(level * cos, level * sin, -down)
    }

    /// Heading of the board where a whisker has this one.
    fn yaw_rad(&self, seat: usize, whisker_yaw_rad: f64) -> f64 {
        let ahead = self.whiskers[seat].base.rotation * Vector3::x();
        whisker_yaw_rad - ahead.y.atan2(ahead.x)
    }

    /// Begins to read it on an occasion: the same words, the same noise.
    fn watch(&'a self, mounting: &Mounting, seed: u64) -> Watch<'a> {
        let Mounting { array, recording, board, .. } = mounting;
        let seed = |words: &[&str]| derived_seed(seed, &[&["hall"], words, &[recording.as_str()]].concat());
        let noise = |words: &[&str]| Noise::new(self.config.white_counts, self.config.flicker_counts, seed(words));
        let mut temperature_rng = Pcg64::seed_from_u64(seed(&["temperature", array]));
        Watch {
            board: self,
            sensors: board.iter().map(|seat| noise(&["sensor", array, &seat.sensor])).collect(),
            reference: ["reference x", "reference y"].map(|kind| noise(&[kind, array])),
            temperature: Forgetting::new(
                self.config.temperature_sd_k,
                self.config.temperature_time_s,
                &mut temperature_rng,
            ),
            temperature_rng,
        }
    }
}

impl Watch<'_> {
    /// The counts of every whisker so long after the last, with the roots turned and the board at a heading.
    fn read(&mut self, dt_s: f64, rotations_rad: &[f64], yaw_rad: f64) -> Vec<Counts> {
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

    /// Reads one whisker so often, all at rest.
    fn rest(&mut self, seat: usize, samples: usize, dt_s: f64, yaw_rad: f64) -> Vec<Counts> {
        let still = vec![0.0; self.board.whiskers.len()];
        (0..samples).map(|_| self.read(dt_s, &still, yaw_rad)[seat]).collect()
    }
}

/// Samples in a time, at least one.
fn samples_in(time_s: f64, dt_s: f64) -> usize {
    (time_s / dt_s).round().max(1.0) as usize
}

impl Played<'_> {
    /// Rotation of the root, one an instant.
    fn rotations_rad(&self) -> Vec<f64> {
        let stiffness_n_m_rad = self.sidecar.whisker.root_stiffness_n_m_rad;
        let instants = self.recording.instants.iter().zip(self.noise_n_m());
        let rotation_rad = |(instant, noise_n_m): (&Instant, f64)| {
            let rotation_rad = instant.rotation_z_rad.unwrap_or(instant.moment_z_n_m / stiffness_n_m_rad);
            rotation_rad + noise_n_m / stiffness_n_m_rad
        };
        instants.map(rotation_rad).collect()
    }

    /// What calibration taught of its sensor.
    fn learnt(&self) -> anyhow::Result<&SensorFile> {
        self.sensor.context("a Hall sensor reads counts: it must be calibrated")
    }

    /// Place of its whisker on the board.
    fn seat(&self) -> usize {
        self.mounting.seat(&self.mounting.sensor).expect("a whisker sits on its own board")
    }
}

impl Hall {
    /// Counts of one whisker of a recording, the common mode taken out, from zero. `rotations_rad` has those of the board's roots, for each whisker one an instant; none where it
    /// rests throughout.
    fn counts(&self, played: &Played, rotations_rad: &[Vec<f64>], seat: usize, common_mode: [f64; 2]) -> Vec<f64> {
        let board = Board::new(&self.config, played.mounting);
        let mut watch = board.watch(played.mounting, played.seed);
        let instants = &played.recording.instants;
        let Some(first) = instants.first() else { return Vec::new() };
        let yaw_rad = |instant: &Instant| board.yaw_rad(played.seat(), instant.base.yaw_rad());
        let rest_dt_s = 1.0 / played.sidecar.rate_hz;
        let zero = self.zero_counts(&mut watch, seat, common_mode, rest_dt_s, yaw_rad(first));
        let mut last_s = first.t_s - rest_dt_s;
        let read = instants.iter().enumerate().map(|(row, instant)| {
            let now_rad: Vec<f64> =
                rotations_rad.iter().map(|of_one| of_one.get(row).copied().unwrap_or(0.0)).collect();
            let counts = watch.read(instant.t_s - last_s, &now_rad, yaw_rad(instant))[seat];
            last_s = instant.t_s;
            counts.compensated(common_mode) - zero
        });
        read.collect()
    }

    /// The compensated counts of the next while at rest, which count as zero.
    fn zero_counts(&self, watch: &mut Watch, seat: usize, common_mode: [f64; 2], dt_s: f64, yaw_rad: f64) -> f64 {
        let samples = samples_in(self.config.zeroing_s, dt_s);
        let rest = watch.rest(seat, samples, dt_s, yaw_rad);
        rest.iter().map(|counts| counts.compensated(common_mode)).sum::<f64>() / samples as f64
    }

    /// Root mean squares of the counts of some recordings at rest, from zero: of what changes within one, and of the mean of one.
    fn rest_sd_counts(
        &self,
        mounting: &Mounting,
        seat: usize,
        seed: u64,
        dt_s: f64,
        common_mode: [f64; 2],
    ) -> (f64, f64) {
        let board = Board::new(&self.config, mounting);
        let (mut changing, mut staying) = (Vec::new(), Vec::new());
        for rest in 0..RESTS {
            let mut watch = board.watch(&mounting.on(&format!("rest {rest}")), seed);
            let zero = self.zero_counts(&mut watch, seat, common_mode, dt_s, 0.0);
            let still = watch.rest(seat, samples_in(REST_S, dt_s), dt_s, 0.0);
            let counts = || still.iter().map(|counts| counts.compensated(common_mode) - zero);
            let mean = mean(counts()).unwrap_or(0.0);
            changing.extend(counts().map(|counts| counts - mean));
            staying.push(mean);
        }
        (rms(&changing).unwrap_or(0.0), rms(&staying).unwrap_or(0.0))
    }

    /// Moments of a whisker and the counts of a sensor on the same board, while that whisker is swept as in some recordings and all others are free: those of
    /// each recording.
    fn swept(
        &self,
        mounting: &Mounting,
        (whisker, sensor): (usize, usize),
        recordings: &[Played],
        common_mode: [f64; 2],
    ) -> Vec<Vec<(f64, f64)>> {
        let of_one = |played: &Played| {
            let swept = Mounting { sensor: mounting.board[whisker].sensor.clone(), ..mounting.clone() };
            // Sweeps of one whisker and of another are occasions of their own.
            let swept = swept.on(&format!("{} of {}", played.mounting.recording, swept.sensor));
            let mut rotations_rad = vec![Vec::new(); mounting.board.len()];
            rotations_rad[whisker] = played.rotations_rad();
            let played = Played { mounting: &swept, ..*played };
            let counts = self.counts(&played, &rotations_rad, sensor, common_mode);
            played.recording.instants.iter().map(|instant| instant.moment_z_n_m).zip(counts).collect()
        };
        recordings.iter().map(of_one).collect()
    }
}

/// Standard deviation, from recording to recording, of the gain by which its counts best follow a characteristic, relative.
fn gain_sd(characteristic: &Characteristic, recordings: &[Vec<(f64, f64)>]) -> f64 {
    let gain = |pairs: &Vec<(f64, f64)>| {
        let sums = pairs.iter().map(|(moment_n_m, counts)| (characteristic.counts(*moment_n_m), counts));
        let (both, square) = sums.fold((0.0, 0.0), |(both, square), (expected, counts)| {
            (both + expected * counts, square + expected * expected)
        });
        (square > 0.0).then(|| both / square)
    };
    let gains: Vec<f64> = recordings.iter().filter_map(gain).collect();
    let middle = mean(gains.iter().copied()).unwrap_or(1.0);
    let squares: f64 = gains.iter().map(|gain| (gain / middle - 1.0).powi(2)).sum();
    (squares / (gains.len().max(2) - 1) as f64).sqrt()
}

impl Chain for Hall {
    fn has_sensor(&self) -> bool {
        true
    }

    fn calibrate(&self, mounting: &Mounting, recordings: &[Played]) -> anyhow::Result<Option<SensorFile>> {
        let Mounting { sensor, array, board, .. } = mounting;
        let first = recordings.first().context("no recording to calibrate on")?;
        let own = mounting.seat(sensor).context("a whisker sits on its own board")?;
        let dt_s = 1.0 / first.sidecar.rate_hz;
        let common_mode = match self.config.compensated {
            true => common_mode::learn(&Board::new(&self.config, mounting), mounting, own, first.seed, dt_s),
            false => [0.0; 2],
        };
        let swept = self.swept(mounting, (own, own), recordings, common_mode);
        let pairs = swept.concat();
        let characteristic = Characteristic::fit(DEGREE, &pairs).with_context(|| {
            format!(
                "sensor `{sensor}`: its counts saturate or turn back within the calibration and do not tell moments"
            )
        })?;
        let others = board.iter().enumerate().filter(|(whisker, _)| *whisker != own);
        let cross_talk = others.map(|(whisker, seat)| {
            let pairs = self.swept(mounting, (whisker, own), recordings, common_mode).concat();
            // Where the sweep tells nothing of it, the characteristic cannot be had either.
            let coefficients = through_zero(CROSS_TALK_DEGREE, &pairs).unwrap_or_default();
            CrossTalk { from: seat.sensor.clone(), coefficients }
        });
        let cross_talk = cross_talk.collect();
        let (changing_counts, staying_counts) = self.rest_sd_counts(mounting, own, first.seed, dt_s, common_mode);
        let per_count: Vec<f64> = pairs.iter().map(|(moment_n_m, _)| 1.0 / characteristic.slope(*moment_n_m)).collect();
        let per_count_n_m = rms(&per_count).unwrap_or(0.0);
        Ok(Some(SensorFile {
            name: sensor.clone(),
            array: array.clone(),
            common_mode,
            cross_talk,
            noise_sd_n_m: changing_counts * per_count_n_m,
            offset_sd_n_m: staying_counts * per_count_n_m,
            gain_sd: gain_sd(&characteristic, &swept),
            characteristic,
        }))
    }

    /// The cross-talk is taken out by what the others' counts tell of their moments as they are: what in these is cross-talk is a hundredth of a hundredth.
    fn readings_n_m(&self, played: &Played) -> anyhow::Result<Vec<f64>> {
        let together = std::iter::once(played).chain(played.neighbours);
        let mut rotations_rad = vec![Vec::new(); played.mounting.board.len()];
        for one in together {
            rotations_rad[one.seat()] = one.rotations_rad();
        }
        let sensor = played.learnt()?;
        let mut counts = self.counts(played, &rotations_rad, played.seat(), sensor.common_mode);
        for other in played.neighbours {
            let Some(talk) = sensor.cross_talk.iter().find(|talk| talk.from == other.mounting.sensor) else { continue };
            let SensorFile { characteristic, common_mode, .. } = other.learnt()?;
            let others = self.counts(played, &rotations_rad, other.seat(), *common_mode);
            for (counts, other) in counts.iter_mut().zip(others) {
                *counts -= talk.counts(characteristic.moment_n_m(other));
            }
        }
        Ok(counts.into_iter().map(|counts| sensor.characteristic.moment_n_m(counts)).collect())
    }

    fn tables(&self) -> &'static [&'static str] {
        &["turn", "transfer"]
    }

    fn table_bytes(&self, sensor: &SensorFile) -> anyhow::Result<Vec<Vec<u8>>> {
        // What of the neighbours' magnets rests while the board turns is zeroed: the sensor may as well be alone.
        let mounting = Mounting::single(&sensor.array, &sensor.name).on("turn");
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
        let whisker = &board.whiskers[0];
        let sensor = whisker.sensor.amplified(amplified);
        for half_degrees in -2 * MOST_DEGREES..=2 * MOST_DEGREES {
            let rotation_rad = (0.5 * f64::from(half_degrees)).to_radians();
            let field_t = board.magnets_t(&[rotation_rad], &whisker.place);
            let [x_counts, y_counts, z_counts] = [0, 1, 2].map(|axis| sensor.counts(axis, field_t, 0.0, 0.0));
            rows.push(TransferRow { amplified, rotation_rad, x_counts, y_counts, z_counts });
        }
    }
    rows
}

#[cfg(test)]
mod tests;
