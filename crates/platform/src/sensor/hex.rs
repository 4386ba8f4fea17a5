//! Two decimal digits, then x, y and z as four lower-case hexadecimal digits each; anything else on the line is ignored.
//!
//! The format has no checksum. A valid reading is a word of exactly 14 digits between spaces or the ends of the line,
//! so a line that lost or gained a character gives no reading, nor do two joined lines.

use super::{LineFormat, Meaning};

const DIGITS: usize = 14;

/// The format `hex`.
#[derive(Debug)]
pub(super) struct Hex;

impl LineFormat for Hex {
    fn read(&mut self, line: &[u8]) -> Meaning {
        let mut readings = line.split(u8::is_ascii_whitespace).filter_map(counts);
        match (readings.next(), readings.next()) {
            (Some(counts), None) => Meaning::Reading(counts),
            // A line with two readings is damaged: sensors print one.
            _ => Meaning::Garbage,
        }
    }

    fn print(&self, [x, y, z]: [u16; 3], bytes: &mut Vec<u8>) {
        bytes.extend(format!("00{x:04x}{y:04x}{z:04x}\n").bytes());
    }
}

fn counts(word: &[u8]) -> Option<[u16; 3]> {
    let (number, axes) = word.split_at_checked(2).filter(|_| word.len() == DIGITS)?;
    let mut counts = [0; 3];
    for (count, digits) in counts.iter_mut().zip(axes.chunks_exact(4)) {
        *count = digits.iter().try_fold(0_u16, |value, digit| Some(value << 4 | nibble(*digit)?))?;
    }
    number.iter().all(u8::is_ascii_digit).then_some(counts)
}

fn nibble(digit: u8) -> Option<u16> {
    match digit {
        b'0'..=b'9' => Some(u16::from(digit - b'0')),
        b'a'..=b'f' => Some(u16::from(digit - b'a') + 10),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_reads_the_documented_line() {
        assert_eq!(Hex.read(b"421f2e3d4c5b6a"), Meaning::Reading([0x1f2e, 0x3d4c, 0x5b6a]));
        assert_eq!(Hex.read(b"sensor 421f2e3d4c5b6a  800Hz"), Meaning::Reading([0x1f2e, 0x3d4c, 0x5b6a]));
    }

    #[test]
    fn robust_a_damaged_line_is_no_reading() {
        for line in [
            &b"421f2e3d4c5b6"[..],
            b"421f2e3d4c5b6a0",
            b"421f2e3d4c5b6a421f2e3d4c5b6a",
            b"421f2e3d4c5b6a 421f2e3d4c5b6a",
            b"4a1f2e3d4c5b6a",
            b"421F2E3D4C5B6A",
            b"421f2e3d-c5b6a",
        ] {
            assert_eq!(Hex.read(line), Meaning::Garbage, "{line:?}");
        }
    }
}
