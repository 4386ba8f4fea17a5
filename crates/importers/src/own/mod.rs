//! Recordings of any laboratory: columns of a CSV, or fields of ROS 2 messages, by a mapping file.
//!
//! [`mapping`] names the columns with their units, signs and frames; [`columns`] and [`topics`] read them as [`series`]
//! over time, which [`recording`] resamples to equal intervals. The differences between recordings in the plane and in space
//! are those of a [`Geometry`]: the keys of pose, reading and contact, the conversion of the readings to moments, and the trace.
//! The contact on the centre line follows from the axis and the radius of the pin that was touched. `docs/own-data.md`
//! specifies the mapping.

pub(crate) mod columns;
mod mapping;
mod parameters;
mod plane;
mod quantity;
mod recording;
mod rest;
mod series;
mod space;
pub(crate) mod topics;
mod units;

use std::fmt::Debug;
use std::path::Path;

use files::{Digest, Error};
use trace::Role;
use whisker::Whisker;

use self::mapping::{Channels, Keys, Layout, Mapping};
use self::plane::Plane;
use self::quantity::Quantity;
use self::recording::{Columns, ReadColumns, Sampled, Wanted};
use self::space::Space;
use self::units::Length;
use crate::{Imported, Progress};

/// Residual of the fitted response of a sensor, relative to the readings (RMS), above which the remark about it is a warning.
const USUAL_RESIDUAL: f64 = 0.05;

/// Remark about the sensor.
#[derive(Clone, Debug)]
pub(crate) struct Remark {
    text: String,
    is_warning: bool,
}

/// Agreement of the readings of a calibration with the mechanics of the whisker.
pub(crate) struct Agreement {
    /// RMS of the residuals over that of the readings.
    residual: f64,
    /// Number of contacts, and of those to which the whisker does not reach.
    contacts: usize,
    unreached: usize,
    /// Number of further contacts that are left out, since their readings are far too small.
    weak: usize,
}

impl Agreement {
    /// Remark about the agreement with a `model` of the whisker. If it is poor, `except` states when this may be right, and `advice`
    /// what to compare.
    fn remark(&self, model: &str, except: &str, advice: &str) -> Remark {
        let is_warning = self.residual > USUAL_RESIDUAL;
        let advice = match is_warning {
            true => format!(
                ", expected at most {:.0} %{except}: estimated contacts are probably wrong; {advice}",
                100.0 * USUAL_RESIDUAL
            ),
            false => String::new(),
        };
        let unreached = match self.unreached {
            0 => String::new(),
            unreached => format!("; the whisker does not reach {unreached} of {} contacts", self.contacts),
        };
        let weak = match self.weak {
            0 => String::new(),
            weak => format!(
                "; the contacts of {weak} of {} rows are left out, since their readings are far smaller than those of {model}",
                self.contacts + weak
            ),
        };
        let text = format!(
            "the readings of the calibration deviate by {:.1} % (RMS) from those of {model} through the known \
             contacts{advice}{unreached}{weak}",
            100.0 * self.residual
        );
        Remark { text, is_warning }
    }
}

/// Numbers of rows whose reading is that of a touch, but whose contact is not known.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lacking {
    /// No contact is found.
    not_found: usize,
    /// The reading is far smaller than that of a whisker deflected by the contact.
    weak: usize,
}

/// Differences between recordings in the plane and in space.
pub(crate) trait Geometry: Clone + Debug {
    /// Format of the mapping and of the traces.
    const FORMAT: u32;
    /// Format that is expected in place of the other one.
    const FORMAT_EXPECTED: &'static str;
    /// Columns of the pose.
    type Pose: PoseKeys;
    /// Constant pose of the base in the frame whose pose is recorded.
    type Base: Keys + Default;
    /// Columns of the reading.
    type Reading: Channels;
    /// True contact: columns, or a known place.
    type Contact: Keys;
    /// Pose of the base in World.
    type BasePose;
    /// Place of a contact, or of the axis of a pin, in World.
    type Place;
    /// Sensor of all recordings.
    type Sensor;

    /// Checks the keys that only one of both kinds of mapping has.
    ///
    /// # Errors
    /// [`Error::Value`] with file and key.
    fn validate(mapping: &Mapping<Self>, path: &Path) -> Result<(), Error>;

    /// Poses of the base at these times.
    ///
    /// # Errors
    /// [`Error`] of the first value that is implausible.
    fn poses(
        laboratory: &Laboratory<'_, Self>,
        path: &Path,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<Self::BasePose>, Error>;

    /// Places of a contact at these times, where they are known.
    ///
    /// # Errors
    /// [`Error`] of the first value that is implausible.
    fn places(
        laboratory: &Laboratory<'_, Self>,
        path: &Path,
        contact: &Self::Contact,
        columns: &Columns<'_>,
        clock_s: &[f64],
    ) -> Result<Vec<Option<Self::Place>>, Error>;

    /// Sensor as stated by the mapping, or fitted to the calibration, and a remark about it. The whisker touches if the reading
    /// differs from rest by more than `touch`.
    ///
    /// # Errors
    /// [`Error`] if the recordings do not determine it.
    fn sensor(
        laboratory: &Laboratory<'_, Self>,
        sampled: &[Sampled<'_, Self>],
        touch: f64,
    ) -> Result<(Self::Sensor, Option<Remark>), Error>;

    /// Adds the trace of a recording. Returns the numbers of rows whose reading is that of a touch, but whose contact is not
    /// known.
    ///
    /// # Errors
    /// [`Error`] if a reader of the trace would refuse it.
    fn add_trace(
        laboratory: &Laboratory<'_, Self>,
        sensor: &Self::Sensor,
        recording: &Sampled<'_, Self>,
        imported: &mut Imported,
    ) -> Result<Lacking, Error>;
}

/// Columns of a pose.
pub(crate) trait PoseKeys: Keys {
    /// The coordinates of the position.
    fn positions(&self) -> Vec<&Quantity<Length>>;
}

/// Format of the files of recordings, and how their columns are read.
struct Source {
    name: &'static str,
    read: fn(&Path, &Layout<'_>, &[Wanted<'_>]) -> Result<ReadColumns, Error>,
}

const COLUMNS: Source = Source { name: columns::NAME, read: columns::read };
const TOPICS: Source = Source { name: topics::NAME, read: topics::read };

/// Imports the recordings of a mapping from CSV files.
///
/// # Errors
/// [`Error`] of the mapping or of a calibration. Damaged trials are listed in `failures`.
pub(crate) fn import_columns(path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    import::<Plane>(&COLUMNS, path, progress)
}

/// Imports the recordings of a mapping from CSV files, in space.
///
/// # Errors
/// As [`import_columns`].
pub(crate) fn import_columns_in_space(path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    import::<Space>(&COLUMNS, path, progress)
}

/// Imports the recordings of a mapping from rosbag2 folders or MCAP files.
///
/// # Errors
/// As [`import_columns`].
pub(crate) fn import_topics(path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    import::<Plane>(&TOPICS, path, progress)
}

/// Imports the recordings of a mapping from rosbag2 folders or MCAP files, in space.
///
/// # Errors
/// As [`import_columns`].
pub(crate) fn import_topics_in_space(path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    import::<Space>(&TOPICS, path, progress)
}

fn import<G: Geometry>(source: &Source, path: &Path, progress: Progress<'_>) -> Result<Imported, Error> {
    let mapping = Mapping::<G>::read(path)?;
    let laboratory = Laboratory { format: source.name, path, whisker: mapping.whisker(path)?, mapping: &mapping };
    let mut imported = Imported::default();
    let mut sampled = Vec::new();
    for (done, entry) in mapping.recordings.iter().enumerate() {
        progress(done as u64, mapping.recordings.len() as u64);
        match Sampled::read(&laboratory, source, entry).and_then(|recording| {
            check_new(&laboratory, done, &recording, &sampled)?;
            Ok(recording)
        }) {
            Ok(recording) => sampled.push(recording),
            // All moments may depend on a calibration.
            Err(error) if entry.role == Role::Calibration => return Err(error),
            Err(error) => imported.failures.push(error),
        }
    }
    if sampled.is_empty() {
        return Ok(imported);
    }
    let usual = usual(&sampled);
    sampled.iter_mut().for_each(|recording| recording.mark_glitches(usual));
    let touch = mapping.reading.touch().unwrap_or_else(|| rest::touch(usual));
    imported.notes.extend(other_rests(&sampled, touch));
    let (sensor, remark) = G::sensor(&laboratory, &sampled, touch)?;
    let (mut not_found, mut weak) = (Vec::new(), Vec::new());
    for recording in &sampled {
        match G::add_trace(&laboratory, &sensor, recording, &mut imported) {
            Ok(lacking) => {
                let of = |rows: usize| (rows > 0).then(|| format!("{} ({rows})", recording.entry.name()));
                not_found.extend(of(lacking.not_found));
                weak.extend(of(lacking.weak));
                imported.notes.extend(recording.notes(touch));
            }
            Err(error) => imported.failures.push(error),
        }
    }
    if !not_found.is_empty() {
        imported.notes.push(format!(
            "rows without a contact, since no contact with the pin agrees with the reading; check `contact`, `base` and `whisker` in \
             the mapping; recordings (rows): {}",
            not_found.join(", ")
        ));
    }
    if !weak.is_empty() {
        imported.notes.push(format!(
            "rows without a contact, since the reading exceeds `touch` ({touch:.3e}), but is far smaller than that of a whisker deflected \
             by the contact: the whisker is probably free, and oscillates or is accelerated; raise `touch`, or state a column `touching`; if \
             it does touch, check `contact`, `base` and `whisker`; \
             recordings (rows): {}",
            weak.join(", ")
        ));
    }
    match remark {
        Some(Remark { text, is_warning: true }) => imported.warnings.push(text),
        Some(Remark { text, .. }) => imported.notes.push(text),
        None => {}
    }
    Ok(imported)
}

/// Checks that the recording at this place of the mapping is none of those before it: a copy of a calibration would not be held
/// out, one of a trial be scored twice.
fn check_new<G: Geometry>(
    laboratory: &Laboratory<'_, G>,
    place: usize,
    recording: &Sampled<'_, G>,
    before: &[Sampled<'_, G>],
) -> Result<(), Error> {
    let Some(same) = before.iter().find(|before| before.sha256 == recording.sha256) else { return Ok(()) };
    let (key, found) = (format!("recordings[{place}].file"), same.entry.name());
    Err(Error::value(
        laboratory.path,
        key,
        format!("the same content as the recording `{found}`"),
        "each recording once",
    ))
}

/// Largest reading relative to rest of the calibration, without glitches; of all recordings if there is no calibration. A trial
/// has no influence on the calibration.
fn usual<G: Geometry>(sampled: &[Sampled<'_, G>]) -> f64 {
    let of = |recordings: &mut dyn Iterator<Item = &Sampled<'_, G>>| recordings.map(Sampled::largest).reduce(f64::max);
    let is_calibration = |recording: &&Sampled<'_, G>| recording.entry.role == Role::Calibration;
    of(&mut sampled.iter().filter(is_calibration)).or_else(|| of(&mut sampled.iter())).unwrap_or_default()
}

/// Remarks about recordings whose reading at rest differs from the median of all recordings as in a touch.
fn other_rests<G: Geometry>(sampled: &[Sampled<'_, G>], touch: f64) -> Vec<String> {
    let rests: Vec<Vec<f64>> = sampled.iter().map(Sampled::rest).collect();
    let usual = |channel: usize| rest::median(rests.iter().map(|rest| rest[channel]).collect());
    let usual: Vec<f64> = (0..rests[0].len()).map(usual).collect();
    let apart = |rest: &[f64]| rest.iter().zip(&usual).map(|(rest, usual)| rest - usual).fold(0.0, f64::hypot);
    let others = sampled.iter().zip(&rests).map(|(recording, rest)| (recording, apart(rest)));
    let remark = |(recording, apart): (&Sampled<'_, G>, f64)| {
        let name = recording.entry.name();
        format!(
            "{name}: reading at rest: found {apart:.3e} from the median of all recordings, expected at most {touch:.3e} (`touch`); the \
             whisker must be free at the start"
        )
    };
    others.filter(|(_, apart)| *apart > touch).map(remark).collect()
}

/// Mapping and whisker, common to all recordings.
pub(crate) struct Laboratory<'a, G: Geometry> {
    format: &'static str,
    /// Path of the mapping.
    path: &'a Path,
    mapping: &'a Mapping<G>,
    whisker: Whisker,
}

/// Hash of the sources that determine a trace.
fn source_sha256() -> String {
    let mut sources = Digest::default();
    for source in [
        &include_bytes!("mod.rs")[..],
        include_bytes!("columns.rs"),
        include_bytes!("mapping.rs"),
        include_bytes!("parameters.rs"),
        include_bytes!("plane/contact.rs"),
        include_bytes!("plane/conversion.rs"),
        include_bytes!("plane/mapping.rs"),
        include_bytes!("plane/mod.rs"),
        include_bytes!("quantity.rs"),
        include_bytes!("recording.rs"),
        include_bytes!("rest.rs"),
        include_bytes!("series.rs"),
        include_bytes!("space/contact.rs"),
        include_bytes!("space/mapping.rs"),
        include_bytes!("space/mod.rs"),
        include_bytes!("space/orientation.rs"),
        include_bytes!("space/pin.rs"),
        include_bytes!("space/response.rs"),
        include_bytes!("topics.rs"),
        include_bytes!("units.rs"),
    ] {
        sources.add(source);
    }
    sources.finish()
}
