//! `whisker bag info`: contents of a recording.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use bag::Reader;
use strict_json::one_line;

use crate::commands::{print, table};

/// List the topics of a recording and check that it can be read to its end
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A rosbag2 folder or an MCAP file
    recording: PathBuf,
}

/// Summary of a topic.
#[derive(Default)]
struct Topic {
    type_name: String,
    messages: u64,
    is_known: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let reader = Reader::open(&arguments.recording)?;
    let mut topics = BTreeMap::<String, Topic>::new();
    let (mut first_ns, mut last_ns, mut error) = (u64::MAX, 0, None);
    for record in reader.records() {
        let read = record.and_then(|record| record.decode_any().map(|message| (record, message.is_some())));
        match read {
            Ok((record, is_known)) => {
                (first_ns, last_ns) = (first_ns.min(record.time_ns), last_ns.max(record.time_ns));
                let topic = topics.entry(record.topic).or_default();
                topic.type_name = record.type_name;
                topic.messages += 1;
                topic.is_known = is_known;
            }
            Err(found) => {
                error = Some(found);
                break;
            }
        }
    }
    let rows: Vec<_> = topics
        .into_iter()
        .map(|(name, topic)| {
            let known = if topic.is_known { "yes" } else { "no" };
            vec![one_line(&name), one_line(&topic.type_name), known.into(), topic.messages.to_string()]
        })
        .collect();
    print(&table::render(&["topic", "type", "read here", "messages"], &rows, 3))?;
    print(&format!("{:.3} s\n", last_ns.saturating_sub(first_ns) as f64 / 1e9))?;
    if let Some(error) = error {
        return Err(error.into());
    }
    for attachment in reader.attachments()? {
        print(&format!("attachment {}, {} bytes\n", one_line(&attachment.name), attachment.data.len()))?;
    }
    Ok(ExitCode::SUCCESS)
}
