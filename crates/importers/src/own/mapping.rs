//! Mapping: names, units, signs and frames of the columns of a recording.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::path::{Path, PathBuf};

use files::{Error, read_json};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use signal::LONGEST_GAP_S;
use trace::{ObjectClass, RATES_HZ, Role, StatedSuspension, is_plain_name};
use whisker::Whisker;
use whisker::sensor::Face;

use super::Geometry;
use super::parameters::StatedWhisker;
use super::units::{Reading, Time};

/// Longest gap that is interpolated.
const MOST_GAP_S: f64 = 60.0;

/// Mapping file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, bound = "G: Geometry")]
pub(crate) struct Mapping<G: Geometry> {
    format: u32,
    kind: String,
    whisker: StatedWhisker,
    /// Springs at the root, in space.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) suspension: Option<StatedSuspension>,
    /// Poisson ratio of the wire, in space.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) poisson_ratio: Option<f64>,
    /// Rate of the traces.
    pub(crate) rate_hz: f64,
    /// Separator of the columns of a CSV.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    delimiter: Option<char>,
    /// Lines of a CSV before its header.
    #[serde(default)]
    skip_lines: usize,
    /// Times of a CSV. `None` if the rows follow each other at the rate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<TimeColumn>,
    /// Times of a bag.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    stamps: Option<Stamps>,
    /// Longest interval that is interpolated. `None` for [`LONGEST_GAP_S`], or two intervals at the rate if they are longer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    longest_gap_s: Option<f64>,
    #[serde(default)]
    gaps: Gaps,
    pub(crate) pose: G::Pose,
    /// Base in the frame whose pose is recorded; if the object moves, in the frame of the positions.
    #[serde(default)]
    pub(crate) base: G::Base,
    pub(crate) reading: G::Reading,
    /// True contact of the recordings that state none themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    contact: Option<G::Contact>,
    pub(crate) recordings: Vec<RecordingEntry<G>>,
}

/// Part of a mapping whose quantities may be columns.
pub(crate) trait Keys: Clone + Debug + Serialize + DeserializeOwned {
    /// Names of the columns.
    fn columns(&self) -> Vec<&str>;

    /// Checks the values of the part with this key.
    ///
    /// # Errors
    /// [`Error::Value`] with file and key.
    fn validate(&self, path: &Path, key: &str) -> Result<(), Error>;
}

/// The reading of a sensor: one column for each channel.
pub(crate) trait Channels: Keys {
    /// Unit of the channels.
    fn unit(&self) -> Reading;

    /// Readings of the free whisker, and the standard deviations of the noise, of a channel, where they are stated.
    fn stated(&self, channel: usize) -> StatedAtRest;

    /// Duration at the start of each recording in which the whisker is free.
    fn rest_s(&self) -> Option<f64>;

    /// Distance from rest, in the unit of the reading, beyond which the whisker touches.
    fn touch(&self) -> Option<f64>;
}

/// Reading of the free whisker and standard deviation of the noise, in the unit of the reading, if stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StatedAtRest {
    pub(crate) rest: Option<f64>,
    pub(crate) noise_sd: Option<f64>,
}

/// Column of the times.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TimeColumn {
    pub(crate) column: String,
    pub(crate) unit: Time,
}

/// Source of the times of a bag.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Stamps {
    /// Time at which a message was recorded.
    Log,
    /// Stamp in the header of a frame, or of the message.
    Header,
}

/// Treatment of intervals longer than the longest gap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Gaps {
    /// The recording is not imported.
    #[default]
    Refuse,
    /// The trace has no rows there.
    Leave,
}

/// Body whose pose is recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Moving {
    /// The whisker, or what carries it: a flange, a stage.
    #[default]
    Whisker,
    /// The object, past a whisker at rest.
    Object,
}

/// Layout of the files, and resampling to equal intervals.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout<'a> {
    /// Rate of the traces.
    pub(crate) rate_hz: f64,
    /// Separator of the columns of a CSV.
    pub(crate) delimiter: char,
    /// Lines of a CSV before its header.
    pub(crate) skip_lines: usize,
    /// Times of a CSV. `None` if the rows follow each other at the rate.
    pub(crate) time: Option<&'a TimeColumn>,
    /// Times of a bag.
    pub(crate) stamps: Option<Stamps>,
    /// Longest interval that is interpolated. At a low rate, the intervals of a recording exceed [`LONGEST_GAP_S`].
    pub(crate) longest_gap_s: f64,
    pub(crate) gaps: Gaps,
}

/// Suffix of the names of outlines, before the extension.
const OUTLINE_SUFFIX: &str = ".contour";

/// A recording to import.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, bound = "G: Geometry")]
pub(crate) struct RecordingEntry<G: Geometry> {
    /// Path, relative to the mapping file.
    file: PathBuf,
    /// Name of the trace. `None` for the name of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    pub(crate) role: Role,
    /// Side of the whisker on which the object lies, in the plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) face: Option<Face>,
    #[serde(default = "pin")]
    pub(crate) object: String,
    /// Group of trials that are scored together. `None` for the name of the object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    group: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    object_class: Option<ObjectClass>,
    /// True contact, in World. `None` if unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) contact: Option<G::Contact>,
    /// Column that is 1 while the whisker touches, else 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) touching: Option<String>,
}

fn pin() -> String {
    "pin".into()
}

impl<G: Geometry> RecordingEntry<G> {
    pub(crate) fn path(&self, mapping: &Path) -> PathBuf {
        mapping.parent().unwrap_or(Path::new("")).join(&self.file)
    }

    pub(crate) fn name(&self) -> String {
        let stem = || self.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        self.name.clone().unwrap_or_else(stem)
    }

    pub(crate) fn group(&self) -> &str {
        self.group.as_deref().unwrap_or(&self.object)
    }

    pub(crate) fn class(&self) -> ObjectClass {
        self.object_class.unwrap_or_else(|| ObjectClass::of_shape(&self.object))
    }

    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        let name = self.name();
        for (part, text) in [("name", name.as_str()), ("object", &self.object), ("group", self.group())] {
            if !is_plain_name(text) {
                return Err(Error::value(path, format!("{key}.{part}"), format!("`{text}`"), "a plain file name"));
            }
        }
        if name.ends_with(OUTLINE_SUFFIX) {
            let expected = format!("a name that does not end in `{OUTLINE_SUFFIX}`, which is reserved for outlines");
            return Err(Error::value(path, format!("{key}.name"), format!("`{name}`"), expected));
        }
        self.contact.as_ref().map_or(Ok(()), |contact| contact.validate(path, &format!("{key}.contact")))
    }
}

impl<G: Geometry> Mapping<G> {
    /// Reads and checks a mapping file.
    ///
    /// # Errors
    /// [`Error`] with file and place.
    pub(crate) fn read(path: &Path) -> Result<Self, Error> {
        if path.is_dir() {
            return Err(Error::value(path, "path", "a folder", "a mapping file (JSON), see docs/own-data.md"));
        }
        // Before the keys, which differ.
        let format = read_json::<Value>(path)?.get("format").cloned().unwrap_or_default();
        if format != G::FORMAT {
            return Err(Error::value(path, "format", format, G::FORMAT_EXPECTED));
        }
        let mut mapping: Self = read_json(path)?;
        // Before the common contact is given to the recordings, so that an error names the place at which it is stated.
        mapping.validate(path)?;
        let contact = mapping.contact.take();
        for recording in &mut mapping.recordings {
            recording.contact = recording.contact.take().or_else(|| contact.clone());
        }
        Ok(mapping)
    }

    /// Layout of the files.
    pub(crate) fn layout(&self) -> Layout<'_> {
        Layout {
            rate_hz: self.rate_hz,
            delimiter: self.delimiter.unwrap_or(','),
            skip_lines: self.skip_lines,
            time: self.time.as_ref(),
            stamps: self.stamps,
            longest_gap_s: self.longest_gap_s.unwrap_or(LONGEST_GAP_S.max(2.0 / self.rate_hz)),
            gaps: self.gaps,
        }
    }

    /// The whisker.
    ///
    /// # Errors
    /// [`Error::Value`] names the parameter that is missing, invalid or implausible.
    pub(crate) fn whisker(&self, path: &Path) -> Result<Whisker, Error> {
        let whisker = self.whisker.whisker(path)?;
        if !is_plain_name(&whisker.name) {
            return Err(Error::value(path, "whisker.name", format!("`{}`", whisker.name), "a plain file name"));
        }
        let invalid =
            |error: whisker::Invalid| Error::value(path, format!("whisker.{}", error.key), error.found, error.expected);
        whisker.validate().and_then(|()| whisker.check_plausible()).map_err(invalid)?;
        Ok(whisker)
    }

    fn validate(&self, path: &Path) -> Result<(), Error> {
        if self.kind != "import" {
            return Err(Error::value(path, "kind", format!("`{}`", self.kind), "`import`"));
        }
        let [least_hz, most_hz] = RATES_HZ;
        if !(least_hz..=most_hz).contains(&self.rate_hz) {
            return Err(Error::value(path, "rate_hz", self.rate_hz, format!("{least_hz} to {most_hz}")));
        }
        let interval_s = 1.0 / self.rate_hz;
        let most_s = MOST_GAP_S.max(interval_s);
        if let Some(found) = self.longest_gap_s.filter(|found| !(interval_s..=most_s).contains(found)) {
            let expected = format!("{interval_s}, the interval at `rate_hz`, to {most_s}");
            return Err(Error::value(path, "longest_gap_s", found, expected));
        }
        if let Some(found) = self.delimiter.filter(|delimiter| !delimiter.is_ascii()) {
            return Err(Error::value(path, "delimiter", format!("`{found}`"), "an ASCII character"));
        }
        self.pose.validate(path, "pose")?;
        self.base.validate(path, "base")?;
        self.reading.validate(path, "reading")?;
        self.contact.as_ref().map_or(Ok(()), |contact| contact.validate(path, "contact"))?;
        if self.recordings.is_empty() {
            return Err(Error::value(path, "recordings", "none", "at least one"));
        }
        let mut names = BTreeSet::new();
        for (i, recording) in self.recordings.iter().enumerate() {
            let key = format!("recordings[{i}]");
            recording.validate(path, &key)?;
            if !names.insert(recording.name()) {
                let found = format!("`{}` twice", recording.name());
                return Err(Error::value(path, format!("{key}.name"), found, "each name once"));
            }
        }
        G::validate(self, path)?;
        self.whisker(path).map(|_| ())
    }
}

/// Checks the stated readings of the free whisker and their noise: no number may be negative, except for `rest`.
pub(crate) fn validate_at_rest(path: &Path, key: &str, reading: &impl Channels) -> Result<(), Error> {
    let key = |name: &str| format!("{key}.{name}");
    let stated: Vec<StatedAtRest> = (0..reading.columns().len()).map(|channel| reading.stated(channel)).collect();
    let noise = stated.iter().map(|stated| ("noise_sd", stated.noise_sd));
    for (name, found) in [("rest_s", reading.rest_s())].into_iter().chain(noise).chain([("touch", reading.touch())]) {
        if let Some(found) = found.filter(|found| !(found.is_finite() && *found >= 0.0)) {
            return Err(Error::value(path, key(name), found, "a number of 0 or more"));
        }
    }
    let is_rest_stated = stated.iter().any(|stated| stated.rest.is_some());
    let rest_s = reading.rest_s();
    if is_rest_stated && rest_s.is_some() {
        return Err(Error::value(path, key("rest"), "`rest` and `rest_s`", "one of them"));
    }
    if reading.unit() == Reading::Counts && !is_rest_stated && rest_s.is_none() {
        let expected =
            "`rest`, the counts of the free whisker, or `rest_s`, the duration for which it is free at first";
        return Err(Error::value(path, key("rest"), "none", expected));
    }
    if rest_s.is_none() && stated.iter().any(|stated| stated.noise_sd.is_none()) {
        let expected = "`noise_sd`, or `rest_s` to estimate it while the whisker is free";
        return Err(Error::value(path, key("noise_sd"), "none", expected));
    }
    Ok(())
}
