//! Rows of a trace as messages of the same time.

use std::path::Path;

use anyhow::{bail, ensure};
use bag::messages::{AnyMessage, Header, Time, Transform};
use bag::{Message, Publisher, Reader, Record, Writer, topics};

/// Messages of one row.
pub(super) struct Row<'a> {
    pub(super) writer: &'a mut Writer,
    pub(super) time_ns: u64,
    /// Beginning of the names of its topics.
    pub(super) prefix: String,
}

impl Row<'_> {
    pub(super) fn header(&self, frame: &str) -> Header {
        Header { stamp: Time::from_nanoseconds(self.time_ns), frame_id: frame.into() }
    }

    pub(super) fn write(&mut self, topic: &str, message: &impl Message) -> anyhow::Result<()> {
        Ok(self.writer.write(&format!("{}{topic}", self.prefix), self.time_ns, message)?)
    }
}

/// Known quantities and truth of each row of a trace, in the plane or in space. A row begins with the time and a frame of the base;
/// `take` receives the further messages of the same time.
pub(super) fn rows_of<Known, Of: Default>(
    reader: &Reader,
    begin: impl Fn(f64, Transform) -> Known,
    take: impl Fn(&Record, AnyMessage, &mut Known, &mut Of) -> anyhow::Result<()>,
) -> anyhow::Result<(Vec<Known>, Vec<Of>)> {
    let (mut instants, mut truth) = (Vec::<Known>::new(), Vec::<Of>::new());
    let mut row_ns = None;
    for record in reader.records() {
        let record = record?;
        let Some(message) = record.decode_any()? else { continue };
        if record.topic == topics::TF {
            instants.push(begin(seconds(record.time_ns), base_of(&record, message)?));
            truth.push(Of::default());
            row_ns = Some(record.time_ns);
            continue;
        }
        let (Some(known), Some(truth)) = (instants.last_mut(), truth.last_mut()) else {
            bail!(record.wrong("a message before any of /tf", "the base's frame first"));
        };
        if row_ns != Some(record.time_ns) {
            bail!(record.wrong(format!("{} ns", record.time_ns), "the time of the last message of /tf"));
        }
        take(&record, message, known, truth)?;
    }
    Ok((instants, truth))
}

/// Pose of the base in a message, which must contain no other frame.
fn base_of(record: &Record, message: AnyMessage) -> anyhow::Result<Transform> {
    if let AnyMessage::TfMessage(frames) = message
        && let [base] = frames.transforms.as_slice()
        && base.child_frame_id == topics::WHISKER
    {
        return Ok(base.transform.clone());
    }
    Err(record.wrong("other frames", format!("that of {} alone", topics::WHISKER)).into())
}

/// Time since the beginning of the trace (ns), from whole microseconds.
pub(super) fn time_ns(t_s: f64, path: &Path) -> anyhow::Result<u64> {
    ensure!(t_s >= 0.0, "{}: t_s: found {t_s}, expected a time of 0 or more: messages have no other", path.display());
    Ok(1000 * (1e6 * t_s).round() as u64)
}

fn seconds(time_ns: u64) -> f64 {
    (time_ns / 1000) as f64 / 1e6
}
