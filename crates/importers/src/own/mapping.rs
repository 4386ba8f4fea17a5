//! Mapping: names, units, signs and frames of the columns of a recording.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use signal::LONGEST_GAP_S;
use trace::{FARTHEST_M, LARGEST, ObjectClass, RATES_HZ, Role, is_plain_name};
use whisker::Whisker;
use whisker::frames::Pose;
use whisker::sensor::Face;

use super::units::{Angle, Length, Reading, Time, Unit};

/// Longest gap that is interpolated.
const MOST_GAP_S: f64 = 60.0;

/// Largest degree of a fitted characteristic, which has three coefficients in a sidecar.
const MOST_DEGREE: usize = 3;

/// Mapping file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mapping {
    format: u32,
    kind: String,
    /// Name of a preset, an object with a `preset` and other values over it, or all parameters.
    whisker: Value,
    /// Rate of the traces.
    pub(crate) rate_hz: f64,
    /// Separator of the columns of a CSV.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) delimiter: Option<char>,
    /// Lines of a CSV before its header.
    #[serde(default)]
    pub(crate) skip_lines: usize,
    /// Times of a CSV. `None` if the rows follow each other at the rate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) time: Option<TimeColumn>,
    /// Times of a bag.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stamps: Option<Stamps>,
    /// Longest interval that is interpolated. `None` for [`LONGEST_GAP_S`], or two intervals at the rate if they are longer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    longest_gap_s: Option<f64>,
    #[serde(default)]
    pub(crate) gaps: Gaps,
    pub(crate) pose: PoseColumns,
    /// Base in the frame whose pose is recorded; if the object moves, in the frame of the positions.
    #[serde(default)]
    base: Placement,
    pub(crate) reading: ReadingColumn,
    /// True contact of the recordings that state none themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    contact: Option<ContactColumns>,
    pub(crate) recordings: Vec<RecordingEntry>,
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

/// Columns of the pose.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PoseColumns {
    #[serde(default)]
    pub(crate) of: Moving,
    pub(crate) x: Quantity<Length>,
    pub(crate) y: Quantity<Length>,
    #[serde(default)]
    pub(crate) yaw: Quantity<Angle>,
}

/// Column, or a constant value, with its unit and sign.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Quantity<U> {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) column: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    unit: U,
    #[serde(default = "positive")]
    sign: f64,
}

fn positive() -> f64 {
    1.0
}

impl Quantity<Length> {
    fn zero() -> Self {
        Self { column: None, value: Some(0.0), unit: Length::M, sign: 1.0 }
    }

    /// Constant value in the unit of the mapping, with the sign. `None` for a column.
    fn stated(&self) -> Option<String> {
        let unit = serde_json::to_value(self.unit).expect("a unit serialises");
        self.value.map(|value| format!("{} {}", self.sign * value, unit.as_str().unwrap_or_default()))
    }
}

impl Default for Quantity<Angle> {
    fn default() -> Self {
        Self { column: None, value: Some(0.0), unit: Angle::Rad, sign: 1.0 }
    }
}

impl<U: Unit> Quantity<U> {
    /// SI units per unit of the column, with the sign.
    pub(crate) fn factor(&self) -> f64 {
        self.sign * self.unit.si()
    }

    /// Constant value in SI units. `None` for a column.
    pub(crate) fn constant(&self) -> Option<f64> {
        self.value.map(|value| self.factor() * value)
    }

    fn validate(&self, path: &Path, key: &str, most: f64) -> Result<(), Error> {
        check_sign(path, key, self.sign)?;
        match (&self.column, self.constant()) {
            (Some(_), None) => Ok(()),
            (None, Some(value)) if value.abs() <= most => Ok(()),
            (None, Some(value)) => {
                Err(Error::value(path, key, format!("{value} in SI units"), format!("a magnitude of at most {most}")))
            }
            (Some(_), Some(_)) => Err(Error::value(path, key, "`column` and `value`", "one of them")),
            (None, None) => Err(Error::value(path, key, "neither `column` nor `value`", "one of them")),
        }
    }

    fn validate_constant(&self, path: &Path, key: &str, most: f64) -> Result<(), Error> {
        self.validate(path, key, most)?;
        if self.column.is_some() {
            return Err(Error::value(path, key, "`column`", "a constant `value`"));
        }
        Ok(())
    }
}

fn check_sign(path: &Path, key: &str, sign: f64) -> Result<(), Error> {
    if sign.abs() != 1.0 {
        return Err(Error::value(path, format!("{key}.sign"), sign, "1 or -1"));
    }
    Ok(())
}

/// Constant pose.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Placement {
    x: Quantity<Length>,
    y: Quantity<Length>,
    #[serde(default)]
    yaw: Quantity<Angle>,
}

impl Default for Placement {
    fn default() -> Self {
        Self { x: Quantity::zero(), y: Quantity::zero(), yaw: Quantity::default() }
    }
}

/// Column of the sensor's reading, and its conversion to the moment.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReadingColumn {
    pub(crate) column: String,
    pub(crate) unit: Reading,
    #[serde(default = "positive")]
    pub(crate) sign: f64,
    /// Reading of the free whisker ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rest: Option<f64>,
    /// ... or the duration at the start of each recording in which the whisker is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rest_s: Option<f64>,
    /// Standard deviation of the noise, in the unit of the reading. `None` to estimate it while the whisker is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) noise_sd: Option<f64>,
    /// Distance from rest, in the unit of the reading, beyond which the whisker touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) touch: Option<f64>,
    /// Counts by powers of the moment (N m). `None` to fit them to the calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) characteristic: Option<[f64; 3]>,
    /// Degree of the fitted characteristic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) degree: Option<usize>,
}

/// A recording to import.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RecordingEntry {
    /// Path, relative to the mapping file.
    file: PathBuf,
    /// Name of the trace. `None` for the name of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    pub(crate) role: Role,
    pub(crate) face: Face,
    #[serde(default = "pin")]
    pub(crate) object: String,
    /// Group of trials that are scored together. `None` for the name of the object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    group: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    object_class: Option<ObjectClass>,
    /// True contact, in World. `None` if unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) contact: Option<ContactColumns>,
    /// Column that is 1 while the whisker touches, else 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) touching: Option<String>,
}

fn pin() -> String {
    "pin".into()
}

/// True contact: columns, or a known place.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ContactColumns {
    pub(crate) x: Quantity<Length>,
    pub(crate) y: Quantity<Length>,
    /// Radius of the pin whose axis the place is. `None` if the place is that of the contact itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    radius: Option<Quantity<Length>>,
}

impl ContactColumns {
    fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        self.x.validate(path, &format!("{key}.x"), FARTHEST_M)?;
        self.y.validate(path, &format!("{key}.y"), FARTHEST_M)?;
        let Some(radius) = &self.radius else { return Ok(()) };
        let key = format!("{key}.radius");
        radius.validate_constant(path, &key, FARTHEST_M)?;
        if self.radius_m().is_none_or(|radius_m| radius_m <= 0.0) {
            return Err(Error::value(path, key, radius.stated().unwrap_or_default(), "a positive radius"));
        }
        Ok(())
    }

    pub(crate) fn radius_m(&self) -> Option<f64> {
        self.radius.as_ref().and_then(Quantity::constant)
    }
}

impl RecordingEntry {
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
        self.contact.as_ref().map_or(Ok(()), |contact| contact.validate(path, &format!("{key}.contact")))
    }
}

impl Mapping {
    /// Reads and checks a mapping file.
    ///
    /// # Errors
    /// [`Error`] with file and place.
    pub(crate) fn read(path: &Path) -> Result<Self, Error> {
        if path.is_dir() {
            return Err(Error::value(path, "path", "a folder", "a mapping file (JSON), see docs/own-data.md"));
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

    /// Longest interval that is interpolated. At a low rate, the intervals of a recording exceed [`LONGEST_GAP_S`].
    pub(crate) fn longest_gap_s(&self) -> f64 {
        self.longest_gap_s.unwrap_or(LONGEST_GAP_S.max(2.0 / self.rate_hz))
    }

    /// The whisker.
    ///
    /// # Errors
    /// [`Error::Value`] names the parameter.
    pub(crate) fn whisker(&self, path: &Path) -> Result<Whisker, Error> {
        let preset = |name: &str| {
            let presets = [Whisker::straight(), Whisker::curved(), Whisker::stanford()];
            let known = presets.iter().map(|preset| preset.name.clone()).collect::<Vec<_>>().join(", ");
            let found = presets.into_iter().find(|preset| preset.name == name);
            found.ok_or_else(|| Error::value(path, "whisker", format!("`{name}`"), format!("one of: {known}")))
        };
        let whisker = match &self.whisker {
            Value::String(name) => preset(name)?,
            Value::Object(stated) => {
                let mut stated = stated.clone();
                let mut all = serde_json::Map::new();
                if let Some(found) = stated.remove("preset") {
                    let Some(name) = found.as_str() else {
                        return Err(Error::value(path, "whisker.preset", found, "the name of a preset"));
                    };
                    if let Ok(Value::Object(of_preset)) = serde_json::to_value(preset(name)?) {
                        all = of_preset;
                    }
                }
                all.extend(stated);
                serde_json::from_value(Value::Object(all)).map_err(|error| {
                    Error::value(path, "whisker", error, "the parameters of a whisker, or a `preset`")
                })?
            }
            other => return Err(Error::value(path, "whisker", other, "the name of a preset, or an object")),
        };
        if !is_plain_name(&whisker.name) {
            return Err(Error::value(path, "whisker.name", format!("`{}`", whisker.name), "a plain file name"));
        }
        let invalid =
            |error: whisker::Invalid| Error::value(path, format!("whisker.{}", error.key), error.found, error.expected);
        whisker.validate().map_err(invalid)?;
        Ok(whisker)
    }

    /// Pose of the base in the frame whose pose is recorded.
    pub(crate) fn base<From, To>(&self) -> Pose<From, To> {
        let Placement { x, y, yaw } = &self.base;
        let constant = |value: Option<f64>| value.unwrap_or_default();
        Pose::new(constant(x.constant()), constant(y.constant()), constant(yaw.constant()))
    }

    fn validate(&self, path: &Path) -> Result<(), Error> {
        if self.format != FORMAT {
            return Err(Error::value(path, "format", self.format, FORMAT));
        }
        if self.kind != "import" {
            return Err(Error::value(path, "kind", format!("`{}`", self.kind), "`import`"));
        }
        let within = |key: &str, found: f64, [least, most]: [f64; 2]| {
            if (least..=most).contains(&found) {
                return Ok(());
            }
            Err(Error::value(path, key, found, format!("{least} to {most}")))
        };
        within("rate_hz", self.rate_hz, RATES_HZ)?;
        let interval_s = 1.0 / self.rate_hz;
        let most_s = MOST_GAP_S.max(interval_s);
        if let Some(found) = self.longest_gap_s.filter(|found| !(interval_s..=most_s).contains(found)) {
            let expected = format!("{interval_s}, the interval at `rate_hz`, to {most_s}");
            return Err(Error::value(path, "longest_gap_s", found, expected));
        }
        if let Some(found) = self.delimiter.filter(|delimiter| !delimiter.is_ascii()) {
            return Err(Error::value(path, "delimiter", format!("`{found}`"), "an ASCII character"));
        }
        self.pose.x.validate(path, "pose.x", FARTHEST_M)?;
        self.pose.y.validate(path, "pose.y", FARTHEST_M)?;
        self.pose.yaw.validate(path, "pose.yaw", LARGEST)?;
        self.base.x.validate_constant(path, "base.x", FARTHEST_M)?;
        self.base.y.validate_constant(path, "base.y", FARTHEST_M)?;
        self.base.yaw.validate_constant(path, "base.yaw", LARGEST)?;
        self.reading.validate(path)?;
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
        self.whisker(path).map(|_| ())
    }
}

impl ReadingColumn {
    fn validate(&self, path: &Path) -> Result<(), Error> {
        let key = |name: &str| format!("reading.{name}");
        check_sign(path, "reading", self.sign)?;
        for (name, found) in [("rest_s", self.rest_s), ("noise_sd", self.noise_sd), ("touch", self.touch)] {
            if let Some(found) = found.filter(|found| !(found.is_finite() && *found >= 0.0)) {
                return Err(Error::value(path, key(name), found, "a number of 0 or more"));
            }
        }
        if self.rest.is_some() && self.rest_s.is_some() {
            return Err(Error::value(path, key("rest"), "`rest` and `rest_s`", "one of them"));
        }
        let is_raw = self.unit == Reading::Counts;
        if is_raw && self.rest.is_none() && self.rest_s.is_none() {
            let expected =
                "`rest`, the counts of the free whisker, or `rest_s`, the duration for which it is free at first";
            return Err(Error::value(path, key("rest"), "none", expected));
        }
        if self.rest_s.is_none() && self.noise_sd.is_none() {
            let expected = "`noise_sd`, or `rest_s` to estimate it while the whisker is free";
            return Err(Error::value(path, key("noise_sd"), "none", expected));
        }
        if !is_raw && (self.characteristic.is_some() || self.degree.is_some()) {
            return Err(Error::value(path, key("unit"), "a unit of moment", "`counts` for a characteristic"));
        }
        if self.characteristic.is_some() && self.degree.is_some() {
            return Err(Error::value(path, key("degree"), "`characteristic` and `degree`", "one of them"));
        }
        if let Some(found) = self.degree.filter(|degree| !(1..=MOST_DEGREE).contains(degree)) {
            return Err(Error::value(path, key("degree"), found, format!("1 to {MOST_DEGREE}")));
        }
        Ok(())
    }
}
