//! Serial stream of a magnetometer, in each of the formats.

use platform::sensor::{Decoder, FORMATS, FormatRow, Tally};

/// Chunk sizes of a serial port.
const PIECES: [usize; 3] = [usize::MAX, 7, 1];

pub(super) fn run(bytes: &[u8]) {
    for row in FORMATS {
        let (readings, tally) = decode(row, bytes, PIECES[0]);
        for size in PIECES {
            assert_eq!(decode(row, bytes, size), (readings.clone(), tally.clone()), "{}: pieces of {size}", row.name);
        }
        let lines = bytes.iter().filter(|byte| **byte == b'\n').count() as u64;
        assert_eq!(tally.bytes, bytes.len() as u64);
        assert_eq!(tally.samples, readings.len() as u64);
        assert!(tally.samples + tally.garbage_lines + tally.partial_lines <= lines + 1, "{tally:?} of {lines} lines");
        assert_eq!(tally.example.is_some(), tally.garbage_lines > 0);
        assert!(tally.example.is_none_or(|example| !example.contains(char::is_control)));
        // Formatting the readings in the sensor's format and decoding them again preserves them. The leading newline
        // ends a possibly partial first line.
        let mut printed = b"\n".to_vec();
        readings.iter().for_each(|counts| (row.build)().print(*counts, &mut printed));
        assert_eq!(decode(row, &printed, PIECES[0]).0, readings, "{}", row.name);
        if row.name == "hex" {
            assert_in_input(bytes, &readings);
        }
    }
}

fn decode(row: &FormatRow, bytes: &[u8], size: usize) -> (Vec<[u16; 3]>, Tally) {
    let (mut decoder, mut readings) = (Decoder::new(row), Vec::new());
    bytes.chunks(size.min(bytes.len().max(1))).for_each(|piece| decoder.push(piece, &mut readings));
    (readings, decoder.finish())
}

/// Asserts that every reading is a separate word of the input.
fn assert_in_input(bytes: &[u8], readings: &[[u16; 3]]) {
    let mut words = bytes.split(u8::is_ascii_whitespace);
    for [x, y, z] in readings {
        let digits = format!("{x:04x}{y:04x}{z:04x}");
        assert!(
            words.any(|word| word.len() == 14 && word.ends_with(digits.as_bytes())),
            "{digits} is not in the input"
        );
    }
}
