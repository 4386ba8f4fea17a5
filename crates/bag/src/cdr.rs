//! Encoding of messages: Common Data Representation (CDR) after a header of four bytes with the byte order.

use byteorder::{BigEndian, LittleEndian};
use cdr_encoding::{from_bytes, to_vec};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Encapsulation header of plain CDR, little-endian (DDSI-RTPS 2.3, table 10.1).
const LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

/// Largest number of padding bytes after the last field.
const MOST_PADDING: usize = 3;

/// Encodes a value.
///
/// # Panics
/// If it has other fields than numbers, texts and sequences, which no message has.
pub fn encode(value: &impl Serialize) -> Vec<u8> {
    let body = to_vec::<_, LittleEndian>(value).expect("messages are made of numbers, texts and sequences");
    [&LITTLE_ENDIAN, body.as_slice()].concat()
}

/// Decodes a value from all of the bytes.
///
/// # Errors
/// Description of the content found.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let Some((head, body)) = bytes.split_at_checked(LITTLE_ENDIAN.len()) else {
        return Err(format!("{} bytes", bytes.len()));
    };
    let decoded = match head[..2] {
        [0, 0] => from_bytes::<T, BigEndian>(body),
        [0, 1] => from_bytes::<T, LittleEndian>(body),
        _ => return Err(format!("encapsulation {:#04x} {:#04x}", head[0], head[1])),
    };
    let (value, used) = decoded.map_err(|error| error.to_string())?;
    let surplus = body.len() - used;
    if surplus > MOST_PADDING {
        return Err(format!("{surplus} bytes beyond the message's end"));
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, MagneticField, Time, Vector3};

    fn field() -> MagneticField {
        MagneticField {
            header: Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "abcd".into() },
            magnetic_field: Vector3 { x: 1.0, y: -2.0, z: 0.5 },
            magnetic_field_covariance: [0.25; 9],
        }
    }

    #[test]
    fn val_bytes_by_hand() {
        // Header; 1 and 2; length of the text with its final zero; the text; padding to a multiple of eight bytes after the header.
        let head = [0, 1, 0, 0];
        let text = [5, 0, 0, 0, b'a', b'b', b'c', b'd', 0];
        let begin = [&head[..], &[1, 0, 0, 0, 2, 0, 0, 0], &text, &[0; 7]].concat();
        let bytes = encode(&field());
        assert_eq!(bytes[..begin.len()], begin);
        assert_eq!(bytes[begin.len()..begin.len() + 8], 1.0_f64.to_le_bytes());
        assert_eq!(bytes.len(), begin.len() + 8 * 12);
    }

    #[test]
    fn verif_both_byte_orders() {
        assert_eq!(decode::<MagneticField>(&encode(&field())).unwrap(), field());
        let body = to_vec::<_, BigEndian>(&field()).unwrap();
        let bytes = [&[0, 0, 0, 0], body.as_slice()].concat();
        assert_eq!(decode::<MagneticField>(&bytes).unwrap(), field());
    }

    #[test]
    fn robust_wrong_lengths_are_errors() {
        let bytes = encode(&field());
        for length in 0..bytes.len() {
            assert!(decode::<MagneticField>(&bytes[..length]).is_err(), "{length}");
        }
        let longer = [bytes.as_slice(), &[0; 4]].concat();
        assert_eq!(decode::<MagneticField>(&longer).unwrap_err(), "4 bytes beyond the message's end");
        let other = [&[0, 7], &bytes[2..]].concat();
        assert_eq!(decode::<MagneticField>(&other).unwrap_err(), "encapsulation 0x00 0x07");
    }
}
