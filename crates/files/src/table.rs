//! Numeric CSV tables with a fixed header.

use std::path::Path;

use csv::ByteRecord;

use crate::Error;

/// Iterates over the rows of a CSV table with exactly the columns `names`; each row comes with its line number, from 1.
///
/// # Errors
/// [`Error::Table`] if the header differs. An item is an error if its row has another number of fields.
pub fn reader<'a>(
    path: &'a Path,
    bytes: &'a [u8],
    names: &'a [&'a str],
) -> Result<impl Iterator<Item = Result<(u64, ByteRecord), Error>> + 'a, Error> {
    let table_error = move |line, place: &str, found: String, expected: String| Error::Table {
        path: path.into(),
        line,
        place: place.into(),
        found,
        expected,
    };
    let mut rows = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        // Numbers need no quotes, and an unclosed quote would absorb the rest of the file.
        .quoting(false)
        .from_reader(bytes)
        .into_byte_records();
    let header = match rows.next() {
        None => return Err(table_error(1, "header", "an empty file".into(), names.join(","))),
        Some(row) => row.map_err(|error| table_error(1, "header", error.to_string(), names.join(",")))?,
    };
    for i in 0..header.len().max(names.len()) {
        let found =
            header.get(i).map_or("no more columns".into(), |cell| format!("`{}`", String::from_utf8_lossy(cell)));
        let expected = names.get(i).map_or("no more columns".into(), |name| format!("`{name}`"));
        if found != expected {
            return Err(table_error(1, &format!("header, column {}", i + 1), found, expected));
        }
    }
    Ok(rows.enumerate().map(move |(i, row)| {
        let fallback = i as u64 + 2;
        let record =
            row.map_err(|error| table_error(fallback, "row", error.to_string(), "a row of the table".into()))?;
        let line = record.position().map_or(fallback, csv::Position::line);
        if record.len() != names.len() {
            let found = format!("{} fields", record.len());
            return Err(table_error(line, "row", found, format!("{} fields", names.len())));
        }
        Ok((line, record))
    }))
}

/// Reads the finite number in column `i` of a row.
///
/// # Errors
/// [`Error::Table`] if the cell is empty or not a finite number.
pub fn number(path: &Path, line: u64, record: &ByteRecord, names: &[&str], i: usize) -> Result<f64, Error> {
    optional(path, line, record, names, i)?.ok_or_else(|| cell_error(path, line, record, names, i, "a number"))
}

fn optional(path: &Path, line: u64, record: &ByteRecord, names: &[&str], i: usize) -> Result<Option<f64>, Error> {
    let cell = &record[i];
    if cell.is_empty() {
        return Ok(None);
    }
    std::str::from_utf8(cell)
        .ok()
        .and_then(|text| text.parse::<f64>().ok())
        .filter(|value| value.is_finite())
        .map(Some)
        .ok_or_else(|| cell_error(path, line, record, names, i, "a finite number"))
}

/// Error of a cell: column name, text found and value expected.
pub fn cell_error(path: &Path, line: u64, record: &ByteRecord, names: &[&str], i: usize, expected: &str) -> Error {
    field_error(path, line, names[i], &record[i], expected)
}

/// The same for the text of a cell of this column.
#[cold]
pub fn field_error(path: &Path, line: u64, column: &str, cell: &[u8], expected: &str) -> Error {
    let cell = String::from_utf8_lossy(cell);
    Error::Table {
        path: path.into(),
        line,
        place: format!("column {column}"),
        found: if cell.is_empty() { "an empty field".into() } else { format!("`{cell}`") },
        expected: expected.into(),
    }
}
