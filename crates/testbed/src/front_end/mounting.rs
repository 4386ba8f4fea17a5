//! Mounting of a whisker's sensor on the board of its array.

use std::path::Path;

use anyhow::Context;
use nalgebra::Isometry3;
use trace::{ArraySidecar, MountedWhisker, Sidecar};

/// Mounting of a whisker's sensor. A name identifies a physical sensor across recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Mounting {
    /// Name of the sensor.
    pub sensor: String,
    /// Name of the array, whose whiskers share a board with one reference sensor.
    pub array: String,
    /// Name of the recording. Whiskers recorded together share temperature and reference readings.
    pub recording: String,
    /// Whiskers of the array, including this one.
    pub board: Vec<BoardSlot>,
}

/// Slot of a whisker on the board of its array.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSlot {
    /// Name of its sensor.
    pub sensor: String,
    /// Name of its trace, if any.
    pub trace: Option<String>,
    /// Pose of its Base in that of the first whisker of the array.
    pub base: Isometry3<f64>,
}

impl Mounting {
    /// Mounting of a sensor alone on its board.
    pub fn single(array: &str, sensor: &str) -> Self {
        let slot = BoardSlot { sensor: sensor.into(), trace: None, base: Isometry3::identity() };
        Self { sensor: sensor.into(), array: array.into(), recording: String::new(), board: vec![slot] }
    }

    /// Mounting of a whisker that was recorded alone, in an array of its own.
    pub fn alone(sidecar: &Sidecar) -> Self {
        let whisker = &sidecar.whisker.name;
        Self { recording: sidecar.name.clone(), ..Self::single(whisker, whisker) }
    }

    /// Same mounting in another recording.
    pub fn on(&self, recording: &str) -> Self {
        Self { recording: recording.into(), ..self.clone() }
    }

    /// Slot of the sensor with this name.
    pub fn slot(&self, sensor: &str) -> Option<usize> {
        self.board.iter().position(|slot| slot.sensor == sensor)
    }

    /// Mounting of a trace in a folder, from the array recording that it belongs to, if any.
    ///
    /// # Errors
    /// If the array recording cannot be read or does not contain the trace.
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
        let slot = |whisker: &&MountedWhisker| BoardSlot {
            sensor: whisker.name.clone(),
            trace: Some(whisker.trace.clone()),
            base: from_first * whisker.mount.isometry(),
        };
        Ok(Self {
            sensor: whisker.name.clone(),
            array: whisker.array.clone(),
            recording: recording.clone(),
            board: array.iter().map(slot).collect(),
        })
    }
}
