//! Columns of a CSV.

use std::path::Path;
use std::rc::Rc;

use csv::ByteRecord;
use files::{Error, read_table, sha256};

use super::mapping::{Layout, Stamps};
use super::recording::{ReadColumns, Wanted};
use super::series::{Clock, Series};
use super::units::Unit;

pub(crate) const NAME: &str = "csv";

/// Byte order mark of UTF-8.
const MARK: &[u8] = b"\xef\xbb\xbf";

/// Byte order marks of UTF-16, in which spreadsheets and instruments may write text.
const MARKS_16: [&[u8]; 2] = [b"\xff\xfe", b"\xfe\xff"];

/// Reads columns of a CSV with a header.
pub(super) fn read(path: &Path, layout: &Layout<'_>, wanted: &[Wanted<'_>]) -> Result<ReadColumns, Error> {
    if layout.stamps.is_some_and(|stamps| stamps == Stamps::Header) {
        return Err(Error::value(path, "stamps", "`header` for a CSV", "`time` with the column of the times"));
    }
    if path.is_dir() {
        return Err(Error::value(path, "file", "a folder", "a CSV file; `whisker import bag` reads rosbag2 folders"));
    }
    let bytes = read_table(path)?;
    if MARKS_16.iter().any(|mark| bytes.starts_with(mark)) {
        return Err(Error::value(path, "encoding", "UTF-16", "UTF-8; export the file again with this encoding"));
    }
    let (body, skipped) = after_lines(bytes.strip_prefix(MARK).unwrap_or(&bytes), layout.skip_lines);
    let (body, is_cut_off) = complete_lines(body);
    let mut rows = csv::ReaderBuilder::new()
        .delimiter(layout.delimiter as u8)
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(body)
        .into_byte_records();
    let damaged = |line: u64, found: String| table_error(path, line, "row", found, "a row of the table");
    let header = match rows.next() {
        None => return Err(table_error(path, 1 + skipped, "header", "the end of the file".into(), "column names")),
        Some(header) => header.map_err(|error| damaged(1 + skipped, error.to_string()))?,
    };
    let time = layout.time.map(|time| place_of(path, &header, skipped, &time.column)).transpose()?;
    let places: Vec<usize> =
        wanted.iter().map(|wanted| place_of(path, &header, skipped, wanted.name)).collect::<Result<_, _>>()?;
    let mut clock = Clock::default();
    let mut values: Vec<Vec<Option<f64>>> = vec![Vec::new(); wanted.len()];
    let (mut line, mut repeated, mut first_s) = (1 + skipped, 0, None);
    for (row, record) in rows.enumerate() {
        let record = record.map_err(|error| damaged(line + 1, error.to_string()))?;
        line = record.position().map_or(line + 1, |at| at.line() + skipped);
        if record.len() != header.len() {
            let expected = format!("{} fields, as in the header", header.len());
            return Err(table_error(path, line, "row", format!("{} fields", record.len()), &expected));
        }
        let cell = Cell { path, line, header: &header, record: &record };
        let time_s = match (layout.time, time) {
            (Some(column), Some(place)) => column.unit.si() * cell.number(place, false)?.unwrap_or_default(),
            _ => row as f64 / layout.rate_hz,
        };
        let since_s = time_s - *first_s.get_or_insert(time_s);
        if !clock.push(path, line, since_s)? {
            repeated += 1;
            continue;
        }
        for ((wanted, place), values) in wanted.iter().zip(&places).zip(&mut values) {
            values.push(cell.number(*place, wanted.may_be_empty)?);
        }
    }
    if clock.times_s.is_empty() {
        return Err(table_error(path, line + 1, "row", "the end of the file".into(), "at least one row"));
    }
    let clock = Rc::new(clock);
    let series = values.into_iter().map(|values| Series { clock: clock.clone(), values }).collect();
    Ok(ReadColumns { series, sha256: sha256(&bytes), repeated, is_cut_off, has_clock: time.is_some() })
}

/// The bytes after this number of lines, and the number of lines that there were.
fn after_lines(mut bytes: &[u8], lines: usize) -> (&[u8], u64) {
    let mut skipped = 0;
    while skipped < lines && !bytes.is_empty() {
        let end = bytes.iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |end| end + 1);
        bytes = &bytes[end..];
        skipped += 1;
    }
    (bytes, skipped as u64)
}

/// The lines that have a line end, and whether a last line without one is left out. A single line is kept without a line end.
fn complete_lines(bytes: &[u8]) -> (&[u8], bool) {
    let end = bytes.iter().rposition(|byte| matches!(byte, b'\n' | b'\r')).map_or(bytes.len(), |end| end + 1);
    (&bytes[..end], end < bytes.len())
}

fn table_error(path: &Path, line: u64, place: &str, found: String, expected: &str) -> Error {
    Error::Table { path: path.into(), line, place: place.into(), found, expected: expected.into() }
}

/// Index of a column, which the header must name once.
fn place_of(path: &Path, header: &ByteRecord, skipped: u64, name: &str) -> Result<usize, Error> {
    let mut places = header.iter().enumerate().filter(|(_, cell)| *cell == name.as_bytes()).map(|(place, _)| place);
    let expected = format!("one column `{name}`");
    match (places.next(), places.next()) {
        (Some(place), None) => Ok(place),
        (Some(_), Some(_)) => {
            Err(table_error(path, 1 + skipped, "header", format!("several columns `{name}`"), &expected))
        }
        (None, _) => {
            let names: Vec<_> = header.iter().map(String::from_utf8_lossy).collect();
            Err(table_error(path, 1 + skipped, "header", names.join(", "), &expected))
        }
    }
}

/// Row of a table.
struct Cell<'a> {
    path: &'a Path,
    line: u64,
    header: &'a ByteRecord,
    record: &'a ByteRecord,
}

impl Cell<'_> {
    /// Number in a column. `None` for an empty field or NaN, if allowed.
    fn number(&self, place: usize, may_be_empty: bool) -> Result<Option<f64>, Error> {
        let bytes = &self.record[place];
        let text = std::str::from_utf8(bytes).ok();
        if may_be_empty && text.is_some_and(|text| text.is_empty() || text.eq_ignore_ascii_case("nan")) {
            return Ok(None);
        }
        let number = text.and_then(|text| text.parse::<f64>().ok()).filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| {
            let found = if bytes.is_empty() {
                "an empty field".into()
            } else {
                format!("`{}`", String::from_utf8_lossy(bytes))
            };
            let column = format!("column {} ({})", place + 1, String::from_utf8_lossy(&self.header[place]));
            let has_comma = |text: &str| text.replacen(',', ".", 1).parse::<f64>().is_ok_and(f64::is_finite);
            let expected = match text.is_some_and(has_comma) {
                true => "a number whose decimal separator is a point, not a comma",
                false => "a finite number",
            };
            table_error(self.path, self.line, &column, found, expected)
        })
    }
}
