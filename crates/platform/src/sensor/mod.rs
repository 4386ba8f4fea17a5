//! Magnetometers on a serial port: line formats, and the thread that reads one.
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

/// What a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// It completes a reading: counts of the three axes.
    Reading([u16; 3]),
    /// It is part of a reading that is not complete.
    Part,
    /// The format knows it, and it says nothing of the field.
    Remark,
    /// The format does not know it.
    Garbage,
}

/// What a sensor prints. It may keep what it needs between the lines of a reading.
pub trait LineFormat: Send {
    /// What the next line, without its end, means.
    fn read(&mut self, line: &[u8]) -> Meaning;

    /// Appends the lines, with their ends, by which a sensor says this.
    fn print(&self, counts: [u16; 3], bytes: &mut Vec<u8>);
}

/// A row of the registry of line formats.
#[derive(Debug)]
pub struct FormatRow {
    /// Its name.
    pub name: &'static str,
    /// What its lines look like.
    pub about: &'static str,
    /// Readings a second of the sensor that prints it, as documented.
    pub rate_hz: f64,
    /// Whether a line that lost its beginning cannot be taken for a whole one.
    pub shows_pieces: bool,
    /// Makes one.
    pub build: fn() -> Box<dyn LineFormat>,
}

/// Bits a second of all of these.
pub const BAUD: u32 = 115_200;

/// The registry of line formats; the first is the default.
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
        // What 115200 baud leave to three lines of a dozen characters.
        rate_hz: 200.0,
        shows_pieces: true,
        build: || Box::new(labelled::Labelled::default()),
    },
];

/// The registry's row of this name.
pub fn format(name: &str) -> Option<&'static FormatRow> {
    FORMATS.iter().find(|row| row.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The exam of every format: what it prints it reads, and nothing in between.
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
