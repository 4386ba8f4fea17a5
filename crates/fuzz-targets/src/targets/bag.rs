//! ROS 2 bag (metadata and MCAP file) and its conversion into traces and logs.

use std::path::Path;

use bag::messages::AnyMessage;
use bag::{Error, Message, Publisher, Reader};
use platform::calibration::logs::LogReader;
use trace::{SpatialTrace, Trace, is_spatial};
use whisker_cli::ros::import;

use crate::properties::one_error;
use crate::scratch;

const FOLDER: &str = "untrusted_bag";

pub(super) fn run(bytes: &[u8]) {
    let [metadata, mcap] = scratch::parts(bytes);
    let metadata = scratch::file("untrusted_bag/metadata.yaml", metadata);
    let mcap = scratch::file("untrusted_bag/untrusted_0.mcap", mcap);
    read(&metadata);
    read(&mcap);
    for salvage in [false, true] {
        assert_files_stay_in_the_folder(&mcap, salvage);
    }
}

fn read(path: &Path) {
    let Some(reader) = one_error(Reader::open(path), FOLDER) else { return };
    for record in reader.records() {
        let Some(record) = one_error(record, FOLDER) else { break };
        if let Some(Some(message)) = one_error(record.decode_any(), FOLDER) {
            message.write(&mut Recoder, &record.topic, record.time_ns).expect("it takes every message");
        }
    }
    one_error(reader.attachments(), FOLDER);
}

fn assert_files_stay_in_the_folder(mcap: &Path, salvage: bool) {
    let kept = scratch::file("imported/kept", "");
    let out = kept.parent().expect("it lies in a folder");
    let Some(files) = one_error(import(mcap, salvage, out), "") else { return };
    for file in &files {
        assert_eq!(file.parent(), Some(out), "{}", file.display());
        if file.ends_with("log.csv") {
            for sample in LogReader::open(file).expect("it is there") {
                sample.expect("written data can be read");
            }
        } else if file.extension().is_some_and(|extension| extension == "csv") && file.with_extension("json").is_file()
        {
            if matches!(is_spatial(file), Ok(true)) {
                one_error(SpatialTrace::read(file), "");
            } else {
                one_error(Trace::read(file), "");
            }
        }
    }
    for file in files {
        std::fs::remove_file(file).expect("it was written");
    }
}

/// Asserts that a decoded message is unchanged by encoding and decoding.
struct Recoder;

impl Publisher for Recoder {
    fn write<M: Message>(&mut self, _topic: &str, _time_ns: u64, message: &M) -> Result<(), Error> {
        let bytes = message.encode();
        let again = M::decode(&bytes).expect("written data can be read");
        assert_eq!(again.encode(), bytes);
        assert!(matches!(AnyMessage::decode(M::TYPE, &bytes), Ok(Some(_))));
        Ok(())
    }
}
