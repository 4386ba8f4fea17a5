//! Hall front end of traces in space: the magnet turns with the root about two axes, and all three components of the
//! field are read.
//!
//! ```text
//! moment -> yaw and pitch of the root -> magnet's + earth's field -> three counts -> common-mode compensation -> zeroing -> bending
//! ```
//!
//! The magnet lies on the axis of the wire, so that twist and axial force do not move it: the sensor reads the bending
//! about the axes of the suspension's springs. Settings, sensors, noise and temperature are those of the planar front
//! end; each whisker has a board of its own.

mod board;
mod common_mode;

use anyhow::{Context, ensure};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use serde_json::Value;
use trace::{SpatialCharacteristic, SpatialSensor};
use whisker::estimators::parse;

use super::board::samples_in;
use super::config::Config;
use super::{REST_S, RESTS};
use crate::front_end::spatial::{BendingAxes, SpatialChain, SpatialInput, moment_n_m};
use crate::statistics::{mean, rms};
use board::{Board, BoardReader, Counts, rotation_of};

pub(in crate::front_end) fn build(config: &Value) -> anyhow::Result<Box<dyn SpatialChain>> {
    Ok(Box::new(Hall { config: parse(config)? }))
}

/// Counts of each axis of a sensor per count of each axis of its reference, 3x3.
fn of_reference(sensor: &SpatialSensor) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| sensor.common_mode[row][column])
}

/// Hall front end with its settings.
#[derive(Debug)]
struct Hall {
    config: Config,
}

impl Hall {
    /// Zeroed and compensated counts of a recording, one entry per instant.
    fn counts(&self, input: &SpatialInput, common_mode: &Matrix3<f64>) -> Vec<Vector3<f64>> {
        let board = Board::new(&self.config, &input.sidecar.whisker.name);
        let mut reader = board.reader(&input.sidecar.name, input.seed);
        let instants = &input.recording.instants;
        let Some(first) = instants.first() else { return Vec::new() };
        let rest_dt_s = 1.0 / input.sidecar.rate_hz;
        let zero = self.zero_counts(&mut reader, common_mode, rest_dt_s, &rotation_of(first));
        let mut last_s = first.t_s - rest_dt_s;
        let read = instants.iter().zip(input.directions()).map(|(instant, direction)| {
            let counts = reader.read(instant.t_s - last_s, direction, &rotation_of(instant));
            last_s = instant.t_s;
            counts.compensated(common_mode) - zero
        });
        read.collect()
    }

    /// Mean of the compensated counts over the next `zeroing_s` at rest.
    fn zero_counts(
        &self,
        reader: &mut BoardReader,
        common_mode: &Matrix3<f64>,
        dt_s: f64,
        base: &Rotation3<f64>,
    ) -> Vector3<f64> {
        let samples = samples_in(self.config.zeroing_s, dt_s);
        let rest = reader.rest(samples, dt_s, base);
        rest.iter().map(|counts| counts.compensated(common_mode)).sum::<Vector3<f64>>() / samples as f64
    }

    /// RMS of each bending moment over recordings at rest: of the variation within a recording, and of its mean.
    fn rest_sd_n_m(&self, sensor: &SpatialSensor, seed: u64, dt_s: f64) -> ([f64; 2], [f64; 2]) {
        let board = Board::new(&self.config, &sensor.name);
        let (common_mode, still) = (of_reference(sensor), Rotation3::identity());
        let mut changing = [Vec::new(), Vec::new()];
        let mut staying = [Vec::new(), Vec::new()];
        for rest in 0..RESTS {
            let mut reader = board.reader(&format!("rest {rest}"), seed);
            let zero = self.zero_counts(&mut reader, &common_mode, dt_s, &still);
            let counts: Vec<Counts> = reader.rest(samples_in(REST_S, dt_s), dt_s, &still);
            let bending_n_m: Vec<[f64; 2]> = counts
                .iter()
                .map(|counts| sensor.characteristic.bending_n_m(counts.compensated(&common_mode) - zero))
                .collect();
            for axis in 0..2 {
                let middle = mean(bending_n_m.iter().map(|bending| bending[axis])).unwrap_or(0.0);
                changing[axis].extend(bending_n_m.iter().map(|bending| bending[axis] - middle));
                staying[axis].push(middle);
            }
        }
        let sd = |of: [Vec<f64>; 2]| of.map(|values| rms(&values).unwrap_or(0.0));
        (sd(changing), sd(staying))
    }
}

impl SpatialChain for Hall {
    fn has_sensor(&self) -> bool {
        true
    }

    fn axes(&self) -> BendingAxes {
        BendingAxes::Springs
    }

    fn calibrate(&self, recordings: &[SpatialInput]) -> anyhow::Result<Option<SpatialSensor>> {
        let first = recordings.first().context("no recording to calibrate on")?;
        let name = &first.sidecar.whisker.name;
        for input in recordings {
            let other = &input.sidecar.whisker.name;
            ensure!(other == name, "found recordings of the whiskers `{name}` and `{other}`, expected those of one");
        }
        let dt_s = 1.0 / first.sidecar.rate_hz;
        let common_mode = match self.config.compensated {
            true => common_mode::fit_at_orientations(&Board::new(&self.config, name), first.seed, dt_s),
            false => Matrix3::zeros(),
        };
        let mut pairs = Vec::new();
        for input in recordings {
            let bending_n_m = input
                .recording
                .instants
                .iter()
                .map(|instant| self.axes().bending_n_m(moment_n_m(instant), &input.sidecar.suspension));
            pairs.extend(bending_n_m.zip(self.counts(input, &common_mode)));
        }
        let characteristic = SpatialCharacteristic::fit(&pairs).with_context(|| {
            format!(
                "sensor `{name}`: its counts saturate, or the calibration does not bend the root in both directions, \
                so that they do not determine the bending"
            )
        })?;
        let mut sensor = SpatialSensor {
            name: name.clone(),
            common_mode: std::array::from_fn(|row| std::array::from_fn(|column| common_mode[(row, column)])),
            characteristic,
            noise_sd_n_m: [0.0; 2],
            offset_sd_n_m: [0.0; 2],
        };
        (sensor.noise_sd_n_m, sensor.offset_sd_n_m) = self.rest_sd_n_m(&sensor, first.seed, dt_s);
        Ok(Some(sensor))
    }

    fn readings_n_m(&self, input: &SpatialInput) -> anyhow::Result<Vec<Vector2<f64>>> {
        let sensor = input
            .sensor
            .context("a Hall sensor reads counts and must be calibrated: found no calibration of the sensor")?;
        let (found, expected) = (&sensor.name, &input.sidecar.whisker.name);
        ensure!(found == expected, "found the calibration of the sensor `{found}`, expected that of `{expected}`");
        let counts = self.counts(input, &of_reference(sensor));
        Ok(counts.into_iter().map(|counts| sensor.characteristic.bending_n_m(counts).into()).collect())
    }
}

#[cfg(test)]
mod tests;
