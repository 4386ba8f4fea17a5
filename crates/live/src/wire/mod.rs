//! Messages of a stream as JSON lines: those between an evaluation and an external program, the other way round. They are
//! specified in `docs/LIVE.md`. Those of streams in space are in the module `space`.

mod space;

use std::fmt;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use strict_json::{parse_json, reason, shown};
use testbed::protocol::space::SpatialAnswerLine;
use testbed::protocol::{AnswerLine, BaseNoiseLine, ContactPriorLine};
use whisker::Whisker;
use whisker::frames::{Base, Pose, World};

use crate::estimator::{Answer, SpatialAnswer};
pub use space::{SpatialGiven, SpatialLine, SpatialPriorLine, SpatialSampleLine, parse as parse_in_space};

/// Keys that only the first line of a whisker has.
const PRIOR_KEYS: [&str; 3] = ["protocol", "rate_hz", "noise_sd_n_m"];

/// Largest magnitude of counts.
const MOST_COUNTS: f64 = 1e10;

/// Largest magnitude of a coordinate (m) and of a yaw (rad): differences of larger ones lose all meaning.
const MOST: f64 = 1e9;

/// First line of a whisker: prior information. Keys of the protocol that the calibration determines are read but not used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PriorLine {
    /// Version of the protocol.
    pub protocol: u32,
    /// Name of the whisker, if there are several.
    #[serde(default)]
    pub name: Option<String>,
    /// Seed for methods that draw random numbers.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Readings per second.
    pub rate_hz: f64,
    /// Standard deviation of the measurement noise. Missing: that of the sensor.
    #[serde(default)]
    pub noise_sd_n_m: Option<f64>,
    /// Name of the sensor in the calibration, `array.sensor`, whose counts are sent. Missing: the calibration has one alone.
    #[serde(default)]
    pub sensor: Option<String>,
    /// Duration of the zeroing at the beginning, with a free whisker (s). Missing: [`crate::counts::ZEROING_S`].
    #[serde(default)]
    pub zeroing_s: Option<f64>,
    /// Number of values of a counter that wraps. Missing: the counts do not wrap.
    #[serde(default)]
    pub modulo: Option<f64>,
    /// Noise of the poses. Missing: none.
    #[serde(default)]
    pub base_noise: Option<BaseNoiseLine>,
    /// Prior of the first contact.
    #[serde(default)]
    pub told: Option<ContactPriorLine>,
    /// Parameters of the whisker, which must be those of the calibration.
    #[serde(default)]
    pub whisker: Option<Whisker>,
    /// Undeflected whisker; not used.
    #[serde(default)]
    pub rest: Option<Value>,
    /// Calibrated faces; not used.
    #[serde(default)]
    pub faces: Option<Value>,
}

/// Later line: a reading, a pose, or both at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleLine<R = Given, P = Pose<Base, World>> {
    /// Name of the whisker, if there are several.
    pub name: Option<String>,
    /// Time.
    pub t_s: f64,
    /// Reading of the sensor.
    pub reading: Option<R>,
    /// Pose of the base in a frame at rest.
    pub base: Option<P>,
}

/// Reading of a line in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Given {
    /// Moment at the root (N m).
    Moment(f64),
    /// Counts of the sensor and, if given, those of the reference sensor along x and y of Base.
    Counts(f64, Option<[f64; 2]>),
}

/// Line of a stream.
#[derive(Clone, Debug, PartialEq)]
pub enum Line<Q = PriorLine, R = Given, P = Pose<Base, World>> {
    /// Prior information.
    Prior(Box<Q>),
    /// Reading, pose or both.
    Sample(SampleLine<R, P>),
}

/// All keys of a later line. Those of the protocol that follow from the poses are read but not used.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    #[serde(default)]
    name: Option<String>,
    t_s: f64,
    #[serde(default)]
    reading_n_m: Option<f64>,
    #[serde(default)]
    counts: Option<f64>,
    #[serde(default)]
    reference_counts: Option<[f64; 2]>,
    #[serde(default)]
    base_x_m: Option<f64>,
    #[serde(default)]
    base_y_m: Option<f64>,
    #[serde(default)]
    base_yaw_rad: Option<f64>,
    #[serde(default)]
    dt_s: Option<f64>,
    #[serde(default)]
    last_x_m: Option<f64>,
    #[serde(default)]
    last_y_m: Option<f64>,
    #[serde(default)]
    last_yaw_rad: Option<f64>,
    #[serde(default)]
    touched: Option<Value>,
}

/// Error of a line that is no message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadLine {
    /// Column, from 1 on. `None` if the problem has no single place.
    pub column: Option<usize>,
    /// The text found and the text expected, in one sentence.
    pub reason: String,
    /// Whether a number is not finite.
    pub is_not_finite: bool,
}

impl fmt::Display for BadLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.column.iter().try_for_each(|column| write!(f, "column {column}: "))?;
        f.write_str(&self.reason)
    }
}

/// Parses a line.
///
/// # Errors
/// [`BadLine`] if it is no message.
pub fn parse(line: &str) -> Result<Line, BadLine> {
    if is_prior(line) {
        return Ok(Line::Prior(Box::new(strict(line)?)));
    }
    let keys: Keys = strict(line)?;
    check_pose(&[("base_x_m", keys.base_x_m), ("base_y_m", keys.base_y_m), ("base_yaw_rad", keys.base_yaw_rad)])?;
    let [reference_x, reference_y] = keys.reference_counts.map_or([None; 2], |counts| counts.map(Some));
    let counts = [("counts", keys.counts), ("reference_counts", reference_x), ("reference_counts", reference_y)];
    check_magnitudes(&counts, MOST_COUNTS)?;
    let reading = match (keys.reading_n_m, keys.counts, keys.reference_counts) {
        (Some(n_m), None, None) => Some(Given::Moment(n_m)),
        (None, Some(counts), reference) => Some(Given::Counts(counts, reference)),
        (None, None, None) => None,
        (Some(_), _, _) => return Err(unplaced("found reading_n_m and counts, expected one of the two")),
        (None, None, Some(_)) => return Err(unplaced("found reference_counts alone, expected counts beside them")),
    };
    let base = match (keys.base_x_m, keys.base_y_m, keys.base_yaw_rad) {
        (Some(x_m), Some(y_m), Some(yaw_rad)) => Some(Pose::new(x_m, y_m, yaw_rad)),
        (None, None, None) => None,
        _ => return Err(unplaced("found a part of a pose, expected all of base_x_m, base_y_m and base_yaw_rad")),
    };
    if reading.is_none() && base.is_none() {
        return Err(unplaced(
            "found neither a reading nor a pose, expected reading_n_m or counts, or base_x_m, base_y_m and base_yaw_rad, or both",
        ));
    }
    Ok(Line::Sample(SampleLine { name: keys.name, t_s: keys.t_s, reading, base }))
}

/// Whether a line is the first one of a whisker, or was meant to be: a line that contains one of its keys but is not valid JSON is
/// reported as a faulty first line.
fn is_prior(line: &str) -> bool {
    let has_key = |value: Value| PRIOR_KEYS.iter().any(|key| value.get(key).is_some());
    PRIOR_KEYS.iter().any(|key| line.contains(key)) && serde_json::from_str(line).map_or(true, has_key)
}

/// An answer that is written as a line.
pub trait Written {
    /// The line.
    type Line: Serialize;

    /// Answer to a reading of the whisker with this name.
    fn line(&self, name: Option<&str>) -> Self::Line;
}

impl Written for Answer {
    type Line = AnswerLine;

    fn line(&self, name: Option<&str>) -> AnswerLine {
        AnswerLine {
            name: name.map(Into::into),
            t_s: Some(self.t_s),
            status: Some(self.status.name().into()),
            base_x_m: self.base.map(|base| base.origin().x()),
            base_y_m: self.base.map(|base| base.origin().y()),
            base_yaw_rad: self.base.map(|base| base.yaw_rad()),
            ..AnswerLine::new(self.estimate.as_ref())
        }
    }
}

impl Written for SpatialAnswer {
    type Line = SpatialAnswerLine;

    fn line(&self, name: Option<&str>) -> SpatialAnswerLine {
        let turn = self.base.map(|base| base.rotation.into_inner());
        SpatialAnswerLine {
            name: name.map(Into::into),
            t_s: Some(self.t_s),
            status: Some(self.status.name().into()),
            base_x_m: self.base.map(|base| base.position.x),
            base_y_m: self.base.map(|base| base.position.y),
            base_z_m: self.base.map(|base| base.position.z),
            base_qw: turn.map(|turn| turn.w),
            base_qx: turn.map(|turn| turn.i),
            base_qy: turn.map(|turn| turn.j),
            base_qz: turn.map(|turn| turn.k),
            ..SpatialAnswerLine::new(self.estimate.as_ref())
        }
    }
}

/// Checks the magnitudes of coordinates and angles with their keys.
fn check_pose(numbers: &[(&str, Option<f64>)]) -> Result<(), BadLine> {
    check_magnitudes(numbers, MOST)
}

/// Checks that numbers with their keys have at most this magnitude.
fn check_magnitudes(numbers: &[(&str, Option<f64>)], most: f64) -> Result<(), BadLine> {
    let is_large = |number: &f64| number.abs() > most;
    let large = numbers.iter().find_map(|(key, number)| Some((key, number.filter(is_large)?)));
    large.map_or(Ok(()), |(key, number)| {
        Err(unplaced(&format!("{key}: found {number:e}, expected a magnitude of at most {most:e}")))
    })
}

fn unplaced(reason: &str) -> BadLine {
    BadLine { column: None, reason: reason.into(), is_not_finite: false }
}

fn strict<T: DeserializeOwned + Serialize>(line: &str) -> Result<T, BadLine> {
    parse_json(line.as_bytes()).map_err(|error| {
        let column = Some(error.column()).filter(|column| *column > 0);
        if let Some(number) = column.and_then(|column| number_at(line, column))
            && is_not_finite(number, &error)
        {
            let reason = format!("found `{}`, expected a finite number", shown(number));
            return BadLine { column, reason, is_not_finite: true };
        }
        let reason = reason(&error);
        let expected = "expected messages are JSON objects with t_s and a reading or a pose, or the first line of a whisker \
            (docs/LIVE.md)";
        BadLine { column, reason: format!("{}; {expected}", shown(&reason)), is_not_finite: false }
    })
}

/// The value at this column of an object or a list: the text between its colon, comma or bracket and the next.
fn number_at(line: &str, column: usize) -> Option<&str> {
    let place = column.min(line.len());
    let start = line.get(..place)?.rfind([':', ',', '['])? + 1;
    let value = line[start..].split([',', '}', ']']).next()?;
    Some(value.trim())
}

/// Whether a text stands for a number that is not finite.
fn is_not_finite(text: &str, error: &serde_json::Error) -> bool {
    let word = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    ["nan", "inf", "infinity"].contains(&word.as_str()) || error.to_string().starts_with("number out of range")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bad(line: &str) -> String {
        parse(line).unwrap_err().to_string()
    }

    #[test]
    fn verif_lines_are_parsed() {
        let sample = |line| match parse(line) {
            Ok(Line::Sample(sample)) => sample,
            other => panic!("{other:?}"),
        };
        let reading = sample(r#"{"name": "left_1", "t_s": 0.5, "reading_n_m": -1e-5}"#);
        let moment = Some(Given::Moment(-1e-5));
        assert_eq!((reading.name.as_deref(), reading.reading, reading.base), (Some("left_1"), moment, None));
        let counts = sample(r#"{"t_s": 0.5, "counts": 512}"#);
        assert_eq!((counts.reading, counts.base), (Some(Given::Counts(512.0, None)), None));
        let beside = sample(r#"{"t_s": 0.5, "counts": -3.5, "reference_counts": [1, -2]}"#);
        assert_eq!(beside.reading, Some(Given::Counts(-3.5, Some([1.0, -2.0]))));
        let pose = sample(r#"{"t_s": 0.5, "base_x_m": 1, "base_y_m": 2, "base_yaw_rad": 3}"#);
        assert_eq!((pose.reading, pose.base), (None, Some(Pose::new(1.0, 2.0, 3.0))));
        let row = r#"{"t_s":1,"dt_s":0.004,"base_x_m":1,"base_y_m":2,"base_yaw_rad":3,"last_x_m":0,"last_y_m":0,
            "last_yaw_rad":0,"reading_n_m":1e-6,"touched":"left"}"#;
        let both = sample(row);
        assert!(both.reading.is_some() && both.base.is_some());
        let prior = parse(r#"{"protocol": 1, "rate_hz": 250, "noise_sd_n_m": 1e-7}"#);
        assert!(matches!(prior, Ok(Line::Prior(prior)) if prior.rate_hz == 250.0 && prior.told.is_none()));
        let prior = parse(r#"{"protocol": 1, "rate_hz": 250, "sensor": "a.s", "zeroing_s": 0.3, "modulo": 65536}"#);
        assert!(
            matches!(prior, Ok(Line::Prior(prior)) if prior.noise_sd_n_m.is_none() && prior.zeroing_s == Some(0.3))
        );
        assert!(matches!(parse(r#"{"name": "protocol", "t_s": 0, "reading_n_m": 0}"#), Ok(Line::Sample(_))));
    }

    #[test]
    fn robust_numbers_that_are_not_finite_are_named_with_their_column() {
        for (value, column) in [("NaN", 23), ("-Infinity", 24), ("1e999", 28), ("inf", 23)] {
            let error = parse(&format!(r#"{{"t_s":1,"reading_n_m":{value}}}"#)).unwrap_err();
            assert!(error.is_not_finite, "{value}: {error}");
            assert!(error.to_string().ends_with(&format!("found `{value}`, expected a finite number")), "{error}");
            assert!(error.column.is_some_and(|found| found.abs_diff(column) <= 3), "{value}: {error}");
        }
    }

    #[test]
    fn robust_lines_that_are_no_messages_are_refused() {
        let nonsense = bad("nonsense");
        assert!(
            nonsense.starts_with("column 2: expected a JSON value; expected messages are JSON objects"),
            "{nonsense}"
        );
        assert!(bad("").contains("messages are JSON objects"));
        assert!(bad("[1, 2]").contains("messages are JSON objects"));
        assert!(bad(r#"{"t_s": 1}"#).starts_with("found neither a reading nor a pose"));
        assert!(bad(r#"{"t_s": 1, "base_x_m": 0}"#).starts_with("found a part of a pose"));
        let far = bad(r#"{"t_s": 1, "base_x_m": 0, "base_y_m": -1e308, "base_yaw_rad": 0}"#);
        assert_eq!(far, "base_y_m: found -1e308, expected a magnitude of at most 1e9");
        let both = bad(r#"{"t_s": 1, "reading_n_m": 0, "counts": 0}"#);
        assert_eq!(both, "found reading_n_m and counts, expected one of the two");
        assert!(bad(r#"{"t_s": 1, "reference_counts": [0, 0]}"#).starts_with("found reference_counts alone, expected"));
        assert!(bad(r#"{"t_s": 1, "counts": 0, "reference_counts": [0]}"#).contains("expected"));
        let large = bad(r#"{"t_s": 1, "counts": 1e300}"#);
        assert_eq!(large, "counts: found 1e300, expected a magnitude of at most 1e10");
        assert!(bad(r#"{"t_s": 1, "reading": 0}"#).contains("unknown field `reading`"));
        assert!(bad(r#"{"t_s": 1, "t_s": 1, "reading_n_m": 0}"#).contains("t_s"));
        assert!(bad(r#"{"protocol": 1}"#).contains("missing field `rate_hz`"));
        assert!(bad(r#"{"protocol": 1, "rate_hz": 250"#).contains("found the end within an object"));
        assert!(bad(r#"{"protocol": 1, "rate_hz": NaN}"#).contains("found `NaN`, expected a finite number"));
        assert!(bad(r#"{"rate_hz": 250, "noise_sd_n_m": 1e-7}"#).contains("missing field `protocol`"));
    }
}
