//! Damaged input: no panic, and no wrong reading.

use std::collections::VecDeque;

use platform::sensor::{Decoder, FORMATS, FormatRow, format};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Number of lines of the long run.
const LINES: u64 = 10_000_000;
/// Undamaged lines on either side of a damaged one, which can only affect its neighbour.
const BETWEEN: u64 = 3;

/// Readings decoded from bytes that arrive in pieces.
fn decoded(row: &FormatRow, bytes: &[u8], pieces: &mut Pcg64) -> Vec<[u16; 3]> {
    let (mut decoder, mut readings, mut rest) = (Decoder::new(row), Vec::new(), bytes);
    while !rest.is_empty() {
        let (piece, later) = rest.split_at(pieces.random_range(1..=rest.len().min(4096)));
        decoder.push(piece, &mut readings);
        rest = later;
    }
    let tally = decoder.finish();
    assert_eq!((tally.bytes, tally.samples), (bytes.len() as u64, readings.len() as u64));
    readings
}

/// Independent parser of the format `hex`: exactly one word of a line is a reading.
fn hex_reference(bytes: &[u8]) -> Vec<[u16; 3]> {
    let ended = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let word = |word: &str| {
        let plain = word.len() == 14 && word.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f'));
        let axis = |start: usize| u16::from_str_radix(&word[start..start + 4], 16).expect("plain");
        let is_reading = plain && word[..2].chars().all(|c| c.is_ascii_digit());
        is_reading.then(|| [axis(2), axis(6), axis(10)])
    };
    let line = |line: &[u8]| {
        let text: String = line.iter().map(|byte| char::from(*byte)).collect();
        let readings: Vec<_> = text.split(['\t', '\n', '\x0c', '\r', ' ']).filter_map(word).collect();
        (readings.len() == 1 && line.len() <= 256).then(|| readings[0])
    };
    bytes[..ended].split(|byte| *byte == b'\n').filter_map(line).collect()
}

/// A damaged line: invalid bytes overwritten or inserted; in the format `hex`, also a piece lost, doubled or cut off.
/// In decimal formats a lost digit gives another valid number.
fn damage(line: &[u8], counts_characters: bool, rng: &mut Pcg64) -> Vec<u8> {
    let mut damaged = line.to_vec();
    let at = rng.random_range(0..line.len() - 1);
    match rng.random_range(0..if counts_characters { 5 } else { 2 }) {
        0 => damaged[at] = b"!~\x00\xff"[rng.random_range(0..4)],
        1 => drop(damaged.splice(at..at, std::iter::repeat_n(b'#', rng.random_range(1..600)))),
        // Less than a line: a whole lost line is not damage.
        2 => drop(damaged.drain(at..(at + rng.random_range(1..8)).min(line.len()))),
        3 => damaged.insert(at, line[at]),
        _ => damaged.truncate(at),
    }
    damaged
}

/// Decodes consecutive readings of which every fourth is damaged. All others must be decoded, and a damaged one gives
/// its own reading or none.
fn count_through_damage(row: &FormatRow, lines: u64, seed: u64) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let (printer, mut decoder, mut bytes) = ((row.build)(), Decoder::new(row), Vec::new());
    let (mut readings, mut line) = (Vec::new(), Vec::new());
    let counts = |number: u64| {
        // Neighbours differ in every digit, so that a mixture of two is detected.
        let mixed = number.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        [(mixed >> 48) as u16, (mixed >> 32) as u16, (mixed >> 16) as u16]
    };
    let mut expected = VecDeque::new();
    for number in 0..lines {
        line.clear();
        printer.print(counts(number), &mut line);
        let is_damaged = number % (BETWEEN + 1) == BETWEEN;
        bytes.extend(if is_damaged { damage(&line, row.name == "hex", &mut rng) } else { line.clone() });
        expected.push_back(number);
        if bytes.len() < 4096 && number + 1 < lines {
            continue;
        }
        decoder.push(&bytes, &mut readings);
        bytes.clear();
        for reading in readings.drain(..) {
            loop {
                let number = expected.pop_front().unwrap_or_else(|| panic!("{}: {reading:?} was not sent", row.name));
                if counts(number) == reading {
                    break;
                }
                // A damaged line may also damage the next one, and no other.
                let is_behind_damage = number % (BETWEEN + 1) == 0;
                assert!(number % (BETWEEN + 1) == BETWEEN || is_behind_damage, "{}: {number} is lost", row.name);
            }
        }
    }
    assert!(expected.len() <= 4, "{}: {} lines lost at the end", row.name, expected.len());
}

#[test]
fn robust_damaged_lines_give_no_wrong_reading() {
    for row in FORMATS {
        count_through_damage(row, 40_000, 1);
    }
}

/// Ten million lines of each format and of noise; takes minutes.
#[test]
#[ignore = "takes minutes; run it by name"]
fn robust_ten_million_damaged_lines_give_no_wrong_reading() {
    for row in FORMATS {
        count_through_damage(row, LINES, 2);
    }
    let mut rng = Pcg64::seed_from_u64(3);
    let (mut readings, mut lines, mut bytes) = (Vec::new(), 0, vec![0_u8; 1 << 16]);
    let mut decoders: Vec<_> = FORMATS.iter().map(Decoder::new).collect();
    while lines < LINES {
        // Noise of the characters of the formats.
        bytes.fill_with(|| b"0123456789abcdef\n\n\r\t >XYZ:.-"[rng.random_range(0..28)]);
        lines += bytes.iter().filter(|byte| **byte == b'\n').count() as u64;
        for decoder in &mut decoders {
            decoder.push(&bytes, &mut readings);
        }
        readings.clear();
    }
}

proptest! {
    #[test]
    fn robust_random_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..4096), seed: u64) {
        for row in FORMATS {
            let whole = decoded(row, &bytes, &mut Pcg64::seed_from_u64(seed));
            prop_assert_eq!(&whole, &decoded(row, &bytes, &mut Pcg64::seed_from_u64(seed ^ 1)), "pieces do not matter");
        }
    }

    #[test]
    fn verif_hex_agrees_with_an_independent_parser(
        bytes in prop::collection::vec(prop::sample::select(b"0123456789abcdefA\n\r\t Z".to_vec()), 0..600),
        readings in prop::collection::vec(any::<[u16; 3]>(), 0..20),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..6),
        seed: u64,
    ) {
        let row = format("hex").expect("registered");
        let mut sent = Vec::new();
        readings.iter().for_each(|counts| (row.build)().print(*counts, &mut sent));
        sent.extend(&bytes);
        for cut in cuts {
            if !sent.is_empty() {
                sent.remove(cut.index(sent.len()));
            }
        }
        prop_assert_eq!(decoded(row, &sent, &mut Pcg64::seed_from_u64(seed)), hex_reference(&sent));
    }
}
