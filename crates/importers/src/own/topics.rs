//! Fields of the messages of a rosbag2 folder or MCAP file.
//!
//! A field is named as in PlotJuggler: the topic, then the path to the number, separated by slashes, for example
//! `/wrench/wrench/torque/z`. An element of a list is chosen by its index, `position[0]`, or by its name,
//! `position[elbow]` for joints and `transforms[tool]` for frames. The stamp of a frame is that in its own header. The yaw of a
//! quaternion is its field `yaw`. If the names of several topics begin a column, as `/arm` and `/arm/wrist` do, it belongs to the
//! longest.

use std::cell::OnceCell;
use std::path::Path;
use std::rc::Rc;

use bag::{Reader, Record};
use files::{Digest, Error};
use serde_json::Value;

use super::mapping::{Layout, Stamps};
use super::recording::{ReadColumns, Wanted};
use super::series::{Clock, Series};

pub(crate) const NAME: &str = "bag";

const S_PER_NS: f64 = 1e-9;

/// A wanted column with the values found so far.
struct Column<'a> {
    wanted: &'a Wanted<'a>,
    clock: Clock,
    values: Vec<Option<f64>>,
    has_topic: bool,
}

/// Reads fields of the messages of a recording.
pub(super) fn read(path: &Path, layout: &Layout<'_>, wanted: &[Wanted<'_>]) -> Result<ReadColumns, Error> {
    if layout.time.is_some() {
        return Err(Error::value(path, "time", "a column", "`stamps` for a bag: `log` or `header`"));
    }
    let reader = Reader::open(path).map_err(converted)?;
    let mut topics = Vec::new();
    let first = read_fields(&reader, path, layout, wanted, &mut topics);
    if first.is_err() {
        topics = topics_of(&reader)?;
    }
    // A column belongs to the topic with the longest name, which may appear after others.
    let is_ambiguous =
        |wanted: &Wanted<'_>| topics.iter().filter(|topic| within(wanted.name, topic).is_some()).count() > 1;
    if wanted.iter().any(is_ambiguous) { read_fields(&reader, path, layout, wanted, &mut topics) } else { first }
}

/// Reads fields of the messages with the known topics, to which those of the messages are added.
fn read_fields(
    reader: &Reader,
    path: &Path,
    layout: &Layout<'_>,
    wanted: &[Wanted<'_>],
    topics: &mut Vec<String>,
) -> Result<ReadColumns, Error> {
    let column = |wanted| Column { wanted, clock: Clock::default(), values: Vec::new(), has_topic: false };
    let mut columns: Vec<Column<'_>> = wanted.iter().map(column).collect();
    let (mut digest, mut first_ns, mut repeated) = (Digest::default(), None, 0);
    for record in reader.records() {
        let record = record.map_err(converted)?;
        if !topics.contains(&record.topic) {
            topics.push(record.topic.clone());
        }
        let mut message = None;
        for column in &mut columns {
            let Some(field) = field_of(column.wanted.name, &record.topic, topics) else { continue };
            column.has_topic = true;
            if message.is_none() {
                digest.add(&record.topic).add(record.time_ns.to_le_bytes()).add(&record.data);
                message = Some(decoded(&record)?);
            }
            let message = message.as_ref().expect("it was decoded");
            let Some(Found { value, stamp }) = value_at(&record, message, field, column.wanted)? else { continue };
            let time_ns = match layout.stamps {
                Some(Stamps::Header) => stamp_ns(&record, stamp.as_ref())?,
                _ => i128::from(record.time_ns),
            };
            let since_ns = time_ns - *first_ns.get_or_insert(time_ns);
            if column.clock.push(&record.file, record.number, since_ns as f64 * S_PER_NS)? {
                column.values.push(value);
            } else {
                repeated += 1;
            }
        }
    }
    for column in &columns {
        if !column.has_topic || column.values.is_empty() {
            let found = if column.has_topic { "no message with this field".into() } else { topics.join(", ") };
            return Err(Error::value(path, "topics", found, format!("the field `{}`", column.wanted.name)));
        }
    }
    Ok(ReadColumns { series: shared(columns), sha256: digest.finish(), repeated, is_cut_off: false, has_clock: true })
}

/// The series; those of one topic share their clock.
fn shared(columns: Vec<Column<'_>>) -> Vec<Series> {
    let mut clocks: Vec<Rc<Clock>> = Vec::new();
    let mut series = Vec::new();
    for Column { clock, values, .. } in columns {
        let known = clocks.iter().find(|known| ***known == clock).cloned();
        let clock = known.unwrap_or_else(|| Rc::new(clock));
        clocks.push(clock.clone());
        series.push(Series { clock, values });
    }
    series
}

/// Topics with messages, in order of their first one.
fn topics_of(reader: &Reader) -> Result<Vec<String>, Error> {
    let mut topics: Vec<String> = Vec::new();
    for record in reader.records() {
        let topic = record.map_err(converted)?.topic;
        if !topics.contains(&topic) {
            topics.push(topic);
        }
    }
    Ok(topics)
}

/// Path of a field within the messages of a topic. `None` if the field belongs to another one of the topics.
fn field_of<'a>(name: &'a str, topic: &str, topics: &[String]) -> Option<&'a str> {
    let field = within(name, topic)?;
    let is_shortest = topics.iter().filter_map(|other| within(name, other)).all(|other| other.len() >= field.len());
    is_shortest.then_some(field)
}

/// Path of a field if its name begins with this topic.
fn within<'a>(name: &'a str, topic: &str) -> Option<&'a str> {
    name.strip_prefix(topic)?.strip_prefix('/')
}

fn converted(error: bag::Error) -> Error {
    match error {
        bag::Error::Io { path, reason } => Error::Io { path, reason },
        bag::Error::Content { path, place, found, expected } => Error::Value { path, key: place, found, expected },
        bag::Error::Live { topic, reason } => Error::value(Path::new(&topic), "topic", reason, "a recording"),
    }
}

fn decoded(record: &Record) -> Result<Value, Error> {
    let message = record.decode_any().map_err(converted)?.ok_or_else(|| {
        let known = bag::messages::AnyMessage::TYPES.join(", ");
        converted(record.wrong(format!("type `{}`", record.type_name), format!("one of: {known}")))
    })?;
    serde_json::to_value(&message).map_err(|error| converted(record.wrong(error, "a message")))
}

/// Number at the path of a field.
#[derive(Debug, PartialEq)]
struct Found {
    /// `None` if the number is not known.
    value: Option<f64>,
    /// Stamp in the header of the chosen element of a list, such as a frame, or of the message if the element has none.
    stamp: Option<Value>,
}

/// Number at a path. `None` if the message has no such element, for example another frame.
fn value_at(record: &Record, message: &Value, field: &str, wanted: &Wanted<'_>) -> Result<Option<Found>, Error> {
    let stamp_of = |value: &Value| value.pointer("/header/stamp").cloned();
    let yaw = OnceCell::new();
    let (mut at, mut stamp) = (message, stamp_of(message));
    for part in parts(field) {
        let (name, element) = match part.strip_suffix(']').and_then(|part| part.split_once('[')) {
            Some((name, element)) => (name, Some(element)),
            None => (part, None),
        };
        let Some(next) = member(at, name, &yaw) else {
            let known = at.as_object().map_or_else(Vec::new, |object| object.keys().cloned().collect());
            let found = format!("no field `{name}` among {}", known.join(", "));
            return Err(converted(record.wrong(found, format!("`{field}`"))));
        };
        at = match element {
            None => next,
            Some(element) => match chosen(at, next, element) {
                Some(element) => {
                    stamp = stamp_of(element).or(stamp);
                    element
                }
                None => return Ok(None),
            },
        };
    }
    match at.as_f64().or_else(|| at.as_bool().map(|flag| f64::from(u8::from(flag)))) {
        Some(number) if number.is_finite() => Ok(Some(Found { value: Some(number), stamp })),
        _ if wanted.may_be_empty && at.is_null() => Ok(Some(Found { value: None, stamp })),
        _ => Err(converted(record.wrong(at, format!("a finite number in `{field}`")))),
    }
}

/// Parts of the path of a field. Names of elements may contain slashes, as those of frames often do.
fn parts(field: &str) -> impl Iterator<Item = &str> {
    let mut is_element = false;
    field.split(move |next| {
        is_element = next == '[' || (is_element && next != ']');
        next == '/' && !is_element
    })
}

/// Member of an object; `yaw` also of a quaternion, computed into `yaw`.
fn member<'a>(value: &'a Value, name: &str, yaw: &'a OnceCell<Value>) -> Option<&'a Value> {
    if let Some(member) = value.get(name) {
        return Some(member);
    }
    let [x, y, z, w] = ["x", "y", "z", "w"].map(|name| value.get(name).and_then(Value::as_f64));
    let (x, y, z, w) = (x?, y?, z?, w?);
    let angle_rad = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    (name == "yaw").then(|| yaw.get_or_init(|| Value::from(angle_rad)))
}

/// Element of a list by its index, by the name of its frame, or by the list `name` beside it.
fn chosen<'a>(parent: &Value, list: &'a Value, element: &str) -> Option<&'a Value> {
    let items = list.as_array()?;
    let index = element.parse().ok().or_else(|| {
        let is_named =
            |item: &Value| item.as_str() == Some(element) || item["child_frame_id"].as_str() == Some(element);
        items.iter().position(is_named).or_else(|| parent.get("name")?.as_array()?.iter().position(is_named))
    })?;
    items.get::<usize>(index)
}

/// Time of a stamp (ns).
fn stamp_ns(record: &Record, stamp: Option<&Value>) -> Result<i128, Error> {
    let part = |name: &str| stamp?.get(name).and_then(Value::as_i64);
    let stamp =
        part("sec").zip(part("nanosec")).map(|(sec, nanosec)| i128::from(sec) * 1_000_000_000 + i128::from(nanosec));
    stamp.ok_or_else(|| {
        converted(record.wrong("no header", "a header with a stamp; state `\"stamps\": \"log\"` for messages without"))
    })
}

#[cfg(test)]
mod tests {
    use bag::messages::{Header, TfMessage, Time, Transform, TransformStamped, Vector3};
    use bag::{Publisher, Writer};

    use super::super::mapping::Gaps;
    use super::*;

    /// Frames of one message, each with its stamp; a column is read with the stamps of its own frame.
    #[test]
    fn verif_a_frame_has_the_stamp_of_its_own_header() {
        const INTERVAL_NS: u64 = 10_000_000;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames");
        let mut writer = Writer::create(&path).unwrap();
        for i in 0..5 {
            // Frames of a slow and of a fast publisher.
            let frame = |name: &str, time_ns: u64, x: f64| TransformStamped {
                header: Header { stamp: Time::from_nanoseconds(time_ns), ..Header::default() },
                child_frame_id: name.into(),
                transform: Transform { translation: Vector3 { x, ..Vector3::default() }, ..Transform::default() },
            };
            let transforms = vec![
                frame("cart", i / 3 * 3 * INTERVAL_NS, i as f64),
                frame("tool", i * INTERVAL_NS + 2_000_000, 10.0 + i as f64),
            ];
            writer.write("/tf", i * INTERVAL_NS, &TfMessage { transforms }).unwrap();
        }
        writer.finish().unwrap();
        let layout = Layout {
            rate_hz: 100.0,
            delimiter: ',',
            skip_lines: 0,
            time: None,
            stamps: Some(Stamps::Header),
            longest_gap_s: 0.5,
            gaps: Gaps::Refuse,
        };
        let wanted = ["cart", "tool", "0"].map(|frame| format!("/tf/transforms[{frame}]/transform/translation/x"));
        let wanted = [0, 1, 2].map(|i| Wanted { name: &wanted[i], may_be_empty: false });
        let found = read(&path, &layout, &wanted).unwrap().series;
        let [cart, tool, first] = found.try_into().ok().unwrap();
        let agree = |series: &Series, expected_s: &[f64]| {
            let found_s = &series.clock.times_s;
            let apart = found_s.iter().zip(expected_s).map(|(found, expected)| (found - expected).abs());
            assert!(found_s.len() == expected_s.len() && apart.fold(0.0, f64::max) < 1e-12, "{found_s:?}");
        };
        agree(&cart, &[0.0, 0.03]);
        assert_eq!(cart.values, [Some(0.0), Some(3.0)]);
        assert_eq!((&first.clock.times_s, &first.values), (&cart.clock.times_s, &cart.values));
        agree(&tool, &[0.002, 0.012, 0.022, 0.032, 0.042]);
        assert_eq!(tool.values, [10.0, 11.0, 12.0, 13.0, 14.0].map(Some));
    }

    #[test]
    fn verif_elements_and_angles_are_found_by_name() {
        let joints = serde_json::json!({"name": ["wrist", "elbow"], "position": [1.0, 2.0]});
        assert_eq!(chosen(&joints, &joints["position"], "elbow"), Some(&Value::from(2.0)));
        assert_eq!(chosen(&joints, &joints["position"], "0"), Some(&Value::from(1.0)));
        assert_eq!(chosen(&joints, &joints["position"], "knee"), None);
        let half = 0.5_f64;
        let turned = serde_json::json!({"x": 0.0, "y": 0.0, "z": half.sin(), "w": half.cos()});
        assert!((member(&turned, "yaw", &OnceCell::new()).unwrap().as_f64().unwrap() - 1.0).abs() < 1e-12);
        let found: Vec<_> = parts("transforms[arm/tool]/transform/translation/x").collect();
        assert_eq!(found, ["transforms[arm/tool]", "transform", "translation", "x"]);
        let topics = ["/wrench".to_owned(), "/wrench/left".to_owned()];
        assert_eq!(field_of("/wrench/torque/z", "/wrench", &topics), Some("torque/z"));
        assert_eq!(field_of("/wrench_2/torque/z", "/wrench", &topics), None);
        assert_eq!(field_of("/wrench/left/torque/z", "/wrench/left", &topics), Some("torque/z"));
        assert_eq!(field_of("/wrench/left/torque/z", "/wrench", &topics), None);
    }
}
