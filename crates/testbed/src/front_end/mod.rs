//! Front ends: what lies between the moment at a whisker's root and the reading, added at replay to the physics of a simulated trace.
//!
//! To add one: a file with a [`Chain`] and a row in [`FRONT_ENDS`].

mod hall;
mod white;

use std::fmt::Debug;
use std::path::Path;

use anyhow::{Context, bail};
use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde_json::{Value, json};
use trace::{
    ArraySidecar, CalibrationFile, FrontEndFile, Instant, MountedWhisker, Recording, SensorFile, Sidecar, Trace,
};

use crate::seeds::derived_seed;
use crate::settings::merged;

pub use hall::{Config as HallConfig, shift_counts};

/// A row of the registry of front ends.
pub struct FrontEndRow {
    /// Its name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Measurement noise to add to simulated moments where none is asked for, as a fraction of the largest reading.
    pub noise: f64,
    /// Its default settings.
    pub defaults: fn() -> Value,
    /// Makes it from its settings.
    build: fn(&Value) -> anyhow::Result<Box<dyn Chain>>,
}

/// The registry of front ends; the first is the default.
pub const FRONT_ENDS: &[FrontEndRow] = &[
    FrontEndRow {
        name: "white",
        about: "the moment itself, with white noise",
        noise: 0.01,
        defaults: || json!({}),
        build: white::build,
    },
    FrontEndRow {
        name: "hall",
        about: "a magnet at the root over a Hall sensor, and a reference sensor that takes out the earth's field (Lin et al. 2022)",
        noise: 0.0,
        defaults: hall::defaults,
        build: hall::build,
    },
];

/// Gives the reading in N m of each instant, in the order of time.
pub type Reader = Box<dyn FnMut(&Instant) -> f64>;

/// What a front end does to the moments of a recording. One that reads them as they are has no sensor; others read counts, and what
/// calibrating their sensor teaches turns those back into moments.
pub trait Chain: Debug + Send + Sync {
    /// Whether it has a sensor, with noise of its own, that must be calibrated.
    fn has_sensor(&self) -> bool {
        false
    }

    /// What somebody who calibrates a sensor on these recordings learns of it.
    ///
    /// # Errors
    /// If the recordings do not tell moments from counts.
    fn calibrate(&self, _: &Mounting, _: &[Played]) -> anyhow::Result<Option<SensorFile>> {
        Ok(None)
    }

    /// Readings of a recording, one an instant.
    ///
    /// # Errors
    /// If it takes a calibration that is not there.
    fn readings_n_m(&self, played: &Played) -> anyhow::Result<Vec<f64>>;

    /// The same instant by instant, with this noise in N m, for recordings that are too long to be held; nothing where a recording is read as a whole.
    fn reader(&self, _noise_n_m: Box<dyn FnMut() -> f64>) -> Option<Reader> {
        None
    }

    /// Names of the tables for the report about a calibrated sensor.
    fn tables(&self) -> &'static [&'static str] {
        &[]
    }

    /// The bytes of these tables, in their order.
    ///
    /// # Errors
    /// If a row does not serialise.
    fn table_bytes(&self, _: &SensorFile) -> anyhow::Result<Vec<Vec<u8>>> {
        Ok(Vec::new())
    }
}

/// Name of a front end and the settings that differ from its defaults.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Name in the registry.
    pub name: String,
    /// Settings; what is missing takes its default.
    pub config: Value,
}

impl Default for Choice {
    fn default() -> Self {
        Self { name: FRONT_ENDS[0].name.into(), config: json!({}) }
    }
}

/// A front end with its settings.
pub struct FrontEnd {
    /// Its row in the registry.
    pub row: &'static FrontEndRow,
    config: Value,
    chain: Box<dyn Chain>,
}

impl FrontEnd {
    /// The one that was chosen.
    ///
    /// # Errors
    /// If there is none of this name, or its settings are wrong.
    pub fn new(choice: &Choice) -> anyhow::Result<Self> {
        let row = FRONT_ENDS.iter().find(|row| row.name == choice.name).with_context(|| {
            let known: Vec<_> = FRONT_ENDS.iter().map(|row| row.name).collect();
            format!("unknown front end `{}`, expected one of: {}", choice.name, known.join(", "))
        })?;
        let place = || format!("settings of the front end `{}`", row.name);
        let config = merged((row.defaults)(), &choice.config).with_context(place)?;
        let chain = (row.build)(&config).with_context(place)?;
        Ok(Self { row, config, chain })
    }

    /// Whether readings differ from seed to seed where no noise is added.
    pub fn is_noisy(&self) -> bool {
        self.chain.has_sensor()
    }

    /// Measurement noise to add where none is asked for, as a fraction of the largest reading: none to a recording, which has its own.
    pub fn default_noise(&self, sidecar: &Sidecar) -> f64 {
        if sidecar.recorded.is_some() { 0.0 } else { self.row.noise }
    }

    /// Checks that a trace may be read through it.
    ///
    /// # Errors
    /// If it is a recording, which has its own front end.
    pub fn check_trace(&self, sidecar: &Sidecar) -> anyhow::Result<()> {
        if sidecar.recorded.is_some() && self.chain.has_sensor() {
            bail!(
                "{}: was recorded through a front end of its own; `{}` is for simulated traces",
                sidecar.name,
                self.row.name
            );
        }
        Ok(())
    }

    /// What is recorded about it, with these sensors.
    pub fn describe(&self, sensors: Vec<SensorFile>) -> FrontEndFile {
        FrontEndFile { name: self.row.name.into(), config: self.config.clone(), sensors }
    }

    /// What calibrating these sensors on recordings teaches; nothing where readings are the moments themselves.
    ///
    /// # Errors
    /// If the recordings do not tell moments from counts.
    pub fn calibrate(&self, mountings: &[Mounting], recordings: &[Played]) -> anyhow::Result<Option<FrontEndFile>> {
        let mut sensors = Vec::new();
        for mounting in mountings {
            sensors.extend(self.chain.calibrate(mounting, recordings)?);
        }
        Ok(self.chain.has_sensor().then(|| self.describe(sensors)))
    }

    /// What a calibration knows of a sensor; nothing where readings are the moments themselves.
    ///
    /// # Errors
    /// If the calibration, whose path this is, was made through another front end, or without this sensor.
    pub fn sensor<'a>(
        &self,
        path: &Path,
        calibration: &'a CalibrationFile,
        mounting: &Mounting,
    ) -> anyhow::Result<Option<&'a SensorFile>> {
        let path = path.display();
        let make = format!("`whisker fit --front-end {}` makes one", self.row.name);
        let Some(file) = &calibration.front_end else {
            if self.chain.has_sensor() {
                bail!("{path}: front_end: found none, expected `{}`; {make}", self.row.name);
            }
            return Ok(None);
        };
        if file.name != self.row.name {
            bail!("{path}: front_end.name: found `{}`, expected `{}`; {make}", file.name, self.row.name);
        }
        let settings = self.config.as_object().into_iter().flatten();
        for (key, expected) in settings {
            let found = &file.config[key];
            if found != expected {
                bail!("{path}: front_end.config.{key}: found {found}, expected {expected}; {make}");
            }
        }
        let sensor = file.sensor(&mounting.array, &mounting.sensor).with_context(|| {
            let known: Vec<_> = file.sensors.iter().map(|sensor| format!("{}/{}", sensor.array, sensor.name)).collect();
            let wanted = format!("{}/{}", mounting.array, mounting.sensor);
            format!("{path}: front_end.sensors: found {}, expected {wanted} among them; `whisker fit --sensors {wanted}` adds it", known.join(", "))
        })?;
        Ok(Some(sensor))
    }

    /// Readings of a recording, one an instant.
    ///
    /// # Errors
    /// If it takes a calibration of the sensor that is not there.
    pub fn readings_n_m(&self, played: &Played) -> anyhow::Result<Vec<f64>> {
        self.chain.readings_n_m(played)
    }

    /// Reads a trace instant by instant, with the readings that [`Self::readings_n_m`] has of the whole; nothing where it must be read as a whole.
    pub fn reader(&self, sidecar: &Sidecar, noise_sd_n_m: f64, seed: u64) -> Option<Reader> {
        let mut standard = noise(sidecar, seed);
        self.chain.reader(Box::new(move || noise_sd_n_m * standard()))
    }

    /// Tables for the report about a sensor, by the names of their files.
    ///
    /// # Errors
    /// If a row does not serialise.
    pub fn tables(&self, sensor: &SensorFile) -> anyhow::Result<Vec<(String, Vec<u8>)>> {
        Ok(self.table_files(sensor).zip(self.chain.table_bytes(sensor)?).collect())
    }

    /// Names of the files of these tables.
    pub fn table_files(&self, sensor: &SensorFile) -> impl Iterator<Item = String> {
        self.chain.tables().iter().map(|table| format!("{}.{table}.csv", sensor.label()))
    }
}

/// Where a whisker's sensor sits. Names stand for things: the same name, the same sensor, in every recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Mounting {
    /// Name of the sensor.
    pub sensor: String,
    /// Name of the array, whose whiskers share a board with one reference sensor.
    pub array: String,
    /// Name of the recording. Whiskers that are recorded together share its temperature and what their reference sensor sees.
    pub recording: String,
    /// The whiskers of the array, itself among them.
    pub board: Vec<Seat>,
}

/// The place of a whisker on the board of its array.
#[derive(Clone, Debug, PartialEq)]
pub struct Seat {
    /// Name of its sensor.
    pub sensor: String,
    /// Name of its trace, where it has one.
    pub trace: Option<String>,
    /// Pose of its Base in that of the first whisker of the array.
    pub base: Isometry3<f64>,
}

impl Mounting {
    /// That of a sensor that is alone on its board.
    pub fn single(array: &str, sensor: &str) -> Self {
        let seat = Seat { sensor: sensor.into(), trace: None, base: Isometry3::identity() };
        Self { sensor: sensor.into(), array: array.into(), recording: String::new(), board: vec![seat] }
    }

    /// That of a whisker that is recorded alone: an array of its own.
    pub fn alone(sidecar: &Sidecar) -> Self {
        let whisker = &sidecar.whisker.name;
        Self { recording: sidecar.name.clone(), ..Self::single(whisker, whisker) }
    }

    /// The same on another occasion.
    pub fn on(&self, recording: &str) -> Self {
        Self { recording: recording.into(), ..self.clone() }
    }

    /// Place among the whiskers of the board of a sensor of this name.
    pub fn seat(&self, sensor: &str) -> Option<usize> {
        self.board.iter().position(|seat| seat.sensor == sensor)
    }

    /// That of a trace in a folder, by the recording of several whiskers to which it belongs, if to any.
    ///
    /// # Errors
    /// If that recording cannot be read or does not have the trace.
    pub fn of(folder: &Path, sidecar: &Sidecar) -> anyhow::Result<Self> {
        let Some(recording) = &sidecar.recording else { return Ok(Self::alone(sidecar)) };
        let path = folder.join(format!("{recording}.json"));
        let array = ArraySidecar::read(&path)?;
        let place = array.place_of(&sidecar.name).with_context(|| {
            format!("{}: whiskers: expected one with the trace `{}`, found none", path.display(), sidecar.name)
        })?;
        let whiskers = array.whiskers;
        let whisker = &whiskers[place];
        let array: Vec<_> = whiskers.iter().filter(|other| other.array == whisker.array).collect();
        let from_first = array[0].mount.isometry().inverse();
        let seat = |whisker: &&MountedWhisker| Seat {
            sensor: whisker.name.clone(),
            trace: Some(whisker.trace.clone()),
            base: from_first * whisker.mount.isometry(),
        };
        Ok(Self {
            sensor: whisker.name.clone(),
            array: whisker.array.clone(),
            recording: recording.clone(),
            board: array.iter().map(seat).collect(),
        })
    }
}

/// A recording that is played to a sensor.
#[derive(Clone, Copy, Debug)]
pub struct Played<'a> {
    /// Where the sensor sits.
    pub mounting: &'a Mounting,
    /// What is known of the trace.
    pub sidecar: &'a Sidecar,
    /// The recording.
    pub recording: &'a Recording,
    /// Standard deviation of the white noise that is added to the moments.
    pub noise_sd_n_m: f64,
    /// Seed of the run; every trace draws its own noise from it.
    pub seed: u64,
    /// What was learnt of the sensor, where it must be calibrated.
    pub sensor: Option<&'a SensorFile>,
    /// What the other whiskers of its board did meanwhile, instant by instant. One that is not among them was at rest.
    pub neighbours: &'a [Played<'a>],
}

impl<'a> Played<'a> {
    /// A trace, played to the sensor that sits there.
    pub fn new(trace: &'a Trace, mounting: &'a Mounting, noise_sd_n_m: f64, seed: u64) -> Self {
        let (sidecar, recording) = (&trace.sidecar, &trace.recording);
        Self { mounting, sidecar, recording, noise_sd_n_m, seed, sensor: None, neighbours: &[] }
    }

    /// The noise to add to the moments, one an instant.
    fn noise_n_m(&self) -> impl Iterator<Item = f64> {
        let mut standard = noise(self.sidecar, self.seed);
        self.recording.instants.iter().map(move |_| self.noise_sd_n_m * standard())
    }
}

/// White noise of standard deviation one: that of a trace under a seed.
fn noise(sidecar: &Sidecar, seed: u64) -> impl FnMut() -> f64 + use<> {
    let mut rng = Pcg64::seed_from_u64(derived_seed(seed, &["front end", &sidecar.name]));
    move || rng.sample(StandardNormal)
}
