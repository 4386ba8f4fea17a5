//! Three lines per reading, `>X: ...`, `>Y: ...`, `>Z: ...`, in decimal microtesla.
//!
//! A reading is three successive lines in this order. Any other line in between discards it, so axes of two readings
//! are never mixed.

use super::{LineFormat, Meaning, microtesla};

const LABELS: [&[u8]; 3] = [b">X: ", b">Y: ", b">Z: "];

/// The format `labelled`.
#[derive(Debug, Default)]
pub(super) struct Labelled {
    counts: [u16; 3],
    /// Number of axes of the current reading so far.
    come: usize,
}

impl LineFormat for Labelled {
    fn read(&mut self, line: &[u8]) -> Meaning {
        let expected = std::mem::take(&mut self.come);
        let Some(axis) = LABELS.iter().position(|label| line.starts_with(label)) else { return Meaning::Garbage };
        let Some(counts) = microtesla::counts(axis, &line[LABELS[axis].len()..]) else { return Meaning::Garbage };
        // x always begins a reading.
        if axis != 0 && axis != expected {
            return Meaning::Garbage;
        }
        self.counts[axis] = counts;
        if axis == LABELS.len() - 1 {
            return Meaning::Reading(self.counts);
        }
        self.come = axis + 1;
        Meaning::Part
    }

    fn print(&self, counts: [u16; 3], bytes: &mut Vec<u8>) {
        for (axis, counts) in counts.into_iter().enumerate() {
            bytes.extend(LABELS[axis]);
            bytes.extend(microtesla::printed(axis, counts).bytes());
            bytes.push(b'\n');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_axes_of_two_readings_are_never_mixed() {
        let mut format = Labelled::default();
        let lines: [(&[u8], Meaning); 8] = [
            (b">Y: 1.5", Meaning::Garbage),
            (b">X: 1.5", Meaning::Part),
            (b">Z: 1.5", Meaning::Garbage),
            (b">X: 1.5", Meaning::Part),
            (b"?", Meaning::Garbage),
            (b">Y: 1.5", Meaning::Garbage),
            (b">X: 0.15", Meaning::Part),
            (b">X: 0.30", Meaning::Part),
        ];
        for (line, meaning) in lines {
            assert_eq!(format.read(line), meaning);
        }
        assert_eq!(format.read(b">Y: 0.45"), Meaning::Part);
        assert_eq!(format.read(b">Z: 0.242"), Meaning::Reading([2, 3, 1]));
    }
}
