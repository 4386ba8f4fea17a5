//! Streaming reader of trace rows, with memory independent of the length of the file.

use std::f64::consts::FRAC_PI_2;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use files::Error;
use files::hexadecimal;
use files::table::field_error;
use memchr::{memchr, memchr_iter};
use sha2::{Digest as _, Sha256};
use whisker::frames::{Point, Pose, Twist, World};

use crate::Sidecar;
use crate::table::{
    COLUMNS, FARTHEST_M, FrictionTruth, FurtherColumns, Instant, LARGEST, SECOND_COLUMNS, SecondTruth, TruthInstant,
    YieldingTruth, columns,
};

/// Number of columns without further ones, and the largest number with them.
const PLAIN: usize = COLUMNS.len();
const CELLS: usize = PLAIN + SECOND_COLUMNS.len();

/// Largest angle of a contact force to the normal: a right one, rounded to the decimals that are written.
const MOST_ANGLE_RAD: f64 = FRAC_PI_2 + 1e-10;

/// Largest magnitude per column: 1e12 for times, which may count from any epoch, [`FARTHEST_M`] for positions and lengths, whose
/// names end in `_m`, and [`LARGEST`] for all other quantities, including moments, whose names end in `_n_m`. The bounds keep
/// derived quantities finite and outlines between positions of bounded length.
const fn bounds(further: FurtherColumns) -> [f64; CELLS] {
    let mut most = [LARGEST; CELLS];
    most[0] = 1e12;
    let further = further.columns();
    let mut i = 1;
    while i < PLAIN + further.len() {
        let (name, _) = if i < PLAIN { COLUMNS[i] } else { further[i - PLAIN] };
        match name.as_bytes() {
            [.., b'_', b'n', b'_', b'm'] => {}
            [.., b'_', b'm'] => most[i] = FARTHEST_M,
            _ => {}
        }
        i += 1;
    }
    most
}

/// Bounds of a table with each of the [`FurtherColumns`], in their order.
const MOST: [[f64; CELLS]; 4] = [
    bounds(FurtherColumns::None),
    bounds(FurtherColumns::Friction),
    bounds(FurtherColumns::Second),
    bounds(FurtherColumns::Yielding),
];

/// Size of a read buffer in bytes; larger than [`MOST_LINE_BYTES`].
const CHUNK_BYTES: usize = 1 << 18;

/// Longest accepted row in bytes.
const MOST_LINE_BYTES: usize = 1 << 14;

/// Iterator over the rows of a trace in order of time: recording and ground truth. Each row is checked when it is read;
/// row count and hash are checked against the sidecar after the last row. A trace is therefore valid only if no item is
/// an error. The iterator ends after an error.
#[derive(Debug)]
pub struct TraceRows {
    path: PathBuf,
    lines: Lines,
    /// Row count stated by the sidecar.
    expected_rows: usize,
    expected_sha256: String,
    /// Columns of the table beyond the plain ones.
    further: FurtherColumns,
    rows: usize,
    last_s: Option<f64>,
    is_over: bool,
}

impl TraceRows {
    /// Opens the trace with this CSV or sidecar path.
    ///
    /// # Errors
    /// [`Error`] with file and place if the sidecar or the header is invalid or the table cannot be read.
    pub fn open(path: &Path) -> Result<(Sidecar, Self), Error> {
        let sidecar = Sidecar::read(path)?;
        let rows = Self::of(&sidecar, path)?;
        Ok((sidecar, rows))
    }

    /// Opens the rows of the trace with this sidecar. `path` is the path of its CSV or sidecar.
    ///
    /// # Errors
    /// [`Error`] with file and place if the header is invalid or the table cannot be read.
    pub fn of(sidecar: &Sidecar, path: &Path) -> Result<Self, Error> {
        let path = path.with_extension("csv");
        let mut lines = Lines::open(&path)?;
        let header = lines.next(&path)?;
        let further = check_header(&path, header.map(|(start, end)| &lines.buffer[start..end]))?;
        Ok(Self {
            path,
            lines,
            expected_rows: sidecar.rows,
            expected_sha256: sidecar.csv_sha256.clone(),
            further,
            rows: 0,
            last_s: None,
            is_over: false,
        })
    }

    fn read(&mut self) -> Result<Option<(Instant, TruthInstant)>, Error> {
        let Some((start, end)) = self.lines.next(&self.path)? else {
            self.check_whole()?;
            return Ok(None);
        };
        let line = Line::split(&self.path, self.lines.number, &self.lines.buffer[start..end], self.further)?;
        let row = line.row(self.last_s)?;
        self.last_s = Some(row.0.t_s);
        self.rows += 1;
        Ok(Some(row))
    }

    fn check_whole(&mut self) -> Result<(), Error> {
        let at_end = |found: String, expected: String| Error::Table {
            path: self.path.clone(),
            line: self.rows as u64 + 2,
            place: "row".into(),
            found,
            expected,
        };
        if self.rows == 0 {
            return Err(at_end("the end of the file".into(), "at least one row".into()));
        }
        if self.rows != self.expected_rows {
            let expected = format!("{} rows, as stated by its sidecar", self.expected_rows);
            return Err(at_end(format!("the end after {} rows", self.rows), expected));
        }
        let found = hexadecimal(&std::mem::take(&mut self.lines.digest).finalize());
        if found != self.expected_sha256 {
            let expected = format!("{}, as stated by its sidecar", self.expected_sha256);
            return Err(Error::value(&self.path, "sha256", found, expected));
        }
        Ok(())
    }
}

impl Iterator for TraceRows {
    type Item = Result<(Instant, TruthInstant), Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let row = self.read().transpose();
        self.is_over = !matches!(row, Some(Ok(_)));
        row
    }
}

/// Lines of a file, buffered in chunks, with the hash of all bytes read.
#[derive(Debug)]
struct Lines {
    file: File,
    digest: Sha256,
    buffer: Vec<u8>,
    /// Part of the buffer that has not been returned yet.
    start: usize,
    end: usize,
    /// Number of the current line, from 1.
    number: u64,
}

impl Lines {
    fn open(path: &Path) -> Result<Self, Error> {
        let file = File::open(path).map_err(Error::io(path))?;
        Ok(Self { file, digest: Sha256::new(), buffer: vec![0; CHUNK_BYTES], start: 0, end: 0, number: 0 })
    }

    /// Range in the buffer of the next non-empty line, without its line ending. `None` after the last line.
    fn next(&mut self, path: &Path) -> Result<Option<(usize, usize)>, Error> {
        loop {
            let found = memchr(b'\n', &self.buffer[self.start..self.end]);
            let is_enough = found.is_some() || self.end - self.start > MOST_LINE_BYTES;
            if !is_enough && self.fill(path)? {
                continue;
            }
            if found.is_none() && self.start == self.end {
                return Ok(None);
            }
            let start = self.start;
            let mut end = found.map_or(self.end, |length| start + length);
            self.start = if found.is_some() { end + 1 } else { end };
            self.number += 1;
            if end - start > MOST_LINE_BYTES {
                return Err(Error::Table {
                    path: path.into(),
                    line: self.number,
                    place: "row".into(),
                    found: format!("more than {MOST_LINE_BYTES} bytes"),
                    expected: format!("{CELLS} fields"),
                });
            }
            if end > start && self.buffer[end - 1] == b'\r' {
                end -= 1;
            }
            if end > start {
                return Ok(Some((start, end)));
            }
        }
    }

    /// Reads more data into the buffer. Returns `false` at the end of the file.
    fn fill(&mut self, path: &Path) -> Result<bool, Error> {
        self.buffer.copy_within(self.start..self.end, 0);
        (self.start, self.end) = (0, self.end - self.start);
        let count = loop {
            match self.file.read(&mut self.buffer[self.end..]) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                read => break read.map_err(Error::io(path))?,
            }
        };
        self.digest.update(&self.buffer[self.end..self.end + count]);
        self.end += count;
        Ok(count > 0)
    }
}

/// Checks that the first line consists of the column names, and returns which further ones it has.
fn check_header(path: &Path, line: Option<&[u8]>) -> Result<FurtherColumns, Error> {
    let wrong = |place: String, found: String, expected: String| Error::Table {
        path: path.into(),
        line: 1,
        place,
        found,
        expected,
    };
    // Spreadsheets begin a table in UTF-8 with a mark of the byte order.
    let line = line.map(|line| line.strip_prefix("\u{feff}".as_bytes()).unwrap_or(line));
    let first = line.unwrap_or_default().split(|byte| *byte == b',').nth(PLAIN);
    let begins = |further: &FurtherColumns| first == further.columns().first().map(|(name, _)| name.as_bytes());
    let further = [FurtherColumns::Friction, FurtherColumns::Second, FurtherColumns::Yielding]
        .into_iter()
        .find(begins)
        .unwrap_or(FurtherColumns::None);
    let names: Vec<&str> = columns(further).map(|(name, _)| name).collect();
    let Some(line) = line else { return Err(wrong("header".into(), "an empty file".into(), names.join(","))) };
    let cells: Vec<&[u8]> = line.split(|byte| *byte == b',').collect();
    for i in 0..cells.len().max(names.len()) {
        let found =
            cells.get(i).map_or("no more columns".into(), |cell| format!("`{}`", String::from_utf8_lossy(cell)));
        let expected = names.get(i).map_or("no more columns".into(), |name| format!("`{name}`"));
        if found != expected {
            return Err(wrong(format!("header, column {}", i + 1), found, expected));
        }
    }
    Ok(further)
}

/// Flag in an optional field. The error is the expected content.
#[inline]
pub(crate) fn flag(number: Option<f64>) -> Result<Option<bool>, &'static str> {
    match number {
        None => Ok(None),
        Some(0.0) => Ok(Some(false)),
        Some(1.0) => Ok(Some(true)),
        Some(_) => Err("0, 1 or an empty field"),
    }
}

/// Row of the table, split at its commas.
struct Line<'a> {
    path: &'a Path,
    number: u64,
    text: &'a [u8],
    /// End of each cell.
    ends: [usize; CELLS],
    /// Columns beyond the plain ones.
    further: FurtherColumns,
}

impl<'a> Line<'a> {
    #[inline]
    fn split(path: &'a Path, number: u64, text: &'a [u8], further: FurtherColumns) -> Result<Self, Error> {
        let cells = PLAIN + further.columns().len();
        let mut ends = [text.len(); CELLS];
        let mut commas = 0;
        for place in memchr_iter(b',', text) {
            if let Some(end) = ends.get_mut(commas) {
                *end = place;
            }
            commas += 1;
        }
        if commas + 1 != cells {
            return Err(Error::Table {
                path: path.into(),
                line: number,
                place: "row".into(),
                found: format!("{} fields", commas + 1),
                expected: format!("{cells} fields"),
            });
        }
        Ok(Self { path, number, text, ends, further })
    }

    #[inline]
    fn cell(&self, i: usize) -> &'a [u8] {
        let start = if i == 0 { 0 } else { self.ends[i - 1] + 1 };
        &self.text[start..self.ends[i]]
    }

    #[inline]
    fn optional(&self, i: usize) -> Result<Option<f64>, Error> {
        let cell = self.cell(i);
        if cell.is_empty() {
            return Ok(None);
        }
        let most = MOST[self.further as usize][i];
        match fast_float2::parse::<f64, _>(cell) {
            Ok(value) if value.abs() <= most => Ok(Some(value)),
            Ok(value) if value.is_finite() => Err(self.wrong(i, &format!("a number of at most {most}"))),
            _ => Err(self.wrong(i, "a finite number")),
        }
    }

    #[inline]
    fn required(&self, i: usize) -> Result<f64, Error> {
        self.optional(i)?.ok_or_else(|| self.wrong(i, "a number"))
    }

    #[inline]
    fn flag(&self, i: usize) -> Result<Option<bool>, Error> {
        flag(self.optional(i)?).map_err(|expected| self.wrong(i, expected))
    }

    #[inline]
    fn point(&self, i: usize) -> Result<Option<Point<World>>, Error> {
        match (self.optional(i)?, self.optional(i + 1)?) {
            (Some(x), Some(y)) => Ok(Some(Point::new(x, y))),
            (None, None) => Ok(None),
            _ => Err(self.wrong(i, "both coordinates or neither")),
        }
    }

    /// The friction: all of its cells or none.
    #[inline]
    fn friction(&self) -> Result<Option<FrictionTruth>, Error> {
        match (self.optional(PLAIN)?, self.optional(PLAIN + 1)?, self.flag(PLAIN + 2)?) {
            (Some(angle_rad), Some(slip_m_s), Some(sticking)) if angle_rad.abs() <= MOST_ANGLE_RAD => {
                Ok(Some(FrictionTruth { angle_rad, slip_m_s, sticking }))
            }
            (Some(_), Some(_), Some(_)) => Err(self.wrong(PLAIN, "an angle of at most a right one")),
            (None, None, None) => Ok(None),
            _ => Err(self.wrong(PLAIN, "all values of the friction or none")),
        }
    }

    /// The second contact: all of its cells or none.
    #[inline]
    fn second(&self) -> Result<Option<SecondTruth>, Error> {
        let place = (self.point(PLAIN)?, self.point(PLAIN + 2)?);
        match (place, self.optional(PLAIN + 4)?, self.optional(PLAIN + 5)?) {
            ((Some(contact), Some(surface)), Some(arc_m), Some(force_n)) => {
                Ok(Some(SecondTruth { contact, surface, arc_m, force_n }))
            }
            ((None, None), None, None) => Ok(None),
            _ => Err(self.wrong(PLAIN, "all values of the second contact or none")),
        }
    }

    /// The displacement of an object that gives way.
    #[inline]
    fn yielding(&self) -> Result<YieldingTruth, Error> {
        let moved = (self.optional(PLAIN)?, self.optional(PLAIN + 1)?);
        match (moved, self.optional(PLAIN + 2)?, self.optional(PLAIN + 3)?) {
            ((Some(x_m), Some(y_m)), Some(yaw_rad), Some(indentation_m)) if indentation_m >= 0.0 => {
                Ok(YieldingTruth { moved_m: [x_m, y_m], yaw_rad, indentation_m })
            }
            ((Some(_), Some(_)), Some(_), Some(_)) => Err(self.wrong(PLAIN + 3, "an indentation of at least 0")),
            _ => Err(self.wrong(PLAIN, "the displacement of the object in every row")),
        }
    }

    /// Parses the row, whose time must be after `last_s`.
    #[inline]
    fn row(&self, last_s: Option<f64>) -> Result<(Instant, TruthInstant), Error> {
        let t_s = self.required(0)?;
        if let Some(last_s) = last_s
            && t_s <= last_s
        {
            return Err(self.wrong(0, &format!("a time after {last_s} (rows in order of time)")));
        }
        let twist = match (self.optional(4)?, self.optional(5)?, self.optional(6)?) {
            (Some(vx_m_s), Some(vy_m_s), Some(wz_rad_s)) => Some(Twist { vx_m_s, vy_m_s, wz_rad_s }),
            (None, None, None) => None,
            _ => return Err(self.wrong(4, "all of the twist or none of it")),
        };
        let known = Instant {
            t_s,
            base: Pose::new(self.required(1)?, self.required(2)?, self.required(3)?),
            twist,
            moment_z_n_m: self.required(7)?,
            rotation_z_rad: self.optional(8)?,
        };
        let touching = self.flag(9)?;
        if touching == Some(false)
            && let Some(i) = (10..PLAIN + self.further.of_contact()).find(|&i| !self.cell(i).is_empty())
        {
            return Err(self.wrong(i, "an empty field while truth_touching is 0"));
        }
        let truth = TruthInstant {
            touching,
            tip: self.flag(10)?,
            split: self.flag(11)?,
            contact: self.point(12)?,
            surface: self.point(14)?,
            arc_m: self.optional(16)?,
            force_n: self.optional(17)?,
            tangent_rad: self.optional(18)?,
            friction: if self.further == FurtherColumns::Friction { self.friction()? } else { None },
            second: if self.further == FurtherColumns::Second { self.second()? } else { None },
            yielding: if self.further == FurtherColumns::Yielding { Some(self.yielding()?) } else { None },
        };
        Ok((known, truth))
    }

    fn wrong(&self, i: usize, expected: &str) -> Error {
        let name = if i < PLAIN { COLUMNS[i].0 } else { self.further.columns()[i - PLAIN].0 };
        field_error(self.path, self.number, name, self.cell(i), expected)
    }
}
