//! Bytes to readings, and a tally of what came.

use super::{FormatRow, LineFormat, Meaning};
use crate::lines::{Lines, shown};

/// What has come over a sensor's port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Bytes.
    pub bytes: u64,
    /// Readings.
    pub samples: u64,
    /// Lines that the format does not know.
    pub garbage_lines: u64,
    /// Lines of which only a piece came, or may have: the first after the port was opened, and the last.
    pub partial_lines: u64,
    /// The first line that was garbage.
    pub example: Option<String>,
}

/// Turns bytes of a port, in whatever pieces, into readings.
pub struct Decoder {
    lines: Lines,
    format: Box<dyn LineFormat>,
    shows_pieces: bool,
    is_first: bool,
    tally: Tally,
}

impl Decoder {
    /// One for a port that was just opened.
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
            // A reading does not hide in a line of hundreds of characters.
            let meaning = if line.overlong { Meaning::Garbage } else { format.read(line.bytes) };
            match meaning {
                // Whoever opens a port in the middle of a line gets its end.
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

    /// What has come so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// What has come in all: a line that never ended is a partial one.
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
    fn robust_a_port_that_is_opened_within_a_line_gives_no_wrong_reading() {
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
