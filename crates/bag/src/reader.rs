//! Reader of rosbag2 folders and MCAP files.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::McapError;
use mcap::records::{Channel, MessageHeader, Record as McapRecord};

use crate::messages::AnyMessage;
use crate::records::Records;
use crate::{Error, Message, metadata};

/// A recording: a rosbag2 folder, complete or interrupted, or a bare MCAP file.
#[derive(Clone, Debug)]
pub struct Reader {
    path: PathBuf,
    files: Vec<PathBuf>,
    /// Number of messages by the metadata, if there are any.
    messages: Option<u64>,
}

/// A recorded message.
#[derive(Clone, Debug)]
pub struct Record {
    /// Its file.
    pub file: Arc<Path>,
    /// Its number in the recording, from 1.
    pub number: u64,
    /// The topic.
    pub topic: String,
    /// Name of its type; empty if the recording has none.
    pub type_name: String,
    /// Encoding of its bytes; `cdr` in ROS 2.
    pub encoding: String,
    /// Time of recording since the recording's epoch (ns).
    pub time_ns: u64,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// A file attached to a recording.
#[derive(Clone, Debug)]
pub struct Attachment {
    /// Its name.
    pub name: String,
    /// Its bytes.
    pub data: Vec<u8>,
}

impl Reader {
    /// Opens a recording: a folder, its `metadata.yaml` or an MCAP file. The folder of an interrupted recording,
    /// without metadata, must have one MCAP file.
    ///
    /// # Errors
    /// [`Error`] names the file and the invalid content.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let kind = fs::metadata(path).map_err(Error::io(path))?;
        let named = path.file_name().is_some_and(|name| name == metadata::FILE);
        let metadata = if named { path.into() } else { path.join(metadata::FILE) };
        let (files, messages) = if named || metadata.is_file() {
            let (files, messages) = metadata::files(&metadata)?;
            (files, Some(messages))
        } else if kind.is_dir() {
            (vec![only_mcap(path)?], None)
        } else {
            (vec![path.into()], None)
        };
        Ok(Self { path: path.into(), files, messages })
    }

    /// Messages, file after file, in the order in which they were written. A damaged or interrupted recording ends with an
    /// error after the last complete message.
    pub fn records(&self) -> impl Iterator<Item = Result<Record, Error>> {
        let mut records = self.files.iter().flat_map(|file| records_of(file));
        let mut number = 0;
        let mut over = false;
        std::iter::from_fn(move || {
            if over {
                return None;
            }
            match records.next() {
                Some(Ok(record)) => {
                    number += 1;
                    Some(Ok(Record { number, ..record }))
                }
                Some(Err(Broken { file, reason })) => {
                    over = true;
                    let place = if number == 0 { "begin".into() } else { format!("after message {number}") };
                    Some(Err(match reason {
                        McapError::Io(reason) if reason.kind() == std::io::ErrorKind::NotFound => {
                            Error::Io { path: file, reason }
                        }
                        other => Error::content(&file, place, other, "an MCAP recording to its end"),
                    }))
                }
                None => {
                    over = true;
                    let expected = self.messages.filter(|expected| *expected != number)?;
                    let expected = format!("{expected}, as in its metadata");
                    Some(Err(Error::content(&self.path, "messages", number, expected)))
                }
            }
        })
    }

    /// Attachments of the recording.
    ///
    /// # Errors
    /// [`Error`] names the file and the invalid content.
    pub fn attachments(&self) -> Result<Vec<Attachment>, Error> {
        let mut attachments = Vec::new();
        for file in &self.files {
            let mut records = Records::open(file, true).map_err(Error::io(file))?;
            while let Some(attachment) = records.next(attachment) {
                let attachment = attachment
                    .map_err(|error| Error::content(file, "attachments", error, "an MCAP recording to its end"))?;
                attachments.extend(attachment);
            }
        }
        Ok(attachments)
    }
}

fn attachment(record: McapRecord<'_>) -> Option<Attachment> {
    match record {
        McapRecord::Attachment { header, data, .. } => Some(Attachment { name: header.name, data: data.into_owned() }),
        _ => None,
    }
}

impl Record {
    /// Decodes the message as this type.
    ///
    /// # Errors
    /// [`Error`] if it is of another type, or its bytes are not a message of this type.
    pub fn decode<M: Message>(&self) -> Result<M, Error> {
        if self.type_name != M::TYPE {
            return Err(self.wrong(format!("type `{}`", self.type_name), format!("`{}`", M::TYPE)));
        }
        self.check_encoding()?;
        M::decode(&self.data).map_err(|found| self.wrong(found, format!("a {}", M::TYPE)))
    }

    /// Decodes the message. `None` if its type is unknown.
    ///
    /// # Errors
    /// [`Error`] if its bytes are not a message of its type.
    pub fn decode_any(&self) -> Result<Option<AnyMessage>, Error> {
        if !AnyMessage::TYPES.contains(&self.type_name.as_str()) {
            return Ok(None);
        }
        self.check_encoding()?;
        AnyMessage::decode(&self.type_name, &self.data)
            .map_err(|found| self.wrong(found, format!("a {}", self.type_name)))
    }

    fn check_encoding(&self) -> Result<(), Error> {
        if self.encoding != "cdr" {
            return Err(self.wrong(format!("encoding `{}`", self.encoding), "`cdr`"));
        }
        Ok(())
    }

    /// Error of invalid content in this message.
    pub fn wrong(&self, found: impl std::fmt::Display, expected: impl std::fmt::Display) -> Error {
        Error::content(&self.file, format!("message {} of {}", self.number, self.topic), found, expected)
    }
}

/// Error that ends the reading of a file.
struct Broken {
    file: PathBuf,
    reason: McapError,
}

/// Messages of one file, with number 0.
fn records_of(path: &Path) -> impl Iterator<Item = Result<Record, Broken>> + use<> {
    let file: Arc<Path> = path.into();
    let (mut records, mut failure) = match Records::open(path, false) {
        Ok(records) => (Some(records), None),
        Err(reason) => (None, Some(McapError::Io(reason))),
    };
    let mut topics = Topics::default();
    std::iter::from_fn(move || {
        let broken = |reason| Broken { file: file.to_path_buf(), reason };
        if let Some(reason) = failure.take() {
            return Some(Err(broken(reason)));
        }
        loop {
            match records.as_mut()?.next(|record| topics.take(record, &file))? {
                Ok(Ok(None)) => {}
                Ok(Ok(Some(record))) => return Some(Ok(record)),
                Ok(Err(reason)) | Err(reason) => return Some(Err(broken(reason))),
            }
        }
    })
}

/// Topics of a file up to the current record.
#[derive(Default)]
struct Topics {
    /// Names of types by the id of their schema.
    types: HashMap<u16, String>,
    channels: HashMap<u16, Channel>,
    /// The data section is over; the summary repeats its records.
    is_over: bool,
}

impl Topics {
    /// Processes a record. Returns its message, if it is one.
    fn take(&mut self, record: McapRecord<'_>, file: &Arc<Path>) -> Result<Option<Record>, McapError> {
        match record {
            McapRecord::DataEnd(_) => self.is_over = true,
            McapRecord::Schema { header, .. } => {
                let known = self.types.entry(header.id).or_insert_with(|| header.name.clone());
                if *known != header.name {
                    return Err(McapError::ConflictingSchemas(header.name));
                }
            }
            McapRecord::Channel(channel) => {
                let known = self.channels.entry(channel.id).or_insert_with(|| channel.clone());
                if *known != channel {
                    return Err(McapError::ConflictingChannels(channel.topic));
                }
            }
            McapRecord::Message { header, data } => return self.message(&header, &data, file).map(Some),
            _ => {}
        }
        Ok(None)
    }

    fn message(&self, header: &MessageHeader, data: &[u8], file: &Arc<Path>) -> Result<Record, McapError> {
        let unknown = McapError::UnknownChannel(header.sequence, header.channel_id);
        let channel = self.channels.get(&header.channel_id).filter(|_| !self.is_over).ok_or(unknown)?;
        let type_name = match channel.schema_id {
            // Schema id of a channel without schema.
            0 => "",
            id => self.types.get(&id).ok_or_else(|| McapError::UnknownSchema(channel.topic.clone(), id))?,
        };
        Ok(Record {
            file: file.clone(),
            number: 0,
            topic: channel.topic.clone(),
            type_name: type_name.into(),
            encoding: channel.message_encoding.clone(),
            time_ns: header.log_time,
            data: data.to_owned(),
        })
    }
}

fn only_mcap(folder: &Path) -> Result<PathBuf, Error> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let file = entry.map_err(Error::io(folder))?.path();
        if file.extension().is_some_and(|extension| extension == "mcap") {
            found.push(file);
        }
    }
    match <[PathBuf; 1]>::try_from(found) {
        Ok([file]) => Ok(file),
        Err(found) => {
            let found = format!("no {} and {} MCAP files", metadata::FILE, found.len());
            Err(Error::content(folder, "folder", found, "a rosbag2 folder"))
        }
    }
}
