//! Decoder from bytes to readings, with statistics.

use super::{FormatRow, LineFormat, Meaning};
use crate::lines::{Lines, shown};

/// Statistics of a sensor's port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Number of bytes.
    pub bytes: u64,
    /// Number of readings.
    pub samples: u64,
    /// Number of lines that are not of the format.
    pub garbage_lines: u64,
    /// Number of lines that are, or may be, incomplete: the first after the port was opened, and the last.
    pub partial_lines: u64,
    /// First line that is not of the format.
    pub example: Option<String>,
}

/// Decoder of a port's bytes, which arrive in any pieces.
pub struct Decoder {
    lines: Lines,
    format: Box<dyn LineFormat>,
    shows_pieces: bool,
    is_first: bool,
    tally: Tally,
}

impl Decoder {
    /// Decoder of a port that was just opened.
    pub fn new(row: &FormatRow) -> Self {
        Self {
            lines: Lines::default(),
            format: (row.build)(),
            shows_pieces: row.shows_pieces,
            is_first: true,
            tally: Tally::default(),
        }
    }

    /// Appends the readings that these bytes complete.
    pub fn push(&mut self, bytes: &[u8], readings: &mut Vec<[u16; 3]>) {
        let Self { lines, format, shows_pieces, is_first, tally } = self;
        tally.bytes += bytes.len() as u64;
        lines.push(bytes, |line| {
            // An overlong line contains no reading.
            let meaning = if line.overlong { Meaning::Garbage } else { format.read(line.bytes) };
            match meaning {
                // A port may be opened in the middle of a line.
                Meaning::Reading(_) if *is_first && !*shows_pieces => tally.partial_lines += 1,
                Meaning::Garbage if *is_first => tally.partial_lines += 1,
                Meaning::Reading(counts) => {
                    tally.samples += 1;
                    readings.push(counts);
                }
                Meaning::Part | Meaning::Remark => {}
                Meaning::Garbage => {
                    tally.garbage_lines += 1;
                    tally.example.get_or_insert_with(|| shown(line.bytes));
                }
            }
            *is_first = false;
        });
    }

    /// Statistics so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Final statistics: an incomplete last line counts as partial.
    pub fn finish(mut self) -> Tally {
        self.tally.partial_lines += u64::from(!self.lines.rest().is_empty());
        self.tally
    }
}

#[cfg(test)]
mod tests {
    use super::super::FORMATS;
    use super::*;

    #[test]
    fn robust_a_port_opened_within_a_line_gives_no_wrong_reading() {
        let sent = [[1000, 2000, 3000], [4000, 5000, 6000], [7000, 8000, 9000]];
        for row in FORMATS {
            let mut bytes = Vec::new();
            sent.iter().for_each(|counts| (row.build)().print(*counts, &mut bytes));
            for start in 0..bytes.len() / sent.len() {
                let (mut decoder, mut readings) = (Decoder::new(row), Vec::new());
                decoder.push(&bytes[start..], &mut readings);
                assert!(
                    sent.ends_with(&readings) && !readings.is_empty(),
                    "{}: from byte {start}: {readings:?}",
                    row.name
                );
            }
        }
    }
}
