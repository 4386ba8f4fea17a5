//! Hall front end: a magnet at the whisker's root above a three-axis Hall sensor (Lin et al. 2022), and a reference
//! sensor shared by the whiskers of an array on the same board.
//!
//! ```text
//! moment -> rotation of the root -> magnet's + earth's field -> counts -> common-mode compensation -> zeroing -> reading
//! ```
//!
//! The magnet is behind the root and rotates with it (`dipole`). The sensor is behind the magnet, at `-x` of Base; its
//! y axis is read. The reference is above the centre of the board's sensors, out of the plane, where only a weak field
//! of the magnets remains: it measures the earth's field. Every sensor sees the magnets of all whiskers of its board;
//! other boards are neglected.
//!
//! A calibration uses only measurable quantities. With the board at rest at several headings and the whiskers free, it
//! estimates the influence of the reference's counts on the sensor's (`common_mode`). Each whisker of the board in turn
//! is swept as in the calibration traces while the others are free; least squares gives the [`Characteristic`] from
//! moment to counts and the [`CrossTalk`] of the others. Recordings at rest give the noise of the counts and their
//! offset per recording. Before each recording the reading is zeroed with the whiskers free.

mod board;
mod common_mode;
mod config;
mod dipole;
mod noise;
mod sensor;
mod spatial;
mod turn;

use anyhow::Context;
use serde_json::{Value, json};
use trace::{Characteristic, CrossTalk, Instant, SensorFile, through_zero};
use whisker::estimators::parse;

use super::chain::{Chain, SensorInput};
use super::mounting::Mounting;
use crate::results::{TransferRow, csv_bytes};
use crate::statistics::{mean, rms};
use board::{Board, BoardReader, samples_in};

pub use config::Config;
pub(super) use spatial::build as build_spatial;
pub use turn::shift_counts;

/// Degree of the characteristic. For a dipole at this distance, the residual of a lower degree exceeds the noise.
const DEGREE: usize = 5;

/// Degree of the cross-talk polynomial: the sine and, by its square, the cosine of the rotation of a distant dipole.
const CROSS_TALK_DEGREE: usize = 2;

/// Number and duration of the recordings at rest for the estimation of noise. The duration is that of a trial, since
/// slow noise grows with time.
const RESTS: usize = 20;
const REST_S: f64 = 10.0;

pub(super) fn defaults() -> Value {
    json!(Config::default())
}

pub(super) fn build(config: &Value) -> anyhow::Result<Box<dyn Chain>> {
    Ok(Box::new(Hall { config: parse(config)? }))
}

/// Hall front end with its settings.
#[derive(Debug)]
struct Hall {
    config: Config,
}

impl SensorInput<'_> {
    /// Rotation of the root, one entry per instant.
    fn rotations_rad(&self) -> Vec<f64> {
        let stiffness_n_m_rad = self.sidecar.whisker.root_stiffness_n_m_rad;
        let instants = self.recording.instants.iter().zip(self.noise_n_m());
        let rotation_rad = |(instant, noise_n_m): (&Instant, f64)| {
            let rotation_rad = instant.rotation_z_rad.unwrap_or(instant.moment_z_n_m / stiffness_n_m_rad);
            rotation_rad + noise_n_m / stiffness_n_m_rad
        };
        instants.map(rotation_rad).collect()
    }

    /// Calibration of the sensor.
    fn calibration(&self) -> anyhow::Result<&SensorFile> {
        self.sensor.context("a Hall sensor reads counts and must be calibrated: found no calibration of the sensor")
    }

    /// Slot of the whisker on its board.
    fn slot(&self) -> usize {
        self.mounting.slot(&self.mounting.sensor).expect("a whisker sits on its own board")
    }
}

impl Hall {
    /// Zeroed and compensated counts of one whisker of a recording. `rotations_rad` contains, for each whisker of the
    /// board, the root's rotation per instant; an empty entry is a whisker at rest.
    fn counts(&self, input: &SensorInput, rotations_rad: &[Vec<f64>], slot: usize, common_mode: [f64; 2]) -> Vec<f64> {
        let board = Board::new(&self.config, input.mounting);
        let mut reader = board.reader(input.mounting, input.seed);
        let instants = &input.recording.instants;
        let Some(first) = instants.first() else { return Vec::new() };
        let yaw_rad = |instant: &Instant| board.yaw_rad(input.slot(), instant.base.yaw_rad());
        let rest_dt_s = 1.0 / input.sidecar.rate_hz;
        let zero = self.zero_counts(&mut reader, slot, common_mode, rest_dt_s, yaw_rad(first));
        let mut last_s = first.t_s - rest_dt_s;
        let read = instants.iter().enumerate().map(|(row, instant)| {
            let now_rad: Vec<f64> =
                rotations_rad.iter().map(|of_one| of_one.get(row).copied().unwrap_or(0.0)).collect();
            let counts = reader.read(instant.t_s - last_s, &now_rad, yaw_rad(instant))[slot];
            last_s = instant.t_s;
            counts.compensated(common_mode) - zero
        });
        read.collect()
    }

    /// Mean of the compensated counts over the next `zeroing_s` at rest.
    fn zero_counts(
        &self,
        reader: &mut BoardReader,
        slot: usize,
        common_mode: [f64; 2],
        dt_s: f64,
        yaw_rad: f64,
    ) -> f64 {
        let samples = samples_in(self.config.zeroing_s, dt_s);
        let rest = reader.rest(slot, samples, dt_s, yaw_rad);
        rest.iter().map(|counts| counts.compensated(common_mode)).sum::<f64>() / samples as f64
    }

    /// RMS of the zeroed counts over recordings at rest: of the variation within a recording, and of the mean of a
    /// recording.
    fn rest_sd_counts(
        &self,
        mounting: &Mounting,
        slot: usize,
        seed: u64,
        dt_s: f64,
        common_mode: [f64; 2],
    ) -> (f64, f64) {
        let board = Board::new(&self.config, mounting);
        let (mut changing, mut staying) = (Vec::new(), Vec::new());
        for rest in 0..RESTS {
            let mut reader = board.reader(&mounting.on(&format!("rest {rest}")), seed);
            let zero = self.zero_counts(&mut reader, slot, common_mode, dt_s, 0.0);
            let still = reader.rest(slot, samples_in(REST_S, dt_s), dt_s, 0.0);
            let counts = || still.iter().map(|counts| counts.compensated(common_mode) - zero);
            let mean = mean(counts()).unwrap_or(0.0);
            changing.extend(counts().map(|counts| counts - mean));
            staying.push(mean);
        }
        (rms(&changing).unwrap_or(0.0), rms(&staying).unwrap_or(0.0))
    }

    /// Pairs of moment and counts per recording: the moment of the whisker in slot `whisker`, swept as in the
    /// recordings with all others free, and the counts of the sensor in slot `sensor`.
    fn swept(
        &self,
        mounting: &Mounting,
        whisker: usize,
        sensor: usize,
        recordings: &[SensorInput],
        common_mode: [f64; 2],
    ) -> Vec<Vec<(f64, f64)>> {
        let of_one = |input: &SensorInput| {
            let swept = Mounting { sensor: mounting.board[whisker].sensor.clone(), ..mounting.clone() };
            // Sweeps of different whiskers are separate recordings with independent noise.
            let swept = swept.on(&format!("{} of {}", input.mounting.recording, swept.sensor));
            let mut rotations_rad = vec![Vec::new(); mounting.board.len()];
            rotations_rad[whisker] = input.rotations_rad();
            let input = SensorInput { mounting: &swept, ..*input };
            let counts = self.counts(&input, &rotations_rad, sensor, common_mode);
            input.recording.instants.iter().map(|instant| instant.moment_z_n_m).zip(counts).collect()
        };
        recordings.iter().map(of_one).collect()
    }
}

/// Relative standard deviation, between recordings, of the gain with which the counts follow a characteristic.
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

    fn calibrate(&self, mounting: &Mounting, recordings: &[SensorInput]) -> anyhow::Result<Option<SensorFile>> {
        let Mounting { sensor, array, board, .. } = mounting;
        let first = recordings.first().context("no recording to calibrate on")?;
        let own = mounting.slot(sensor).context("a whisker sits on its own board")?;
        let dt_s = 1.0 / first.sidecar.rate_hz;
        let common_mode = match self.config.compensated {
            true => common_mode::fit_at_headings(&Board::new(&self.config, mounting), mounting, own, first.seed, dt_s),
            false => [0.0; 2],
        };
        let swept = self.swept(mounting, own, own, recordings, common_mode);
        let pairs = swept.concat();
        let characteristic = Characteristic::fit(DEGREE, &pairs).with_context(|| {
            format!(
                "sensor `{sensor}`: its counts saturate or are not monotone within the calibration, so that they do \
                not determine the moment"
            )
        })?;
        let others = board.iter().enumerate().filter(|(whisker, _)| *whisker != own);
        let cross_talk = others.map(|(whisker, slot)| {
            let pairs = self.swept(mounting, whisker, own, recordings, common_mode).concat();
            // If the sweep does not determine the cross-talk, it does not determine the characteristic either.
            let coefficients = through_zero(CROSS_TALK_DEGREE, &pairs).unwrap_or_default();
            CrossTalk { from: slot.sensor.clone(), coefficients }
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

    /// Cross-talk is compensated with the uncompensated moments of the other whiskers. The neglected term is of second
    /// order, about 1e-4.
    fn readings_n_m(&self, input: &SensorInput) -> anyhow::Result<Vec<f64>> {
        let together = std::iter::once(input).chain(input.neighbours);
        let mut rotations_rad = vec![Vec::new(); input.mounting.board.len()];
        for one in together {
            rotations_rad[one.slot()] = one.rotations_rad();
        }
        let sensor = input.calibration()?;
        let mut counts = self.counts(input, &rotations_rad, input.slot(), sensor.common_mode);
        for other in input.neighbours {
            let Some(talk) = sensor.cross_talk.iter().find(|talk| talk.from == other.mounting.sensor) else { continue };
            let SensorFile { characteristic, common_mode, .. } = other.calibration()?;
            let others = self.counts(input, &rotations_rad, other.slot(), *common_mode);
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
        // The resting magnets of neighbours contribute a constant, which zeroing removes; a single sensor suffices.
        let mounting = Mounting::single(&sensor.array, &sensor.name).on("turn");
        let board = Board::new(&self.config, &mounting);
        Ok(vec![csv_bytes(&turn::rows(&board, &mounting, sensor))?, csv_bytes(&transfer(&board))?])
    }
}

/// Counts over the rotation of the root, without noise and earth's field, for several amplifications of the signal.
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
