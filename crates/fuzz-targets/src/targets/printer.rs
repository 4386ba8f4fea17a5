//! Replies of a printer.

use platform::printer::{Answer, Position};

use crate::properties::is_decimal;

pub(super) fn run(bytes: &[u8]) {
    for line in String::from_utf8_lossy(bytes).lines() {
        match Answer::parse(line) {
            Answer::Ok(Some(position)) | Answer::Position(position) => assert_in_input(line, position),
            Answer::Resend(number) => assert!(line.contains(&number.to_string()), "{number} of `{line}`"),
            Answer::Error(text) | Answer::Halted(text) => assert_eq!(text, line.trim()),
            Answer::Ok(None) | Answer::Busy | Answer::Started | Answer::Remark => {}
        }
    }
}

/// Asserts that every coordinate is a decimal number after its axis letter.
fn assert_in_input(line: &str, position: Position) {
    let line = line.trim();
    let behind = |axis: char, value: f64| {
        let mut words =
            line.split(axis).skip(1).filter_map(|rest| rest.strip_prefix(':')?.split_ascii_whitespace().next());
        assert!(words.any(|word| is_decimal(word) && word.parse() == Ok(value)), "{axis}: {value} of `{line}`");
    };
    for (axis, value) in ['X', 'Y', 'Z'].into_iter().zip(position.goal) {
        behind(axis, value);
    }
    for (axis, value) in ['X', 'Y'].into_iter().zip(position.count.into_iter().flatten()) {
        behind(axis, value);
    }
}
