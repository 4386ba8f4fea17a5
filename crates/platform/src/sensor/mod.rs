//! Magnetometers on a serial port: line formats and the reader thread.
//!
//! To add a format: a file with a [`LineFormat`] and a row in [`FORMATS`].

mod clock;
mod decoder;
mod hex;
mod labelled;
mod microtesla;
mod reader;
mod ring;
mod table;

pub use clock::SampleClock;
pub use decoder::{Decoder, Tally};
pub use reader::{Arrival, Reader, ReaderSettings, Report};

/// Meaning of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// It completes a reading: counts of the three axes.
    Reading([u16; 3]),
    /// Part of an incomplete reading.
    Part,
    /// A line of the format without a reading.
    Remark,
    /// Not a line of the format.
    Garbage,
}

/// Line format of a sensor. It may keep state between the lines of a reading.
pub trait LineFormat: Send {
    /// Meaning of the next line, without its end.
    fn read(&mut self, line: &[u8]) -> Meaning;

    /// Appends the lines of a reading, with their ends.
    fn print(&self, counts: [u16; 3], bytes: &mut Vec<u8>);
}

/// Row of the registry of line formats.
#[derive(Debug)]
pub struct FormatRow {
    /// Name.
    pub name: &'static str,
    /// Description of its lines.
    pub about: &'static str,
    /// Nominal rate of its sensor (Hz).
    pub rate_hz: f64,
    /// Whether a line that lost its beginning is always recognised as damaged.
    pub shows_pieces: bool,
    /// Constructor.
    pub build: fn() -> Box<dyn LineFormat>,
}

/// Baud rate of all formats.
pub const BAUD: u32 = 115_200;

/// Registry of line formats; the first is the default.
pub const FORMATS: &[FormatRow] = &[
    FormatRow {
        name: "hex",
        about: "two decimal digits, then x, y and z as four lower-case hexadecimal digits each, `01a1b2c3d4e5f6`",
        rate_hz: 800.0,
        shows_pieces: true,
        build: || Box::new(hex::Hex),
    },
    FormatRow {
        name: "table",
        about: "x, y and z in decimal microtesla and the rate, two tabulators apart, `12.30\\t\\t-4.50\\t\\t6.70\\t\\tFreq: 800Hz`",
        // The sketch prints every fifth sample.
        rate_hz: 160.0,
        // `12.30` without its first digit is another number.
        shows_pieces: false,
        build: || Box::new(table::Table),
    },
    FormatRow {
        name: "labelled",
        about: "three lines in decimal microtesla, `>X: 12.30`, `>Y: -4.50`, `>Z: 6.70`",
        // Limit of 115200 baud with three lines of twelve characters.
        rate_hz: 200.0,
        shows_pieces: true,
        build: || Box::new(labelled::Labelled::default()),
    },
];

/// Row of the registry with this name.
pub fn format(name: &str) -> Option<&'static FormatRow> {
    FORMATS.iter().find(|row| row.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exam of every format: it reads the lines that it prints, and no others.
    #[test]
    fn verif_every_format_reads_what_it_prints() {
        let extremes = [0, 1, 255, 0x7fff, 0x8000, 0xabcd, 0xffff];
        for row in FORMATS {
            let mut format = (row.build)();
            for counts in extremes.map(|x| [x, x ^ 0x1234, !x]) {
                let mut bytes = Vec::new();
                format.print(counts, &mut bytes);
                let lines: Vec<_> = bytes.strip_suffix(b"\n").expect("an end").split(|byte| *byte == b'\n').collect();
                let (last, parts) = lines.split_last().expect("a line");
                for part in parts {
                    assert_eq!(format.read(part), Meaning::Part, "{}", row.name);
                }
                assert_eq!(format.read(last), Meaning::Reading(counts), "{}", row.name);
            }
            for garbage in
                [&b""[..], b"\0\xff", b"hello", b"NaN\t\tNaN\t\tNaN\t\tFreq: 1Hz", b">X: inf", b"00ABCDABCDABCD"]
            {
                assert!(matches!(format.read(garbage), Meaning::Garbage), "{}: {garbage:?}", row.name);
            }
        }
    }
}
