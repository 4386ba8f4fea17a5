//! Streaming reader of samples, from a file or from a pipe that is still being written.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use files::Error;
use flate2::bufread::MultiGzDecoder;

use super::{LAYOUTS, Layout, MARK};
use crate::Sample;

/// Longest line in bytes.
const LONGEST_LINE: u64 = 4096;

const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Iterator over the samples of a log.
///
/// A last line without a line end is incomplete and skipped, even if it can be parsed: a number may lack digits.
pub struct LogReader {
    path: PathBuf,
    lines: Box<dyn BufRead + Send>,
    layout: Option<&'static Layout>,
    line: u64,
    last_s: f64,
    cut_off: bool,
    over: bool,
}

impl LogReader {
    /// Opens a file, which may be compressed with gzip.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let io = |reason| Error::Io { path: path.into(), reason };
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let compressed = file.fill_buf().map_err(io)?.starts_with(&GZIP);
        Ok(if compressed { Self::new(path, BufReader::new(MultiGzDecoder::new(file))) } else { Self::new(path, file) })
    }

    /// Reader of a stream; `path` is its name in errors.
    pub fn new(path: &Path, lines: impl BufRead + Send + 'static) -> Self {
        Self {
            path: path.into(),
            lines: Box::new(lines),
            layout: None,
            line: 0,
            last_s: f64::NEG_INFINITY,
            cut_off: false,
            over: false,
        }
    }

    /// Whether the last line was incomplete.
    pub fn cut_off(&self) -> bool {
        self.cut_off
    }

    /// Next line without its end. `None` at the end of the log.
    fn next_line(&mut self) -> Result<Option<String>, Error> {
        let mut bytes = Vec::new();
        let read = self.lines.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes);
        self.line += 1;
        match read {
            Ok(0) => return Ok(None),
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                return Err(self.wrong("row", "the end of an incomplete gzip file", "a complete one: copy it again"));
            }
            Err(reason) => return Err(Error::Io { path: self.path.clone(), reason }),
        }
        if bytes.pop() != Some(b'\n') {
            if bytes.len() as u64 + 1 == LONGEST_LINE {
                return Err(self.wrong("row", format!("more than {LONGEST_LINE} bytes"), "a line of the log"));
            }
            self.cut_off = true;
            return Ok(None);
        }
        let text = String::from_utf8_lossy(&bytes);
        let text = if self.line == 1 { text.trim_start_matches(MARK) } else { &text };
        Ok(Some(text.trim_end_matches('\r').to_owned()))
    }

    fn next_sample(&mut self) -> Result<Option<Sample>, Error> {
        let Some(mut line) = self.next_line()? else {
            if self.layout.is_none() {
                return Err(self.wrong("row", "the end of the log", "at least one sample"));
            }
            return Ok(None);
        };
        let layout = match self.layout {
            Some(layout) => layout,
            None => {
                let layout = self.recognise(&line)?;
                self.layout = Some(layout);
                if layout.headers.contains(&line.as_str()) {
                    let Some(next) = self.next_line()? else { return Ok(None) };
                    line = next;
                }
                layout
            }
        };
        let fields: Vec<&str> = line.split(',').collect();
        if fields.len() != layout.columns.len() {
            let found = format!("{} fields", fields.len());
            return Err(self.wrong("row", found, format!("{} fields", layout.columns.len())));
        }
        let sample = (layout.parse)(&fields).map_err(|(column, expected)| {
            self.wrong(&format!("column {}", layout.columns[column]), format!("`{}`", fields[column]), expected)
        })?;
        if sample.t_s < self.last_s {
            let place = format!("column {}", layout.columns[0]);
            let expected = "a time not before that of the row above";
            return Err(self.wrong(&place, format!("`{}`", fields[0]), expected));
        }
        self.last_s = sample.t_s;
        Ok(Some(sample))
    }

    fn recognise(&self, line: &str) -> Result<&'static Layout, Error> {
        let fields: Vec<&str> = line.split(',').collect();
        let takes = |layout: &&Layout| fields.len() == layout.columns.len() && (layout.parse)(&fields).is_ok();
        let by_header = LAYOUTS.iter().find(|layout| layout.headers.contains(&line));
        by_header.or_else(|| LAYOUTS.iter().find(takes)).ok_or_else(|| {
            let known: Vec<String> = LAYOUTS.iter().map(|layout| format!("`{}`", layout.headers[0])).collect();
            let found: String = line.chars().take(60).collect();
            self.wrong("header", format!("`{found}`"), known.join(" or "))
        })
    }

    fn wrong(&self, place: &str, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::Table {
            path: self.path.clone(),
            line: self.line,
            place: place.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }
}

impl Iterator for LogReader {
    type Item = Result<Sample, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.over {
            return None;
        }
        let next = self.next_sample().transpose();
        self.over = !matches!(next, Some(Ok(_)));
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Sample>, String> {
        let reader = LogReader::new(Path::new("log"), io::Cursor::new(text.to_owned()));
        reader.collect::<Result<_, _>>().map_err(|error| error.to_string())
    }

    #[test]
    fn verif_the_first_line_determines_the_layout() {
        let native = read("t_s,x_counts,y_counts,z_counts\r\n0.5,1,2,65535\r\n").unwrap();
        assert_eq!(native, [Sample { t_s: 0.5, counts: [1, 2, 65535] }]);
        for header in ["", "timestamp,AX,AY\n"] {
            let log = read(&format!("{header}2024-04-17_11:48:11.5,33059,32798\n")).unwrap();
            assert_eq!(log, [Sample { t_s: 1_713_354_491.5, counts: [33059, 32798, 0] }]);
        }
        let grid = read("timestamp,ss.x,ss.y,ss.z,Dist,Bend\n1702641442.5,24963,51635,35964,0.0,0.0\n").unwrap();
        assert_eq!(grid, [Sample { t_s: 1_702_641_442.5, counts: [24963, 51635, 35964] }]);
    }

    #[test]
    fn robust_an_incomplete_last_line_is_skipped() {
        for last in ["1.0,4,5", "1.0,4,5,6"] {
            let text = format!("t_s,x_counts,y_counts,z_counts\n0.5,1,2,3\n{last}");
            let mut reader = LogReader::new(Path::new("log"), io::Cursor::new(text));
            assert_eq!(reader.by_ref().count(), 1);
            assert!(reader.cut_off());
        }
    }

    #[test]
    fn robust_a_byte_order_mark_is_skipped() {
        for header in ["", "t_s,x_counts,y_counts,z_counts\r\n"] {
            let log = read(&format!("\u{feff}{header}0.5,1,2,3\n")).unwrap();
            assert_eq!(log, [Sample { t_s: 0.5, counts: [1, 2, 3] }]);
        }
    }

    #[test]
    fn robust_an_error_names_line_column_found_and_expected() {
        let header = "t_s,x_counts,y_counts,z_counts\n";
        for (text, expected) in [
            ("", "log:1: row: found the end of the log, expected at least one sample"),
            ("1,2\n", "log:1: header: found `1,2`, expected "),
            (&format!("{header}0,1,2\n"), "log:2: row: found 3 fields, expected 4 fields"),
            (
                &format!("{header}0,1,2,3\n0,1,-2,3\n"),
                "log:3: column y_counts: found `-2`, expected counts from 0 to 65535",
            ),
            (&format!("{header}nan,1,2,3\n"), "log:2: column t_s: found `nan`, expected a finite number of seconds"),
            (&format!("{header}1,1,2,3\n0,1,2,3\n"), "log:3: column t_s: found `0`, expected a time not before"),
            (&format!("{header}{}\n", "9".repeat(5000)), "log:2: row: found more than 4096 bytes, expected a line"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
