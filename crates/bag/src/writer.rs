//! Writer of rosbag2 folders. Chunks are not compressed, as in rosbag2's default.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions};

use crate::metadata::{self, Metadata, Recorded, quality};
use crate::{Error, Message, Publisher};

/// Size of a chunk in bytes: the largest loss of an interrupted recording.
const CHUNK_BYTES: u64 = 1 << 18;

/// Writer of a recording.
///
/// It writes into a folder whose name ends in `.part` and renames it when it is finished: a folder without `.part` is
/// complete. An interrupted recording remains readable under the name with `.part`, up to its last complete chunk.
pub struct Writer {
    folder: PathBuf,
    part: PathBuf,
    file: PathBuf,
    mcap: mcap::Writer<BufWriter<File>>,
    topics: BTreeMap<String, Topic>,
    /// Times of the first and the last message (ns).
    span_ns: Option<(u64, u64)>,
}

struct Topic {
    channel: u16,
    type_name: &'static str,
    messages: u64,
}

impl Writer {
    /// Creates a recording with this final name.
    ///
    /// # Errors
    /// [`Error`] if the folder or its `.part` exists, or if a system call fails.
    pub fn create(folder: &Path) -> Result<Self, Error> {
        let Some(name) = folder.file_name().map(|name| name.to_string_lossy().into_owned()) else {
            return Err(Error::content(folder, "path", "no name", "the name of a new folder"));
        };
        let part = folder.with_file_name(format!("{name}.part"));
        for taken in [folder, &part] {
            if taken.exists() {
                return Err(Error::content(
                    taken,
                    "path",
                    "an existing file or folder",
                    "a new name: rename or remove it",
                ));
            }
        }
        fs::create_dir_all(&part).map_err(Error::io(&part))?;
        let file = part.join(format!("{name}_0.mcap"));
        let stream = BufWriter::new(File::create(&file).map_err(Error::io(&file))?);
        let mcap = WriteOptions::new()
            .profile("ros2")
            .library(concat!("whisker bag ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .create(stream)
            .map_err(failed(&file))?;
        Ok(Self { folder: folder.into(), part, file, mcap, topics: BTreeMap::new(), span_ns: None })
    }

    /// Attaches a file.
    ///
    /// # Errors
    /// [`Error`] if a system call fails.
    pub fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> Result<(), Error> {
        let attachment = mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: name.into(),
            media_type: media_type.into(),
            data: Cow::Borrowed(data),
        };
        self.mcap.attach(&attachment).map_err(failed(&self.file))
    }

    /// Ends the recording and gives it its final name.
    ///
    /// # Errors
    /// [`Error`] if a system call fails.
    pub fn finish(self) -> Result<(), Error> {
        let folder = self.folder.clone();
        let part = self.leave()?;
        fs::rename(&part, &folder).map_err(Error::io(&folder))
    }

    /// Ends an incomplete recording. It keeps the name that ends in `.part`, which is returned.
    ///
    /// # Errors
    /// [`Error`] if a system call fails.
    pub fn leave(mut self) -> Result<PathBuf, Error> {
        self.mcap.finish().map_err(failed(&self.file))?;
        let stream = self.mcap.into_inner();
        let written = stream.into_inner().map_err(std::io::IntoInnerError::into_error).and_then(|file| file.sync_all());
        written.map_err(Error::io(&self.file))?;
        let recorded: Vec<_> = self
            .topics
            .iter()
            .map(|(name, topic)| Recorded { name, type_name: topic.type_name, messages: topic.messages })
            .collect();
        let (first_ns, last_ns) = self.span_ns.unwrap_or_default();
        let name = self.file.file_name().unwrap_or_default().to_string_lossy();
        let metadata = self.part.join(metadata::FILE);
        let text = Metadata::new(&name, first_ns, last_ns, &recorded).to_yaml();
        fs::write(&metadata, text).map_err(Error::io(&metadata))?;
        Ok(self.part)
    }

    /// Channel of a topic, created at its first message.
    fn topic<M: Message>(&mut self, name: &str) -> Result<&mut Topic, Error> {
        // Most messages are of existing topics: looked up by reference first.
        if !self.topics.contains_key(name) {
            let make = |mcap: &mut mcap::Writer<_>| {
                let schema = mcap.add_schema(M::TYPE, "ros2msg", M::definition().as_bytes())?;
                let notes = BTreeMap::from([("offered_qos_profiles".into(), quality(name))]);
                mcap.add_channel(schema, name, "cdr", &notes)
            };
            let channel = make(&mut self.mcap).map_err(failed(&self.file))?;
            self.topics.insert(name.into(), Topic { channel, type_name: M::TYPE, messages: 0 });
        }
        let topic = self.topics.get_mut(name).expect("the topic is there by now");
        if topic.type_name != M::TYPE {
            let (found, expected) = (M::TYPE, format!("{}, as before", topic.type_name));
            return Err(Error::content(&self.file, name, found, expected));
        }
        Ok(topic)
    }
}

impl Publisher for Writer {
    /// Records a message of a topic. All messages of a topic are of one type.
    fn write<M: Message>(&mut self, topic: &str, time_ns: u64, message: &M) -> Result<(), Error> {
        let topic = self.topic::<M>(topic)?;
        // The sequence number distinguishes messages and may wrap around.
        let sequence = topic.messages as u32;
        topic.messages += 1;
        let header = MessageHeader { channel_id: topic.channel, sequence, log_time: time_ns, publish_time: time_ns };
        self.mcap.write_to_known_channel(&header, &message.encode()).map_err(failed(&self.file))?;
        let (first_ns, last_ns) = self.span_ns.unwrap_or((time_ns, time_ns));
        self.span_ns = Some((first_ns.min(time_ns), last_ns.max(time_ns)));
        Ok(())
    }
}

fn failed(path: &Path) -> impl FnOnce(McapError) -> Error + '_ {
    move |error| match error {
        McapError::Io(reason) => Error::Io { path: path.into(), reason },
        other => Error::content(path, "recording", other, "to be able to go on"),
    }
}
