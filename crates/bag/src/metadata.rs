//! `metadata.yaml` of a rosbag2 folder, version 5 (ROS 2 Humble and later read it).

use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{Error, topics};

/// Name of the file.
pub(crate) const FILE: &str = "metadata.yaml";

const VERSION: u32 = 5;

/// Content of the file.
#[derive(Debug, Serialize)]
pub(crate) struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Debug, Serialize)]
struct Information {
    version: u32,
    storage_identifier: String,
    duration: Duration,
    starting_time: Moment,
    message_count: u64,
    topics_with_message_count: Vec<TopicCount>,
    compression_format: String,
    compression_mode: String,
    relative_file_paths: Vec<String>,
    files: Vec<FileInformation>,
}

#[derive(Clone, Debug, Serialize)]
struct Duration {
    nanoseconds: u64,
}

#[derive(Clone, Debug, Serialize)]
struct Moment {
    nanoseconds_since_epoch: u64,
}

#[derive(Debug, Serialize)]
struct FileInformation {
    path: String,
    starting_time: Moment,
    duration: Duration,
    message_count: u64,
}

#[derive(Debug, Serialize)]
struct TopicCount {
    topic_metadata: Topic,
    message_count: u64,
}

#[derive(Debug, Serialize)]
struct Topic {
    name: String,
    #[serde(rename = "type")]
    type_name: String,
    serialization_format: String,
    offered_qos_profiles: String,
}

/// Recorded messages of a topic.
pub(crate) struct Recorded<'a> {
    pub(crate) name: &'a str,
    pub(crate) type_name: &'a str,
    pub(crate) messages: u64,
}

impl Metadata {
    /// Metadata of one MCAP file with these topics and the times of its first and last message (ns).
    pub(crate) fn new(file: &str, first_ns: u64, last_ns: u64, recorded: &[Recorded<'_>]) -> Self {
        let duration = Duration { nanoseconds: last_ns - first_ns };
        let starting_time = Moment { nanoseconds_since_epoch: first_ns };
        let message_count = recorded.iter().map(|topic| topic.messages).sum();
        let topics = recorded.iter().map(|topic| TopicCount {
            topic_metadata: Topic {
                name: topic.name.into(),
                type_name: topic.type_name.into(),
                serialization_format: "cdr".into(),
                offered_qos_profiles: quality(topic.name),
            },
            message_count: topic.messages,
        });
        Self {
            rosbag2_bagfile_information: Information {
                version: VERSION,
                storage_identifier: "mcap".into(),
                duration: duration.clone(),
                starting_time: starting_time.clone(),
                message_count,
                topics_with_message_count: topics.collect(),
                compression_format: String::new(),
                compression_mode: String::new(),
                relative_file_paths: vec![file.into()],
                files: vec![FileInformation { path: file.into(), starting_time, duration, message_count }],
            },
        }
    }

    pub(crate) fn to_yaml(&self) -> String {
        serde_saphyr::to_string(self).expect("texts and numbers become YAML")
    }
}

/// Offered quality of service of a topic in rosbag2's format: reliable; static frames are kept for later subscribers.
pub(crate) fn quality(topic: &str) -> String {
    let (history, depth, durability) = if topic == topics::TF_STATIC { (1, 1, 1) } else { (3, 0, 2) };
    let endless = "\n    sec: 9223372036\n    nsec: 854775807\n";
    format!(
        "- history: {history}\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline:{endless}  \
         lifespan:{endless}  liveliness: 1\n  liveliness_lease_duration:{endless}  avoid_ros_namespace_conventions: false"
    )
}

/// Keys of the file that a reader needs; others depend on the version.
#[derive(Debug, Deserialize)]
struct Found {
    rosbag2_bagfile_information: FoundInformation,
}

#[derive(Debug, Deserialize)]
struct FoundInformation {
    storage_identifier: String,
    relative_file_paths: Vec<String>,
    message_count: u64,
    #[serde(default)]
    compression_mode: String,
}

/// MCAP files of a folder, in their order, and their total number of messages.
pub(crate) fn files(path: &Path) -> Result<(Vec<PathBuf>, u64), Error> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let found: Found = serde_saphyr::from_str(&text)
        .map_err(|error| Error::content(path, "YAML", error, "the metadata of a rosbag2 folder"))?;
    let found = found.rosbag2_bagfile_information;
    if found.storage_identifier != "mcap" {
        let storage = format!("`{}`", found.storage_identifier);
        return Err(Error::content(path, "storage_identifier", storage, "`mcap`"));
    }
    if found.compression_mode.eq_ignore_ascii_case("file") {
        return Err(Error::content(path, "compression_mode", "`file`", "files that are not compressed as a whole"));
    }
    let folder = path.parent().unwrap_or(Path::new("."));
    let files = found.relative_file_paths.iter().map(|name| {
        // Files outside the folder are refused.
        if Path::new(name).components().all(|part| matches!(part, Component::Normal(_))) {
            Ok(folder.join(name))
        } else {
            Err(Error::content(path, "relative_file_paths", format!("`{name}`"), "a path within the folder"))
        }
    });
    Ok((files.collect::<Result<_, _>>()?, found.message_count))
}
