//! One line per reading: x, y and z in decimal microtesla and the sensor's rate, two tabulators apart, after a line
//! `Code starting`.

use super::{LineFormat, Meaning, microtesla};

/// The format `table`.
#[derive(Debug)]
pub(super) struct Table;

impl LineFormat for Table {
    fn read(&mut self, line: &[u8]) -> Meaning {
        if line == b"Code starting" {
            return Meaning::Remark;
        }
        reading(line).map_or(Meaning::Garbage, Meaning::Reading)
    }

    fn print(&self, counts: [u16; 3], bytes: &mut Vec<u8>) {
        for (axis, counts) in counts.into_iter().enumerate() {
            bytes.extend(microtesla::printed(axis, counts).bytes());
            bytes.extend(b"\t\t");
        }
        bytes.extend(b"Freq: 800Hz\n");
    }
}

fn reading(line: &[u8]) -> Option<[u16; 3]> {
    // Every other field is empty: columns are separated by two tabulators.
    let fields: Vec<_> = line.split(|byte| *byte == b'\t').collect();
    let [x, b"", y, b"", z, b"", rate] = fields[..] else { return None };
    let digits = rate.strip_prefix(b"Freq:")?.trim_ascii_start().strip_suffix(b"Hz")?;
    if !digits.iter().all(|byte| byte.is_ascii_digit() || *byte == b'.') {
        return None;
    }
    Some([microtesla::counts(0, x)?, microtesla::counts(1, y)?, microtesla::counts(2, z)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_reads_the_documented_line() {
        assert_eq!(Table.read(b"Code starting"), Meaning::Remark);
        assert_eq!(Table.read(b"1.50\t\t-0.15\t\t24.20\t\tFreq: 812Hz"), Meaning::Reading([10, 0xffff, 100]));
        assert_eq!(Table.read(b"1.50\t\t-0.15\t\t24.20\t\tFreq: 81"), Meaning::Garbage);
        assert_eq!(Table.read(b"1.50\t-0.15\t\t24.20\t\tFreq: 812Hz"), Meaning::Garbage);
    }
}
