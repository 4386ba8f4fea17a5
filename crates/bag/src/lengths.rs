//! Lengths stated in the records of an MCAP file, checked against the bytes that follow.

use mcap::records::op;

/// `None` if a length in a record reaches beyond its end. The crate `mcap` would allocate the stated length before
/// checking that as many bytes follow.
pub(crate) fn fit(opcode: u8, body: &[u8]) -> Option<()> {
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

/// A text behind its length, and the bytes that follow.
pub(crate) fn text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}
