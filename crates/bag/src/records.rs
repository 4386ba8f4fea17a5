//! Records of an MCAP file in their order. Every length in the file is checked before it is used.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::chunk::Chunk;
use crate::lengths;

/// Longest record, and longest uncompressed chunk: more than any message of a whisker needs.
const LONGEST_RECORD: u64 = 1 << 28;

/// Largest ratio of a record's length to that of its file, which bounds the memory that a small file can claim.
const MOST_COMPRESSION: u64 = 1000;

/// Records that a reader needs.
const NEEDED: [u8; 5] = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::ATTACHMENT, op::DATA_END];

/// Reader of an MCAP file from its beginning to its end.
pub(crate) struct Records {
    stream: BufReader<File>,
    reader: LinearReader,
    longest: u64,
    skips_chunks: bool,
    /// Records of the current chunk, which was checked whole.
    chunk: Chunk,
}

impl Records {
    /// Opens a file. Chunks are skipped, or their records are among those that [`Self::next`] gives.
    pub(crate) fn open(path: &Path, skips_chunks: bool) -> io::Result<Self> {
        let file = File::open(path)?;
        let longest = LONGEST_RECORD.min(file.metadata()?.len().saturating_mul(MOST_COMPRESSION));
        let options = LinearReaderOptions::default().with_record_length_limit(longest as usize).with_emit_chunks(true);
        let reader = LinearReader::new_with_options(options);
        Ok(Self { stream: BufReader::new(file), reader, longest, skips_chunks, chunk: Chunk::default() })
    }

    /// Applies `take` to the next record. `None` at the end of the file.
    pub(crate) fn next<T>(&mut self, take: impl FnOnce(Record<'_>) -> T) -> Option<Result<T, McapError>> {
        loop {
            if let Some((opcode, place)) = self.chunk.next() {
                if NEEDED.contains(&opcode) {
                    return Some(parsed(opcode, self.chunk.body(place)).map(take));
                }
                continue;
            }
            match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => match self.stream.read(self.reader.insert(need)) {
                    Ok(read) => self.reader.notify_read(read),
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Some(Err(error.into())),
                },
                Ok(LinearReadEvent::Record { opcode: op::CHUNK, data }) => {
                    if !self.skips_chunks {
                        match Chunk::new(data, self.longest) {
                            Ok(chunk) => self.chunk = chunk,
                            Err(error) => return Some(Err(error)),
                        }
                    }
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    if NEEDED.contains(&opcode) {
                        return Some(parsed(opcode, data).map(take));
                    }
                }
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

fn parsed(opcode: u8, body: &[u8]) -> Result<Record<'_>, McapError> {
    lengths::fit(opcode, body).ok_or(McapError::UnexpectedEof)?;
    mcap::parse_record(opcode, body)
}
