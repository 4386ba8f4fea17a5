//! The records of an MCAP file, one after the other. No length that stands in one is believed before it is checked.

use std::fs::File;
use std::io::{self, BufReader, Read, Take};
use std::path::Path;

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// The longest record that is believed in: more than any message of a whisker, less than a damaged length may claim.
const LONGEST_RECORD: u64 = 1 << 28;

/// How many times as long as its file a record may be: chunks are compressed, but not that far.
const MOST_COMPRESSION: u64 = 1000;

/// What is not among these says nothing that a reader here needs.
const NEEDED: [u8; 5] = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::ATTACHMENT, op::DATA_END];

/// An MCAP file that is read from its begin to its end.
pub(crate) struct Records {
    stream: BufReader<Take<File>>,
    reader: LinearReader,
}

impl Records {
    /// Opens a file; the chunks in it are passed over, or what they hold is handed on. Then the file ends before a chunk that is not whole or not filled by its
    /// records: the library takes a record that reaches beyond its chunk for one that goes on behind it.
    pub(crate) fn open(path: &Path, pass_over_chunks: bool) -> io::Result<Self> {
        let whole = Self::with_chunks(path, true, u64::MAX)?;
        if pass_over_chunks { Ok(whole) } else { Self::with_chunks(path, false, whole.sound_bytes()) }
    }

    fn with_chunks(path: &Path, pass_over_chunks: bool, most_bytes: u64) -> io::Result<Self> {
        let file = File::open(path)?;
        let longest = LONGEST_RECORD.min(file.metadata()?.len().saturating_mul(MOST_COMPRESSION));
        // A chunk is checked whole before any of its messages is believed.
        let options = LinearReaderOptions::default()
            .with_record_length_limit(longest as usize)
            .with_prevalidate_chunk_crcs(true)
            .with_emit_chunks(pass_over_chunks);
        let reader = LinearReader::new_with_options(options);
        Ok(Self { stream: BufReader::new(file.take(most_bytes)), reader })
    }

    /// Length of the file up to the first record that is not whole, or a chunk that is not filled; no end where there is none.
    fn sound_bytes(mut self) -> u64 {
        let mut sound = mcap::MAGIC.len() as u64;
        let mut size = |opcode, body: &[u8]| {
            let is_filled = opcode != op::CHUNK || chunk_is_filled(body).is_some();
            // An opcode and a length come before a record.
            Some(is_filled.then_some(1 + 8 + body.len() as u64))
        };
        while let Some(event) = self.event(&mut size) {
            let Ok(Some(bytes)) = event else { return sound };
            sound += bytes;
        }
        u64::MAX
    }

    /// What is made of the next record; none at the end of the file.
    pub(crate) fn next<T>(&mut self, take: impl FnOnce(Record<'_>) -> T) -> Option<Result<T, McapError>> {
        let mut take = Some(take);
        let record = self.event(|opcode, body| {
            NEEDED.contains(&opcode).then(|| parsed(opcode, body).map(|record| take.take().map(|take| take(record))))
        })?;
        record.flatten().transpose()
    }

    /// What is made of the next record of which something is; none at the end of the file.
    fn event<T>(&mut self, mut take: impl FnMut(u8, &[u8]) -> Option<T>) -> Option<Result<T, McapError>> {
        loop {
            match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => match self.stream.read(self.reader.insert(need)) {
                    Ok(read) => self.reader.notify_read(read),
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Some(Err(error.into())),
                },
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    if let Some(taken) = take(opcode, data) {
                        return Some(Ok(taken));
                    }
                }
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

fn parsed(opcode: u8, body: &[u8]) -> Result<Record<'_>, McapError> {
    // The library makes room for what a length claims before it looks whether so much is there.
    lengths_fit(opcode, body).ok_or(McapError::UnexpectedEof)?;
    mcap::parse_record(opcode, body)
}

/// Nothing where a length in a record reaches beyond it.
fn lengths_fit(opcode: u8, body: &[u8]) -> Option<()> {
    match opcode {
        op::SCHEMA => {
            let (_name, rest) = text(body.get(2..)?)?;
            let (_encoding, rest) = text(rest)?;
            text(rest)?;
        }
        op::CHANNEL => {
            let (_topic, rest) = text(body.get(4..)?)?;
            let (_encoding, rest) = text(rest)?;
            let (mut notes, _) = text(rest)?;
            while !notes.is_empty() {
                let (_key, rest) = text(notes)?;
                (_, notes) = text(rest)?;
            }
        }
        op::ATTACHMENT => {
            let (_name, rest) = text(body.get(16..)?)?;
            let (_media_type, rest) = text(rest)?;
            // The length of its bytes, and their checksum.
            rest.get(8 + 4..)?;
        }
        _ => {}
    }
    Some(())
}

/// Nothing unless the records of a chunk that is not compressed fill it.
fn chunk_is_filled(body: &[u8]) -> Option<()> {
    // Times of its first message and its last, its length and its checksum.
    let (compression, rest) = text(body.get(8 + 8 + 8 + 4..)?)?;
    let (length, records) = rest.split_first_chunk()?;
    let mut records = records.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    while compression.is_empty() && !records.is_empty() {
        let (_opcode, rest) = records.split_first()?;
        let (length, rest) = rest.split_first_chunk()?;
        records = rest.get(usize::try_from(u64::from_le_bytes(*length)).ok()?..)?;
    }
    Some(())
}

/// A text behind its length, and what follows.
fn text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}
