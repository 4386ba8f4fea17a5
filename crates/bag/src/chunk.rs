//! Chunks of an MCAP file: several records, compressed with zstd, LZ4 or not at all.

use std::io::{self, Read};
use std::ops::Range;

use lz4_flex::frame::FrameDecoder;
use mcap::McapError;
use ruzstd::decoding::StreamingDecoder;

use crate::lengths::text;

/// Opcode and length of a record.
const RECORD_HEAD: usize = 1 + 8;

/// Uncompressed records of a chunk.
#[derive(Default)]
pub(crate) struct Chunk {
    records: Vec<u8>,
    /// Where the next record begins.
    next: usize,
}

impl Chunk {
    /// Decompresses the body of a chunk record. The result has at most `longest` bytes, for any length stated in the record.
    ///
    /// # Errors
    /// If it is damaged, too long, compressed in another way, or its records do not fill it.
    pub(crate) fn new(body: &[u8], longest: u64) -> Result<Self, McapError> {
        let Head { length, checksum, compression, compressed } = Head::of(body).ok_or(McapError::UnexpectedEof)?;
        if length > longest {
            return Err(McapError::ChunkTooLarge(length));
        }
        let records = match compression {
            b"" => compressed.to_vec(),
            b"zstd" => decompressed(compressed, length, zstd)?,
            b"lz4" => decompressed(compressed, length, lz4)?,
            other => return Err(McapError::UnsupportedCompression(String::from_utf8_lossy(other).into_owned())),
        };
        if records.len() as u64 != length {
            return Err(McapError::BadChunkLength { header: length, available: records.len() as u64 });
        }
        let calculated = crc32fast::hash(&records);
        // Zero: the writer gave none.
        if checksum != 0 && checksum != calculated {
            return Err(McapError::BadChunkCrc { saved: checksum, calculated });
        }
        let mut chunk = Self { records, next: 0 };
        while chunk.next < chunk.records.len() {
            chunk.next().ok_or(McapError::UnexpectedEof)?;
        }
        chunk.next = 0;
        Ok(chunk)
    }

    /// Opcode of the next record, and the place of its body. `None` at the end.
    pub(crate) fn next(&mut self) -> Option<(u8, Range<usize>)> {
        let (head, rest) = self.records.get(self.next..)?.split_first_chunk::<RECORD_HEAD>()?;
        let (opcode, length) = head.split_first()?;
        let length = usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?;
        rest.get(..length)?;
        let begin = self.next + RECORD_HEAD;
        self.next = begin + length;
        Some((*opcode, begin..self.next))
    }

    /// Body of a record.
    pub(crate) fn body(&self, place: Range<usize>) -> &[u8] {
        &self.records[place]
    }
}

/// Fields of a chunk record that a reader needs.
struct Head<'a> {
    /// Length of the uncompressed records.
    length: u64,
    /// CRC-32 of the uncompressed records.
    checksum: u32,
    compression: &'a [u8],
    compressed: &'a [u8],
}

impl<'a> Head<'a> {
    /// `None` if a length reaches beyond the record.
    fn of(body: &'a [u8]) -> Option<Self> {
        // After the times of its first message and its last.
        let (length, rest) = body.get(8 + 8..)?.split_first_chunk()?;
        let (checksum, rest) = rest.split_first_chunk()?;
        let (compression, rest) = text(rest)?;
        let (compressed_length, rest) = rest.split_first_chunk()?;
        let compressed = rest.get(..usize::try_from(u64::from_le_bytes(*compressed_length)).ok()?)?;
        let (length, checksum) = (u64::from_le_bytes(*length), u32::from_le_bytes(*checksum));
        Some(Self { length, checksum, compression, compressed })
    }
}

/// Decoder of the frame with which some bytes begin.
type Decoder = for<'a, 'b> fn(&'b mut &'a [u8]) -> io::Result<Box<dyn Read + 'b>>;

fn zstd<'b>(frame: &'b mut &[u8]) -> io::Result<Box<dyn Read + 'b>> {
    Ok(Box::new(StreamingDecoder::new(frame).map_err(io::Error::other)?))
}

fn lz4<'b>(frame: &'b mut &[u8]) -> io::Result<Box<dyn Read + 'b>> {
    Ok(Box::new(FrameDecoder::new(frame)))
}

/// Decompresses frame after frame, up to `length` bytes: memory grows with the bytes that come out, not with the length
/// that is claimed.
fn decompressed(mut frames: &[u8], length: u64, decoder: Decoder) -> Result<Vec<u8>, McapError> {
    let mut bytes = Vec::new();
    let mut append = || -> io::Result<()> {
        while !frames.is_empty() && (bytes.len() as u64) < length {
            let missing = length - bytes.len() as u64;
            decoder(&mut frames)?.take(missing).read_to_end(&mut bytes)?;
        }
        Ok(())
    };
    append().map_err(|error| McapError::DecompressionError(error.to_string()))?;
    Ok(bytes)
}
